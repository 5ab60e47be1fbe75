//! Ray casting through the DAG: the voxels that a ray crosses, front to back.
//!
//! # Which voxels a ray crosses
//!
//! The ray is re-based in f64 at its entry into the grid. It meets the plane at coordinate c of an axis at
//! `t(c) = (c - base) * inverse`, computed from the plane's position every time and never accumulated. A voxel is
//! *crossed* when the largest t of its three near planes is smaller than the smallest t of its three far planes (and the
//! interval between lies in the ray's). For each axis, t rises with the planes, and the far plane of one voxel is the near plane
//! of the next: so the open intervals between the ray's successive crossings belong to one voxel each, whatever the
//! rounding. There is no tie, no gap and no way to loop.
//!
//! Rounding moves the ray as a whole, by no more than f64 rounds its coordinates: 2^-34 voxel inside the largest grid, 2^-14 from a
//! million grid sides away. So it can only lose a voxel into which the ray goes no *deeper* than that, far below
//! the promised 2^-10 voxel. (A ray almost parallel to a face may be that shallow for a long way.)
//!
//! # The paths
//!
//! | path | for | how |
//! |---|---|---|
//! | [`DagRef::cast`] | the reference | scalar, from cell to cell, integers and f64 |
//! | [`RayCaster::cast`], [`RayCaster::cast_batch`] | unrelated rays | all 64 children of a node at once, f32 SIMD |
//! | [`RayCaster::cast_packet`] | up to 64 rays of a tile of pixels | the tile's frustum, then lanes of rays |
//! | [`RayCaster::cast_bricks`] | the bricks that such rays may cross, all rays of an octant together | the same, without deciding in f64 |
//!
//! The SIMD paths discard with f32 tests that are widened by a bound of their error, and decide in f64 by the rule above wherever f32
//! leaves a doubt ([`RayCaster::cast_bricks`] leaves that to its caller). So every other path gives the same voxels as the reference, in the same order, on every processor.

mod bricks;
mod lanes;
mod packet;
mod ray;
mod reference;
mod single;
mod slabs;

pub use bricks::{PacketBrick, RayEnds};
pub use packet::{PACKET_RAYS, RayPacket};
pub use ray::GridRay;

use fearless_simd::{Level, Simd};

use ray::WalkRef;

use crate::dag::DagRef;
use crate::dag::node::{child_word, mask_at, slot};

/// Height of the root over the largest grid, and a slot for the leaf.
const MAX_STACK: usize = 9;

/// Where a walk goes on after an occupied voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// To the next voxel.
    Voxel,
    /// Past the rest of this voxel's brick.
    Brick,
    /// Nowhere: the caller has what it wants.
    End,
}

/// Width of what a ray stands for, in voxels: `width + growth t`, t in the ray's own parameter.
///
/// A brick entered where the width is more than its side (4 voxels) is not opened: it is reported as one hit. The
/// default never stops early.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Footprint {
    /// At t = 0.
    pub width: f64,
    /// Per unit of t.
    pub growth: f64,
}

impl Footprint {
    /// Is it wider than a brick at this t?
    #[inline(always)]
    fn covers_brick(&self, t: f64) -> bool {
        self.width + self.growth * t > 4.0
    }

    fn is_zero(&self) -> bool {
        *self == Self::default()
    }
}

/// An occupied voxel that a ray crosses.
pub struct VoxelHit<'t> {
    /// Voxel coordinates; of the brick's low corner for a whole brick.
    pub voxel: [i32; 3],
    /// The ray's [`Footprint`] is wider than this brick, which stands for its voxels.
    pub whole_brick: bool,
    walk: WalkRef<'t>,
    dag: &'t DagRef<'t>,
    /// Node of each height on the way down, index 0 unused.
    nodes: &'t [u32; MAX_STACK],
}

impl VoxelHit<'_> {
    /// Where the ray enters it, in the ray's own parameter: to 2^-45 of the largest parameter at which the ray is in the
    /// grid, and by as little below its start or beyond its end.
    pub fn t(&self) -> f64 {
        let size = if self.whole_brick { 4 } else { 1 };
        let walk = self.walk.get();
        walk.ray_t(walk.entry(self.voxel, size))
    }

    /// Bit of the voxel in its brick.
    pub fn bit(&self) -> u32 {
        slot(self.voxel, 0)
    }

    /// Ordinal of its brick in depth-first order, for [`crate::dag::OwnersRef::of_brick`].
    pub fn brick_ordinal(&self) -> u64 {
        ordinal(self.dag, self.nodes, self.voxel)
    }

    /// Mask of the occupied voxels of its brick, for [`crate::dag::OwnersRef::of_brick`].
    pub fn brick_mask(&self) -> u64 {
        mask(self.dag, self.nodes, self.voxel)
    }
}

