//! Up to 64 neighbouring rays at once: the tile's frustum finds the nodes, lanes of rays the cells.

use fearless_simd::Simd;

use super::lanes::{Kinds, Lanes};
use super::ray::{RayLanes, WalkRef, Walks};
use super::single::{Subtree, cast_alone, cast_brick, cast_subtree, child_corner, child_size, true_corner};
use super::slabs::{Columns, TileSlabs};
use super::{Footprint, GridRay, MAX_STACK, Next, VoxelHit};
use crate::bits::{SetBits, mirror, mirror_slot};
use crate::dag::DagRef;
use crate::dag::node::{child_word, mask_at};

/// Rays in a packet, at most: 8x8 pixels.
pub const PACKET_RAYS: usize = 64;

/// Rays of a packet are tested one by one against the children of nodes of this height and below.
const RAY_TEST_HEIGHT: usize = 2;
/// Below this many rays a brick's voxels are not narrowed down by the tile.
const FEW_RAYS: u32 = 4;
/// Rays beyond which one test of all rays is cheaper than a test of all children for each: per child of a node, per
/// voxel of a brick. Measured.
const RAYS_PER_CHILD: u32 = 1;
const RAYS_PER_VOXEL: u32 = 2;

/// Up to [`PACKET_RAYS`] rays, such as those of a tile of 8x8 pixels, and room to work. Keep one per thread and fill it
/// again and again.
#[derive(Clone, Debug)]
pub struct RayPacket {
    pub(super) rays: RayLanes<PACKET_RAYS>,
    count: usize,
    pub(super) walks: Walks<PACKET_RAYS>,
    pub(super) lanes: Lanes,
}

impl Default for RayPacket {
    fn default() -> Self {
        RayPacket { rays: RayLanes::new(), count: 0, walks: Walks::new(), lanes: Lanes::new() }
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
        // Lanes without a ray repeat the last one, so that the tile's bounds are those of its rays.
        if let Some(last) = self.count.checked_sub(1) {
            let last = self.rays.get(last);
            (self.count..PACKET_RAYS).for_each(|i| self.rays.set(i, &last));
        }
        self.count
    }

    /// Sets up the lanes of all rays, which are of one octant. Returns those that meet the grid, and those of them
    /// that have to go alone.
    #[inline(always)]
    pub(super) fn set_up<S: Simd>(&mut self, simd: S, dag: &DagRef, flip: u32) -> (u64, u64) {
        let RayPacket { rays, count, walks, lanes } = self;
        walks.enter(rays, f64::from(1 << dag.log2));
        let inside = Kinds::new(simd, walks, *count).inside;
        let apart = lanes.set_up(simd, walks, inside, flip, f64::from(dag.tree_side()));
        (inside & !apart, apart)
    }
}

/// See [`super::RayCaster::cast_packet`].
#[inline(always)]
pub(super) fn cast<S: Simd>(
    simd: S,
    dag: &DagRef,
    packet: &mut RayPacket,
    footprint: Footprint,
    visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
) {
    let Some(root) = dag.root else { return };
    let columns = Columns::new(simd);
    let mut nodes = [0u32; MAX_STACK];
    nodes[dag.height as usize] = root;
    let apart = for_each_octant(
        simd,
        dag,
        packet,
        #[inline(always)]
        |packet, flip, tile, ready| {
            trace(columns, dag, packet, &mut nodes, flip, tile, ready, footprint, visit)
        },
    );
    for i in SetBits(apart) {
        let i = i as usize;
        cast_alone(columns, dag, &packet.walks.get(i), &mut nodes, footprint, &mut |hit| visit(i, hit));
    }
}

/// Calls `trace(packet, flip, tile, ready)` for the rays of each octant: its axes along which they fall, their bounds, and
/// which rays they are when their lanes are set up already, `None` for all rays in one octant whose lanes are
/// not. Returns the rays that have to go alone, those that `trace` returns among them.
#[inline(always)]
pub(super) fn for_each_octant<S: Simd>(
    simd: S,
    dag: &DagRef,
    packet: &mut RayPacket,
    mut trace: impl FnMut(&mut RayPacket, u32, &TileSlabs, Option<u64>) -> u64,
) -> u64 {
    let tree_side = f64::from(dag.tree_side());
    if let Some((flip, tile)) = packet.rays.tile(simd, tree_side) {
        return trace(packet, flip, &tile, None);
    }
    // A tile across an axis is done in parts.
    let RayPacket { rays, count, walks, .. } = &mut *packet;
    walks.enter(rays, f64::from(1 << dag.log2));
    let kinds = Kinds::new(simd, walks, *count);
    // Rays whose parameter is not that of the others.
    let mut apart = kinds.scaled;
    let mut waiting = kinds.inside & !kinds.scaled;
    while waiting != 0 {
        let flip = kinds.flip(waiting.trailing_zeros());
        let rays = waiting & kinds.of_octant(flip);
        waiting &= !rays;
        let far_off = packet.lanes.set_up(simd, &packet.walks, rays, flip, tree_side);
        apart |= far_off;
        if rays != far_off {
            let tile = packet.lanes.tile;
            apart |= trace(packet, flip, &tile, Some(rays & !far_off));
        }
    }
    apart
}

