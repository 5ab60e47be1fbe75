//! The query `hybrid`: voxels along each ray name the candidates, front to back; each candidate's triangles are asked
//! once a ray. The nearest hit wins as soon as the ray has come to it.
//!
//! Every voxel that a triangle touches knows it as owner, so that with `accept_below_px` 0 this finds what `exact`
//! finds: the voxel that holds the nearest hit is entered before the walk ends.

use voxsight_voxel::raycast::{Next, PACKET_RAYS, RayCaster, RayPacket, VoxelHit};

use super::voxel::{KeptOwners, grid_ray};
use super::{QueryScene, RayQuery, VisibleSet};
use crate::camera::CameraRays;
use crate::exact::TriangleHit;
use crate::ray::Ray;

pub(super) struct HybridQuery<'a> {
    scene: QueryScene<'a>,
    camera: &'a CameraRays,
    /// A voxel smaller than so many pixels is accepted unseen.
    accept_below_px: f64,
}

/// What is known of one ray on its way.
#[derive(Default)]
struct State {
    /// Drawables whose triangles were asked.
    asked: Vec<u32>,
    /// Hits with transparent drawables.
    through: Vec<TriangleHit>,
    /// Nearest hit with an opaque drawable.
    best: Option<TriangleHit>,
    /// The first opaque owner of a voxel that was accepted unseen, and where.
    accepted: Option<(u32, f64)>,
}

/// Working memory of a thread.
pub(super) struct HybridScratch<'a> {
    packet: RayPacket,
    owners: KeptOwners<'a>,
    states: Vec<State>,
}

impl Default for HybridScratch<'_> {
    fn default() -> Self {
        HybridScratch {
            packet: RayPacket::default(),
            owners: KeptOwners::default(),
            states: (0..PACKET_RAYS).map(|_| State::default()).collect(),
        }
    }
}

impl<'a> HybridQuery<'a> {
    pub fn new(scene: &QueryScene<'a>, camera: &'a CameraRays, accept_below_px: f64) -> Self {
        HybridQuery { scene: *scene, camera, accept_below_px }
    }

    /// A voxel on a ray's way.
    fn meet(
        &self,
        ray: &Ray,
        state: &mut State,
        owners: &mut KeptOwners<'a>,
        hit: &VoxelHit,
        found: &mut VisibleSet,
    ) -> Next {
        let QueryScene { exact, filter, grid, .. } = self.scene;
        // Half a voxel of slack, in t: a hit on the very border of its voxel may lie before it by rounding.
        let slack = 0.5 * grid.voxel_size / ray.direction.length();
        if state.best.is_some_and(|best| hit.t() > best.t + slack) {
            return Next::End;
        }
        let unseen = self.accept_below_px > 0.0
            && grid.voxel_size < self.camera.pixel_at(hit.t()) * self.accept_below_px;
        let of_brick = owners.of_brick(&self.scene, hit);
        for owner in of_brick.of_voxel(hit.bit()).filter(|&owner| !filter.is_hidden(owner)) {
            if unseen {
                found.visible[owner as usize] = true;
                if !exact.is_transparent(owner) && state.accepted.is_none() {
                    state.accepted = Some((owner, hit.t()));
                }
                continue;
            }
            if state.asked.contains(&owner) {
                continue;
            }
            state.asked.push(owner);
            let limit = Ray { t_max: state.best.map_or(ray.t_max, |best| best.t), ..*ray };
            let Some(triangle) = exact.closest_of(owner, &limit) else { continue };
            if exact.is_transparent(owner) {
                state.through.push(triangle);
            } else if state.best.is_none_or(|b| triangle.t < b.t || triangle.t == b.t && owner < b.drawable) {
                state.best = Some(triangle);
            }
        }
        if state.accepted.is_some() {
            Next::End
        } else if !unseen
            && of_brick.all().all(|owner| state.asked.contains(&owner) || filter.is_hidden(owner))
        {
            // The brick has nothing more to tell.
            Next::Brick
        } else {
            Next::Voxel
        }
    }
}

impl<'a> RayQuery for HybridQuery<'a> {
    type Scratch = HybridScratch<'a>;

    fn trace(&self, rays: &[Ray], found: &mut VisibleSet, scratch: &mut HybridScratch<'a>) {
        let HybridScratch { packet, owners, states } = scratch;
        packet.fill(rays.iter().map(|ray| grid_ray(&self.scene, ray)));
        RayCaster::new(self.scene.dag).cast_packet(packet, |number, hit| {
            self.meet(&rays[number], &mut states[number], owners, hit, found)
        });
        for state in states.iter_mut().take(rays.len()) {
            let best = state.best.take().map(|hit| (hit.drawable, hit.t));
            let first = match (best, state.accepted.take()) {
                (Some(best), Some(accepted)) if accepted.1 < best.1 => Some(accepted),
                (best, accepted) => best.or(accepted),
            };
            found.count_ray(&state.through, first);
            state.asked.clear();
            state.through.clear();
        }
    }
}
