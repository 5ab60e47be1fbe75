//! Levels of detail of whole parts: no cracks, errors that can be trusted, the same bits every time.

#![allow(clippy::unwrap_used, reason = "the helpers are used by tests only")]

use std::collections::HashMap;

use glam::DVec3;
use voxsight::geometry::{PreparedChunk, PreparedPart, decode};
use voxsight::model::Mesh;
use voxsight::prepare::part::{MAX_CHUNK_TRIANGLES, PartSettings, prepare_part};
use voxsight::report::Findings;

// ---- meshes ----

/// A mesh over a grid of `rings + 1` by `sides` vertices (`sides + 1` if not `closed` around), `place` of each in
/// `[0, 1]^2`; a cell becomes two triangles where `is_solid`.
fn sheet(
    rings: u32,
    sides: u32,
    closed: bool,
    is_solid: impl Fn(f64, f64) -> bool,
    place: impl Fn(f64, f64) -> DVec3,
) -> Mesh {
    let columns = if closed { sides } else { sides + 1 };
    let mut mesh = Mesh::default();
    for ring in 0..=rings {
        for side in 0..columns {
            let (u, v) = (f64::from(ring) / f64::from(rings), f64::from(side) / f64::from(sides));
            mesh.positions.push(place(u, v));
            let middle = (u + 0.5 / f64::from(rings), v + 0.5 / f64::from(sides));
            if ring < rings && side < sides && is_solid(middle.0, middle.1) {
                let right = (side + 1) % columns;
                let at = |ring: u32, side: u32| ring * columns + side;
                let [a, b] = [at(ring, side), at(ring, right)];
                let [c, d] = [at(ring + 1, right), at(ring + 1, side)];
                mesh.triangles.push([a, b, c]);
                mesh.triangles.push([a, c, d]);
            }
        }
    }
    mesh
}

fn circle(v: f64) -> (f64, f64) {
    (libm::cos(v * std::f64::consts::TAU), libm::sin(v * std::f64::consts::TAU))
}

/// Closed: the rings at the poles are points, whose triangles collapse when quantized.
fn sphere(rings: u32) -> Mesh {
    sheet(
        rings,
        2 * rings,
        true,
        |_, _| true,
        |u, v| {
            let (height, radius) = circle(u / 2.0);
            let radius = if u == 0.0 || u == 1.0 { 0.0 } else { radius };
            DVec3::new(circle(v).0 * radius, circle(v).1 * radius, height)
        },
    )
}

fn torus(rings: u32, sides: u32) -> Mesh {
    let mut mesh = sheet(
        rings,
        sides,
        true,
        |_, _| true,
        |u, v| {
            // The last ring is the first: the same bits, welded.
            let (x, y) = circle(if u == 1.0 { 0.0 } else { u });
            let (r, z) = circle(v);
            DVec3::new(x * (3.0 + r), y * (3.0 + r), z)
        },
    );
    mesh.triangles.reverse();
    mesh
}

fn open_cylinder(rings: u32, sides: u32) -> Mesh {
    sheet(rings, sides, true, |_, _| true, |u, v| DVec3::new(circle(v).0, circle(v).1, 10.0 * u))
}

/// A flat plate of 2 by 1 with round holes.
fn plate_with_holes(n: u32) -> Mesh {
    let is_solid = |u: f64, v: f64| {
        let (x, y) = (2.0 * u, v);
        !(1..=3).any(|i| (x - 0.5 * f64::from(i)).hypot(y - 0.5) < 0.05 * f64::from(i))
    };
    sheet(2 * n, n, false, is_solid, |u, v| DVec3::new(2.0 * u, v, 0.0))
}

/// A curved sheet with a narrow rib on it: what averages over planes hide.
fn bumpy_sheet(n: u32) -> Mesh {
    sheet(
        n,
        n,
        false,
        |_, _| true,
        |u, v| {
            let height = if (u - 0.5).abs() < 0.02 { 0.02 } else { 0.0 };
            DVec3::new(u, v, height + 0.05 * libm::sin(9.0 * u) * libm::cos(7.0 * v))
        },
    )
}

// ---- helpers ----

fn prepare(mesh: &Mesh, settings: &PartSettings) -> PreparedPart {
    prepare_part(mesh, settings, &mut Findings::default(), &|| "generated".to_owned()).unwrap()
}

fn small_chunks(chunk_triangles: usize) -> PartSettings {
    PartSettings { chunk_triangles, ..PartSettings::default() }
}

