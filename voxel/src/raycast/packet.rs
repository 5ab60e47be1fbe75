//! Up to 64 neighbouring rays at once: the tile's frustum finds the nodes, lanes of rays the cells.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16};

use super::ray::{RayLanes, Walks};
use super::single::{Subtree, cast_alone, cast_brick, cast_subtree, child_corner, child_size, true_corner};
use super::slabs::{Columns, MARGIN, RaySlabs, TileSlabs, rounded_down, rounded_up};
use super::{Footprint, GridRay, MAX_STACK, Next, VoxelHit};
use crate::bits::{SetBits, mirror, mirror_slot};
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
    rays: RayLanes<PACKET_RAYS>,
    count: usize,
}

impl Default for RayPacket {
    fn default() -> Self {
        RayPacket { rays: RayLanes::new(), count: 0 }
    }
}

impl RayPacket {
    /// Replaces the rays: the first [`PACKET_RAYS`] that come. Returns how many that were.
    #[inline]
    pub fn fill(&mut self, rays: impl IntoIterator<Item = GridRay>) -> usize {
        self.count = 0;
        for (i, ray) in rays.into_iter().take(PACKET_RAYS).enumerate() {
            self.rays.set(i, &ray);
            self.count = i + 1;
        }
        self.count
    }
}

/// The packet on its way: rays re-based at a common t, mirrored as the rays of one octant are.
struct Lanes<'w> {
    walks: &'w Walks<PACKET_RAYS>,
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
    let walks = Walks::new(&packet.rays, f64::from(1 << dag.log2));
    let columns = Columns::new(simd);
    let mut nodes = [0u32; MAX_STACK];
    nodes[dag.height as usize] = root;
    let (mut waiting, mut apart) = (0u64, 0u64);
    let mut flips = [0u8; PACKET_RAYS];
    for i in 0..packet.count {
        let inside = u64::from(walks.t_end[i] >= 0.0);
        // A ray whose parameter is not that of the others goes alone.
        let plain = u64::from(walks.scale[i] == 1.0);
        waiting |= (inside & plain) << i;
        apart |= (inside & !plain) << i;
        flips[i] = walks.flip(i) as u8;
    }
    for i in SetBits(apart) {
        let i = i as usize;
        cast_alone(columns, dag, &walks.get(i), &mut nodes, footprint, &mut |hit| visit(i, hit));
    }
    // Usually all rays go to the same octant; a tile across an axis is done in parts.
    while waiting != 0 {
        let flip = flips[waiting.trailing_zeros() as usize];
        let mut rays = 0u64;
        for i in 0..PACKET_RAYS {
            rays |= u64::from(flips[i] == flip) << i;
        }
        rays &= waiting;
        waiting &= !rays;
        let mut lanes = Lanes::new(&walks);
        let apart = lanes.set_up(rays, u32::from(flip), f64::from(dag.tree_side()));
        for i in SetBits(apart) {
            let i = i as usize;
            cast_alone(columns, dag, &walks.get(i), &mut nodes, footprint, &mut |hit| visit(i, hit));
        }
        trace(columns, dag, root, &lanes, rays & !apart, u32::from(flip), footprint, visit);
    }
}

impl<'w> Lanes<'w> {
    #[inline(always)]
    fn new(walks: &'w Walks<PACKET_RAYS>) -> Self {
        Lanes {
            walks,
            high: [[0.0; PACKET_RAYS]; 3],
            low: [[0.0; PACKET_RAYS]; 3],
            inverse: [[0.0; PACKET_RAYS]; 3],
            t_min: [0.0; PACKET_RAYS],
            t_max: [0.0; PACKET_RAYS],
            tile: TileSlabs::default(),
        }
    }

