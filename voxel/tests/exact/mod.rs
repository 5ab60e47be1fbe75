//! Exact oracles for triangle/box overlap, and hostile triangles. Nothing here is fast or rounded.
#![allow(dead_code, reason = "tests and bench use their own parts")]

use glam::DVec3;
use oorandom::Rand64;
use voxsight_voxel::grid::SUBVOXELS;

/// log2 of the units a voxel that exact coordinates are counted in: 2^-30 voxel, about 1e-9.
pub const UNITS_LOG2: u32 = 30;
/// Units a voxel.
pub const UNIT: i64 = 1 << UNITS_LOG2;
/// log2 of the voxels a side of the grid that all triangles lie in, the largest there is.
pub const GRID_LOG2: u32 = 17;
/// Side of that grid in units: coordinates are exact as f64 grid coordinates, too.
pub const SIDE: i64 = UNIT << GRID_LOG2;

/// A triangle in units.
pub type ExactTriangle = [[i64; 3]; 3];

/// A point in units as f64 grid coordinates, without rounding.
pub fn grid_position(p: [i64; 3]) -> DVec3 {
    DVec3::from_array(p.map(|c| c as f64 / UNIT as f64))
}

fn sub<T: Copy + std::ops::Sub<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [i128; 3], b: [i128; 3]) -> [i128; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Do a snapped triangle and a box, in steps, overlap? All 13 axes straight from the definition, in i128.
pub fn snapped_overlaps_box(v: [[i32; 3]; 3], low: [i64; 3], high: [i64; 3]) -> bool {
    let v = v.map(|p| p.map(i128::from));
    let edges = [sub(v[1], v[0]), sub(v[2], v[1]), sub(v[0], v[2])];
    let units = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    let mut axes = vec![cross(edges[0], edges[1])];
    axes.extend(units);
    axes.extend(edges.iter().flat_map(|&e| units.map(|u| cross(e, u))));
    axes.iter().all(|axis| {
        let dot = |p: [i128; 3]| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2];
        let triangle = v.map(dot);
        let corner = |c: i32| [0, 1, 2].map(|k| i128::from(if c >> k & 1 == 1 { high[k] } else { low[k] }));
        let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|c| dot(corner(c)));
        triangle.iter().min() <= corners.iter().max() && triangle.iter().max() >= corners.iter().min()
    })
}

/// Does a snapped triangle touch the cell of `2^shift` voxels at voxel `corner`, widened by one step?
pub fn snapped_touches_cell(v: [[i32; 3]; 3], corner: [i32; 3], shift: u32) -> bool {
    let low = corner.map(|c| i64::from(c * SUBVOXELS) - 1);
    snapped_overlaps_box(v, low, low.map(|c| c + (i64::from(SUBVOXELS) << shift) + 2))
}

/// Sign of `n . p`, for n below 2^98 and p below 2^49: needs 150 bits, so the low 64 bits of n are summed apart.
fn sign_of_dot(n: [i128; 3], p: [i64; 3]) -> i32 {
    let (mut high, mut low) = (0i128, 0i128);
    for k in 0..3 {
        high += (n[k] >> 64) * i128::from(p[k]);
        low += i128::from(n[k] as u64) * i128::from(p[k]);
    }
    high += low >> 64;
    if high < 0 { -1 } else { i32::from(high > 0 || low as u64 != 0) }
}

/// Does the triangle itself, neither snapped nor widened, touch the closed box from `low` to `high` (units)? Exact.
pub fn exact_overlaps_box(v: ExactTriangle, low: [i64; 3], high: [i64; 3]) -> bool {
    for k in 0..3 {
        let of = v.map(|p| p[k]);
        if of.iter().all(|&c| c < low[k]) || of.iter().all(|&c| c > high[k]) {
            return false;
        }
    }
    for e in 0..3 {
        let (start, edge) = (v[e], sub(v[(e + 1) % 3], v[e]));
        for (a, b) in [(1, 2), (0, 2), (0, 1)] {
            // Values relative to the edge, whose own is 0: below 2^98.
            let value = |x: i64, y: i64| {
                i128::from(edge[a]) * i128::from(y - start[b])
                    - i128::from(edge[b]) * i128::from(x - start[a])
            };
            let apex = v[(e + 2) % 3];
            let opposite = value(apex[a], apex[b]);
            let corners =
                [(low, low), (high, low), (low, high), (high, high)].map(|(x, y)| value(x[a], y[b]));
            if corners.iter().all(|&c| c < opposite.min(0)) || corners.iter().all(|&c| c > opposite.max(0)) {
                return false;
            }
        }
    }
    let normal = cross(sub(v[1], v[0]).map(i128::from), sub(v[2], v[0]).map(i128::from));
    let farthest =
        |sign: i128| [0, 1, 2].map(|k| if normal[k] * sign > 0 { high[k] } else { low[k] } - v[0][k]);
    sign_of_dot(normal, farthest(1)) >= 0 && sign_of_dot(normal, farthest(-1)) <= 0
}

/// Does the triangle itself touch the closed voxel?
pub fn exact_touches_voxel(v: ExactTriangle, voxel: [i32; 3]) -> bool {
    let low = voxel.map(|c| i64::from(c) * UNIT);
    exact_overlaps_box(v, low, low.map(|c| c + UNIT))
}

