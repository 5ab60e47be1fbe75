//! Quantization: one grid of power-of-two steps for all chunks of a part.
//!
//! Xue et al. 2016, eq. 1 and 2 divide each box into 2^16 - 1 equal parts. We differ: the step is the next power of
//! two, and every chunk of a part counts from the same origin. So a border vertex has the same coordinates in all
//! its chunks (no cracks), decoding is exact in f32, and the price is at most one bit of the sixteen.

use glam::DVec3;

use super::chunk::Bounds;

/// Largest distance between two cells of a chunk: what 16 bits hold.
const MAX_CELL_SPAN: i64 = u16::MAX as i64;
/// Cells of a part are below this, so that they and their product with a power of two are exact in f32.
const CELL_LIMIT: i64 = 1 << 24;
/// Steps below 2^-100 are not made, so that squares of distances stay normal numbers in f64.
const MIN_EXPONENT: i32 = -100;
/// Extents reach [`MAX_EXTENT`], so that no step needs to be above 2^45.
const MAX_EXPONENT: i32 = 60;
/// No axis is divided finer than this part of the coarsest axis's step: below 2^-24 lies rounding noise of the
/// exporter, which costs bytes and shows nothing.
const MAX_EXPONENT_SPREAD: i32 = 24;
/// Largest extent of a part, in its own units: 2^60, so that areas stay finite in f32.
pub(super) const MAX_EXTENT: f64 = (1u64 << 60) as f64;

/// The grid of a part: position = origin + cell * step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// Low corner of the part's box, in the space of the imported mesh.
    pub origin: DVec3,
    /// Powers of two, each exact in f32.
    pub step: DVec3,
}

impl Grid {
    /// The finest grid on which every one of `chunks` spans at most 65,535 cells and `part`, which encloses them,
    /// less than 2^24. The part's extent is at most [`MAX_EXTENT`].
    ///
    /// An axis on which the part is flat gets the finest step of the others; it decodes exactly.
    pub fn fit(part: &Bounds, chunks: &[Bounds]) -> Grid {
        let exponents = [0, 1, 2].map(|axis| axis_exponent(part, chunks, axis));
        let given = || exponents.iter().flatten().copied();
        let coarsest = given().max().unwrap_or(MIN_EXPONENT);
        let floor = (coarsest - MAX_EXPONENT_SPREAD).max(MIN_EXPONENT);
        let finest = given().min().unwrap_or(MIN_EXPONENT).max(floor);
        let step = exponents.map(|exponent| power_of_two(exponent.map_or(finest, |e| e.max(floor))));
        Grid { origin: part.min, step: DVec3::from_array(step) }
    }

    /// The cell nearest to `position`, per axis: decoding it gives a coordinate within half a step of
    /// `position - origin`, in exact arithmetic.
    pub fn cell(&self, position: DVec3) -> [i64; 3] {
        [0, 1, 2].map(|axis| nearest_cell(position[axis], self.origin[axis], self.step[axis]))
    }

    /// Half the coarsest step of the axes on which `part` is not flat; 0 for a point. Part units.
    pub fn position_error(&self, part: &Bounds) -> f64 {
        let extent = part.extent();
        (0..3).filter(|&axis| extent[axis] > 0.0).map(|axis| self.step[axis] / 2.0).fold(0.0, f64::max)
    }
}

/// Largest extent per axis that a chunk may have so that half a step is at most `max_position_error`.
///
/// Where that cannot be, because a triangle (`longest_triangle`, the extent of the longest per axis) does not fit,
/// or the whole part would have 2^24 cells or more, the limit is the tightest that makes sense, and the grid comes
/// out coarser than asked.
pub(super) fn chunk_extent_limit(
    max_position_error: f64,
    part_extent: DVec3,
    longest_triangle: DVec3,
) -> DVec3 {
    // One cell less than 16 bits hold: rounding both ends outwards adds up to one.
    let span = (MAX_CELL_SPAN - 1) as f64;
    let asked = (libm::ilogb(max_position_error).saturating_add(1)).clamp(MIN_EXPONENT, MAX_EXPONENT);
    DVec3::from_array([0, 1, 2].map(|axis| {
        let part_fits = |e: i32| part_extent[axis] <= (CELL_LIMIT - 2) as f64 * power_of_two(e);
        // A chunk as large as its longest triangle would hold little else: twice that, when the goal is lost anyway.
        let triangle_fits = |e: i32| {
            let limit = span * power_of_two(e);
            longest_triangle[axis] <= if e == asked { limit } else { limit / 2.0 }
        };
        let exponent = (asked..MAX_EXPONENT).find(|&e| part_fits(e) && triangle_fits(e));
        span * power_of_two(exponent.unwrap_or(MAX_EXPONENT))
    }))
}