    /// Sets up the rays of one octant. Returns those that do not fit into f32 beside the others.
    #[inline(always)]
    fn set_up(&mut self, rays: u64, flip: u32, tree_side: f64) -> u64 {
        let margin = MARGIN * tree_side;
        let mut t_start = f64::INFINITY;
        for i in SetBits(rays) {
            let t = self.walks.t_base[i as usize];
            t_start = if t < t_start { t } else { t_start };
        }
        let mut out = [0u8; PACKET_RAYS];
        for i in 0..PACKET_RAYS {
            let ahead = self.walks.t_base[i] - t_start;
            let mut farthest = 0.0;
            for k in 0..3 {
                let moved = ahead * self.walks.direction[k][i];
                farthest = if moved.abs() > farthest { moved.abs() } else { farthest };
                let origin = self.walks.base[k][i] - moved;
                let origin = if flip >> k & 1 == 0 { origin } else { tree_side - origin };
                self.high[k][i] = (origin + margin) as f32;
                self.low[k][i] = (origin - margin) as f32;
                self.inverse[k][i] = self.walks.inverse[k][i].abs() as f32;
            }
            self.t_min[i] = rounded_down(ahead);
            self.t_max[i] = rounded_up(ahead + self.walks.t_end[i]);
            out[i] = u8::from(farthest > tree_side);
        }
        let mut apart = 0;
        for i in 0..PACKET_RAYS {
            apart |= u64::from(out[i]) << i;
        }
        apart &= rays;
        let together = rays & !apart;
        if together == 0 {
            return apart;
        }
        // Lanes without a ray repeat one that is there: no test needs to know.
        let some = together.trailing_zeros() as usize;
        for i in SetBits(!together) {
            let i = i as usize;
            for k in 0..3 {
                self.high[k][i] = self.high[k][some];
                self.low[k][i] = self.low[k][some];
                self.inverse[k][i] = self.inverse[k][some];
            }
            self.t_min[i] = self.t_min[some];
            self.t_max[i] = self.t_max[some];
        }
        for k in 0..3 {
            self.tile.high[k] = most(&self.high[k]);
            self.tile.low[k] = least(&self.low[k]);
            self.tile.least_inverse[k] = least(&self.inverse[k]);
            self.tile.greatest_inverse[k] = most(&self.inverse[k]);
        }
        self.tile.t_min = least(&self.t_min);
        self.tile.t_max = most(&self.t_max);
        apart
    }

    /// One ray of the packet, to go on alone.
    #[inline(always)]
    fn slabs(&self, ray: usize) -> RaySlabs {
        let (high, low, inverse) = (&self.high, &self.low, &self.inverse);
        RaySlabs {
            high: [high[0][ray], high[1][ray], high[2][ray]],
            low: [low[0][ray], low[1][ray], low[2][ray]],
            inverse: [inverse[0][ray], inverse[1][ray], inverse[2][ray]],
            t_min: self.t_min[ray],
            t_max: self.t_max[ray],
        }
    }

    /// Those of `rays` that may cross the cell of `size` voxels at a mirrored corner; with `SURE`, those that certainly do.
    #[inline(always)]
    fn crossing<S: Simd, const SURE: bool>(&self, simd: S, rays: u64, corner: [f32; 3], size: f32) -> u64 {
        // Planes moved apart, or together.
        let (near_origin, far_origin) = if SURE { (&self.low, &self.high) } else { (&self.high, &self.low) };
        let mut found = 0;
        for group in 0..PACKET_RAYS / LANES {
            let start = group * LANES;
            if rays >> start & 0xffff == 0 {
                continue;
            }
            let (near, far) = (near_origin, far_origin);
            let high = [corner[0] + size, corner[1] + size, corner[2] + size];
            let x = slab(simd, &near[0], &far[0], &self.inverse[0], start, corner[0], high[0]);
            let y = slab(simd, &near[1], &far[1], &self.inverse[1], start, corner[1], high[1]);
            let z = slab(simd, &near[2], &far[2], &self.inverse[2], start, corner[2], high[2]);
            let (mut t_min, mut t_max) = (load(simd, &self.t_min, start), load(simd, &self.t_max, start));
            if SURE {
                const SLACK: f32 = 1.0 / (1 << 20) as f32;
                t_min = t_min * f32x16::splat(simd, 1.0 + SLACK);
                t_max = t_max * f32x16::splat(simd, 1.0 - SLACK);
            }
            let t_in = x.0.max(y.0).max(z.0.max(t_min));
            let t_out = x.1.min(y.1).min(z.1.min(t_max));
            let crossed = if SURE { t_in.simd_lt(t_out) } else { t_in.simd_le(t_out) };
            found |= crossed.to_bitmask() << start;
        }
        found & rays
    }
}

