//! Triangles that need care, one by one in f64: at the eye or behind it, cut by a plane, or seen along their plane.

use super::Screen;
use super::image::DepthImage;
use super::setup::{Exact, linear};
use crate::occlusion::view::Homogeneous;

/// Draws a triangle. `cuts` holds for each plane that may cut it the heights of its corners above that plane: only what
/// is not below any of them is drawn.
pub(super) fn draw(
    corners: [Homogeneous; 3],
    is_parallel: bool,
    cuts: &[[f64; 3]],
    screen: Screen,
    image: &mut DepthImage,
) {
    let Some(triangle) = Exact::new(corners, is_parallel) else { return };
    // A height over H is a plane of the image as nearness is, and a sum of the edge functions: its sign is
    // that of the sum, as these were multiplied by the sign of the determinant.
    let mut bounds = triangle.edges.to_vec();
    bounds.extend(cuts.iter().map(|heights| {
        std::array::from_fn(|axis| (0..3).map(|i| triangle.edges[i][axis] * heights[i]).sum())
    }));
    let Some((rows, columns)) = pixels(&corners, screen) else { return };
    image.touch(rows.0, rows.1);
    for row in rows.0..=rows.1 {
        // Between the crossings of the edges, a pixel more on either side.
        let (mut from, mut to) = (columns.0 as f64, columns.1 as f64);
        for bound in &bounds {
            let at_zero = linear(bound, 0.0, row as f64);
            let crossing = -at_zero / bound[0];
            if bound[0] > 0.0 {
                from = from.max(crossing.floor() - 1.0);
            } else if bound[0] < 0.0 {
                to = to.min(crossing.ceil() + 1.0);
            } else if at_zero < 0.0 {
                to = f64::NEG_INFINITY;
            }
        }
        if from > to {
            continue;
        }
        let start = row * image.stride;
        for column in from as usize..=to as usize {
            let at = (column as f64, row as f64);
            if bounds.iter().all(|bound| linear(bound, at.0, at.1) >= 0.0) {
                let texel = &mut image.texels[start + column];
                *texel = texel.max(triangle.nearness_at(at.0, at.1));
            }
        }
    }
}

/// First and last row and column that the triangle may cover: the whole image when a corner is not in front of the eye.
fn pixels(corners: &[Homogeneous; 3], screen: Screen) -> Option<((usize, usize), (usize, usize))> {
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