type Cell = [i32; 3];

/// Triangles of one level of a chunk, as cells of the part's grid.
fn cells(chunk: &PreparedChunk, level: usize) -> Vec<[Cell; 3]> {
    let mesh = &chunk.levels[level].mesh;
    let cell = |v: u32| {
        let q = mesh.vertices[v as usize];
        [0, 1, 2].map(|axis| chunk.offset[axis] + i32::from(q[axis]))
    };
    mesh.triangles.iter().map(|t| t.map(cell)).collect()
}

/// How many edges have an odd number of triangles.
fn open_edges(triangles: impl Iterator<Item = [Cell; 3]>) -> usize {
    let mut count: HashMap<[Cell; 2], u32> = HashMap::new();
    for [a, b, c] in triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *count.entry([from.min(to), from.max(to)]).or_default() += 1;
        }
    }
    count.values().filter(|&&count| count % 2 == 1).count()
}

/// Triangles of one level of a part of one chunk, in part space.
fn triangles_in_part(part: &PreparedPart, level: usize) -> Vec<[DVec3; 3]> {
    let chunk = &part.chunks[0];
    let mesh = &chunk.levels[level].mesh;
    let at = |v: u32| decode(chunk.offset, mesh.vertices[v as usize], part.step).as_dvec3();
    mesh.triangles.iter().map(|t| t.map(at)).collect()
}

fn segment_distance(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = b - a;
    let t = if along == DVec3::ZERO { 0.0 } else { (p - a).dot(along) / along.length_squared() };
    p.distance(a + along * t.clamp(0.0, 1.0))
}

fn triangle_distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let edges = segment_distance(p, a, b).min(segment_distance(p, b, c)).min(segment_distance(p, c, a));
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let inside =
        [(a, b), (b, c), (c, a)].iter().all(|&(from, to)| normal.cross(to - from).dot(p - from) >= 0.0);
    if inside && normal != DVec3::ZERO { normal.dot(p - a).abs() } else { edges }
}

/// Largest distance of points spread over `from` to the nearest triangle of `to`.
fn sampled_distance(from: &[[DVec3; 3]], to: &[[DVec3; 3]]) -> f64 {
    let weights =
        [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.5, 0.5], [0.5, 0.0], [0.0, 0.5], [1.0 / 3.0, 1.0 / 3.0]];
    let mut worst = 0.0f64;
    for [a, b, c] in from {
        for [u, v] in weights {
            let p = *a * u + *b * v + *c * (1.0 - u - v);
            let nearest = to.iter().map(|&t| triangle_distance(p, t)).fold(f64::INFINITY, f64::min);
            worst = worst.max(nearest);
        }
    }
    worst
}

fn assert_well_formed(part: &PreparedPart, what: &str) {
    for (c, chunk) in part.chunks.iter().enumerate() {
        assert_eq!(chunk.levels[0].error, 0.0);
        for (l, level) in chunk.levels.iter().enumerate() {
            let mesh = &level.mesh;
            assert!(!mesh.triangles.is_empty(), "{what}: chunk {c}, level {l} is empty");
            assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < mesh.vertices.len()));
            assert!(mesh.triangles.len() <= MAX_CHUNK_TRIANGLES);
            assert!(level.error.is_finite() && level.error >= 0.0);
            if let Some(coarser) = chunk.levels.get(l + 1) {
                assert!(coarser.mesh.triangles.len() < mesh.triangles.len(), "{what}: chunk {c}, level {l}");
                assert!(coarser.error >= level.error, "{what}: chunk {c}, level {l}");
                let all: std::collections::HashSet<[u16; 3]> = mesh.vertices.iter().copied().collect();
                assert!(
                    coarser.mesh.vertices.iter().all(|v| all.contains(v)),
                    "{what}: chunk {c}, level {l}"
                );
            }
        }
    }
}

/// A closed mesh stays closed at level 0, at the coarsest levels, and at `mixes` random levels per chunk.
fn assert_no_cracks(part: &PreparedPart, mixes: u64, what: &str) {
    assert!(part.chunks.len() > 1, "{what}: one chunk has no borders");
    let glued = |level_of: &mut dyn FnMut(&PreparedChunk) -> usize| {
        let all: Vec<_> = part.chunks.iter().flat_map(|c| cells(c, level_of(c))).collect();
        open_edges(all.into_iter())
    };
    assert_eq!(glued(&mut |_| 0), 0, "{what}, level 0");
    assert_eq!(glued(&mut |c| c.levels.len() - 1), 0, "{what}, coarsest");
    for seed in 0..mixes {
        let mut random = oorandom::Rand64::new(seed.into());
        let open = glued(&mut |c| random.rand_range(0..c.levels.len() as u64) as usize);
        assert_eq!(open, 0, "{what}, seed {seed}: cracks between levels");
    }
}

