//! What a format must answer, and what all of them are walked with: one plain walker of rays and one of all leaves.

use voxsight_voxel::raycast::GridRay;

/// A packed DAG. Nodes and leaves are named by a word that the format alone understands.
///
/// Height 0 are leaf masks, the root has the greatest height. Everything is `#[inline(always)]`, so that one compiled
/// walker holds one format.
pub trait Format: Sync {
    /// log2 of the child slots a side of a node.
    const WIDTH: u32;
    /// log2 of the voxels a side of a leaf mask.
    const LEAF: u32;

    /// Of height `heights()`.
    fn root(&self) -> u32;
    /// Height of the root.
    fn heights(&self) -> u32;
    /// What is in `slot` of a node of `height` (1 or more), if anything.
    fn child(&self, height: u32, node: u32, slot: u32) -> Option<u32>;
    /// Mask of a leaf as it is stored.
    fn leaf(&self, leaf: u32) -> u64;
    /// What to XOR a voxel's bit with to find it in the stored mask.
    #[inline(always)]
    fn leaf_flip(&self, _leaf: u32) -> u32 {
        0
    }
    /// All that traversal needs.
    fn bytes(&self) -> usize;
}

/// Enough for 2^17 voxels a side and two children a side.
const MAX_STACK: usize = 20;

/// Stands for 1/0, as in the library.
const PARALLEL: f64 = (1u128 << 100) as f64;

/// A ray re-based at its entry into the grid: the library's rule of what a ray crosses
/// (see `voxsight_voxel::raycast`), for directions of a length near 1.
struct Walk {
    base: [f64; 3],
    direction: [f64; 3],
    inverse: [f64; 3],
    t_end: f64,
}

impl Walk {
    #[inline(always)]
    fn enter(ray: &GridRay, side: f64) -> Option<Self> {
        let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
        let (mut inverse, mut base) = ([PARALLEL; 3], [0.0; 3]);
        let (mut t_in, mut t_out) = (ray.t_min, ray.t_max);
        for k in 0..3 {
            if direction[k] == 0.0 {
                if origin[k] < 0.0 || origin[k] > side {
                    return None;
                }
                continue;
            }
            inverse[k] = 1.0 / direction[k];
            let (a, b) = ((0.0 - origin[k]) * inverse[k], (side - origin[k]) * inverse[k]);
            t_in = t_in.max(a.min(b));
            t_out = t_out.min(a.max(b));
        }
        for k in 0..3 {
            base[k] = (origin[k] + t_in * direction[k]).max(0.0).min(side);
        }
        (t_in <= t_out).then_some(Walk { base, direction, inverse, t_end: t_out - t_in })
    }

    #[inline(always)]
    fn at(&self, k: usize, plane: i32) -> f64 {
        (f64::from(plane) - self.base[k]) * self.inverse[k]
    }

    #[inline(always)]
    fn rises(&self, k: usize) -> bool {
        self.inverse[k] > 0.0
    }

    /// The first voxel's coordinate.
    #[inline(always)]
    fn start(&self, k: usize) -> i32 {
        let c = self.base[k] as i32;
        if f64::from(c) == self.base[k] && !self.rises(k) { c - 1 } else { c }
    }

    /// Coordinate of the voxel just after `t`, within the cell of `size` at `low`, from `before` on.
    #[inline(always)]
    fn coordinate_after(&self, k: usize, t: f64, before: i32, low: i32, size: i32) -> i32 {
        let guess = (self.base[k] + t * self.direction[k]) as i32;
        let (least, most) = if self.rises(k) { (before, low + size - 1) } else { (low, before) };
        let mut c = guess.clamp(least, most);
        if self.rises(k) {
            while c > least && self.at(k, c) > t {
                c -= 1;
            }
            while c < most && self.at(k, c + 1) <= t {
                c += 1;
            }
        } else {
            while c < most && self.at(k, c + 1) > t {
                c += 1;
            }
            while c > least && self.at(k, c) <= t {
                c -= 1;
            }
        }
        c
    }
}

/// log2 of the side of the children of a node of `height`; of a voxel for 0.
#[inline(always)]
fn child_log2<F: Format>(height: u32) -> u32 {
    if height == 0 { 0 } else { F::LEAF + F::WIDTH * (height - 1) }
}

