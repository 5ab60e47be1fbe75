//! The triangle in one coordinate plane: its three edge axes, tested against 4x4 columns of cells at a time.

use fearless_simd::{Simd, i32x4, i32x16, prelude::*};

use super::STEPS_LOG2;

/// Below this magnitude of all relative coordinates, in steps, edge values fit in 32 bits: a product is below 2^29
/// (a component of an edge is below twice this), the sum of two below 2^30.
pub(super) const SMALL: i32 = 1 << 14;

/// The two coordinates that stay when axis 0, 1, 2 (x, y, z) is projected away.
pub(super) const KEPT_AXES: [(usize, usize); 3] = [(1, 2), (0, 2), (0, 1)];

/// The three edge axes of a triangle in a coordinate plane. A vector of four has a lane for each edge, the last unused.
#[derive(Clone, Copy)]
pub(super) struct Projection<S: Simd> {
    /// What cells 0 to 3 along both axes, each of four cells a side, add to the values: multiples of 4 normals.
    along: [[i32x4<S>; 4]; 2],
    /// Of each edge: what the 4x4 columns, bit a + 4 b, add to the value of the first one.
    steps: [i32x16<S>; 3],
    /// The triangle's interval of `normal . point`, widened by one step on both sides and in units of 256 steps, rounded
    /// inwards.
    low: i32x4<S>,
    high: i32x4<S>,
    /// Sums of the positive and of the negative components of the normals.
    positive: i32x4<S>,
    negative: i32x4<S>,
}

/// Interval of a cell's value, for three edge axes and cells of one size, ready for one signed comparison:
/// `value + offset < limit`.
#[derive(Clone, Copy)]
pub(super) struct EdgeBounds<S: Simd> {
    pub offset: i32x4<S>,
    limit: i32x4<S>,
}

impl<S: Simd> EdgeBounds<S> {
    /// Values from `low` to `high`, both included; none when `high < low`.
    ///
    /// `value - low` and `high - low` are below 2^31 in magnitude ([`fits_32_bits`]), so that shifting both by -2^31
    /// turns the two-sided test into an unsigned comparison, made with a signed one.
    #[inline(always)]
    fn between(simd: S, low: i32x4<S>, high: i32x4<S>) -> Self {
        let least = i32x4::splat(simd, i32::MIN);
        EdgeBounds { offset: least - low, limit: least + (high - low + 1).max(0) }
    }
}

/// Does all arithmetic on edge values fit in 32 bits for a triangle of this extent (steps, per axis) in a window of
/// `width` voxels a side?
///
/// An edge's normal (a, b) has two components: the edge's extents along the two axes that are kept, exchanged. So
/// d = |a| + |b| is at most the sum of the two largest extents. Values are within d width, bounds are clamped to one past
/// that, and the bounds for whole cells (at most a quarter of the window) add d width / 4; the cells' own steps and both
/// roundings are the rest. In a window of 16 voxels it is always so: d <= 2^26.
#[inline(always)]
pub(super) fn fits_32_bits(extent: [i32; 3], width: i32) -> bool {
    let [x, y, z] = extent.map(i64::from);
    let d = x + y + z - x.min(y).min(z);
    let width = i64::from(width);
    d * (width + width / 4 + 2) + 4 < 1 << 31
}

impl<S: Simd> Projection<S> {
    /// Projects the triangle with corners `v`, in steps from the low corner of a window of `width` voxels, onto the plane
    /// of the coordinates `(a, b)`. `small` says that all coordinates are below [`SMALL`] in magnitude.
    #[inline(always)]
    pub fn new(simd: S, v: &[[i32; 3]; 3], (a, b): (usize, usize), small: bool, width: i32) -> Self {
        let (start_a, start_b) = (corners(simd, v, a, 0), corners(simd, v, b, 0));
        let (end_a, end_b) = (corners(simd, v, a, 1), corners(simd, v, b, 1));
        let (normal_a, normal_b) = (start_b - end_b, end_a - start_a);
        let positive = normal_a.max(0) + normal_b.max(0);
        let negative = normal_a.min(0) + normal_b.min(0);
        let (low, high) = if small {
            // Both ends of an edge have the same value.
            let on_edge = normal_a * start_a + normal_b * start_b;
            let opposite = normal_a * corners(simd, v, a, 2) + normal_b * corners(simd, v, b, 2);
            let widening = positive - negative;
            let low = on_edge.min(opposite) - widening;
            let high = on_edge.max(opposite) + widening;
            (-(-low >> STEPS_LOG2), high >> STEPS_LOG2)
        } else {
            let [low, high] = wide_interval(v, (a, b), width);
            (i32x4::simd_from(simd, low), i32x4::simd_from(simd, high))
        };
        let (of_a, of_b) = (normal_a.to_array(), normal_b.to_array());
        Projection {
            along: [multiples(simd, normal_a), multiples(simd, normal_b)],
            steps: [
                steps_of(simd, of_a[0], of_b[0]),
                steps_of(simd, of_a[1], of_b[1]),
                steps_of(simd, of_a[2], of_b[2]),
            ],
            low,
            high,
            positive,
            negative,
        }
    }

