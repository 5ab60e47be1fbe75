//! Makes a [`Mesh`] that keeps the promises of `model`: finite coordinates, indices in range, no triangle
//! with a repeated corner, no vertex that no triangle uses. What is dropped is counted.

use std::collections::HashMap;

use glam::DVec3;

use crate::model::Mesh;
use crate::report::Findings;

/// Coordinates beyond this are damage, not geometry: at 1e15 metres an f64 resolves 12 cm.
pub(super) const MAX_COORDINATE: f64 = 1e15;

/// Most triangles in one part, so that even unshared corners can be numbered by a u32.
pub(super) const MAX_PART_TRIANGLES: u64 = (u32::MAX as u64 - 2) / 3;

/// Triangles that were dropped, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Dropped {
    pub out_of_range: u64,
    pub repeated_corner: u64,
    pub not_finite: u64,
    pub too_far: u64,
}

impl Dropped {
    /// Writes the counts down; `place` names the mesh.
    pub fn report(self, findings: &mut Findings, place: impl Fn() -> String) {
        let reasons = [
            ("triangles dropped: an index is out of range", self.out_of_range),
            ("triangles dropped: two corners are the same vertex", self.repeated_corner),
            ("triangles dropped: a coordinate is not a finite number", self.not_finite),
            ("triangles dropped: a coordinate is beyond 1e15", self.too_far),
        ];
        for (reason, count) in reasons {
            findings.add(reason, count, &place);
        }
    }
}

/// Where each vertex of a source went. Numbers are given in the order of first use, which is kind to caches
/// and independent of vertices that nothing uses.
pub(super) enum Remap {
    /// One entry a source vertex.
    Dense {
        /// New number, or one of the marks below.
        table: Vec<u32>,
        /// Source vertices whose entry is set, so that clearing costs only what was used.
        touched: Vec<u32>,
    },
    /// For a few triangles out of a huge shared vertex buffer.
    Sparse(HashMap<u32, u32>),
}

// No new number reaches the marks: see MAX_PART_TRIANGLES.
const UNSEEN: u32 = u32::MAX;
const NOT_FINITE: u32 = u32::MAX - 1;
const TOO_FAR: u32 = u32::MAX - 2;

impl Remap {
    /// For a source of `vertices`, of which about `corners` will be looked up.
    pub fn new(vertices: usize, corners: usize) -> Self {
        if vertices / 8 > corners {
            Remap::Sparse(HashMap::new())
        } else {
            Remap::Dense { table: vec![UNSEEN; vertices], touched: Vec::new() }
        }
    }

    /// Forgets everything; the source stays the same.
    pub fn clear(&mut self) {
        match self {
            Remap::Dense { table, touched } => {
                for vertex in touched.drain(..) {
                    if let Some(entry) = table.get_mut(vertex as usize) {
                        *entry = UNSEEN;
                    }
                }
            }
            Remap::Sparse(map) => map.clear(),
        }
    }

    fn get(&self, vertex: u32) -> u32 {
        match self {
            Remap::Dense { table, .. } => table.get(vertex as usize).copied().unwrap_or(UNSEEN),
            Remap::Sparse(map) => map.get(&vertex).copied().unwrap_or(UNSEEN),
        }
    }

    fn set(&mut self, vertex: u32, to: u32) {
        match self {
            Remap::Dense { table, touched } => {
                if let Some(entry) = table.get_mut(vertex as usize) {
                    *entry = to;
                    touched.push(vertex);
                }
            }
            Remap::Sparse(map) => {
                map.insert(vertex, to);
            }
        }
    }
}

