//! Queries through the voxel DAG: `voxel` and `hybrid`.

use voxsight_voxel::dag::Owners;
use voxsight_voxel::raycast::{GridRay, Next, RayCaster, VoxelHit};

use super::{QueryScene, RayQuery, Scratch, VisibleSet};
use crate::camera::CameraRays;
use crate::exact::TriangleHit;
use crate::ray::Ray;

/// The same ray in voxel units; `t` stays.
fn grid_ray(scene: &QueryScene, ray: &Ray) -> GridRay {
    GridRay {
        origin: scene.grid.grid_from_world(ray.origin),
        direction: ray.direction / scene.grid.voxel_size,
        t_min: ray.t_min,
        t_max: ray.t_max,
    }
}

/// Owners of the brick last asked for: neighbouring voxels along a ray mostly share it.
struct BrickOwners<'a> {
    last: Option<([i32; 3], Owners<'a>)>,
}

impl<'a> BrickOwners<'a> {
    fn new() -> Self {
        BrickOwners { last: None }
    }

    fn of_brick(&mut self, scene: &QueryScene<'a>, hit: &VoxelHit) -> Owners<'a> {
        let brick = hit.voxel.map(|c| c >> 2);
        match self.last {
            Some((last, owners)) if last == brick => owners,
            _ => {
                let owners = scene.owners.of_brick(hit.brick_ordinal(), hit.brick_mask());
                self.last = Some((brick, owners));
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

impl RayQuery for VoxelQuery<'_> {
    fn trace(&self, ray: &Ray, found: &mut VisibleSet, scratch: &mut Scratch) -> bool {
        let exact = self.scene.exact;
        let mut owners = BrickOwners::new();
        let filter = self.scene.filter;
        let passed = &mut scratch.asked;
        passed.clear();
        let mut any = false;
        let Some(ray) = filter.clipped(ray) else { return false };
        RayCaster::new(self.scene.dag).cast(&grid_ray(&self.scene, &ray), |hit| {
            let of_voxel = owners.of_brick(&self.scene, hit).of_voxel(hit.bit());
            let mut first_opaque = None;
            for owner in of_voxel.filter(|&owner| !filter.is_hidden(owner)) {
                any = true;
                found.visible[owner as usize] = true;
                if exact.is_transparent(owner) {
                    if !passed.contains(&owner) {
                        passed.push(owner);
                        found.count(owner);
                    }
                } else if first_opaque.is_none() {
                    first_opaque = Some(owner);
                }
            }
            match first_opaque {
                Some(owner) => {
                    found.count(owner);
                    Next::End
                }
                None => Next::Voxel,
            }
        });
        any
    }
}

/// Voxels name the candidates, front to back; each candidate's triangles are asked once a ray. The nearest hit wins as
/// soon as the ray has come to it.
///
/// Every voxel that a triangle touches knows it as owner, so that with `accept_below_px` 0 this finds what `exact` finds: the
/// voxel that holds the nearest hit is entered before the walk ends.
pub(super) struct HybridQuery<'a> {
    scene: QueryScene<'a>,
    camera: &'a CameraRays,
    /// A voxel smaller than so many pixels is accepted unseen.
    accept_below_px: f64,
}

impl<'a> HybridQuery<'a> {
    pub fn new(scene: &QueryScene<'a>, camera: &'a CameraRays, accept_below_px: f64) -> Self {
        HybridQuery { scene: *scene, camera, accept_below_px }
    }
}

impl RayQuery for HybridQuery<'_> {
    fn trace(&self, ray: &Ray, found: &mut VisibleSet, scratch: &mut Scratch) -> bool {
        let QueryScene { exact, filter, .. } = self.scene;
        let Some(ray) = filter.clipped(ray) else { return false };
        let mut owners = BrickOwners::new();
        let Scratch { asked, through } = scratch;
        asked.clear();
        through.clear();
        let mut best: Option<TriangleHit> = None;
        let mut accepted: Option<(u32, f64)> = None;
        // Half a voxel of slack, in t: a hit on the very border of its voxel may lie before it by rounding.
        let slack = 0.5 * self.scene.grid.voxel_size / ray.direction.length();
        RayCaster::new(self.scene.dag).cast(&grid_ray(&self.scene, &ray), |hit| {
            if best.is_some_and(|best| hit.t() > best.t + slack) {
                return Next::End;
            }
            let unseen = self.scene.grid.voxel_size < self.camera.pixel_at(hit.t()) * self.accept_below_px;
            let of_brick = owners.of_brick(&self.scene, hit);
            for owner in of_brick.of_voxel(hit.bit()).filter(|&owner| !filter.is_hidden(owner)) {
                if unseen {
                    found.visible[owner as usize] = true;
                    if !exact.is_transparent(owner) && accepted.is_none() {
                        accepted = Some((owner, hit.t()));
                    }
                    continue;
                }
                if asked.contains(&owner) {
                    continue;
                }
                asked.push(owner);
                let limit = Ray { t_max: best.map_or(ray.t_max, |best| best.t), ..ray };
                let Some(triangle) = exact.closest_of(owner, &limit) else { continue };
                if exact.is_transparent(owner) {
                    through.push(triangle);
                } else if best.is_none_or(|b| triangle.t < b.t || triangle.t == b.t && owner < b.drawable) {
                    best = Some(triangle);
                }
            }
            if accepted.is_some() {
                Next::End
            } else if !unseen && of_brick.all().all(|owner| asked.contains(&owner) || filter.is_hidden(owner))
            {
                // The brick has nothing more to tell.
                Next::Brick
            } else {
                Next::Voxel
            }
        });
        let best = best.map(|hit| (hit.drawable, hit.t));
        let first = match (best, accepted) {
            (Some(best), Some(accepted)) if accepted.1 < best.1 => Some(accepted),
            (best, accepted) => best.or(accepted),
        };
        found.count_ray(through, first)
    }
}