#[inline(always)]
fn least(lanes: &[f32; PACKET_RAYS]) -> f32 {
    let mut least = f32::INFINITY;
    for &lane in lanes {
        least = if lane < least { lane } else { least };
    }
    least
}

#[inline(always)]
fn most(lanes: &[f32; PACKET_RAYS]) -> f32 {
    let mut most = f32::NEG_INFINITY;
    for &lane in lanes {
        most = if lane > most { lane } else { most };
    }
    most
}

/// Entries into and exits from a slab between two planes, for one register of rays.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "lanes of four arrays and two planes")]
fn slab<S: Simd>(
    simd: S,
    near_origin: &[f32; PACKET_RAYS],
    far_origin: &[f32; PACKET_RAYS],
    inverse: &[f32; PACKET_RAYS],
    start: usize,
    low: f32,
    high: f32,
) -> (f32x16<S>, f32x16<S>) {
    let inverse = load(simd, inverse, start);
    let near = (f32x16::splat(simd, low) - load(simd, near_origin, start)) * inverse;
    let far = (f32x16::splat(simd, high) - load(simd, far_origin, start)) * inverse;
    (near, far)
}

#[inline(always)]
fn load<S: Simd>(simd: S, lanes: &[f32; PACKET_RAYS], start: usize) -> f32x16<S> {
    f32x16::from_slice(simd, &lanes[start..start + LANES])
}

/// Traces rays of one octant.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "the state of one traversal, all of it")]
fn trace<S: Simd>(
    columns: Columns<S>,
    dag: &DagRef,
    root: u32,
    lanes: &Lanes,
    rays: u64,
    flip: u32,
    footprint: Footprint,
    visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
) {
    let simd = columns.witness();
    let top = dag.height as usize;
    let mut nodes = [0u32; MAX_STACK];
    nodes[top] = root;

    let slot_flip = mirror_slot(flip);
    let mut alive = rays;
    let mut corners = [[0.0f32; 3]; MAX_STACK];
    let mut left = [0u64; MAX_STACK];
    let mut rays_at = [0u64; MAX_STACK];
    let mut height = top;
    let occupied = mirror(mask_at(dag.words, root), flip);
    left[top] = occupied & lanes.tile.children(columns, corners[top], child_size(top));
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
        let size = child_size(height);
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
            for i in SetBits(rays) {
                let i = i as usize;
                let (walk, slabs) = (&lanes.walks.get(i), lanes.slabs(i));
                let subtree = Subtree { height: height as u32 - 1, corner };
                let goes_on =
                    cast_subtree(columns, dag, walk, &slabs, &mut nodes, subtree, footprint, &mut |hit| {
                        visit(i, hit)
                    });
                alive &= !(u64::from(!goes_on) << i);
            }
        } else {
            height -= 1;
            nodes[height] = child;
            corners[height] = corner;
            let occupied = mirror(mask_at(dag.words, child), flip);
            left[height] = occupied & lanes.tile.children(columns, corner, child_size(height));
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
        for i in SetBits(rays) {
            let i = i as usize;
            let (walk, slabs) = (&lanes.walks.get(i), lanes.slabs(i));
            let goes_on =
                cast_brick(columns, dag, walk, &slabs, nodes, corner, candidates, footprint, &mut |hit| {
                    visit(i, hit)
                });
            ended |= u64::from(!goes_on) << i;
        }
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
        for i in SetBits(maybe) {
            let i = i as usize;
            let walk = &lanes.walks.get(i);
            if sure >> i & 1 == 0 && walk.crosses(voxel, 1).is_none() {
                continue;
            }
            match visit(i, &VoxelHit { voxel, whole_brick: false, walk, dag, nodes }) {
                Next::Voxel => {}
                Next::Brick => rays &= !(1 << i),
                Next::End => {
                    rays &= !(1 << i);
                    ended |= 1 << i;
                }
            }
        }
    }
    ended
}
