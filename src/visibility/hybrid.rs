//! The query `hybrid`: voxels along the rays of a tile name the candidates, front to back; each candidate's triangles
//! are asked once a tile, for all its rays together. The nearest hit wins as soon as the ray has come to it.
//!
//! Every voxel that a triangle touches knows it as owner, so that this finds what `exact` finds: the voxel that holds
//! the nearest hit is entered before the walk ends.

use voxsight_voxel::raycast::{PACKET_RAYS, PacketBrick, RayCaster, RayEnds, RayPacket};

use super::tally::{Passed, Tally};
use super::voxel::grid_ray;
use super::{QueryScene, RayQuery};
use crate::exact::TriangleRays;
use crate::ray::Ray;

pub(super) struct HybridQuery<'a> {
    scene: QueryScene<'a>,
}

/// Working memory of a thread.
pub(super) struct HybridScratch {
    packet: RayPacket,
    triangles: TriangleRays,
    tile: TileHits,
}

/// What is known of the rays of a tile on their way.
struct TileHits {
    /// For each drawable the last tile that asked its triangles.
    asked: Vec<u32>,
    /// Number of this tile.
    number: u32,
    /// Nearest hit of each ray with an opaque drawable, or its end.
    t: [f64; PACKET_RAYS],
    opaque: [u32; PACKET_RAYS],
    /// Half a voxel in t: a hit on the very border of its voxel may lie before it by rounding.
    slack: [f64; PACKET_RAYS],
    /// Hits with transparent drawables.
    through: Vec<Passed>,
}

/// No drawable.
const NOBODY: u32 = u32::MAX;

impl Default for HybridScratch {
    fn default() -> Self {
        HybridScratch {
            packet: RayPacket::default(),
            triangles: TriangleRays::default(),
            tile: TileHits {
                asked: Vec::new(),
                number: 0,
                t: [0.0; PACKET_RAYS],
                opaque: [NOBODY; PACKET_RAYS],
                slack: [0.0; PACKET_RAYS],
                through: Vec::new(),
            },
        }
    }
}

impl<'a> HybridQuery<'a> {
    pub fn new(scene: &QueryScene<'a>) -> Self {
        HybridQuery { scene: *scene }
    }

    /// A brick on the way of some rays.
    fn meet(
        &self,
        tile: &mut TileHits,
        triangles: &mut TriangleRays,
        brick: &PacketBrick,
        ends: &mut RayEnds,
    ) {
        let QueryScene { exact, filter, .. } = self.scene;
        for owner in self.scene.owners.all_of_brick(brick.ordinal()) {
            if tile.asked[owner as usize] == tile.number || filter.is_hidden(owner) {
                continue;
            }
            tile.asked[owner as usize] = tile.number;
            let mut t = tile.t;
            let met = exact.closest_of_packet(owner, triangles, triangles.all(), &mut t);
            for ray in (0..PACKET_RAYS).filter(|ray| met >> ray & 1 != 0) {
                if exact.is_transparent(owner) {
                    tile.through.push(Passed { ray, drawable: owner, t: t[ray] });
                } else if t[ray] < tile.t[ray] || owner < tile.opaque[ray] {
                    tile.t[ray] = t[ray];
                    tile.opaque[ray] = owner;
                    ends.shorten(ray, t[ray] + tile.slack[ray]);
                    triangles.shorten(ray, t[ray]);
                }
            }
        }
    }
}

impl<'a> RayQuery for HybridQuery<'a> {
    type Scratch = HybridScratch;

    fn trace(&self, rays: &[Ray], tally: &mut Tally, scratch: &mut HybridScratch) {
        let HybridScratch { packet, triangles, tile } = scratch;
        let drawables = self.scene.exact.drawable_count() as usize;
        if tile.asked.len() != drawables {
            // Zeroed by the system, page by page, as they are used: a query of few rays does not pay for all drawables.
            tile.asked = vec![0; drawables];
        }
        tile.number = tile.number.wrapping_add(1);
        if tile.number == 0 {
            tile.asked.fill(0);
            tile.number = 1;
        }
        packet.fill(rays.iter().map(|ray| grid_ray(&self.scene, ray)));
        triangles.fill(self.scene.exact, rays);
        tile.opaque = [NOBODY; PACKET_RAYS];
        for (i, ray) in rays.iter().enumerate() {
            tile.t[i] = ray.t_max;
            tile.slack[i] = 0.5 * self.scene.grid.voxel_size / ray.direction.length();
        }
        RayCaster::new(self.scene.dag)
            .cast_bricks(packet, |brick, ends| self.meet(tile, triangles, brick, ends));
        for (number, ray) in rays.iter().enumerate() {
            let first = (tile.opaque[number] != NOBODY).then_some((tile.opaque[number], tile.t[number]));
            tally.count_ray(number, ray, &tile.through, first);
        }
        tile.through.clear();
    }
}
