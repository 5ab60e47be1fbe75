//! The query `voxel`, and what queries through the voxel DAG share.

use voxsight_voxel::dag::Owners;
use voxsight_voxel::raycast::{GridRay, Next, RayCaster, RayPacket, VoxelHit};

use super::tally::Tally;
use super::{QueryScene, RayQuery};
use crate::ray::Ray;

/// The same ray in voxel units; `t` stays.
pub(crate) fn grid_ray(scene: &QueryScene, ray: &Ray) -> GridRay {
    GridRay {
        origin: scene.grid.grid_from_world(ray.origin),
        direction: ray.direction / scene.grid.voxel_size,
        t_min: ray.t_min,
        t_max: ray.t_max,
    }
}

/// Bricks whose owners are kept: 4x4x4 of them side by side have places of their own.
const KEPT_BRICKS: usize = 64;

/// Owners of bricks met a moment ago: the rays of a tile mostly meet the same ones.
pub(super) struct KeptOwners<'a> {
    kept: Vec<Option<([i32; 3], Owners<'a>)>>,
}

impl Default for KeptOwners<'_> {
    fn default() -> Self {
        KeptOwners { kept: vec![None; KEPT_BRICKS] }
    }
}

impl<'a> KeptOwners<'a> {
    /// Owners of the brick of a hit.
    #[inline]
    pub fn of_brick(&mut self, scene: &QueryScene<'a>, hit: &VoxelHit) -> Owners<'a> {
        let brick = hit.voxel.map(|c| c >> 2);
        let place = (brick[0] & 3 | (brick[1] & 3) << 2 | (brick[2] & 3) << 4) as usize;
        match self.kept[place] {
            Some((kept, owners)) if kept == brick => owners,
            _ => {
                let owners = scene.owners.of_brick(hit.brick_ordinal(), hit.brick_mask());
                self.kept[place] = Some((brick, owners));
                owners
            }
        }
    }
}

/// The first voxel with an opaque owner ends the ray.
pub(super) struct VoxelQuery<'a> {
    scene: QueryScene<'a>,
}

impl<'a> VoxelQuery<'a> {
    pub fn new(scene: &QueryScene<'a>) -> Self {
        VoxelQuery { scene: *scene }
    }
}

/// Working memory of a thread.
#[derive(Default)]
pub(super) struct VoxelScratch<'a> {
    packet: RayPacket,
    owners: KeptOwners<'a>,
    /// (ray, transparent drawable) that was counted.
    passed: Vec<(usize, u32)>,
}

impl<'a> RayQuery for VoxelQuery<'a> {
    type Scratch = VoxelScratch<'a>;

    fn trace(&self, rays: &[Ray], tally: &mut Tally, scratch: &mut VoxelScratch<'a>) {
        let filter = self.scene.filter;
        let VoxelScratch { packet, owners, passed } = scratch;
        passed.clear();
        packet.fill(rays.iter().map(|ray| grid_ray(&self.scene, ray)));
        let mut met = 0u64;
        RayCaster::new(self.scene.dag).cast_packet(packet, |ray, hit| {
            let mut first_opaque = None;
            let t = if tally.has_sightings() { hit.t() } else { f64::NAN };
            let of_brick = owners.of_brick(&self.scene, hit);
            for owner in of_brick.of_voxel(hit.bit()).filter(|&owner| !filter.is_hidden(owner)) {
                met |= 1 << ray;
                tally.see(owner, ray, &rays[ray], t);
                if self.scene.is_transparent(owner) {
                    if !passed.contains(&(ray, owner)) {
                        passed.push((ray, owner));
                        tally.count(owner, ray, &rays[ray], t);
                    }
                } else if first_opaque.is_none() {
                    first_opaque = Some(owner);
                }
            }
            match first_opaque {
                Some(owner) => {
                    tally.count(owner, ray, &rays[ray], t);
                    Next::End
                }
                None => Next::Voxel,
            }
        });
        tally.found.hits += u64::from(met.count_ones());
    }
}
