//! Triangles that need care, one by one in f64: at the eye or behind it, cut by a plane, or seen along their plane.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16, f64x8};

use super::Screen;
use super::image::DepthImage;
use super::setup::{Exact, linear};
use crate::occlusion::view::Homogeneous;

/// Draws a triangle. `cuts` holds for each plane that may cut it the heights of its corners above that plane: only what
/// is not below any of them is drawn.
#[inline(always)]
pub(super) fn draw<S: Simd>(
    simd: S,
    corners: [Homogeneous; 3],
    is_parallel: bool,
    cuts: &[[f64; 3]],
    screen: Screen,
    image: &mut DepthImage,
) {
    let Some((rows, columns)) = pixels(&corners, screen) else { return };
    let Some(triangle) = Exact::new(corners, is_parallel) else { return };
    image.touch(rows.0, rows.1);
    for row in rows.0..=rows.1 {
        let Some(span) = span(&triangle, cuts, row, columns) else { continue };
        let start = row * image.stride;
        let texels = &mut image.texels[start..start + columns.1 + 1];
        for column in (span.from..span.sure_from).chain(span.sure_to..span.to) {
            if is_inside(&triangle, cuts, column, row) {
                texels[column] = texels[column].max(triangle.nearness_at(column as f64, row as f64));
            }
        }
        fill(simd, &triangle, row, span.sure_from, &mut texels[span.sure_from..span.sure_to]);
    }
}

/// Columns of a row, ends not included: outside of `from..to` nothing is inside, within `sure_from..sure_to` everything.
struct Span {
    from: usize,
    sure_from: usize,
    sure_to: usize,
    to: usize,
}

/// Height over a cut, times the triangle's determinant, over H: a plane of the image as nearness is, and a sum of the edge
/// functions. Its sign is that of the height, as these were multiplied by the sign of the determinant.
#[inline(always)]
fn over(triangle: &Exact, heights: &[f64; 3]) -> [f64; 3] {
    let [a, b, c] = &triangle.edges;
    let sum = |axis: usize| a[axis] * heights[0] + b[axis] * heights[1] + c[axis] * heights[2];
    [sum(0), sum(1), sum(2)]
}

#[inline(never)]
fn is_inside(triangle: &Exact, cuts: &[[f64; 3]], column: usize, row: usize) -> bool {
    let (column, row) = (column as f64, row as f64);
    triangle.covers(column, row)
        && cuts.iter().all(|heights| linear(&over(triangle, heights), column, row) >= 0.0)
}

/// Between the crossings of the edges with a row, two pixels to either side for the rounding of the quotients.
#[inline(never)]
fn span(triangle: &Exact, cuts: &[[f64; 3]], row: usize, columns: (usize, usize)) -> Option<Span> {
    const EITHER_SIDE: f64 = 2.0;
    let (first, last) = (columns.0 as f64, columns.1 as f64);
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    let of_cuts = cuts.iter().map(|heights| over(triangle, heights));
    for bound in triangle.edges.iter().copied().chain(of_cuts) {
        let at_zero = linear(&bound, 0.0, row as f64);
        let crossing = -at_zero / bound[0];
        if bound[0] > 0.0 {
            from = from.max(crossing);
        } else if bound[0] < 0.0 {
            to = to.min(crossing);
        } else if at_zero < 0.0 {
            return None;
        }
    }
    let (outer, inner) = ((from - EITHER_SIDE).max(first), (from + EITHER_SIDE).ceil().max(first));
    let (outer_to, inner_to) = ((to + EITHER_SIDE).min(last), (to - EITHER_SIDE).floor().min(last));
    if outer > outer_to {
        return None;
    }
    let (from, to) = (outer as usize, outer_to as usize + 1);
    // `as` takes what is below 0 to 0, and what is beyond the numbers to the greatest.
    let (sure_from, sure_to) = ((inner as usize).min(to), (inner_to + 1.0) as usize);
    Some(Span { from, sure_from, sure_to: sure_to.clamp(sure_from, to), to })
}

/// Pixels of a row, from `first` on, that are all inside.
#[inline(always)]
fn fill<S: Simd>(simd: S, triangle: &Exact, row: usize, first: usize, texels: &mut [f32]) {
    const PLACES: [f64; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    let places = f64x8::from_slice(simd, &PLACES);
    let mut runs = texels.chunks_exact_mut(16);
    let mut column = first;
    for run in &mut runs {
        let low = nearness(simd, triangle, places + column as f64, row);
        let high = nearness(simd, triangle, places + (column + 8) as f64, row);
        f32x16::from_slice(simd, run).max(low.narrow(high)).store_slice(run);
        column += 16;
    }
    for texel in runs.into_remainder() {
        *texel = texel.max(triangle.nearness_at(column as f64, row as f64));
        column += 1;
    }
}

/// [`Exact::nearness_at`] of eight pixels.
#[inline(always)]
fn nearness<S: Simd>(simd: S, triangle: &Exact, columns: f64x8<S>, row: usize) -> f64x8<S> {
    let [per_column, per_row, at_zero] = triangle.nearness;
    let plane = columns * per_column + f64x8::splat(simd, row as f64 * per_row) + at_zero;
    let nearness = plane.min(f64x8::splat(simd, triangle.nearest));
    nearness - nearness.abs() * (1.0 / (1u64 << 23) as f64)
}

/// First and last row and column that the triangle may cover: the whole image when a corner is not in front of the eye.
fn pixels(corners: &[Homogeneous; 3], screen: Screen) -> Option<((usize, usize), (usize, usize))> {
    // All corners beyond one side of the image: behind the eye or not, nothing of it is seen.
    let beyond = |outside: &dyn Fn(&Homogeneous) -> bool| corners.iter().all(outside);
    let (last_column, last_row) = (f64::from(screen.last_column), f64::from(screen.last_row));
    if beyond(&|c| c.x < 0.0)
        || beyond(&|c| c.y < 0.0)
        || beyond(&|c| c.x > last_column * c.h)
        || beyond(&|c| c.y > last_row * c.h)
    {
        return None;
    }
    let span = |at: fn(&Homogeneous) -> f64, last: f32| {
        let last = f64::from(last);
        let (mut low, mut high) = (0.0, last);
        if corners.iter().all(|c| c.h >= crate::occlusion::view::LEAST_H) {
            let (least, most) = corners
                .iter()
                .map(|c| at(c) / c.h)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
            low = (least - 1e-6).ceil().max(0.0);
            high = (most + 1e-6).floor().min(last);
        }
        // Not `low > high`: NaN is no bound.
        (low <= high).then_some((low as usize, high as usize))
    };
    Some((span(|c| c.y, screen.last_row)?, span(|c| c.x, screen.last_column)?))
}
