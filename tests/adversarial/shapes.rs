//! Meshes of the adversarial scenes.

use glam::{DAffine3, DVec2, DVec3};
use voxsight::model::Mesh;

use crate::common::{cuboid, mesh};

/// The box from `min` to `max`.
pub fn block(min: DVec3, max: DVec3) -> Mesh {
    let (centre, half) = (0.5 * (min + max), 0.5 * (max - min));
    placed(cuboid(), DAffine3::from_translation(centre) * DAffine3::from_scale(half))
}

/// A mesh moved.
pub fn placed(mut mesh: Mesh, by: DAffine3) -> Mesh {
    mesh.positions.iter_mut().for_each(|p| *p = by.transform_point3(*p));
    mesh
}

/// Several meshes as one.
pub fn joined(meshes: impl IntoIterator<Item = Mesh>) -> Mesh {
    let mut all = Mesh::default();
    for mesh in meshes {
        let first = all.positions.len() as u32;
        all.positions.extend(mesh.positions);
        all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|corner| first + corner)));
    }
    all
}

/// The rectangle from `min` to `max` in the plane z.
pub fn wall(min: DVec2, max: DVec2, z: f64) -> Mesh {
    let corners = [[min.x, min.y, z], [max.x, min.y, z], [max.x, max.y, z], [min.x, max.y, z]];
    mesh(&corners, &[[0, 1, 2], [0, 2, 3]])
}

/// The square of half side `half` around the origin of the plane z, without the rectangle from `min` to `max` in it.
pub fn wall_with_hole(half: f64, min: DVec2, max: DVec2, z: f64) -> Mesh {
    let (low, high) = (DVec2::splat(-half), DVec2::splat(half));
    joined([
        wall(low, DVec2::new(min.x, half), z),
        wall(DVec2::new(max.x, -half), high, z),
        wall(DVec2::new(min.x, -half), DVec2::new(max.x, min.y), z),
        wall(DVec2::new(min.x, max.y), DVec2::new(max.x, half), z),
    ])
}

/// A rod of square section between two points.
pub fn rod(from: DVec3, to: DVec3, half_thickness: f64) -> Mesh {
    let along = to - from;
    let side = along.normalize_or(DVec3::X).any_orthonormal_vector() * half_thickness;
    let other = along.cross(side).normalize_or_zero() * half_thickness;
    let axes = glam::DMat3::from_cols(0.5 * along, side, other);
    placed(cuboid(), DAffine3::from_mat3_translation(axes, 0.5 * (from + to)))
}