// ---- tests ----

#[test]
fn a_big_sphere_becomes_full_chunks_without_cracks_at_any_mix_of_levels() {
    let mesh = sphere(230);
    assert!(mesh.triangles.len() > 3 * MAX_CHUNK_TRIANGLES);
    let part = prepare(&mesh, &PartSettings::default());
    assert_well_formed(&part, "sphere");
    assert!((4..=8).contains(&part.chunks.len()), "{} chunks", part.chunks.len());
    assert_no_cracks(&part, 8, "sphere");
    for chunk in &part.chunks {
        let coarsest = chunk.levels.last().unwrap().mesh.triangles.len();
        // The locked border is what is left: some hundreds of the vertices of a chunk.
        assert!(
            coarsest * 16 < chunk.levels[0].mesh.triangles.len(),
            "coarsest level has {coarsest} triangles"
        );
    }
}

#[test]
fn the_crack_test_sees_one_moved_vertex() {
    let mut part = prepare(&sphere(40), &small_chunks(1_000));
    assert_no_cracks(&part, 1, "sphere");
    let level = part.chunks[1].levels.len() - 1;
    part.chunks[1].levels[level].mesh.vertices[0][0] ^= 1;
    let all: Vec<_> = part.chunks.iter().flat_map(|c| cells(c, c.levels.len() - 1)).collect();
    assert!(open_edges(all.into_iter()) > 0);
}

#[test]
fn small_chunks_of_closed_meshes_have_no_cracks() {
    for (what, mesh) in [("sphere", sphere(60)), ("torus", torus(120, 60))] {
        for chunk_triangles in [50, 700, 3_000] {
            let part = prepare(&mesh, &small_chunks(chunk_triangles));
            assert_well_formed(&part, what);
            assert_no_cracks(&part, 8, &format!("{what}, {chunk_triangles} triangles a chunk"));
        }
    }
}

#[test]
fn each_level_has_about_half_the_triangles_of_the_one_before() {
    for (what, mesh) in
        [("sphere", sphere(90)), ("torus", torus(200, 80)), ("cylinder", open_cylinder(40, 400))]
    {
        let part = prepare(&mesh, &PartSettings::default());
        assert_well_formed(&part, what);
        let counts: Vec<usize> = part.chunks[0].levels.iter().map(|l| l.mesh.triangles.len()).collect();
        for pair in counts.windows(2).filter(|pair| pair[0] > 48) {
            let ratio = pair[1] as f64 / pair[0] as f64;
            assert!((0.4..=0.65).contains(&ratio), "{what}: {counts:?}");
        }
        assert!(*counts.last().unwrap() <= 48, "{what}: {counts:?}");
    }
}

/// How far below the sampled distance a stored error may be. Errors are measured at lost vertices and the middles of
/// triangles and open edges, the distance here at the middles of all edges, too, by brute force. Worst of these meshes:
/// 1.5, first level of the sheet with a rib; of the smooth ones 1.23.
const LARGEST_UNDERESTIMATE: f64 = 1.6;
/// And how far above, on smooth surfaces: see `REFERENCE_DISTANCE` in `prepare::lod`.
const LARGEST_OVERESTIMATE: f64 = 2.0;

#[test]
fn stored_errors_are_close_to_sampled_distances_in_both_directions() {
    let meshes = [
        ("sphere", sphere(16), true),
        ("torus", torus(36, 16), true),
        ("cylinder", open_cylinder(8, 64), true),
        ("plate with holes", plate_with_holes(18), false),
        ("sheet with a rib", bumpy_sheet(28), false),
    ];
    for (what, mesh, is_smooth) in meshes {
        let part = prepare(&mesh, &PartSettings::default());
        assert_well_formed(&part, what);
        let fine = triangles_in_part(&part, 0);
        let size = fine.iter().flatten().copied().reduce(DVec3::max).unwrap().max_element();
        for (l, level) in part.chunks[0].levels.iter().enumerate().skip(1) {
            let coarse = triangles_in_part(&part, l);
            let (outwards, inwards) = (sampled_distance(&coarse, &fine), sampled_distance(&fine, &coarse));
            let sampled = outwards.max(inwards);
            let error = f64::from(level.error);
            println!(
                "{what}: level {l}, {} triangles, error {error:.6}, sampled {outwards:.6} and {inwards:.6}, {:.2}",
                coarse.len(),
                error / sampled
            );
            let noise = 1e-6 * size;
            assert!(
                error * LARGEST_UNDERESTIMATE + noise >= sampled,
                "{what}: level {l}: {error} < {sampled}"
            );
            if is_smooth {
                assert!(
                    error <= LARGEST_OVERESTIMATE * sampled + noise,
                    "{what}: level {l}: {error} > {sampled}"
                );
            }
        }
        assert!(part.chunks[0].levels.len() > 3, "{what}");
    }
}

