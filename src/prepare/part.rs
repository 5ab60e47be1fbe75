//! One part, from its imported mesh to quantized chunks with levels of detail.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::chunk::{self, Bounds, Limits};
use super::lod;
use super::quantize::{self, Grid};
use super::weld::{self, WeldedChunk};
use crate::geometry::{LevelMesh, PreparedChunk, PreparedLevel, PreparedPart, decode};
use crate::model::Mesh;
use crate::report::Findings;

pub use super::lod::MAX_TRIANGLES_WITHOUT_LEVELS;

/// Most triangles of a chunk.
pub const MAX_CHUNK_TRIANGLES: usize = 65_536;

/// From this many triangles around one vertex on, triangles are ordered by the simpler of meshoptimizer's two methods:
/// the other takes time in proportion to the square, 5 s for a fan of 65,536 triangles.
const HUB_TRIANGLES: usize = 1_024;
/// What that method assumes, meshoptimizer's own suggestion.
const FIFO_CACHE_SIZE: u32 = 16;

/// Finding: triangles with two corners in one cell of the grid.
pub const TRIANGLES_DROPPED: &str = "triangles dropped: thinner than the quantization step";
/// Finding: parts of which no triangle with three distinct corners is left.
pub const PARTS_COLLAPSED: &str = "parts kept as points and segments: every triangle has equal corners";
/// Finding: parts that miss [`PartSettings::max_position_error`].
pub const PARTS_TOO_COARSE: &str =
    "parts quantized coarser than asked: a triangle, or the part, is too long for the step";

/// How a part is prepared.
#[derive(Clone, Debug, PartialEq)]
pub struct PartSettings {
    /// Half a quantization step must not exceed this, in part units; chunks are split until it does not. A part that
    /// cannot be split that finely is prepared as well as it can be, and counted as [`PARTS_TOO_COARSE`]. Default:
    /// none, which leaves half a step at about 2^-16 of the largest chunk's extent, or less.
    pub max_position_error: Option<f64>,
    /// Whether to make coarser levels. Default: yes.
    pub lod: bool,
    /// Most triangles of a chunk, from 1 to [`MAX_CHUNK_TRIANGLES`], into which range it is clamped. Default: that.
    pub chunk_triangles: usize,
}

impl Default for PartSettings {
    fn default() -> Self {
        PartSettings { max_position_error: None, lod: true, chunk_triangles: MAX_CHUNK_TRIANGLES }
    }
}

/// Why a part cannot be prepared. `place` says which part, in the caller's words.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PrepareError {
    /// The mesh is empty.
    #[error("{place}: the part has no triangles; leave it out of the model")]
    NoTriangles {
        /// Which part.
        place: String,
    },
    /// The importer broke its promise.
    #[error(
        "{place}: triangle {triangle} refers to vertex {vertex}, but there are {vertices} vertices; \
         this is a fault of the importer"
    )]
    IndexOutOfRange {
        /// Which part.
        place: String,
        /// Index of the triangle.
        triangle: usize,
        /// What it refers to.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// The importer broke its promise.
    #[error(
        "{place}: vertex {vertex} is at {position}, expected finite numbers; this is a fault of the importer"
    )]
    NotFinite {
        /// Which part.
        place: String,
        /// Index of the vertex.
        vertex: u32,
        /// Its position.
        position: DVec3,
    },
    /// 32-bit floats, in which the GPU works, would overflow.
    #[error(
        "{place}: the part is {extent:e} units long, at most {limit:e} can be stored; \
         remove the stray vertices or choose a larger unit"
    )]
    TooLarge {
        /// Which part.
        place: String,
        /// Longest side of its box, part units.
        extent: f64,
        /// Largest length that is accepted.
        limit: f64,
    },
    /// Triangles are counted in 32 bits.
    #[error("{place}: the part has {triangles} triangles, at most {limit} can be stored; split it")]
    TooManyTriangles {
        /// Which part.
        place: String,
        /// How many there are.
        triangles: usize,
        /// How many are accepted.
        limit: u32,
    },
    /// The setting makes no sense.
    #[error("the position error must be a finite number above 0, found {value}; choose another")]
    BadPositionError {
        /// What was set.
        value: f64,
    },
}

