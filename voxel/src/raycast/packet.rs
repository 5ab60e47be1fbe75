//! Up to 64 neighbouring rays at once: the tile's frustum finds the nodes, lanes of rays the cells.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16};

use super::ray::Walk;
use super::single::{Subtree, cast_alone, cast_brick, cast_subtree, child_corner, true_corner};
use super::slabs::{Columns, MARGIN, RaySlabs, TileSlabs, rounded_down, rounded_up};
use super::{Footprint, GridRay, MAX_STACK, Next, VoxelHit};
use crate::bits::{mirror, mirror_slot};
use crate::dag::DagRef;
use crate::dag::node::{child_word, mask_at};

/// Rays in a packet, at most: 8x8 pixels.
pub const PACKET_RAYS: usize = 64;

/// Rays a SIMD register.
const LANES: usize = 16;

/// Rays of a packet are tested one by one against children of this height and below.
const RAY_TEST_HEIGHT: u32 = 2;
/// With fewer rays left than this, each goes its own way through a subtree.
const FEW_RAYS: u32 = 4;

/// Up to [`PACKET_RAYS`] rays, such as those of a tile of 8x8 pixels.
#[derive(Clone, Debug)]
pub struct RayPacket {
    rays: [GridRay; PACKET_RAYS],
    count: usize,
}

impl Default for RayPacket {
    fn default() -> Self {
        let nothing = GridRay::new(glam::DVec3::ZERO, glam::DVec3::ZERO);
        RayPacket { rays: [nothing; PACKET_RAYS], count: 0 }
    }
}

impl RayPacket {
    /// Replaces the rays: the first [`PACKET_RAYS`] that come. Returns how many that were.
    pub fn fill(&mut self, rays: impl IntoIterator<Item = GridRay>) -> usize {
        self.count = 0;
        for (slot, ray) in self.rays.iter_mut().zip(rays) {
            *slot = ray;
            self.count += 1;
        }
        self.count
    }

    /// The rays.
    pub fn rays(&self) -> &[GridRay] {
        &self.rays[..self.count]
    }
}

/// The packet on its way: rays re-based at a common t, mirrored as the rays of one octant are.
struct Lanes {
    walks: [Walk; PACKET_RAYS],
    /// Origins moved up and down, and reciprocals: see [`RaySlabs`].
    high: [[f32; PACKET_RAYS]; 3],
    low: [[f32; PACKET_RAYS]; 3],
    inverse: [[f32; PACKET_RAYS]; 3],
    t_min: [f32; PACKET_RAYS],
    t_max: [f32; PACKET_RAYS],
    tile: TileSlabs,
}

/// See [`super::RayCaster::cast_packet`].
#[inline(always)]
pub(super) fn cast<S: Simd>(
    simd: S,
    dag: &DagRef,
    packet: &RayPacket,
    footprint: Footprint,
    visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
) {
    let Some(root) = dag.root else { return };
    let side = f64::from(1 << dag.log2);
    let mut lanes = Lanes {
        walks: packet.rays.each_ref().map(|ray| Walk::new(ray, side)),
        high: [[0.0; PACKET_RAYS]; 3],
        low: [[0.0; PACKET_RAYS]; 3],
        inverse: [[0.0; PACKET_RAYS]; 3],
        t_min: [0.0; PACKET_RAYS],
        t_max: [0.0; PACKET_RAYS],
        tile: TileSlabs::default(),
    };
    let columns = Columns::new(simd);
    let mut waiting = 0u64;
    let mut nodes = [0u32; MAX_STACK];
    nodes[dag.height as usize] = root;
    for (i, walk) in lanes.walks.iter().enumerate().take(packet.count) {
        if !walk.is_inside() {
            continue;
        }
        if walk.scale == 1.0 {
            waiting |= 1 << i;
        } else {
            // Its parameter is not that of the others.
            cast_alone(columns, dag, walk, &mut nodes, footprint, &mut |hit| visit(i, hit));
        }
    }
    // Usually all rays go to the same octant; a tile across an axis is done in parts.
    while waiting != 0 {
        let flip = lanes.walks[waiting.trailing_zeros() as usize].flip();
        let mut rays = 0u64;
        let mut t_start = f64::INFINITY;
        for_each_ray(waiting, |i| {
            let walk = &lanes.walks[i];
            if walk.flip() == flip {
                rays |= 1 << i;
                t_start = t_start.min(walk.t_base);
            }
        });
        waiting &= !rays;
        trace(columns, dag, root, &mut lanes, rays, flip, t_start, footprint, visit);
    }
}

/// Calls `f` with the number of each ray of the set, in rising order.
#[inline(always)]
fn for_each_ray(rays: u64, mut f: impl FnMut(usize)) {
    let mut left = rays;
    while left != 0 {
        f(left.trailing_zeros() as usize);
        left &= left - 1;
    }
}

