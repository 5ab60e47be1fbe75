//! Flat-sided primitives: extruded outlines (rolled steel, blocks) and plates with openings (walls, gratings).

use glam::{DAffine3, DVec2, DVec3};

use super::shapes::{Detail, turn};
use crate::model::Mesh;

/// A section in local XZ, to be extruded along +Y.
#[derive(Clone, Debug)]
pub(super) enum Outline {
    /// Centred on the origin.
    Rectangle { x: f64, z: f64 },
    /// Rolled I-section with root fillets: height along Z, flange width along X, centred.
    ISection { height: f64, width: f64, web: f64, flange: f64 },
    /// Rolled channel: height along Z, back at X = 0, flanges towards +X.
    Channel { height: f64, width: f64, thickness: f64 },
    /// Regular hexagon, by its width across flats: heads and nuts.
    Hexagon { flats: f64 },
    /// Any simple polygon, turning from +X to +Z, without collinear corners.
    Polygon(Vec<DVec2>),
}

impl Outline {
    /// Corners, turning from +X to +Z.
    pub fn corners(&self, detail: Detail) -> Vec<DVec2> {
        let at = DVec2::new;
        match *self {
            Outline::Rectangle { x, z } => {
                let (x, z) = (x / 2.0, z / 2.0);
                vec![at(-x, -z), at(x, -z), at(x, z), at(-x, z)]
            }
            Outline::ISection { height, width, web, flange } => {
                i_section(height / 2.0, width / 2.0, web / 2.0, flange, detail)
            }
            Outline::Channel { height, width, thickness: t } => {
                let z = height / 2.0;
                vec![
                    at(0.0, -z),
                    at(width, -z),
                    at(width, t - z),
                    at(t, t - z),
                    at(t, z - t),
                    at(width, z - t),
                ]
                .into_iter()
                .chain([at(width, z), at(0.0, z)])
                .collect()
            }
            Outline::Hexagon { flats } => (0..6).map(|side| turn(side, 6) * (flats / SQRT_3)).collect(),
            Outline::Polygon(ref corners) => corners.clone(),
        }
    }
}

/// Width across flats over width from centre to corner, of a regular hexagon.
const SQRT_3: f64 = 1.732_050_807_568_877_2;

/// Half sizes; the root fillet is as large as the flange is thick.
fn i_section(height: f64, width: f64, web: f64, flange: f64, detail: Detail) -> Vec<DVec2> {
    let fillet = flange;
    let steps = (detail.sides(fillet) / 4).max(1);
    // One quarter, from the outer corner of the flange at +X +Z to the web; the other three mirror it.
    let mut quarter = vec![DVec2::new(width, height), DVec2::new(width, height - flange)];
    let centre = DVec2::new(web + fillet, height - flange - fillet);
    for step in 0..=steps {
        let round = turn(step, 4 * steps);
        quarter.push(centre + DVec2::new(-round.y, round.x) * fillet);
    }
    // That quarter runs from +Z towards the middle: against the sense of turning. So do its mirror images in
    // turn, which gives: quarter reversed (+X+Z), then its image in X forward (-X+Z), and so on.
    let mirrored = |x: f64, z: f64| quarter.iter().map(move |corner| *corner * DVec2::new(x, z));
    let mut corners: Vec<DVec2> = mirrored(1.0, 1.0).rev().collect();
    corners.extend(mirrored(-1.0, 1.0));
    corners.extend(mirrored(-1.0, -1.0).rev());
    corners.extend(mirrored(1.0, -1.0));
    corners
}

