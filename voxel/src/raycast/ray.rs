//! A ray of grid space, and its crossing of planes and cells in f64.
#![allow(clippy::needless_range_loop, reason = "lanes and axes of several arrays at once")]

use glam::DVec3;

use super::PACKET_RAYS;

/// Direction components below this fraction of the largest are taken as 0: over the largest grid they move the ray by
/// less than 2^-40 voxel.
const NEGLIGIBLE: f64 = 1.0 / (1u64 << 60) as f64;

/// Stands for 1/0: larger than any other reciprocal, and still finite after every product.
const PARALLEL: f64 = (1u128 << 100) as f64;

/// Directions with a largest component in this range are used as they come; others are scaled by a power of two, which
/// is exact.
const PLAIN_LENGTHS: std::ops::RangeInclusive<f64> = 1.0 / (1u64 << 20) as f64..=(1u64 << 20) as f64;

/// A ray of grid space: the points `origin + t direction` for `t` in `t_min ..= t_max`.
///
/// The direction may have any length but 0; `t` counts in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridRay {
    /// Any finite point, in voxels from the grid's low corner.
    pub origin: DVec3,
    /// Any finite vector; a zero vector hits nothing.
    pub direction: DVec3,
    /// Start; not negative in most uses, but may be.
    pub t_min: f64,
    /// End; infinity is fine.
    pub t_max: f64,
}

impl GridRay {
    /// From `origin` on without end.
    pub fn new(origin: DVec3, direction: DVec3) -> Self {
        GridRay { origin, direction, t_min: 0.0, t_max: f64::INFINITY }
    }

    /// Clips the ray to the grid of `side` voxels and re-bases it at its entry. `None` when it passes by.
    #[inline(always)]
    pub(super) fn enter(&self, side: f64) -> Option<Walk> {
        let walk = Walk::new(self, side);
        walk.is_inside().then_some(walk)
    }
}

/// A ray re-based at its entry into the grid; its parameter t counts from there.
///
/// Everything that decides which voxels it crosses is a function of [`Walk::at`] alone: where every path calls it, all
/// paths agree to the last bit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    /// Where the ray enters the grid, inside it.
    pub base: [f64; 3],
    pub direction: [f64; 3],
    /// 1/direction; [`PARALLEL`] where the ray stays in a plane.
    pub inverse: [f64; 3],
    /// End of the ray or of the grid; negative when it misses the grid.
    pub t_end: f64,
    pub t_base: f64,
    pub scale: f64,
}

impl Walk {
    /// Without branches, so that loops over many rays become SIMD code. Check [`Walk::is_inside`].
    #[inline(always)]
    pub fn new(ray: &GridRay, side: f64) -> Self {
        let larger = |a: f64, b: f64| if a > b { a } else { b };
        let smaller = |a: f64, b: f64| if a < b { a } else { b };
        let origin = ray.origin.to_array();
        let given = ray.direction.to_array();
        let largest = larger(larger(given[0].abs(), given[1].abs()), given[2].abs());
        let power_of_two = f64::from_bits((largest.to_bits() & f64::INFINITY.to_bits()).max(1));
        let scale = if PLAIN_LENGTHS.contains(&largest) { 1.0 } else { power_of_two };
        let negligible = largest / scale * NEGLIGIBLE;

        let mut walk = Walk {
            base: [0.0; 3],
            direction: [0.0; 3],
            inverse: [PARALLEL; 3],
            t_end: 0.0,
            t_base: 0.0,
            scale,
        };
        let (mut t_in, mut t_out) = (ray.t_min * scale, ray.t_max * scale);
        let mut finite = largest > 0.0 && largest < f64::INFINITY && !t_in.is_nan() && !t_out.is_nan();
        for k in 0..3 {
            let d = given[k] / scale;
            let parallel = d.abs() < negligible;
            let inverse = if parallel { PARALLEL } else { 1.0 / d };
            walk.direction[k] = if parallel { 0.0 } else { d };
            walk.inverse[k] = inverse;
            let (a, b) = ((0.0 - origin[k]) * inverse, (side - origin[k]) * inverse);
            let within = origin[k] >= 0.0 && origin[k] <= side;
            let everywhere = if within { f64::INFINITY } else { f64::NEG_INFINITY };
            t_in = larger(t_in, if parallel { -everywhere } else { smaller(a, b) });
            t_out = smaller(t_out, if parallel { everywhere } else { larger(a, b) });
            finite &= origin[k].abs() < f64::INFINITY && given[k].abs() < f64::INFINITY;
        }
        let inside = finite && t_in <= t_out && t_in.abs() < f64::INFINITY;
        for k in 0..3 {
            let entry = origin[k] + t_in * walk.direction[k];
            walk.base[k] = smaller(larger(0.0, entry), side);
        }
        walk.t_base = t_in;
        walk.t_end = if inside { t_out - t_in } else { -1.0 };
        walk
    }