/// Slot of a voxel among cells of 2^shift, 2^width of them a side.
#[inline(always)]
fn slot(voxel: [i32; 3], shift: u32, width: u32) -> u32 {
    let digit = |c: i32| (c >> shift) as u32 & ((1 << width) - 1);
    digit(voxel[0]) | digit(voxel[1]) << width | digit(voxel[2]) << (2 * width)
}

/// The first occupied voxel that the ray crosses in a grid of 2^log2 voxels a side: the algorithm of the library's
/// scalar reference, from cell to cell.
#[inline(always)]
pub fn first_hit<F: Format>(format: &F, log2: u32, ray: &GridRay) -> Option<[i32; 3]> {
    let walk = Walk::enter(ray, f64::from(1 << log2))?;
    let last = (1u32 << log2) - 1;
    // A negative coordinate has high bits too.
    let outside = |v: [i32; 3]| ((v[0] | v[1] | v[2]) as u32) > last;
    let mut voxel = [walk.start(0), walk.start(1), walk.start(2)];
    if outside(voxel) {
        return None;
    }
    let mut height = format.heights();
    let mut nodes = [0u32; MAX_STACK];
    nodes[height as usize] = format.root();
    let mut leaf = 0u64;
    loop {
        // Down to the smallest cell that holds the voxel and is empty or a voxel.
        loop {
            if height == 0 {
                let bit = slot(voxel, 0, F::LEAF) ^ format.leaf_flip(nodes[0]);
                if leaf >> bit & 1 == 1 {
                    return Some(voxel);
                }
                break;
            }
            let slot = slot(voxel, child_log2::<F>(height), F::WIDTH);
            let Some(child) = format.child(height, nodes[height as usize], slot) else { break };
            height -= 1;
            nodes[height as usize] = child;
            if height == 0 {
                leaf = format.leaf(child);
            }
        }

        // Across the nearest plane of the cell, and every other that the ray meets at the same t.
        let size = 1 << child_log2::<F>(height);
        let low = [voxel[0] & -size, voxel[1] & -size, voxel[2] & -size];
        let mut exits = [0.0; 3];
        for k in 0..3 {
            exits[k] = walk.at(k, if walk.rises(k) { low[k] + size } else { low[k] });
        }
        let t = if exits[0] < exits[1] { exits[0] } else { exits[1] };
        let t = if exits[2] < t { exits[2] } else { t };
        if t > walk.t_end {
            return None;
        }
        let before = voxel;
        for k in 0..3 {
            voxel[k] = if exits[k] <= t {
                if walk.rises(k) { low[k] + size } else { low[k] - 1 }
            } else if size == 1 {
                before[k]
            } else {
                walk.coordinate_after(k, t, before[k], low[k], size)
            };
        }
        if outside(voxel) {
            return None;
        }
        // Up to the node that holds both.
        let differ = (before[0] ^ voxel[0]) | (before[1] ^ voxel[1]) | (before[2] ^ voxel[2]);
        let highest = 31 - (differ as u32).leading_zeros();
        let common = if highest < F::LEAF { 0 } else { (highest - F::LEAF) / F::WIDTH + 1 };
        height = height.max(common);
    }
}

/// Calls `visit(corner, mask)` for every leaf, sharing expanded; the mask as it lies in the grid.
pub fn for_each_leaf<F: Format>(format: &F, visit: &mut impl FnMut([i32; 3], u64)) {
    below(format, format.heights(), format.root(), [0; 3], visit);
}

fn below<F: Format>(
    format: &F,
    height: u32,
    node: u32,
    corner: [i32; 3],
    visit: &mut impl FnMut([i32; 3], u64),
) {
    if height == 0 {
        let (mask, flip) = (format.leaf(node), format.leaf_flip(node));
        return visit(corner, if flip == 0 { mask } else { super::tree::mirror(mask, flip) });
    }
    for slot in 0..1u32 << (3 * F::WIDTH) {
        if let Some(child) = format.child(height, node, slot) {
            let digit = |k: u32| (slot >> (k * F::WIDTH) & ((1 << F::WIDTH) - 1)) as i32;
            let at = |k: u32| corner[k as usize] + (digit(k) << child_log2::<F>(height));
            below(format, height - 1, child, [at(0), at(1), at(2)], visit);
        }
    }
}
