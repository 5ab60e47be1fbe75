//! The CPU twin of `shaders/dag.wgsl` and `shaders/query.wgsl`: the same steps with the same names in f32, so that both give the same voxels.
//!
//! Nothing where products are added decides anything once a ray is in the grid: compilers for GPUs may fuse multiplication and
//! addition, which moves a ray's entry from outside by a rounding, and no more.

use glam::{BVec3, IVec3, UVec2, UVec3, Vec3};
use voxsight_voxel::dag::DagRef;

use super::clear::ClearBricks;
use crate::visibility::QueryScene;

/// Height of the root over the largest grid, and a slot for the leaf.
pub const MAX_STACK: usize = 9;
/// Stands for 1/0.
pub const PARALLEL: f32 = (1u128 << 100) as f32;
/// Components of directions below this fraction of the largest are taken as 0.
pub const NEGLIGIBLE: f32 = 1.0 / (1u32 << 30) as f32;

/// A ray of grid space: whole voxels and the rest of its origin apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridRay {
    /// Whole voxels.
    pub base: IVec3,
    /// 0 to 1.
    pub fraction: Vec3,
    /// Finite; any length but 0.
    pub direction: Vec3,
    /// In lengths of the direction; finite.
    pub t_end: f32,
}

struct Walk {
    base: IVec3,
    fraction: Vec3,
    direction: Vec3,
    inverse: Vec3,
    rises: BVec3,
    t_end: f32,
}

impl Walk {
    fn at_planes(&self, planes: IVec3) -> Vec3 {
        ((planes - self.base).as_vec3() - self.fraction) * self.inverse
    }

    fn at_plane(&self, axis: usize, plane: i32) -> f32 {
        ((plane - self.base[axis]) as f32 - self.fraction[axis]) * self.inverse[axis]
    }

    fn enter(ray: &GridRay, side: i32) -> Option<Self> {
        let size = ray.direction.abs();
        let most = size.max_element();
        if most.is_nan() || most <= 0.0 {
            return None;
        }
        let parallel = size.cmplt(Vec3::splat(most * NEGLIGIBLE));
        let inverse = Vec3::select(parallel, Vec3::splat(PARALLEL), 1.0 / ray.direction);
        let mut walk = Walk {
            base: ray.base,
            fraction: ray.fraction,
            direction: Vec3::select(parallel, Vec3::ZERO, ray.direction),
            inverse,
            rises: inverse.cmpgt(Vec3::ZERO),
            t_end: 0.0,
        };
        let low = walk.at_planes(IVec3::ZERO);
        let high = walk.at_planes(IVec3::splat(side));
        let within = ray.base.cmpge(IVec3::ZERO) & ray.base.cmplt(IVec3::splat(side));
        if (parallel & !within).any() {
            return None;
        }
        let nearest = Vec3::select(parallel, Vec3::splat(-PARALLEL), low.min(high));
        let farthest = Vec3::select(parallel, Vec3::splat(PARALLEL), low.max(high));
        let t_in = nearest.max_element().max(0.0);
        let t_out = farthest.min_element().min(ray.t_end);
        if t_in > t_out {
            return None;
        }
        if t_in > 0.0 {
            let entry = walk.fraction + t_in * walk.direction;
            let whole = entry.floor();
            let base = walk.base + whole.as_ivec3();
            let outside = base.cmpge(IVec3::splat(side)) | base.cmplt(IVec3::ZERO);
            walk.fraction = Vec3::select(outside, Vec3::ZERO, entry - whole);
            walk.base = base.clamp(IVec3::ZERO, IVec3::splat(side));
        }
        walk.t_end = t_out - t_in;
        Some(walk)
    }

    fn start(&self) -> IVec3 {
        let is_below = self.fraction.cmpeq(Vec3::ZERO) & !self.rises;
        self.base - IVec3::select(is_below, IVec3::ONE, IVec3::ZERO)
    }

    fn coordinate_after(&self, axis: usize, t: f32, before: i32, low: i32, size: i32) -> i32 {
        let guess = self.base[axis] + (self.fraction[axis] + t * self.direction[axis]).floor() as i32;
        if self.rises.test(axis) {
            let mut c = guess.clamp(before, low + size - 1);
            while c > before && self.at_plane(axis, c) > t {
                c -= 1;
            }
            while c < low + size - 1 && self.at_plane(axis, c + 1) <= t {
                c += 1;
            }
            c
        } else {
            let mut c = guess.clamp(low, before);
            while c < before && self.at_plane(axis, c + 1) > t {
                c += 1;
            }
            while c > low && self.at_plane(axis, c) <= t {
                c -= 1;
            }
            c
        }
    }
}

fn slot_of(voxel: IVec3, shift: u32) -> u32 {
    let digits = (voxel.as_uvec3() >> shift) & UVec3::splat(3);
    digits.x | digits.y << 2 | digits.z << 4
}

/// A ray on its way through a DAG.
struct Traversal<'a> {
    dag: &'a DagRef<'a>,
    walk: Walk,
    voxel: IVec3,
    height: u32,
    leaf: u64,
    nodes: [u32; MAX_STACK],
}

