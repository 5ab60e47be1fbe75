//! The rasterizer once more, as plainly as it can be written: every pixel against every triangle, in f64.

use super::identity;
use super::image::DepthImage;
use super::setup::Exact;
use crate::occlusion::view::View;

/// Adds triangles of world space to an image. Covers the same centres as [`super::draw_triangles`], exactly; nearness is
/// rounded to f32 and no further.
pub fn draw_triangles(view: &View, triangles: &[[[f32; 3]; 3]], image: &mut DepthImage) {
    let (width, height) = image.size();
    if width == 0 || height == 0 {
        return;
    }
    image.touch(0, height as usize - 1);
    let part = identity(view);
    for corners in triangles {
        let Some(triangle) = Exact::new(corners.map(|c| part.point(c)), view.is_parallel()) else { continue };
        for row in 0..height as usize {
            for column in 0..width as usize {
                if triangle.covers(column as f64, row as f64) {
                    let texel = &mut image.texels[row * image.stride + column];
                    *texel = texel.max(triangle.nearness_at(column as f64, row as f64));
                }
            }
        }
    }
}