/// Extrudes `corners` along +Y of `frame`.
pub(super) fn append_prism(corners: &[DVec2], length: f64, frame: &DAffine3, mesh: &mut Mesh) {
    let first = mesh.positions.len() as u32;
    let count = corners.len() as u32;
    for y in [0.0, length] {
        mesh.positions.extend(corners.iter().map(|c| frame.transform_point3(DVec3::new(c.x, y, c.y))));
    }
    for at in 0..count {
        let next = (at + 1) % count;
        let (low, high) = (first, first + count);
        mesh.triangles.push([low + at, high + at, high + next]);
        mesh.triangles.push([low + at, high + next, low + next]);
    }
    for [a, b, c] in clip_ears(corners) {
        mesh.triangles.push([first + a, first + b, first + c]);
        mesh.triangles.push([first + count + a, first + count + c, first + count + b]);
    }
}

/// Triangulates a simple polygon that turns from +X to +Z; `corners.len() - 2` triangles, none of zero area.
///
/// Ear clipping (Meisters 1975): cut off a convex corner whose closed triangle holds no other corner.
fn clip_ears(corners: &[DVec2]) -> Vec<[u32; 3]> {
    let mut left: Vec<usize> = (0..corners.len()).collect();
    let mut triangles = Vec::with_capacity(corners.len());
    // Twice the signed area. Indices come from `left`, so they are below corners.len().
    let area = |a: usize, b: usize, c: usize| (corners[b] - corners[a]).perp_dot(corners[c] - corners[a]);
    while left.len() > 3 {
        let count = left.len();
        let corner = |at: usize| left[at % count];
        let is_ear = |&at: &usize| {
            let (a, b, c) = (corner(at + count - 1), corner(at), corner(at + 1));
            area(a, b, c) > 1e-12
                && left.iter().filter(|&&p| p != a && p != b && p != c).all(|&p| {
                    let outside = -1e-12;
                    area(a, b, p) < outside || area(b, c, p) < outside || area(c, a, p) < outside
                })
        };
        // A simple polygon always has an ear; the first corner is the way out for one that is not simple.
        let ear = (0..count).find(is_ear).unwrap_or(0);
        triangles.push([corner(ear + count - 1), corner(ear), corner(ear + 1)].map(|i| i as u32));
        left.remove(ear);
    }
    triangles.extend(left.first_chunk::<3>().map(|last| last.map(|i| i as u32)));
    triangles
}

/// A plate in local XZ, its lower face at Y = 0, cut into cells of which some are openings.
///
/// Openings must not touch each other at a corner: the solid would not be a manifold there.
#[derive(Clone, Debug)]
pub(super) struct Plate {
    /// Cell borders along X, growing.
    pub x: Vec<f64>,
    /// Cell borders along Z, growing.
    pub z: Vec<f64>,
    /// Openings, as (cell along X, cell along Z).
    pub openings: Vec<(usize, usize)>,
    /// Along +Y.
    pub thickness: f64,
}

impl Plate {
    /// A plate from the origin to (`width`, `depth`) with the rectangles `[x0, z0, x1, z1]` cut out. Rectangles may
    /// reach the plate's border, and must not overlap in X.
    pub fn with_openings(width: f64, depth: f64, thickness: f64, cuts: &[[f64; 4]]) -> Self {
        let borders = |low: usize, end: f64| {
            let mut at: Vec<f64> =
                cuts.iter().flat_map(|cut| [cut[low], cut[low + 2]]).chain([0.0, end]).collect();
            at.sort_by(f64::total_cmp);
            at.dedup();
            at
        };
        let (x, z) = (borders(0, width), borders(1, depth));
        let mut openings = Vec::new();
        for (i, x0) in x.iter().enumerate().take(x.len() - 1) {
            for (j, z0) in z.iter().enumerate().take(z.len() - 1) {
                if cuts.iter().any(|c| c[0] <= *x0 && *x0 < c[2] && c[1] <= *z0 && *z0 < c[3]) {
                    openings.push((i, j));
                }
            }
        }
        Plate { x, z, openings, thickness }
    }