#[test]
fn a_flat_plate_loses_triangles_without_error() {
    let part =
        prepare(&sheet(64, 64, false, |_, _| true, |u, v| DVec3::new(u, v, 0.0)), &PartSettings::default());
    let coarsest = part.chunks[0].levels.last().unwrap();
    assert!(coarsest.mesh.triangles.len() <= 12 && coarsest.error < 1e-6, "{coarsest:?}");
}

#[test]
fn small_and_disabled_chains_have_one_level() {
    let few = prepare(&open_cylinder(1, 12), &PartSettings::default());
    assert_eq!(few.chunks[0].levels.len(), 1);
    let many = PartSettings { lod: false, ..PartSettings::default() };
    assert_eq!(prepare(&sphere(20), &many).chunks[0].levels.len(), 1);
}

#[test]
fn pieces_that_went_count_at_least_with_their_radius() {
    // 500 tetrahedra of growing size: no edge can collapse without losing one of them.
    let mut mesh = Mesh::default();
    let size = |i: u32| 0.1 + 0.4 * f64::from(i) / 500.0;
    for i in 0..500u32 {
        let at = DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100));
        mesh.positions.extend([DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| at + p * size(i)));
        mesh.triangles.extend([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map(|t| t.map(|v| 4 * i + v)));
    }
    let part = prepare(&mesh, &PartSettings::default());
    assert_well_formed(&part, "tetrahedra");
    assert!(part.chunks[0].levels.len() > 4);
    for (l, level) in part.chunks[0].levels.iter().enumerate().skip(1) {
        let mut gone = [true; 500];
        for corner in triangles_in_part(&part, l).into_iter().flatten() {
            let [x, y, z] = (corner + 0.01).to_array().map(|c| c as usize);
            gone[100 * z + 10 * y + x] = false;
        }
        let largest = (0..500u32).rev().find(|&i| gone[i as usize]).unwrap();
        // About the centre of its corners.
        let radius = size(largest) * (11.0f64 / 16.0).sqrt();
        let error = f64::from(level.error);
        println!(
            "level {l}: {} pieces gone, radius up to {radius:.3}, error {error:.3}",
            gone.iter().filter(|g| **g).count()
        );
        assert!(error >= 0.999 * radius, "level {l}: {error} for a piece of radius {radius}");
    }
}

#[test]
fn any_soup_of_triangles_is_prepared() {
    for seed in 0..60u64 {
        println!("seed {seed}");
        let mut random = oorandom::Rand64::new(seed.into());
        // Few vertices and many triangles: edges of many triangles, duplicates, both windings, collapsed ones.
        let vertices = random.rand_range(3..300);
        let side = random.rand_range(1..9);
        let mut mesh = Mesh::default();
        for _ in 0..vertices {
            mesh.positions.push(DVec3::from_array([0; 3].map(|_| random.rand_range(0..side) as f64)));
        }
        for _ in 0..random.rand_range(1..2_000) {
            mesh.triangles.push([0; 3].map(|_| random.rand_range(0..vertices) as u32));
        }
        let settings = small_chunks(if seed.is_multiple_of(2) { 200 } else { 65_536 });
        assert_well_formed(&prepare(&mesh, &settings), &format!("seed {seed}"));
    }
}

#[test]
fn the_same_bits_come_out_for_any_number_of_threads() {
    let mesh = sphere(100);
    let prepare_on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| prepare(&mesh, &small_chunks(5_000)))
    };
    let one = prepare_on(1);
    assert!(one.chunks.len() >= 8);
    assert_eq!(one, prepare_on(3));
    assert_eq!(one, prepare_on(1));
}