/// Appends `triangles` over a source of `vertices` vertices to `mesh`, leaving out what is broken.
///
/// `position` is asked only for indices below `vertices`. `remap` belongs to the source and the mesh:
/// appending again with the same one shares vertices. The caller keeps to [`MAX_PART_TRIANGLES`].
pub(super) fn append(
    mesh: &mut Mesh,
    vertices: usize,
    position: impl Fn(u32) -> DVec3,
    triangles: impl Iterator<Item = [u32; 3]>,
    remap: &mut Remap,
    dropped: &mut Dropped,
) {
    for corners in triangles {
        if corners.iter().any(|&corner| corner as usize >= vertices) {
            dropped.out_of_range += 1;
            continue;
        }
        let [a, b, c] = corners;
        if a == b || b == c || c == a {
            dropped.repeated_corner += 1;
            continue;
        }
        let mut numbers = corners.map(|corner| remap.get(corner));
        for (number, &corner) in numbers.iter_mut().zip(&corners) {
            if *number == UNSEEN {
                let mark = fault_of(position(corner));
                if mark != UNSEEN {
                    remap.set(corner, mark);
                    *number = mark;
                }
            }
        }
        // One reason a triangle: the graver one.
        if numbers.contains(&NOT_FINITE) {
            dropped.not_finite += 1;
            continue;
        }
        if numbers.contains(&TOO_FAR) {
            dropped.too_far += 1;
            continue;
        }
        for (number, &corner) in numbers.iter_mut().zip(&corners) {
            if *number == UNSEEN {
                *number = mesh.positions.len() as u32;
                mesh.positions.push(position(corner));
                remap.set(corner, *number);
            }
        }
        mesh.triangles.push(numbers);
    }
}

/// [`append`] for a whole mesh of its own.
pub(super) fn tidy(positions: &[DVec3], triangles: &[[u32; 3]], dropped: &mut Dropped) -> Mesh {
    let mut mesh = Mesh::default();
    mesh.triangles.reserve(triangles.len());
    let mut remap = Remap::new(positions.len(), 3 * triangles.len());
    let position = |i: u32| positions.get(i as usize).copied().unwrap_or(DVec3::NAN);
    append(&mut mesh, positions.len(), position, triangles.iter().copied(), &mut remap, dropped);
    mesh
}

fn fault_of(position: DVec3) -> u32 {
    if !position.is_finite() {
        NOT_FINITE
    } else if position.abs().max_element() > MAX_COORDINATE {
        TOO_FAR
    } else {
        UNSEEN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_broken_is_dropped_by_reason_and_what_is_unused_with_it() {
        let at = |x| DVec3::new(x, x * x, 1.0);
        let positions =
            [at(9.0), at(0.0), at(1.0), DVec3::NAN, at(2.0), DVec3::splat(2e15), at(f64::INFINITY)];
        let triangles =
            [[1, 2, 4], [1, 2, 3], [3, 5, 1], [2, 4, 5], [1, 1, 2], [1, 2, 7], [4, 2, 6], [4, 2, 1]];
        let mut dropped = Dropped::default();
        let mesh = tidy(&positions, &triangles, &mut dropped);
        assert_eq!(dropped, Dropped { out_of_range: 1, repeated_corner: 1, not_finite: 3, too_far: 1 });
        assert_eq!(mesh.positions, [at(0.0), at(1.0), at(2.0)]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 0]]);
    }

    #[test]
    fn a_sparse_remap_gives_the_same_mesh_as_a_dense_one() {
        let positions: Vec<_> = (0..1000).map(|i| DVec3::new(f64::from(i), 0.5, 0.25)).collect();
        let triangles = [[999, 3, 500], [3, 4, 999], [3, 3, 4]];
        let mut dropped = Dropped::default();
        let sparse = tidy(&positions, &triangles, &mut dropped);
        let mut dense = Mesh::default();
        let mut remap = Remap::new(1000, 1000);
        assert!(matches!(remap, Remap::Dense { .. }));
        for _ in 0..2 {
            dense = Mesh::default();
            remap.clear();
            let at = |i: u32| positions[i as usize];
            append(&mut dense, 1000, at, triangles.iter().copied(), &mut remap, &mut dropped);
        }
        assert_eq!(sparse, dense);
    }
}
