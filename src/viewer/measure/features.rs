//! Vertices and feature edges of a part: what a measurement snaps to.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use glam::DVec3;

use crate::exact::ExactScene;

/// Triangles that meet at a larger angle than this make an edge; at a smaller one they are a smooth face.
const CREASE_DEG: f64 = 30.0;

/// A triangle narrower than this fraction of its side has no direction from that side that rounding would not decide.
const NARROW: f64 = 1e-6;

/// More triangles than this at one edge are no face.
const MOST_AT_AN_EDGE: usize = 64;

/// Vertices, triangles and feature edges of a part, part space. Made once for a part, used at each move of the cursor.
///
/// A feature edge has a triangle that no other one continues on its other side: a boundary, or a bend of more than 30 degrees. How
/// triangles are wound does not matter, nor whether a sheet has both its sides.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Features {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    edges: Vec<[u32; 2]>,
}

impl Features {
    /// Of triangles, which are given by the positions of their corners. Equal positions become one vertex; a triangle with two
    /// equal corners is left out.
    pub fn new(triangles: impl IntoIterator<Item = [DVec3; 3]>) -> Self {
        let mut features = Features::default();
        let mut known = HashMap::new();
        for corners in triangles {
            let [a, b, c] = corners.map(|corner| features.weld(&mut known, corner));
            if a != b && b != c && c != a {
                features.triangles.push([a, b, c]);
            }
        }
        features.edges = features.find_edges();
        features
    }

    /// Of drawables that are the chunks of one object, at level 0. All of them are needed: where a part was split into chunks
    /// there is no edge.
    ///
    /// # Panics
    ///
    /// The scene has no such drawable.
    pub fn of_drawables(exact: &ExactScene, drawables: impl IntoIterator<Item = u32>) -> Self {
        let chunks = drawables.into_iter().map(|drawable| &exact.chunks()[exact.chunk_of(drawable) as usize]);
        Features::new(chunks.flat_map(|chunk| (0..chunk.triangle_count()).map(|i| chunk.triangle(i))))
    }

    /// Distinct positions, part space.
    pub fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// Corners of the triangles; every index is below the number of vertices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Ends of the feature edges; every index is below the number of vertices.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// The vertex at a position.
    fn weld(&mut self, known: &mut HashMap<[u64; 3], u32>, position: DVec3) -> u32 {
        // -0 is where 0 is.
        let key = (position + 0.0).to_array().map(f64::to_bits);
        match known.entry(key) {
            Entry::Occupied(there) => *there.get(),
            Entry::Vacant(new) => {
                self.vertices.push(position);
                *new.insert(self.vertices.len() as u32 - 1)
            }
        }
    }

    fn find_edges(&self) -> Vec<[u32; 2]> {
        // `weld` made the indices of these vertices.
        let at = |vertex: u32| self.vertices[vertex as usize];
        let sides = |&[a, b, c]: &[u32; 3]| {
            [(a, b, c), (b, c, a), (c, a, b)]
                .map(|(a, b, c)| Side { ends: [a.min(b), a.max(b)], inward: inward(at(a), at(b), at(c)) })
        };
        let mut sides: Vec<Side> = self.triangles.iter().flat_map(sides).collect();
        sides.sort_unstable_by_key(|side| side.ends);
        let edges = sides.chunk_by(|a, b| a.ends == b.ends);
        edges.filter(|around| is_feature(around)).filter_map(|around| Some(around.first()?.ends)).collect()
    }
}

/// A side of a triangle.
struct Side {
    /// The lower vertex first.
    ends: [u32; 2],
    /// From the side into the triangle, in its plane and at a right angle to the side, length 1; zero for a triangle without
    /// area.
    inward: DVec3,
}

/// [`Side::inward`] of the side from `a` to `b`.
fn inward(a: DVec3, b: DVec3, c: DVec3) -> DVec3 {
    let (along, to_c) = (b - a, c - a);
    let across = to_c - along * (to_c.dot(along) / along.length_squared());
    let longest = along.length().max(to_c.length());
    if across.length() > NARROW * longest { across.normalize_or_zero() } else { DVec3::ZERO }
}