    /// Does the ray meet the grid at all?
    #[inline(always)]
    pub fn is_inside(&self) -> bool {
        self.t_end >= 0.0
    }

    /// Parameter of the caller's ray.
    #[inline(always)]
    pub fn ray_t(&self, t: f64) -> f64 {
        (self.t_base + t) / self.scale
    }

    /// Where the ray meets the plane at this coordinate of axis k.
    #[inline(always)]
    pub fn at(&self, k: usize, plane: i32) -> f64 {
        (f64::from(plane) - self.base[k]) * self.inverse[k]
    }

    /// Does it run towards larger coordinates of axis k (or in a plane across k)?
    #[inline(always)]
    pub fn rises(&self, k: usize) -> bool {
        self.inverse[k] > 0.0
    }

    /// Axes along which it runs towards smaller coordinates: x, y, z = 1, 2, 4.
    #[inline(always)]
    pub fn flip(&self) -> u32 {
        u32::from(!self.rises(0)) | u32::from(!self.rises(1)) << 1 | u32::from(!self.rises(2)) << 2
    }

    /// Where the ray enters the cell of `size` voxels with this low corner, `None` when it does not cross it: the rule
    /// of the module's documentation.
    #[inline(always)]
    pub fn crosses(&self, low: [i32; 3], size: i32) -> Option<f64> {
        let (mut t_in, mut t_out) = (0.0f64, f64::INFINITY);
        for k in 0..3 {
            let (a, b) = (self.at(k, low[k]), self.at(k, low[k] + size));
            let (near, far) = if self.rises(k) { (a, b) } else { (b, a) };
            t_in = if near > t_in { near } else { t_in };
            t_out = if far < t_out { far } else { t_out };
        }
        (t_in < t_out && t_in <= self.t_end).then_some(t_in)
    }

    /// Where the ray enters a cell of `size` voxels that it crosses; not below 0, its start.
    #[inline(always)]
    pub fn entry(&self, low: [i32; 3], size: i32) -> f64 {
        (0..3).fold(0.0, |t, k| {
            let near = self.at(k, if self.rises(k) { low[k] } else { low[k] + size });
            if near > t { near } else { t }
        })
    }

    /// The voxel in which the ray starts; may lie outside the grid where the ray only touches it.
    pub fn start(&self) -> [i32; 3] {
        [0, 1, 2].map(|k| {
            // Not negative, so that truncation is the floor.
            let c = self.base[k] as i32;
            // On a plane and going down: the ray's first voxel is the one below.
            if f64::from(c) == self.base[k] && !self.rises(k) { c - 1 } else { c }
        })
    }

    /// Coordinate of axis k of the voxel that the ray is in just after `t`, within the cell of `size` voxels that starts
    /// at `low`, from the voxel `before` on.
    #[inline(always)]
    pub fn coordinate_after(&self, k: usize, t: f64, before: i32, low: i32, size: i32) -> i32 {
        // A guess that rounding can make wrong by one, then the planes decide.
        let guess = (self.base[k] + t * self.direction[k]) as i32;
        if self.rises(k) {
            let mut c = guess.clamp(before, low + size - 1);
            while c > before && self.at(k, c) > t {
                c -= 1;
            }
            while c < low + size - 1 && self.at(k, c + 1) <= t {
                c += 1;
            }
            c
        } else {
            let mut c = guess.clamp(low, before);
            while c < before && self.at(k, c + 1) > t {
                c += 1;
            }
            while c > low && self.at(k, c) <= t {
                c -= 1;
            }
            c
        }
    }
}