    /// Bounds of the values of cells of `2^level` voxels that overlap the triangle in this projection.
    #[inline(always)]
    pub fn touching(&self, simd: S, level: u32) -> EdgeBounds<S> {
        let low = -(-self.low >> level) - self.positive;
        let high = (self.high >> level) - self.negative;
        EdgeBounds::between(simd, low, high)
    }

    /// Bounds of the values of cells of `2^level` voxels of which every single voxel overlaps the triangle in this
    /// projection.
    #[inline(always)]
    pub fn covering(&self, simd: S, level: u32) -> EdgeBounds<S> {
        // The values of the cell's voxels are 2^level value + 0 ..= (2^level - 1) in each direction.
        let others = (1 << level) - 1;
        let low = self.low - self.positive - self.negative * others;
        let high = self.high - self.negative - self.positive * others;
        EdgeBounds::between(simd, -(-low >> level), high >> level)
    }

    /// Value of the first cell within cell (a, b), 0 to 3 each; `first_cell` is that of the first cell within (0, 0),
    /// four times the value of (0, 0) itself.
    #[inline(always)]
    pub fn descend(&self, first_cell: i32x4<S>, a: i32, b: i32) -> i32x4<S> {
        first_cell + self.along[0][a as usize & 3] + self.along[1][b as usize & 3]
    }

    /// Columns of the 4x4 that lie within the bounds on all three axes: bit a + 4 b. `offset_value` is the first one's
    /// value plus the bounds' offset.
    #[inline(always)]
    pub fn columns(&self, offset_value: i32x4<S>, bounds: &EdgeBounds<S>) -> u16 {
        let first = offset_value.to_array();
        let limit = bounds.limit.to_array();
        let within_0 = (self.steps[0] + first[0]).simd_lt(limit[0]);
        let within_1 = (self.steps[1] + first[1]).simd_lt(limit[1]);
        let within_2 = (self.steps[2] + first[2]).simd_lt(limit[2]);
        (within_0 & within_1 & within_2).to_bitmask() as u16
    }
}

// No closures around vectors: only a function that is always inlined gets the SIMD level of its caller.

/// Coordinate `k` of the corners, a lane each, from corner `first` on around the triangle.
#[inline(always)]
fn corners<S: Simd>(simd: S, v: &[[i32; 3]; 3], k: usize, first: usize) -> i32x4<S> {
    i32x4::simd_from(simd, [v[first][k], v[(first + 1) % 3][k], v[(first + 2) % 3][k], 0])
}

#[inline(always)]
fn multiples<S: Simd>(simd: S, normal: i32x4<S>) -> [i32x4<S>; 4] {
    let n = normal << 2;
    let twice = n + n;
    [i32x4::splat(simd, 0), n, twice, twice + n]
}

/// `a i + b j` for columns (i, j), bit i + 4 j.
#[inline(always)]
pub(super) fn steps_of<S: Simd>(simd: S, a: i32, b: i32) -> i32x16<S> {
    let across = i32x16::simd_from(simd, [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3]);
    let down = i32x16::simd_from(simd, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3]);
    across * a + down * b
}

/// The triangle's widened interval on its three edge axes in units of 256 steps, clamped to what makes a difference in a
/// window of `width` voxels: one past the values of its columns.
#[inline(never)]
fn wide_interval(v: &[[i32; 3]; 3], (a, b): (usize, usize), width: i32) -> [[i32; 4]; 2] {
    let v = v.map(|p| p.map(i64::from));
    let mut interval = [[0; 4]; 2];
    for e in 0..3 {
        let (start, end, apex) = (v[e], v[(e + 1) % 3], v[(e + 2) % 3]);
        let normal = [start[b] - end[b], end[a] - start[a]];
        let project = |p: [i64; 3]| normal[0] * p[a] + normal[1] * p[b];
        let (on_edge, opposite) = (project(start), project(apex));
        let positive = normal[0].max(0) + normal[1].max(0);
        let negative = normal[0].min(0) + normal[1].min(0);
        let widening = positive - negative;
        let low = -((widening - on_edge.min(opposite)) >> STEPS_LOG2);
        let high = (on_edge.max(opposite) + widening) >> STEPS_LOG2;
        let width = i64::from(width);
        let clamp = |c: i64| c.clamp(negative * width - 1, positive * width + 1) as i32;
        interval[0][e] = clamp(low);
        interval[1][e] = clamp(high);
    }
    interval
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_triangle_fits_32_bits_in_a_window_of_16_voxels_and_not_in_much_larger_ones() {
        let largest = [1 << 25; 3];
        assert!(fits_32_bits(largest, 16));
        assert!(!fits_32_bits(largest, 64));
        assert!(fits_32_bits([3_300_000; 3], 256) && !fits_32_bits([3_400_000; 3], 256));
    }
}