/// Is there a triangle at the edge that no other continues? One without area, such as fills a gap between a long side and
/// two short ones, continues any.
fn is_feature(around: &[Side]) -> bool {
    let straight_on = -CREASE_DEG.to_radians().cos();
    let continues = |side: &Side, other: &Side| {
        side.inward == DVec3::ZERO
            || other.inward == DVec3::ZERO
            || side.inward.dot(other.inward) <= straight_on
    };
    around.len() > MOST_AT_AN_EDGE
        || around.iter().any(|side| !around.iter().any(|other| continues(side, other)))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// The box from -1 to 1, wound outward.
    pub fn cuboid() -> Vec<[DVec3; 3]> {
        let corner = |i: usize| DVec3::from([0, 1, 2].map(|k| if i >> k & 1 == 1 { 1.0 } else { -1.0 }));
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let split = |f: [usize; 4]| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]];
        faces.into_iter().flat_map(split).map(|t| t.map(corner)).collect()
    }

    /// A closed cylinder of radius 1 from z = -1 to 1 with so many sides, wound outward.
    pub fn cylinder(sides: u32) -> Vec<[DVec3; 3]> {
        let at = |i: u32, z: f64| {
            let angle = f64::from(i % sides) / f64::from(sides) * std::f64::consts::TAU;
            DVec3::new(angle.cos(), angle.sin(), z)
        };
        let side = |i: u32| {
            let [a, b, c, d] = [at(i, -1.0), at(i + 1, -1.0), at(i + 1, 1.0), at(i, 1.0)];
            [[a, b, c], [a, c, d], [DVec3::NEG_Z, b, a], [DVec3::Z, d, c]]
        };
        (0..sides).flat_map(side).collect()
    }

    fn edge_lengths(features: &Features) -> Vec<f64> {
        let length =
            |&[a, b]: &[u32; 2]| features.vertices[a as usize].distance(features.vertices[b as usize]);
        let mut lengths: Vec<f64> = features.edges.iter().map(length).collect();
        lengths.sort_by(f64::total_cmp);
        lengths
    }

    #[test]
    fn a_box_has_its_twelve_edges_and_no_diagonals() {
        let features = Features::new(cuboid());
        assert_eq!((features.vertices.len(), features.triangles.len()), (8, 12));
        assert_eq!(edge_lengths(&features), [2.0; 12]);
        // Wound anyhow, and with every triangle doubled, it is the same box.
        let every_third_turned =
            |(i, [a, b, c]): (usize, [DVec3; 3])| if i % 3 == 0 { [a, c, b] } else { [a, b, c] };
        assert_eq!(Features::new(cuboid().into_iter().enumerate().map(every_third_turned)).edges.len(), 12);
        assert_eq!(Features::new(cuboid().into_iter().chain(cuboid())).edges, features.edges);
    }

    #[test]
    fn cylinders_are_smooth_from_thirteen_sides_on() {
        for (sides, has_sides) in [(8, true), (11, true), (13, false), (24, false), (90, false)] {
            let features = Features::new(cylinder(sides));
            let expected = if has_sides { 3 * sides } else { 2 * sides };
            assert_eq!(features.edges.len() as u32, expected, "{sides} sides");
        }
    }

    #[test]
    fn boundaries_are_edges_and_sheets_of_two_sides_have_no_others() {
        let [a, b, c, d] = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        let sheet = [[a, b, c], [a, c, d]];
        assert_eq!(edge_lengths(&Features::new(sheet)), [1.0; 4]);
        let both = sheet.into_iter().chain(sheet.map(|[a, b, c]| [a, c, b]));
        assert_eq!(edge_lengths(&Features::new(both)), [1.0; 4]);
        // A rib on the diagonal makes it an edge.
        let rib = sheet.into_iter().chain([[a, c, c + DVec3::Z]]);
        assert_eq!(Features::new(rib).edges.len(), 7);
    }

    #[test]
    fn triangles_without_area_make_no_edges() {
        let [a, b, c, d] =
            [DVec3::ZERO, DVec3::X * 2.0, DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, -1.0, 0.0)];
        let middle = DVec3::X;
        // Below the x axis one triangle, above it two, and between them one without area.
        let filled = [[a, d, b], [a, middle, c], [middle, b, c], [a, b, middle]];
        assert_eq!(Features::new(filled).edges.len(), 4);
        assert_eq!(
            Features::new([[a, a, b], [c, d, c]]),
            Features { vertices: vec![a, b, c, d], ..Default::default() }
        );
        assert_eq!(Features::new([[DVec3::new(-0.0, 0.0, 0.0), b, c], [a, d, b]]).vertices.len(), 4);
    }
}