/// Ordinal of the brick that holds a voxel, below the nodes of each height.
#[inline]
fn ordinal(dag: &DagRef, nodes: &[u32; MAX_STACK], voxel: [i32; 3]) -> u64 {
    let mut before = 0;
    for height in 1..=dag.height {
        before += dag.bricks_before(height, nodes[height as usize], slot(voxel, 2 * height));
    }
    before
}

/// Its mask.
#[inline]
fn mask(dag: &DagRef, nodes: &[u32; MAX_STACK], voxel: [i32; 3]) -> u64 {
    let node = nodes[1];
    let word = child_word(mask_at(dag.words, node), node, slot(voxel, 2));
    dag.leaves[dag.words[word] as usize]
}

/// Runs code that is generic over [`Simd`] with the instructions asked for; with less where the processor has less.
macro_rules! with_simd {
    ($instructions:expr, $simd:ident => $op:expr) => {{
        let level = Level::new();
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        let (avx512, avx2) = (level.as_avx512(), level.as_avx2());
        #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
        let (avx512, avx2): (Option<fearless_simd::Fallback>, Option<fearless_simd::Fallback>) = (None, None);
        match ($instructions, avx512, avx2) {
            (Instructions::Avx512, Some($simd), _) => $simd.vectorize(
                #[inline(always)]
                || $op,
            ),
            (Instructions::Avx512 | Instructions::Avx2, _, Some($simd)) => $simd.vectorize(
                #[inline(always)]
                || $op,
            ),
            _ => fearless_simd::dispatch!(Level::baseline(), $simd => $op),
        }
    }};
}

impl DagRef<'_> {
    /// Calls `visit` for the occupied voxels that the ray crosses, nearest first, until it says
    /// [`Next::End`] or the ray ends. The scalar reference: [`RayCaster`] gives the same, faster.
    pub fn cast(&self, ray: &GridRay, visit: impl FnMut(&VoxelHit) -> Next) {
        self.cast_footprint(ray, Footprint::default(), visit);
    }

    /// [`DagRef::cast`], stopping at bricks below the footprint.
    pub fn cast_footprint(
        &self,
        ray: &GridRay,
        footprint: Footprint,
        mut visit: impl FnMut(&VoxelHit) -> Next,
    ) {
        // Scalar code, but bits are counted in one instruction where the processor can.
        with_simd!(Instructions::best(), simd => {
            let _ = simd;
            if let Some(walk) = ray.enter(f64::from(1 << self.log2)) {
                reference::cast(self, &walk, footprint, &mut visit);
            }
        });
    }

    /// The first occupied voxel that the ray crosses, and where it enters it.
    pub fn first_hit(&self, ray: &GridRay) -> Option<([i32; 3], f64)> {
        let mut first = None;
        self.cast(ray, |hit| {
            first = Some((hit.voxel, hit.t()));
            Next::End
        });
        first
    }

    /// Does the ray cross an occupied voxel?
    pub fn any_hit(&self, ray: &GridRay) -> bool {
        self.first_hit(ray).is_some()
    }
}

/// Which instructions the SIMD paths use. All give the same answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Instructions {
    /// What every processor of the target has (SSE2, NEON).
    Portable,
    /// AVX2, FMA and BMI2.
    Avx2,
    /// AVX-512 as of Ice Lake and Zen 4.
    Avx512,
}

impl Instructions {
    /// Those that this processor has, slowest first.
    pub fn available() -> Vec<Self> {
        let best = Self::best();
        [Self::Portable, Self::Avx2, Self::Avx512].into_iter().filter(|&set| set <= best).collect()
    }

    /// The fastest that this processor has.
    pub fn best() -> Self {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        match Level::new() {
            Level::Avx512(_) => return Self::Avx512,
            Level::Avx2(_) => return Self::Avx2,
            _ => {}
        }
        Self::Portable
    }
}