/// Kinds of triangles, all in a grid of 2^17 voxels a side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Smaller than a voxel.
    Tiny,
    /// 1 to 16 voxels across.
    Small,
    /// 16 to 256 voxels across.
    Medium,
    /// 256 to 8192 voxels across.
    Large,
    /// Corners anywhere in the grid.
    Huge,
    /// Any length, about 1e-9 voxel wide.
    Sliver,
    /// From one side of the grid to another, below a voxel wide.
    Needle,
    /// All corners on corners of voxels.
    OnCorners,
    /// Within a plane between two layers of voxels, or a unit off it.
    InVoxelPlane,
    /// Edges that pass exactly through a corner of a voxel.
    ThroughCorner,
    /// Corners midway between two steps, where snapping rounds by most, or a unit off that.
    OnTies,
    /// Segments and points.
    Degenerate,
}

impl Class {
    /// All of them.
    pub const ALL: [Class; 12] = [
        Class::Tiny,
        Class::Small,
        Class::Medium,
        Class::Large,
        Class::Huge,
        Class::Sliver,
        Class::Needle,
        Class::OnCorners,
        Class::InVoxelPlane,
        Class::ThroughCorner,
        Class::OnTies,
        Class::Degenerate,
    ];

    /// A random triangle of this class.
    pub fn triangle(self, random: &mut Rand64) -> ExactTriangle {
        let centre = [0; 3].map(|_: i64| random.rand_range(0..SIDE as u64 + 1) as i64);
        // A reach in voxels, evenly spread over its logarithm.
        let reach = |random: &mut Rand64, from: f64, to: f64| {
            ((from.ln() + random.rand_float() * (to / from).ln()).exp() * UNIT as f64) as i64
        };
        let any = |random: &mut Rand64| reach(random, 0.1, 65536.0);
        let corners = |random: &mut Rand64, reach: i64| [0; 3].map(|_: i64| near(random, centre, reach));
        let v = match self {
            Class::Tiny => {
                let reach = reach(random, 0.001, 0.5);
                corners(random, reach)
            }
            Class::Small => {
                let reach = reach(random, 0.5, 8.0);
                corners(random, reach)
            }
            Class::Medium => {
                let reach = reach(random, 8.0, 128.0);
                corners(random, reach)
            }
            Class::Large => {
                let reach = reach(random, 128.0, 4096.0);
                corners(random, reach)
            }
            Class::Huge => corners(random, SIDE),
            Class::Sliver => {
                let reach = any(random);
                let [a, b, _] = corners(random, reach);
                let at = random.rand_float();
                let c = [0, 1, 2].map(|k| a[k] + ((b[k] - a[k]) as f64 * at) as i64);
                [a, b, near(random, c, 1)]
            }
            Class::Needle => {
                let [mut a, mut b, _] = corners(random, SIDE);
                let k = random.rand_range(0..3) as usize;
                (a[k], b[k]) = (0, SIDE);
                let width = reach(random, 1e-6, 0.5);
                [a, b, near(random, b, width)]
            }
            Class::OnCorners => {
                let reach = any(random);
                corners(random, reach).map(|p| p.map(|c| (c + UNIT / 2) & -UNIT))
            }
            Class::InVoxelPlane => {
                let reach = any(random);
                let k = random.rand_range(0..3) as usize;
                let off = random.rand_range(0..3) as i64 - 1;
                corners(random, reach).map(|mut p| {
                    p[k] = (centre[k] & -UNIT) + off;
                    p
                })
            }
            Class::ThroughCorner => {
                let reach = any(random);
                let [a, _, c] = corners(random, reach);
                // The middle of the first edge is a corner of a voxel.
                let middle = centre.map(|c| c & -UNIT);
                [a, [0, 1, 2].map(|k| 2 * middle[k] - a[k]), c]
            }
            Class::OnTies => {
                let reach = any(random);
                let step = UNIT / i64::from(SUBVOXELS);
                corners(random, reach)
                    .map(|p| p.map(|c| (c & -step) + step / 2 + random.rand_range(0..3) as i64 - 1))
            }
            Class::Degenerate => {
                let reach = any(random);
                let [a, b, _] = corners(random, reach);
                match random.rand_range(0..4) {
                    0 => [a; 3],
                    1 => [a, a, b],
                    // Along one axis.
                    2 => [a, [b[0], a[1], a[2]], [(a[0] + b[0]) / 2, a[1], a[2]]],
                    _ => [a, b, [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) / 2 * 2)],
                }
            }
        };
        let start = random.rand_range(0..3) as usize;
        [0, 1, 2].map(|i| v[(start + i) % 3].map(|c| c.clamp(0, SIDE)))
    }
}

fn near(random: &mut Rand64, centre: [i64; 3], reach: i64) -> [i64; 3] {
    centre.map(|c| {
        let offset = random.rand_range(0..2 * reach as u64 + 1) as i64 - reach;
        (c + offset).clamp(0, SIDE)
    })
}

/// The brick (its low corner in voxels) around a random point of the triangle, or a neighbour of it.
pub fn brick_near(random: &mut Rand64, v: ExactTriangle) -> [i32; 3] {
    let (mut s, mut t) = (random.rand_float(), random.rand_float());
    if s + t > 1.0 {
        (s, t) = (1.0 - s, 1.0 - t);
    }
    // Corners and edges of the triangle are where tests go wrong.
    match random.rand_range(0..4) {
        0 => t = 0.0,
        1 => (s, t) = (0.0, 0.0),
        _ => {}
    }
    [0, 1, 2].map(|k| {
        let at = v[0][k] as f64 + s * (v[1][k] - v[0][k]) as f64 + t * (v[2][k] - v[0][k]) as f64;
        let step = random.rand_range(0..8).saturating_sub(5) as i32 - i32::from(random.rand_range(0..8) == 0);
        ((at / UNIT as f64) as i32 + step).clamp(0, (1 << GRID_LOG2) - 1) & !3
    })
}
