//! How well a drawable fills its box (Peng and Cao 2013, section 6.1, eq. 2).

use fearless_simd::Level;
use glam::DVec3;

use super::boxes::OrientedBox;
use super::mesh::OccluderMesh;
use super::raster::{DepthImage, draw_mesh};
use super::view::{FARTHEST, PartView};

/// Pixels a side of the three projections.
const SIDE: u32 = 64;

/// P_i / R_i of eq. 2 for the three axes of part space: which part of the box's projection the chunk covers. 0 along axes
/// across which the box has no area.
pub fn covered(mesh: &OccluderMesh, min: DVec3, max: DVec3) -> [f64; 3] {
    let extent = max - min;
    let mut image = DepthImage::new(SIDE, SIDE);
    [0, 1, 2].map(|axis| {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        if extent[u] <= 0.0 || extent[v] <= 0.0 {
            return 0.0;
        }
        image.clear(SIDE, SIDE);
        // The box fills the image; nearness does not matter.
        let along = |k: usize| {
            let per_unit = f64::from(SIDE) / extent[k];
            let mut row = [0.0, 0.0, 0.0, -min[k] * per_unit - 0.5];
            row[k] = per_unit;
            row
        };
        let part = PartView { m: [along(u), along(v), [0.0; 4]], is_parallel: true };
        draw_mesh(Level::new(), mesh, part, &mut image);
        let drawn = |row: u32| image.row(row).iter().filter(|&&nearness| nearness > FARTHEST).count();
        (0..SIDE).map(drawn).sum::<usize>() as f64 / f64::from(SIDE * SIDE)
    })
}

/// Eq. 2: the parts that are covered, weighted with the areas A_i of the faces. Between 0 and 1.
pub fn compactness(covered: [f64; 3], placed: &OrientedBox) -> f64 {
    let areas = placed.face_areas();
    let all: f64 = areas.iter().sum();
    if all > 0.0 { areas.iter().zip(covered).map(|(area, part)| area / all * part).sum() } else { 0.0 }
}
