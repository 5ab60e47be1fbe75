//! Placements of nodes and instances, in f64 as the JSON says them.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::json::Node;

/// The node's own transform; the flag is true if its matrix has a bottom row other than 0 0 0 1, which is
/// ignored.
pub(super) fn of_node(node: &Node) -> (DAffine3, bool) {
    match node.matrix.as_deref().copied() {
        Some([a, b, c, p, d, e, f, q, g, h, i, r, x, y, z, s]) => {
            let matrix = DMat3::from_cols_array(&[a, b, c, d, e, f, g, h, i]);
            let is_projective = [p, q, r, s] != [0.0, 0.0, 0.0, 1.0];
            (DAffine3 { matrix3: matrix, translation: DVec3::new(x, y, z) }, is_projective)
        }
        None => {
            let translation = node.translation.unwrap_or_default();
            let rotation = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
            (from_parts(translation, rotation, node.scale.unwrap_or([1.0; 3])), false)
        }
    }
}

/// Translation * rotation * scale. The quaternion is made a unit first: files hold it in 32 bits or fewer.
/// One that has no direction gives NaN, and so an object that is dropped and counted.
pub(super) fn from_parts(translation: [f64; 3], rotation: [f64; 4], scale: [f64; 3]) -> DAffine3 {
    let [x, y, z, w] = rotation;
    // Without rotation nothing is computed, so nothing is rounded.
    let matrix = if [x, y, z] == [0.0; 3] && w != 0.0 && w.is_finite() {
        DMat3::from_diagonal(scale.into())
    } else {
        let q = DQuat::from_xyzw(x, y, z, w);
        DMat3::from_quat(q * (1.0 / q.length())) * DMat3::from_diagonal(scale.into())
    };
    DAffine3 { matrix3: matrix, translation: translation.into() }
}
