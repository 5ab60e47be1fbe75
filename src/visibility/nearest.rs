//! Nearest hits of the rays of a tile: voxels along the rays name the candidates, front to back; each candidate's triangles
//! are asked once a tile, for all its rays together. The nearest hit wins as soon as the ray has come to it. Where voxels are
//! finer than the rays are apart, boxes do what voxels do.
//!
//! Every voxel that a triangle touches knows it as owner, so that this finds what
//! [`ExactScene`](crate::exact::ExactScene) finds: the voxel that holds the nearest hit is entered before the walk ends.

use voxsight_voxel::raycast::{PACKET_RAYS, PacketBrick, RayCaster, RayEnds, RayPacket};

use super::QueryScene;
use super::tally::Passed;
use super::voxel::grid_ray;
use crate::exact::{TriangleHit, TriangleRays};
use crate::ray::Ray;

/// Where the rays of a tile enter the scene farther apart than this, in voxels, each ray would cross bricks of its own, and
/// most of what is in them lies between the rays: there the boxes of drawables name the candidates, which is quicker from
/// outside (0.8 of the time on a plant of 12 M triangles at 4096^3) and slower inside (1.2 to 1.5 times). The answer is the same.
pub(crate) const VOXELS_BETWEEN_RAYS: f64 = 1.5;

/// No drawable.
const NOBODY: u32 = u32::MAX;

/// Finds the nearest hits of tiles of up to [`PACKET_RAYS`] rays.
#[derive(Clone, Copy)]
pub struct TileTracer<'a> {
    scene: QueryScene<'a>,
}

/// The rays of a tile, what they met, and room to work. Keep one per thread and use it again and again.
pub struct TileHits {
    packet: RayPacket,
    triangles: TriangleRays,
    state: State,
}

/// What is known of the rays on their way.
struct State {
    asked: Asked,
    /// Nearest hit of each ray with an opaque drawable, or its end.
    t: [f64; PACKET_RAYS],
    opaque: [u32; PACKET_RAYS],
    /// Half a voxel in t: a hit on the very border of its voxel may lie before it by rounding.
    slack: [f64; PACKET_RAYS],
    /// Hits with transparent drawables.
    through: Vec<Passed>,
}

/// Which drawables' triangles a tile has asked.
#[derive(Default)]
pub(crate) struct Asked {
    /// For each drawable the last tile that asked it.
    by: Vec<u32>,
    /// Number of this tile.
    tile: u32,
}

impl Asked {
    /// Another tile, of a scene with so many drawables: nothing is asked yet.
    pub fn begin(&mut self, drawables: u32) {
        if self.by.len() != drawables as usize {
            // Zeroed by the system, page by page, as they are used: few rays do not pay for all drawables.
            self.by = vec![0; drawables as usize];
        }
        self.tile = self.tile.wrapping_add(1);
        if self.tile == 0 {
            self.by.fill(0);
            self.tile = 1;
        }
    }

    /// Is it asked for the first time?
    #[inline]
    pub fn is_new(&mut self, drawable: u32) -> bool {
        let by = &mut self.by[drawable as usize];
        std::mem::replace(by, self.tile) != self.tile
    }
}

impl Default for TileHits {
    fn default() -> Self {
        TileHits {
            packet: RayPacket::default(),
            triangles: TriangleRays::default(),
            state: State {
                asked: Asked::default(),
                t: [0.0; PACKET_RAYS],
                opaque: [NOBODY; PACKET_RAYS],
                slack: [0.0; PACKET_RAYS],
                through: Vec::new(),
            },
        }
    }
}

impl TileHits {
    /// The nearest opaque drawable that a ray met, and where.
    pub fn opaque(&self, ray: usize) -> Option<(u32, f64)> {
        let drawable = self.state.opaque[ray];
        (drawable != NOBODY).then_some((drawable, self.state.t[ray]))
    }

    /// Transparent drawables that rays met, each with its nearest hit, in no particular order; some lie behind the nearest
    /// opaque one.
    pub(crate) fn through(&self) -> &[Passed] {
        &self.state.through
    }
}

impl<'a> TileTracer<'a> {
    /// For rays of this scene.
    pub fn new(scene: &QueryScene<'a>) -> Self {
        TileTracer { scene: *scene }
    }

    /// Traces up to [`PACKET_RAYS`] rays, already cut to what the filter leaves; best neighbours.
    pub fn trace(&self, rays: &[Ray], hits: &mut TileHits) {
        let rays = &rays[..rays.len().min(PACKET_RAYS)];
        let TileHits { packet, triangles, state, .. } = hits;
        state.asked.begin(self.scene.exact.drawable_count());
        state.through.clear();
        state.opaque = [NOBODY; PACKET_RAYS];
        triangles.fill(self.scene.exact, rays);
        for (i, ray) in rays.iter().enumerate() {
            state.t[i] = ray.t_max;
            state.slack[i] = 0.5 * self.scene.grid.voxel_size / ray.direction.length();
        }
        if triangles.spacing() > VOXELS_BETWEEN_RAYS * self.scene.grid.voxel_size {
            self.scene.exact.visit_packet(triangles, |drawable, triangles| {
                self.ask(state, triangles, drawable, |_, _| ());
            });
            return;
        }
        packet.fill(rays.iter().map(|ray| grid_ray(&self.scene, ray)));
        RayCaster::new(self.scene.dag)
            .cast_bricks(packet, |brick, ends| self.meet(state, triangles, brick, ends));
    }

    /// The triangle of a hit that [`TileTracer::trace`] has found: of one ray with one drawable at `t`.
    pub fn triangle(&self, ray: &Ray, drawable: u32, t: f64) -> Option<TriangleHit> {
        // A little farther: where t is large beside the drawable's box, the box test rounds more than it is widened by.
        self.scene.exact.closest_of(drawable, &Ray { t_max: t + 1e-12 * t.abs(), ..*ray })
    }

    /// A brick on the way of some rays.
    fn meet(&self, state: &mut State, triangles: &mut TriangleRays, brick: &PacketBrick, ends: &mut RayEnds) {
        for owner in self.scene.owners.all_of_brick(brick.ordinal()) {
            if state.asked.is_new(owner) {
                self.ask(state, triangles, owner, |ray, t| ends.shorten(ray, t));
            }
        }
    }

    /// Asks the triangles of a drawable, and tells of rays that end nearer now.
    fn ask(
        &self,
        state: &mut State,
        triangles: &mut TriangleRays,
        drawable: u32,
        mut shorten: impl FnMut(usize, f64),
    ) {
        let QueryScene { exact, filter, .. } = self.scene;
        if filter.is_hidden(drawable) {
            return;
        }
        let mut t = state.t;
        let met = exact.closest_of_packet(drawable, triangles, triangles.all(), &mut t);
        for ray in (0..PACKET_RAYS).filter(|ray| met >> ray & 1 != 0) {
            if self.scene.is_transparent(drawable) {
                state.through.push(Passed { ray, drawable, t: t[ray] });
            } else if t[ray] < state.t[ray] || drawable < state.opaque[ray] {
                state.t[ray] = t[ray];
                state.opaque[ray] = drawable;
                shorten(ray, t[ray] + state.slack[ray]);
                triangles.shorten(ray, t[ray]);
            }
        }
    }
}