impl<'a> Traversal<'a> {
    fn begin(dag: &'a DagRef<'a>, ray: &GridRay) -> Option<Self> {
        let root = dag.root()?;
        let walk = Walk::enter(ray, 1 << dag.log2())?;
        let mut nodes = [0; MAX_STACK];
        nodes[dag.height() as usize] = root;
        let voxel = walk.start();
        let traversal = Traversal { dag, walk, voxel, height: dag.height(), leaf: 0, nodes };
        (!traversal.is_outside()).then_some(traversal)
    }

    fn is_outside(&self) -> bool {
        let side = IVec3::splat(1 << self.dag.log2());
        self.voxel.cmplt(IVec3::ZERO).any() || self.voxel.cmpge(side).any()
    }

    fn descend(&mut self) -> bool {
        let (words, leaves) = (self.dag.words(), self.dag.leaves());
        loop {
            let bit = slot_of(self.voxel, 2 * self.height);
            if self.height == 0 {
                return self.leaf >> bit & 1 == 1;
            }
            let node = self.nodes[self.height as usize] as usize;
            let mask = u64::from(words[node]) | u64::from(words[node + 1]) << 32;
            if mask >> bit & 1 == 0 {
                return false;
            }
            let child = words[node + 2 + (mask & ((1 << bit) - 1)).count_ones() as usize];
            self.height -= 1;
            if self.height > 0 {
                self.nodes[self.height as usize] = child;
            } else {
                self.leaf = leaves[child as usize];
            }
        }
    }

    fn advance(&mut self) -> bool {
        let size = 1i32 << (2 * self.height);
        let before = self.voxel;
        let low = before & IVec3::splat(-size);
        let exits = self.walk.at_planes(IVec3::select(self.walk.rises, low + size, low));
        let t = exits.min_element();
        if t > self.walk.t_end {
            return false;
        }
        for axis in 0..3 {
            if exits[axis] <= t {
                let rises = self.walk.rises.test(axis);
                self.voxel[axis] = if rises { low[axis] + size } else { low[axis] - 1 };
            } else if size > 1 {
                self.voxel[axis] = self.walk.coordinate_after(axis, t, before[axis], low[axis], size);
            }
        }
        if self.is_outside() {
            return false;
        }
        let changed = before ^ self.voxel;
        let differ = (changed.x | changed.y | changed.z) as u32;
        self.height = self.height.max((31 - differ.leading_zeros()) / 2);
        true
    }
}

/// The first voxel on a ray that casts a shadow.
pub fn first_hit(dag: &DagRef, clear: &ClearBricks, ray: &GridRay) -> Option<IVec3> {
    let mut traversal = Traversal::begin(dag, ray)?;
    loop {
        if traversal.descend() && !clear.is_clear(traversal.voxel) {
            return Some(traversal.voxel);
        }
        if !traversal.advance() {
            return None;
        }
    }
}

/// What a query's rays meet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tally {
    /// Of each drawable.
    pub samples: Vec<u32>,
    /// Likewise: an owner of a voxel that a ray came to.
    pub seen: Vec<bool>,
    /// Rays that met any.
    pub hits: u32,
}

/// Transparent drawables that a ray counts once each; from then on each time that it meets one.
pub const MOST_PASSED: usize = 16;

/// The query `voxel` over a list of rays: `count` of `shaders/query.wgsl`.
pub fn count(scene: &QueryScene, rays: &[GridRay]) -> Tally {
    let drawables = scene.exact.drawable_count() as usize;
    let mut tally = Tally { samples: vec![0; drawables], seen: vec![false; drawables], hits: 0 };
    for ray in rays {
        let Some(mut traversal) = Traversal::begin(&scene.dag, ray) else { continue };
        let mut passed = Vec::new();
        let mut has_met = false;
        loop {
            let mut opaque = None;
            if traversal.descend() {
                // By its place, not by its path: nothing is shared with the shader's ordinals.
                let brick = scene.dag.brick_at(traversal.voxel.to_array());
                let owners = brick.map(|(ordinal, mask)| scene.owners.of_brick(ordinal, mask));
                let owners = owners.into_iter().flat_map(|owners| owners.of_voxel(bit_of(traversal.voxel)));
                for owner in owners.filter(|&owner| !scene.filter.is_hidden(owner)) {
                    has_met = true;
                    tally.seen[owner as usize] = true;
                    if !scene.is_transparent(owner) {
                        opaque = opaque.or(Some(owner));
                    } else if !passed.contains(&owner) {
                        tally.samples[owner as usize] += 1;
                        if passed.len() < MOST_PASSED {
                            passed.push(owner);
                        }
                    }
                }
            }
            if let Some(owner) = opaque {
                tally.samples[owner as usize] += 1;
                break;
            }
            if !traversal.advance() {
                break;
            }
        }
        tally.hits += u32::from(has_met);
    }
    tally
}

/// Where a brick's key stands in a table of `slots` slots, a power of two, if it is free; `hash_of` of the shader.
pub(super) fn hash_of(key: UVec2) -> u32 {
    let mut h = key.x.wrapping_mul(0x9e37_79b1) ^ key.y.wrapping_mul(0x85eb_ca77);
    h ^= h >> 15;
    h = h.wrapping_mul(0xc2b2_ae3d);
    h ^ (h >> 13)
}

/// Index of a voxel in its brick; `slot_of` of the shader.
pub(super) fn bit_of(voxel: IVec3) -> u32 {
    slot_of(voxel, 0)
}