/// Prepares one part: splits it into chunks, quantizes them on one grid, makes their levels of detail.
///
/// Every coordinate of level 0 decodes to within half a step of the input's, less the origin. Triangles of which two
/// corners become equal are dropped and counted in `findings`. If that leaves nothing (a mesh of points and segments),
/// they are kept in their degenerate form, each once, as a single level per chunk: the object stays there, can be
/// found and voxelized, and draws nothing. Chunks of at most [`MAX_TRIANGLES_WITHOUT_LEVELS`] triangles have level 0
/// only. `place` names the part, for findings and errors.
///
/// The result depends on the arguments alone; big parts use rayon's current pool.
pub fn prepare_part(
    mesh: &Mesh,
    settings: &PartSettings,
    findings: &mut Findings,
    place: &dyn Fn() -> String,
) -> Result<PreparedPart, PrepareError> {
    let bounds = checked_bounds(mesh, settings, place)?;
    let groups = chunk::split(mesh, &limits(mesh, &bounds, settings));
    let boxes: Vec<Bounds> = groups.par_iter().map(|group| Bounds::of_triangles(mesh, group)).collect();
    let grid = Grid::fit(&bounds, &boxes);
    let welded = weld::weld(mesh, &grid, &groups);

    findings.add(TRIANGLES_DROPPED, welded.dropped, place);
    findings.add(PARTS_COLLAPSED, u64::from(welded.all_collapsed), place);
    if let Some(asked) = settings.max_position_error {
        let reached = grid.position_error(&bounds);
        findings.add(PARTS_TOO_COARSE, u64::from(reached > asked), || {
            format!("{}: half a step is {reached:e}, asked for {asked:e}", place())
        });
    }

    let step = grid.step.as_vec3();
    let lod = settings.lod && !welded.all_collapsed;
    let chunks = welded.chunks.into_par_iter().map(|chunk| prepare_chunk(chunk, step, lod)).collect();
    Ok(PreparedPart { origin: grid.origin, step, chunks })
}

/// The box of all triangles, after everything that later stages rely on was checked.
fn checked_bounds(
    mesh: &Mesh,
    settings: &PartSettings,
    place: &dyn Fn() -> String,
) -> Result<Bounds, PrepareError> {
    if let Some(value) = settings.max_position_error.filter(|e| !(e.is_finite() && *e > 0.0)) {
        return Err(PrepareError::BadPositionError { value });
    }
    if mesh.triangles.is_empty() {
        return Err(PrepareError::NoTriangles { place: place() });
    }
    // A third, so that corners can be counted in 32 bits, too.
    let limit = u32::MAX / 3;
    if mesh.triangles.len() > limit as usize {
        return Err(PrepareError::TooManyTriangles {
            place: place(),
            triangles: mesh.triangles.len(),
            limit,
        });
    }
    let mut bounds = Bounds::EMPTY;
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        for &vertex in corners {
            let Some(&position) = mesh.positions.get(vertex as usize) else {
                let vertices = mesh.positions.len();
                return Err(PrepareError::IndexOutOfRange { place: place(), triangle, vertex, vertices });
            };
            if !position.is_finite() {
                return Err(PrepareError::NotFinite { place: place(), vertex, position });
            }
            bounds = bounds.union(&Bounds { min: position, max: position });
        }
    }
    let (extent, limit) = (bounds.extent().max_element(), quantize::MAX_EXTENT);
    if extent > limit {
        return Err(PrepareError::TooLarge { place: place(), extent, limit });
    }
    Ok(bounds)
}

fn limits(mesh: &Mesh, bounds: &Bounds, settings: &PartSettings) -> Limits {
    let max_extent = settings.max_position_error.map(|error| {
        let extents =
            mesh.triangles.iter().map(|t| Bounds::of(t.map(|v| mesh.positions[v as usize])).extent());
        let longest_triangle = extents.fold(DVec3::ZERO, DVec3::max);
        quantize::chunk_extent_limit(error, bounds.extent(), longest_triangle)
    });
    Limits { max_triangles: settings.chunk_triangles.clamp(1, MAX_CHUNK_TRIANGLES), max_extent }
}

/// Quantized levels of one chunk, without coarser ones if not `lod`.
fn prepare_chunk(chunk: WeldedChunk, step: Vec3, lod: bool) -> PreparedChunk {
    let WeldedChunk { cells, triangles, shared } = chunk;
    let lowest = |axis: usize| cells.iter().map(|cell| cell[axis]).min().unwrap_or(0);
    let offset = [lowest(0), lowest(1), lowest(2)];
    // The grid was fitted so that no chunk spans more than 65,535 cells.
    let quantized: Vec<[u16; 3]> =
        cells.iter().map(|cell| [0, 1, 2].map(|axis| (cell[axis] - offset[axis]) as u16)).collect();
    let levels = if lod {
        let positions: Vec<Vec3> = quantized.iter().map(|&q| decode(offset, q, step)).collect();
        lod::chain(&positions, triangles, &shared)
    } else {
        vec![lod::Level { triangles, error: 0.0 }]
    };
    let levels = levels
        .into_iter()
        .map(|level| PreparedLevel { mesh: pack(&quantized, level.triangles), error: round_up(level.error) })
        .collect();
    PreparedChunk { offset, levels }
}