impl Lanes {
    /// Sets up the rays of one octant from `t_start` on. Returns those that do not fit into f32 beside the others.
    #[inline(always)]
    fn set_up(&mut self, rays: u64, tree_side: f64, t_start: f64) -> u64 {
        let margin = MARGIN * tree_side;
        let mut apart = 0;
        let mut tile = TileSlabs {
            high: [f32::NEG_INFINITY; 3],
            low: [f32::INFINITY; 3],
            least_inverse: [f32::INFINITY; 3],
            greatest_inverse: [0.0; 3],
            t_min: f32::INFINITY,
            t_max: f32::NEG_INFINITY,
        };
        for_each_ray(rays, |i| {
            let walk = &self.walks[i];
            let ahead = walk.t_base - t_start;
            if walk.direction.iter().any(|d| d.abs() * ahead > tree_side) {
                apart |= 1 << i;
                return;
            }
            for k in 0..3 {
                let origin = walk.base[k] - ahead * walk.direction[k];
                let origin = if walk.rises(k) { origin } else { tree_side - origin };
                let (high, low) = ((origin + margin) as f32, (origin - margin) as f32);
                let inverse = walk.inverse[k].abs() as f32;
                self.high[k][i] = high;
                self.low[k][i] = low;
                self.inverse[k][i] = inverse;
                tile.high[k] = tile.high[k].max(high);
                tile.low[k] = tile.low[k].min(low);
                tile.least_inverse[k] = tile.least_inverse[k].min(inverse);
                tile.greatest_inverse[k] = tile.greatest_inverse[k].max(inverse);
            }
            self.t_min[i] = rounded_down(ahead);
            self.t_max[i] = rounded_up(ahead + walk.t_end);
            tile.t_min = tile.t_min.min(self.t_min[i]);
            tile.t_max = tile.t_max.max(self.t_max[i]);
        });
        self.tile = tile;
        apart
    }

    /// One ray of the packet, to go on alone.
    #[inline(always)]
    fn slabs(&self, ray: usize) -> RaySlabs {
        let pick = |lanes: &[[f32; PACKET_RAYS]; 3]| [0, 1, 2].map(|k| lanes[k][ray]);
        RaySlabs {
            high: pick(&self.high),
            low: pick(&self.low),
            inverse: pick(&self.inverse),
            t_min: self.t_min[ray],
            t_max: self.t_max[ray],
        }
    }

    /// Those of `rays` that may cross the cell of `size` voxels at a mirrored corner; with `SURE`, those that certainly do.
    #[inline(always)]
    fn crossing<S: Simd, const SURE: bool>(&self, simd: S, rays: u64, corner: [f32; 3], size: f32) -> u64 {
        // Planes moved apart, or together.
        let (near_origin, far_origin) = if SURE { (&self.low, &self.high) } else { (&self.high, &self.low) };
        let splat = |v: f32| f32x16::splat(simd, v);
        let mut found = 0;
        for group in 0..PACKET_RAYS / LANES {
            let start = group * LANES;
            if rays >> start & 0xffff == 0 {
                continue;
            }
            let load = |lanes: &[f32; PACKET_RAYS]| f32x16::from_slice(simd, &lanes[start..start + LANES]);
            let near = |k: usize| (splat(corner[k]) - load(&near_origin[k])) * load(&self.inverse[k]);
            let far = |k: usize| (splat(corner[k] + size) - load(&far_origin[k])) * load(&self.inverse[k]);
            let (mut t_min, mut t_max) = (load(&self.t_min), load(&self.t_max));
            if SURE {
                const SLACK: f32 = 1.0 / (1 << 20) as f32;
                t_min = t_min * splat(1.0 + SLACK);
                t_max = t_max * splat(1.0 - SLACK);
            }
            let t_in = near(0).max(near(1)).max(near(2).max(t_min));
            let t_out = far(0).min(far(1)).min(far(2).min(t_max));
            let crossed = if SURE { t_in.simd_lt(t_out) } else { t_in.simd_le(t_out) };
            found |= crossed.to_bitmask() << start;
        }
        found & rays
    }
}