/// A walk, alone or among others.
#[derive(Clone, Copy)]
pub(super) enum WalkRef<'t> {
    One(&'t Walk),
    Lane(&'t Walks<PACKET_RAYS>, usize),
}

impl WalkRef<'_> {
    pub fn get(self) -> Walk {
        match self {
            WalkRef::One(walk) => *walk,
            WalkRef::Lane(walks, ray) => walks.get(ray),
        }
    }
}

/// Many [`Walk`]s, lane by lane.
#[derive(Clone, Debug)]
pub(super) struct Walks<const N: usize> {
    pub base: [[f64; N]; 3],
    pub direction: [[f64; N]; 3],
    pub inverse: [[f64; N]; 3],
    pub t_end: [f64; N],
    pub t_base: [f64; N],
    pub scale: [f64; N],
}

impl<const N: usize> Walks<N> {
    /// Nothing yet.
    pub fn new() -> Self {
        let empty = [[0.0; N]; 3];
        Walks {
            base: empty,
            direction: empty,
            inverse: empty,
            t_end: empty[0],
            t_base: empty[0],
            scale: empty[0],
        }
    }

    /// What [`Walk::new`] gives, in a loop that becomes SIMD code.
    #[inline(always)]
    pub fn enter(&mut self, rays: &RayLanes<N>, side: f64) {
        let walks = self;
        for i in 0..N {
            let walk = Walk::new(&rays.get(i), side);
            for k in 0..3 {
                walks.base[k][i] = walk.base[k];
                walks.direction[k][i] = walk.direction[k];
                walks.inverse[k][i] = walk.inverse[k];
            }
            walks.t_end[i] = walk.t_end;
            walks.t_base[i] = walk.t_base;
            walks.scale[i] = walk.scale;
        }
    }

    /// One of them.
    #[inline(always)]
    pub fn get(&self, i: usize) -> Walk {
        let pick = |lanes: &[[f64; N]; 3]| [lanes[0][i], lanes[1][i], lanes[2][i]];
        Walk {
            base: pick(&self.base),
            direction: pick(&self.direction),
            inverse: pick(&self.inverse),
            t_end: self.t_end[i],
            t_base: self.t_base[i],
            scale: self.scale[i],
        }
    }
}

/// Rays of grid space, lane by lane.
#[derive(Clone, Debug)]
pub(super) struct RayLanes<const N: usize> {
    pub origin: [[f64; N]; 3],
    pub direction: [[f64; N]; 3],
    pub t_min: [f64; N],
    pub t_max: [f64; N],
}

impl<const N: usize> RayLanes<N> {
    /// Rays that hit nothing.
    pub fn new() -> Self {
        RayLanes { origin: [[0.0; N]; 3], direction: [[0.0; N]; 3], t_min: [0.0; N], t_max: [0.0; N] }
    }

    #[inline(always)]
    pub fn set(&mut self, i: usize, ray: &GridRay) {
        for k in 0..3 {
            self.origin[k][i] = ray.origin[k];
            self.direction[k][i] = ray.direction[k];
        }
        self.t_min[i] = ray.t_min;
        self.t_max[i] = ray.t_max;
    }

    #[inline(always)]
    pub fn get(&self, i: usize) -> GridRay {
        let pick = |lanes: &[[f64; N]; 3]| DVec3::new(lanes[0][i], lanes[1][i], lanes[2][i]);
        GridRay {
            origin: pick(&self.origin),
            direction: pick(&self.direction),
            t_min: self.t_min[i],
            t_max: self.t_max[i],
        }
    }
}