/// A mesh with only the vertices that `triangles` use, in the order in which the codecs pack both well.
fn pack(vertices: &[[u16; 3]], triangles: Vec<[u32; 3]>) -> LevelMesh {
    let indices: &[u32] = bytemuck::cast_slice(&triangles);
    let mut valence = vec![0usize; vertices.len()];
    for &v in indices {
        valence[v as usize] += 1;
    }
    let mut ordered = if valence.iter().any(|&triangles| triangles > HUB_TRIANGLES) {
        meshopt::optimize_vertex_cache_fifo(indices, vertices.len(), FIFO_CACHE_SIZE)
    } else {
        meshopt::optimize_vertex_cache(indices, vertices.len())
    };
    let vertices = meshopt::optimize_vertex_fetch(&mut ordered, vertices);
    LevelMesh { vertices, triangles: ordered.as_chunks::<3>().0.to_vec() }
}

/// The smallest f32 that is not below `error`.
fn round_up(error: f64) -> f32 {
    let nearest = error as f32;
    if f64::from(nearest) < error { nearest.next_up() } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prepare(mesh: &Mesh, settings: &PartSettings) -> (PreparedPart, Findings) {
        let mut findings = Findings::default();
        let part = prepare_part(mesh, settings, &mut findings, &|| "test part".to_owned()).unwrap();
        (part, findings)
    }

    fn triangle(corners: [[f64; 3]; 3]) -> Mesh {
        Mesh { positions: corners.map(DVec3::from).to_vec(), triangles: vec![[0, 1, 2]] }
    }

    /// Sign of the exact sum of `terms`: Shewchuk 1997, "Adaptive precision floating-point arithmetic", grow-expansion.
    fn sign_of_sum(terms: &[f64]) -> f64 {
        let mut expansion: Vec<f64> = Vec::new();
        for &term in terms {
            let mut carry = term;
            for part in &mut expansion {
                let sum = carry + *part;
                let virtual_part = sum - carry;
                *part = (carry - (sum - virtual_part)) + (*part - virtual_part);
                carry = sum;
            }
            expansion.push(carry);
        }
        expansion.iter().rev().find(|&&part| part != 0.0).map_or(0.0, |part| part.signum())
    }

    #[test]
    fn exact_sums_see_what_rounding_hides() {
        assert_eq!(sign_of_sum(&[1e30, 1.0, -1e30]), 1.0);
        assert_eq!(sign_of_sum(&[1e30, -1e-30, -1e30]), -1.0);
        assert_eq!(sign_of_sum(&[0.5, -1.0, 0.5]), 0.0);
    }

    /// Each triangle of `mesh`, as the multiset of level 0 says it must decode: within half a step, exactly.
    fn assert_within_half_a_step(mesh: &Mesh, part: &PreparedPart, what: &str) {
        let decoded = level_0_cells(part);
        let mut expected: Vec<[[i64; 3]; 3]> = Vec::new();
        let grid = Grid { origin: part.origin, step: part.step.as_dvec3() };
        for t in &mesh.triangles {
            let cells = t.map(|v| grid.cell(mesh.positions[v as usize]));
            for (v, cell) in t.iter().zip(cells) {
                for (axis, cell) in cell.into_iter().enumerate() {
                    let (step, at) = (grid.step[axis], mesh.positions[*v as usize][axis]);
                    let place = cell as f64 * step;
                    for (sign, half) in [(1.0, -step / 2.0), (-1.0, -step / 2.0)] {
                        let excess = sign_of_sum(&[sign * place, sign * part.origin[axis], -sign * at, half]);
                        assert!(excess <= 0.0, "{what}: {at} decodes to {place}, step {step}");
                    }
                }
            }
            if cells[0] != cells[1] && cells[1] != cells[2] && cells[2] != cells[0] {
                expected.push(rotated(cells));
            }
        }
        expected.sort_unstable();
        assert_eq!(decoded, expected, "{what}: the triangles of level 0 are not the quantized input");
    }

    /// Corners rotated so that the least is first, which keeps the winding.
    fn rotated(mut t: [[i64; 3]; 3]) -> [[i64; 3]; 3] {
        while t[0] > t[1] || t[0] > t[2] {
            t.rotate_left(1);
        }
        t
    }

    fn level_0_cells(part: &PreparedPart) -> Vec<[[i64; 3]; 3]> {
        let mut all = Vec::new();
        for chunk in &part.chunks {
            let mesh = &chunk.levels[0].mesh;
            for t in &mesh.triangles {
                all.push(rotated(t.map(|v| {
                    [0, 1, 2].map(|a| i64::from(chunk.offset[a]) + i64::from(mesh.vertices[v as usize][a]))
                })));
            }
        }
        all.sort_unstable();
        all
    }

    #[test]
    fn every_decoded_coordinate_is_within_half_a_step_in_exact_arithmetic() {
        for seed in 0..240u64 {
            let mut random = oorandom::Rand64::new(seed.into());
            let extents = [0, 1, 2].map(|axis| match (seed / 4 + axis) % 6 {
                0 => 1.0,
                1 => 1e-6,
                2 => 1e12,
                3 => 0.0,
                4 => 65_536.0,
                _ => random.rand_float() * 1_000.0,
            });
            let far = [0.0, 1e7, -1e15, 0.1][(seed % 4) as usize];
            let mut mesh = Mesh::default();
            for i in 0..200u32 {
                for _ in 0..3 {
                    let p = extents.map(|e| far + (random.rand_float() - 0.5) * e);
                    mesh.positions.push(p.into());
                }
                mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
            }
            let chunk_triangles = if seed.is_multiple_of(2) { 200 } else { 23 };
            let (part, _) =
                prepare(&mesh, &PartSettings { chunk_triangles, lod: false, ..PartSettings::default() });
            let what = format!("seed {seed}, extents {extents:?}, at {far}");
            for (axis, step) in part.step.to_array().into_iter().enumerate() {
                assert_eq!(libm::frexpf(step).0, 0.5, "{what}: {step} is not a power of two");
                for chunk in &part.chunks {
                    let highest = chunk.levels[0].mesh.vertices.iter().map(|q| q[axis]).max().unwrap();
                    assert!(
                        chunk.offset[axis] >= 0 && chunk.offset[axis] + i32::from(highest) < 1 << 24,
                        "{what}"
                    );
                }
            }
            let collapsed = mesh
                .triangles
                .iter()
                .all(|t| t.iter().all(|&v| mesh.positions[v as usize] == mesh.positions[t[0] as usize]));
            if !collapsed {
                assert_within_half_a_step(&mesh, &part, &what);
            }
        }
    }

    #[test]
    fn a_triangle_thinner_than_the_step_is_dropped_and_counted() {
        let mut mesh = triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        mesh.positions.push(DVec3::new(1e-9, 0.0, 0.0));
        mesh.triangles.push([0, 3, 2]);
        let (part, findings) = prepare(&mesh, &PartSettings::default());
        assert_eq!(part.chunks[0].levels[0].mesh.triangles.len(), 1);
        assert_eq!(findings.0[TRIANGLES_DROPPED].count, 1);
        assert_eq!(findings.0[TRIANGLES_DROPPED].first, "test part");
    }

    #[test]
    fn points_and_segments_are_kept_in_degenerate_form() {
        let here = [3.0, 4.0, 5.0];
        let mut point = triangle([here; 3]);
        point.triangles = vec![[0, 1, 2]; 40];
        let (part, findings) = prepare(&point, &PartSettings::default());
        assert_eq!(part.origin, DVec3::from(here));
        assert_eq!(part.chunks.len(), 1);
        assert_eq!(part.chunks[0].levels.len(), 1);
        assert_eq!(
            part.chunks[0].levels[0].mesh,
            LevelMesh { vertices: vec![[0; 3]], triangles: vec![[0; 3]] }
        );
        assert_eq!(findings.0[PARTS_COLLAPSED].count, 1);
        assert!(!findings.0.contains_key(TRIANGLES_DROPPED));

        let (part, findings) = prepare(&triangle([here, here, [4.0, 4.0, 5.0]]), &PartSettings::default());
        assert_eq!(part.chunks[0].levels[0].mesh.vertices.len(), 2);
        assert_eq!(part.chunks[0].levels[0].mesh.triangles.len(), 1);
        assert_eq!(findings.0[PARTS_COLLAPSED].count, 1);
    }

    #[test]
    fn one_or_two_triangles_and_collinear_ones_have_one_level() {
        let (part, findings) =
            prepare(&triangle([[0.0; 3], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]]), &PartSettings::default());
        assert_eq!(part.chunks[0].levels[0].mesh.triangles.len(), 1);
        assert_eq!(findings, Findings::default());
        let mut square = triangle([[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]);
        square.positions.push(DVec3::new(0.0, 1.0, 0.0));
        square.triangles.push([0, 2, 3]);
        let (part, _) = prepare(&square, &PartSettings::default());
        assert_eq!(part.chunks.len(), 1);
        assert_eq!(part.chunks[0].levels.len(), 1);
        assert_eq!(part.chunks[0].levels[0].mesh.vertices.len(), 4);
    }

    #[test]
    fn vertices_that_no_triangle_uses_do_not_matter() {
        let mut mesh = triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let (expected, _) = prepare(&mesh, &PartSettings::default());
        mesh.positions.push(DVec3::splat(1e300));
        mesh.positions.push(DVec3::NAN);
        assert_eq!(prepare(&mesh, &PartSettings::default()).0, expected);
    }

    #[test]
    fn faults_are_named() {
        let check = |mesh: &Mesh, settings: &PartSettings| {
            prepare_part(mesh, settings, &mut Findings::default(), &|| "p".to_owned()).unwrap_err()
        };
        let usual = PartSettings::default();
        let good = triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert!(matches!(check(&Mesh::default(), &usual), PrepareError::NoTriangles { .. }));
        let mut mesh = good.clone();
        mesh.triangles.push([0, 1, 3]);
        assert!(matches!(check(&mesh, &usual), PrepareError::IndexOutOfRange { triangle: 1, vertex: 3, .. }));
        let mut mesh = good.clone();
        mesh.positions[2].z = f64::INFINITY;
        assert!(matches!(check(&mesh, &usual), PrepareError::NotFinite { vertex: 2, .. }));
        let mut mesh = good.clone();
        mesh.positions[2].z = 2e18;
        assert!(matches!(check(&mesh, &usual), PrepareError::TooLarge { .. }));
        (mesh.positions[1].z, mesh.positions[2].z) = (-f64::MAX, f64::MAX);
        assert!(matches!(check(&mesh, &usual), PrepareError::TooLarge { .. }));
        for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let settings = PartSettings { max_position_error: Some(value), ..usual.clone() };
            assert!(matches!(check(&good, &settings), PrepareError::BadPositionError { .. }), "{value}");
        }
    }

    /// A strip of `n` short triangles, 1 unit apart.
    fn strip(n: u32) -> Mesh {
        let mut mesh = Mesh::default();
        for i in 0..n {
            for [x, y] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] {
                mesh.positions.push(DVec3::new(f64::from(i) + x, y, 0.0));
            }
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        mesh
    }

    #[test]
    fn chunks_are_split_until_the_position_error_is_met() {
        let mesh = strip(1_000);
        for error in [1.0, 1e-2, 1e-4, 6.2e-5] {
            let settings = PartSettings { max_position_error: Some(error), ..PartSettings::default() };
            let (part, findings) = prepare(&mesh, &settings);
            assert!(f64::from(part.step.max_element()) / 2.0 <= error, "{error}: step {}", part.step);
            assert_eq!(findings, Findings::default());
            assert_within_half_a_step(&mesh, &part, "strip");
            // Not more chunks than needed, within the slack that halving has.
            let needed = 1_000.0 / (65_535.0 * error);
            assert!(part.chunks.len() as f64 <= 4.0 * needed + 1.0, "{error}: {} chunks", part.chunks.len());
        }
    }

    #[test]
    fn an_unreachable_position_error_is_reported_with_what_was_reached() {
        let mut mesh = strip(1_000);
        mesh.positions[1].x = 900.0;
        let settings = PartSettings { max_position_error: Some(1e-5), ..PartSettings::default() };
        let (part, findings) = prepare(&mesh, &settings);
        let finding = &findings.0[PARTS_TOO_COARSE];
        assert_eq!(finding.count, 1);
        assert!(finding.first.contains("asked for 1e-5"), "{}", finding.first);
        assert!(part.chunks.len() < 10, "{} chunks", part.chunks.len());
        assert_within_half_a_step(&mesh, &part, "strip with a long triangle");

        let settings = PartSettings { max_position_error: Some(1e-300), ..PartSettings::default() };
        let (part, findings) = prepare(&strip(50), &settings);
        assert_eq!(findings.0[PARTS_TOO_COARSE].count, 1);
        assert!(part.chunks.len() <= 50);
    }
}