/// Exponent of the smallest power of two that fits along `axis`; `None` where the part is flat.
fn axis_exponent(part: &Bounds, chunks: &[Bounds], axis: usize) -> Option<i32> {
    let origin = part.min[axis];
    if part.extent()[axis] <= 0.0 {
        return None;
    }
    let fits = |exponent: i32| {
        let cell = |v: f64| nearest_cell(v, origin, power_of_two(exponent));
        let part_fits = cell(part.max[axis]) < CELL_LIMIT;
        part_fits && chunks.iter().all(|c| cell(c.max[axis]) - cell(c.min[axis]) <= MAX_CELL_SPAN)
    };
    let chunk_extent = chunks.iter().map(|c| c.extent()[axis]).fold(0.0, f64::max);
    // An extent of 2^k is 65,536 steps of 2^(k - 16), one too many, so that the search may start one above. Only the
    // rounding of the two ends and the limit on the whole part can push it further. `ilogb(0)` is hugely negative.
    let start = libm::ilogb(chunk_extent).saturating_sub(15).clamp(MIN_EXPONENT, MAX_EXPONENT);
    Some((start..MAX_EXPONENT).find(|&exponent| fits(exponent)).unwrap_or(MAX_EXPONENT))
}

/// 2 to the power of `exponent`, exactly, for the normal exponents that this module uses.
fn power_of_two(exponent: i32) -> f64 {
    libm::ldexp(1.0, exponent)
}

/// The integer nearest to the exact value of `(v - origin) / step`, for a `step` that is a power of two.
///
/// The subtraction may round. That moves the quotient onto a tie between two integers but never across one, for
/// ties are representable; so only a tie needs the rounding error (two-sum: Knuth, The Art of Computer Programming
/// 2, 4.2.2) to be decided.
fn nearest_cell(v: f64, origin: f64, step: f64) -> i64 {
    let difference = v - origin;
    let quotient = difference / step;
    let nearest = quotient.round_ties_even();
    if (quotient - nearest).abs() != 0.5 {
        return nearest as i64;
    }
    let taken = difference - v;
    let rest = (v - (difference - taken)) - (origin + taken);
    let decided = if rest > 0.0 {
        quotient.ceil()
    } else if rest < 0.0 {
        quotient.floor()
    } else {
        nearest
    };
    decided as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(min: [f64; 3], max: [f64; 3]) -> Bounds {
        Bounds { min: min.into(), max: max.into() }
    }

    #[test]
    fn a_tie_is_decided_by_what_the_subtraction_lost() {
        assert_eq!(nearest_cell(0.5, 0.0, 1.0), 0);
        assert_eq!(nearest_cell(0.5, -1e-30, 1.0), 1);
        assert_eq!(nearest_cell(1.5, 1e-30, 1.0), 1);
        assert_eq!(nearest_cell(1.5, 0.0, 1.0), 2);
    }

    #[test]
    fn the_step_is_the_smallest_that_fits() {
        for (extent, expected) in
            [(65_535.0, 1.0), (65_536.0, 2.0), (65_535.25, 1.0), (65_535.5, 2.0), (1.0, 1.0 / 32_768.0)]
        {
            let part = bounds([0.0; 3], [extent, extent / 2.0, 0.0]);
            let grid = Grid::fit(&part, &[part]);
            assert_eq!(grid.step, DVec3::new(expected, expected / 2.0, expected / 2.0), "extent {extent}");
        }
    }

    #[test]
    fn the_whole_part_stays_below_two_to_the_24_cells() {
        let part = bounds([0.0; 3], [1.0; 3]);
        let tiny = [bounds([0.0; 3], [1e-6; 3]), bounds([1.0 - 1e-6; 3], [1.0; 3])];
        let grid = Grid::fit(&part, &tiny);
        // 2^24 cells would end in cell 2^24, one too far.
        assert_eq!(grid.step.x, power_of_two(-23));
        assert!(grid.cell(DVec3::ONE)[0] < CELL_LIMIT);
    }

    #[test]
    fn noise_on_a_flat_axis_does_not_make_a_grid_of_its_own() {
        let part = bounds([0.0; 3], [1.0, 1.0, 1e-17]);
        let grid = Grid::fit(&part, &[part]);
        assert_eq!(grid.step.z, grid.step.x * power_of_two(-MAX_EXPONENT_SPREAD));
        assert_eq!(grid.cell(DVec3::new(0.0, 0.0, 1e-17))[2], 0);
    }

    #[test]
    fn extents_from_nothing_to_the_limit_get_normal_steps() {
        for extent in [0.0, f64::MIN_POSITIVE, 1e-60, 1e-30, 1e-6, 1.0, 1e12, MAX_EXTENT] {
            let part = bounds([1.0 - extent, 0.0, -extent], [1.0, extent, extent]);
            let grid = Grid::fit(&part, &[part]);
            for step in grid.step.to_array() {
                assert_eq!(f64::from(step as f32), step, "extent {extent}");
                assert_eq!(libm::frexp(step).0, 0.5, "extent {extent}: {step} is not a power of two");
            }
        }
    }
}