    /// A grating panel centred on the origin, with `slots` slots side by side in two rows.
    pub fn grating(width: f64, depth: f64, thickness: f64, slots: usize) -> Self {
        let pitch = width / slots as f64;
        let bar = (pitch * 0.3).min(0.012);
        let x = (0..slots)
            .flat_map(|slot| [slot as f64 * pitch, slot as f64 * pitch + bar])
            .chain([width, width + bar])
            .map(|x| x - width / 2.0)
            .collect();
        let (end, bar) = (depth / 2.0, 0.012);
        let z = vec![-end, bar - end, -bar / 2.0, bar / 2.0, end - bar, end];
        let openings = (0..slots).flat_map(|slot| [(2 * slot + 1, 1), (2 * slot + 1, 3)]).collect();
        Plate { x, z, openings, thickness }
    }

    fn columns(&self) -> usize {
        self.x.len() - 1
    }

    fn rows(&self) -> usize {
        self.z.len() - 1
    }

    /// Which cells are solid, row by row.
    fn solid(&self) -> Vec<bool> {
        let mut solid = vec![true; self.columns() * self.rows()];
        for &(i, j) in &self.openings {
            if let Some(cell) = solid.get_mut(j * self.columns() + i) {
                *cell = false;
            }
        }
        solid
    }

    /// Calls back with each border edge between a solid cell and none: its two grid corners, in the sense in which
    /// the solid turns from +X to +Z.
    fn each_edge(&self, solid: &[bool], mut edge: impl FnMut((usize, usize), (usize, usize))) {
        let is_solid = |i: Option<usize>, j: Option<usize>| matches!((i, j), (Some(i), Some(j)) if i < self.columns() && j < self.rows() && solid[j * self.columns() + i]);
        for j in 0..self.rows() {
            for i in 0..self.columns() {
                if !is_solid(Some(i), Some(j)) {
                    continue;
                }
                let around = [
                    ((Some(i), j.checked_sub(1)), (i, j), (i + 1, j)),
                    ((Some(i + 1), Some(j)), (i + 1, j), (i + 1, j + 1)),
                    ((Some(i), Some(j + 1)), (i + 1, j + 1), (i, j + 1)),
                    ((i.checked_sub(1), Some(j)), (i, j + 1), (i, j)),
                ];
                for ((ni, nj), from, to) in around {
                    if !is_solid(ni, nj) {
                        edge(from, to);
                    }
                }
            }
        }
    }

    /// Triangles of the plate.
    pub fn triangles(&self) -> u64 {
        let solid = self.solid();
        let mut edges = 0;
        self.each_edge(&solid, |_, _| edges += 1);
        4 * solid.iter().filter(|solid| **solid).count() as u64 + 2 * edges
    }

    /// Appends the plate, placed by `frame`.
    pub fn append(&self, frame: &DAffine3, mesh: &mut Mesh) {
        let solid = self.solid();
        let stride = self.x.len();
        let mut low_vertex = vec![None; stride * self.z.len()];
        // Low vertices are even, the one above each follows it.
        let mut vertex = |(i, j): (usize, usize), mesh: &mut Mesh| {
            *low_vertex[j * stride + i].get_or_insert_with(|| {
                let low = DVec3::new(self.x[i], 0.0, self.z[j]);
                let first = mesh.positions.len() as u32;
                mesh.positions.push(frame.transform_point3(low));
                mesh.positions.push(frame.transform_point3(low + DVec3::Y * self.thickness));
                first
            })
        };
        for j in 0..self.rows() {
            for i in (0..self.columns()).filter(|i| solid[j * self.columns() + i]) {
                let [a, b, c, d] =
                    [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|at| vertex(at, mesh));
                mesh.triangles.extend([[a, b, c], [a, c, d], [a + 1, c + 1, b + 1], [a + 1, d + 1, c + 1]]);
            }
        }
        self.each_edge(&solid, |from, to| {
            let (a, b) = (vertex(from, mesh), vertex(to, mesh));
            mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        });
    }
}