/// Casts rays through a DAG with SIMD: the same voxels as [`DagRef::cast`].
#[derive(Clone, Copy, Debug)]
pub struct RayCaster<'a> {
    dag: DagRef<'a>,
    instructions: Instructions,
    footprint: Footprint,
}

impl<'a> RayCaster<'a> {
    /// With the fastest instructions of this processor, and without stopping at bricks.
    pub fn new(dag: DagRef<'a>) -> Self {
        RayCaster { dag, instructions: Instructions::best(), footprint: Footprint::default() }
    }

    /// With these instructions instead; with lesser ones where the processor lacks them.
    pub fn with_instructions(self, instructions: Instructions) -> Self {
        RayCaster { instructions, ..self }
    }

    /// Stopping at bricks below this footprint.
    pub fn with_footprint(self, footprint: Footprint) -> Self {
        RayCaster { footprint, ..self }
    }

    /// Calls `visit` for the occupied voxels that the ray crosses, nearest first, until it says [`Next::End`] or the ray
    /// ends.
    pub fn cast(&self, ray: &GridRay, mut visit: impl FnMut(&VoxelHit) -> Next) {
        let Self { dag, footprint, .. } = self;
        with_simd!(self.instructions, simd => single::cast(simd, dag, ray, *footprint, &mut visit));
    }

    /// [`RayCaster::cast`] for each of many unrelated rays, such as shadow rays; `visit` also gets the ray's number. Hits
    /// of one ray come nearest first, those of different rays in any order.
    ///
    /// The rays are traced one after another: interleaving eight of them, so that the processor works on one while it
    /// waits for another, was no faster (0.86 to 1.08 times, on three scenes).
    pub fn cast_batch(&self, rays: &[GridRay], mut visit: impl FnMut(usize, &VoxelHit) -> Next) {
        let Self { dag, footprint, .. } = self;
        with_simd!(self.instructions, simd => {
            for (number, ray) in rays.iter().enumerate() {
                single::cast(simd, dag, ray, *footprint, &mut |hit| visit(number, hit));
            }
        });
    }

    /// The first occupied voxel that the ray crosses, and where it enters it.
    pub fn first_hit(&self, ray: &GridRay) -> Option<([i32; 3], f64)> {
        let mut first = None;
        self.cast(ray, |hit| {
            first = Some((hit.voxel, hit.t()));
            Next::End
        });
        first
    }

    /// Does the ray cross an occupied voxel?
    pub fn any_hit(&self, ray: &GridRay) -> bool {
        let mut any = false;
        self.cast(ray, |_| {
            any = true;
            Next::End
        });
        any
    }

    /// Which of the rays cross an occupied voxel, `found` one for each.
    pub fn any_hits(&self, rays: &[GridRay], found: &mut Vec<bool>) {
        found.clear();
        found.resize(rays.len(), false);
        self.cast_batch(rays, |ray, _| {
            found[ray] = true;
            Next::End
        });
    }

    /// [`RayCaster::cast`] for each ray of a packet; `visit` also gets the ray's number. Rays of a packet should be
    /// neighbours: what they do not share costs time, never an answer. Hits of one ray come nearest first, those of
    /// different rays in any order.
    pub fn cast_packet(&self, packet: &mut RayPacket, mut visit: impl FnMut(usize, &VoxelHit) -> Next) {
        let Self { dag, footprint, .. } = self;
        with_simd!(self.instructions, simd => packet::cast(simd, dag, packet, *footprint, &mut visit));
    }

    /// Calls `visit` for the bricks that rays of a packet may cross, with those rays; front to back for each ray. Rays of one
    /// octant (the signs of their directions, where these are not next to nothing) go together: a brick comes once for all of them, and once more for each other
    /// octant of the packet, as in a tile of pixels across an axis of the world. The few rays that SIMD cannot bound go
    /// alone. No ray has a brick twice. `visit` may shorten the rays, for example when it has found what stops them. No
    /// brick that a ray crosses before its end is missing; some may be passed by 2^-19 of the grid's side.
    pub fn cast_bricks(&self, packet: &mut RayPacket, mut visit: impl FnMut(&PacketBrick, &mut RayEnds)) {
        with_simd!(self.instructions, simd => bricks::cast(simd, &self.dag, packet, &mut visit));
    }
}