/// Traces rays of one octant.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "the state of one traversal, all of it")]
fn trace<S: Simd>(
    columns: Columns<S>,
    dag: &DagRef,
    root: u32,
    lanes: &mut Lanes,
    rays: u64,
    flip: u32,
    t_start: f64,
    footprint: Footprint,
    visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
) {
    let simd = columns.witness();
    let top = dag.height as usize;
    let mut nodes = [0u32; MAX_STACK];
    nodes[top] = root;

    let apart = lanes.set_up(rays, f64::from(dag.tree_side()), t_start);
    for_each_ray(apart, |i| {
        cast_alone(columns, dag, &lanes.walks[i], &mut nodes, footprint, &mut |hit| visit(i, hit));
    });

    let slot_flip = mirror_slot(flip);
    let sizes = |height: usize| (1u32 << (2 * height)) as f32;
    let mut alive = rays & !apart;
    let mut corners = [[0.0f32; 3]; MAX_STACK];
    let mut left = [0u64; MAX_STACK];
    let mut rays_at = [0u64; MAX_STACK];
    let mut height = top;
    let occupied = mirror(mask_at(dag.words, root), flip);
    left[top] = occupied & lanes.tile.children(columns, corners[top], sizes(top));
    rays_at[top] = alive;
    loop {
        let mut rays = rays_at[height] & alive;
        if left[height] == 0 || rays == 0 {
            if alive == 0 || height == top {
                return;
            }
            height += 1;
            continue;
        }
        let bit = left[height].trailing_zeros();
        left[height] &= left[height] - 1;
        let size = sizes(height);
        let corner = child_corner(corners[height], bit, size);
        if height as u32 <= RAY_TEST_HEIGHT {
            rays = lanes.crossing::<S, false>(simd, rays, corner, size);
            if rays == 0 {
                continue;
            }
        }
        let node = nodes[height];
        let mask = mask_at(dag.words, node);
        let child = dag.words[child_word(mask, node, bit ^ slot_flip)];
        if height == 1 {
            let leaf = mirror(dag.leaves[child as usize], flip);
            let ended = brick(columns, dag, lanes, &nodes, rays, flip, corner, leaf, footprint, visit);
            alive &= !ended;
        } else if rays.count_ones() < FEW_RAYS {
            nodes[height - 1] = child;
            for_each_ray(rays, |i| {
                let (walk, slabs) = (&lanes.walks[i], lanes.slabs(i));
                let subtree = Subtree { height: height as u32 - 1, corner };
                let goes_on =
                    cast_subtree(columns, dag, walk, &slabs, &mut nodes, subtree, footprint, &mut |hit| {
                        visit(i, hit)
                    });
                alive &= !(u64::from(!goes_on) << i);
            });
        } else {
            height -= 1;
            nodes[height] = child;
            corners[height] = corner;
            let occupied = mirror(mask_at(dag.words, child), flip);
            left[height] = occupied & lanes.tile.children(columns, corner, sizes(height));
            rays_at[height] = rays;
        }
    }
}

/// Visits the voxels of a brick for all `rays` that may cross it. Returns the rays that end here.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "the state of one traversal, all of it")]
fn brick<S: Simd>(
    columns: Columns<S>,
    dag: &DagRef,
    lanes: &Lanes,
    nodes: &[u32; MAX_STACK],
    rays: u64,
    flip: u32,
    corner: [f32; 3],
    leaf: u64,
    footprint: Footprint,
    visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
) -> u64 {
    let simd = columns.witness();
    let mut ended = 0u64;
    let count = rays.count_ones();
    let candidates = if count > FEW_RAYS { leaf & lanes.tile.children(columns, corner, 1.0) } else { leaf };
    // A voxel costs a test of all rays, a ray a test of all voxels: whichever are fewer.
    if !footprint.is_zero() || candidates.count_ones() * 2 > count {
        for_each_ray(rays, |i| {
            let (walk, slabs) = (&lanes.walks[i], lanes.slabs(i));
            let goes_on =
                cast_brick(columns, dag, walk, &slabs, nodes, corner, candidates, footprint, &mut |hit| {
                    visit(i, hit)
                });
            ended |= u64::from(!goes_on) << i;
        });
        return ended;
    }
    let mut rays = rays;
    let mut left = candidates;
    while left != 0 && rays != 0 {
        let at = child_corner(corner, left.trailing_zeros(), 1.0);
        left &= left - 1;
        let maybe = lanes.crossing::<S, false>(simd, rays, at, 1.0);
        if maybe == 0 {
            continue;
        }
        let sure = lanes.crossing::<S, true>(simd, maybe, at, 1.0);
        let voxel = true_corner(dag, at, 1, flip);
        for_each_ray(maybe, |i| {
            let walk = &lanes.walks[i];
            if sure >> i & 1 == 0 && walk.crosses(voxel, 1).is_none() {
                return;
            }
            match visit(i, &VoxelHit { voxel, whole_brick: false, walk, dag, nodes }) {
                Next::Voxel => {}
                Next::Brick => rays &= !(1 << i),
                Next::End => {
                    rays &= !(1 << i);
                    ended |= 1 << i;
                }
            }
        });
    }
    ended
}