/// Traces rays of one octant from the root, which is in `nodes` already: those named, whose lanes are set up, or all. In
/// that case lanes are set up when the first of them is needed: many tiles meet nothing at all. Returns the
/// rays that have to go alone.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "the state of one traversal, all of it")]
fn trace<S: Simd>(
    columns: Columns<S>,
    dag: &DagRef,
    packet: &mut RayPacket,
    nodes: &mut [u32; MAX_STACK],
    flip: u32,
    tile: &TileSlabs,
    ready: Option<u64>,
    footprint: Footprint,
    visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
) -> u64 {
    let simd = columns.witness();
    let top = dag.height as usize;
    let slot_flip = mirror_slot(flip);
    let (mut is_ready, mut alive) = (ready.is_some(), ready.unwrap_or(u64::MAX));
    let mut apart = 0;
    let mut corners = [[0.0f32; 3]; MAX_STACK];
    let mut left = [0u64; MAX_STACK];
    let mut rays_at = [0u64; MAX_STACK];
    let mut height = top;
    let occupied = mirror(mask_at(dag.words, nodes[top]), flip);
    left[top] = occupied & tile.children(columns, corners[top], child_size(top));
    rays_at[top] = alive;
    loop {
        let mut rays = rays_at[height] & alive;
        if left[height] == 0 || rays == 0 {
            if alive == 0 || height == top {
                return apart;
            }
            height += 1;
            continue;
        }
        if height <= RAY_TEST_HEIGHT && !is_ready {
            (alive, apart) = packet.set_up(simd, dag, flip);
            is_ready = true;
            continue;
        }
        let RayPacket { walks, lanes, .. } = &*packet;
        let bit = left[height].trailing_zeros();
        left[height] &= left[height] - 1;
        let size = child_size(height);
        let corner = child_corner(corners[height], bit, size);
        if height <= RAY_TEST_HEIGHT {
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
            alive &=
                !brick(columns, dag, walks, lanes, tile, nodes, rays, flip, corner, leaf, footprint, visit);
            continue;
        }
        nodes[height - 1] = child;
        let occupied = mirror(mask_at(dag.words, child), flip);
        let candidates = occupied & tile.children(columns, corner, child_size(height - 1));
        // A child costs a test of all rays, a ray a test of all children: whichever are fewer.
        if !is_ready || rays.count_ones() > RAYS_PER_CHILD * candidates.count_ones() {
            height -= 1;
            corners[height] = corner;
            left[height] = candidates;
            rays_at[height] = rays;
            continue;
        }
        for i in SetBits(rays) {
            let i = i as usize;
            let walk = &walks.get(i);
            let subtree = Subtree { height: height - 1, corner, candidates };
            let goes_on =
                cast_subtree(columns, dag, walk, &lanes.slabs(i), nodes, subtree, footprint, &mut |hit| {
                    visit(i, hit)
                });
            alive &= !(u64::from(!goes_on) << i);
        }
    }
}

/// Visits the voxels of a brick for all `rays` that may cross it. Returns the rays that end here.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "the state of one traversal, all of it")]
fn brick<S: Simd>(
    columns: Columns<S>,
    dag: &DagRef,
    walks: &Walks<PACKET_RAYS>,
    lanes: &Lanes,
    tile: &TileSlabs,
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
    let candidates = if count >= FEW_RAYS { leaf & tile.children(columns, corner, 1.0) } else { leaf };
    if count < FEW_RAYS || count <= RAYS_PER_VOXEL * candidates.count_ones() || !footprint.is_zero() {
        for i in SetBits(rays) {
            let i = i as usize;
            let walk = &walks.get(i);
            let slabs = &lanes.slabs(i);
            let goes_on =
                cast_brick(columns, dag, walk, slabs, nodes, corner, candidates, footprint, &mut |hit| {
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
            if sure >> i & 1 == 0 && walks.get(i as usize).crosses(voxel, 1).is_none() {
                continue;
            }
            let walk = WalkRef::Lane(walks, i as usize);
            match visit(i as usize, &VoxelHit { voxel, whole_brick: false, walk, dag, nodes }) {
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
