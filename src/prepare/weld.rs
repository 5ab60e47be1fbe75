//! From groups of triangles to chunks on the part's grid: equal cells become one vertex, triangles that collapse go.

use glam::DVec3;
use rayon::prelude::*;

use super::quantize::Grid;
use crate::model::Mesh;

/// "No vertex", "no chunk".
const NONE: u32 = u32::MAX;

/// A chunk on its part's grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct WeldedChunk {
    /// Distinct cells of the part's grid, each below 2^24.
    pub cells: Vec<[i32; 3]>,
    /// Corners as indices into `cells`, three different ones (unless the whole part collapsed).
    pub triangles: Vec<[u32; 3]>,
    /// For each vertex, whether another chunk of the part uses it too.
    pub shared: Vec<bool>,
}

/// The chunks of a part, and what became of its triangles.
pub(super) struct Welded {
    /// None is empty. At least one, if the mesh has a triangle.
    pub chunks: Vec<WeldedChunk>,
    /// Triangles with two equal corners on the grid, left out.
    pub dropped: u64,
    /// True when all triangles have two equal corners: then they stand in `chunks`, each distinct one once, as points
    /// and segments, and nothing is dropped.
    pub all_collapsed: bool,
}

/// Puts `groups` of triangles of `mesh` on `grid`. The groups are disjoint and every cell is below 2^24 (which
/// [`Grid::fit`] saw to).
pub(super) fn weld(mesh: &Mesh, grid: &Grid, groups: &[Vec<u32>]) -> Welded {
    let used = used_vertices(mesh);
    let cells: Vec<[i32; 3]> = mesh
        .positions
        .par_iter()
        .zip(&used)
        .map(|(&position, &used)| if used { cell_i32(grid, position) } else { [0; 3] })
        .collect();
    let twin = first_with_equal_cell(&cells, &used);
    let welded_corners = |t: u32| mesh.triangles[t as usize].map(|corner| twin[corner as usize]);

    let is_collapsed = |&[a, b, c]: &[u32; 3]| a == b || b == c || c == a;
    let mut kept: Vec<Vec<[u32; 3]>> = groups
        .par_iter()
        .map(|group| group.iter().map(|&t| welded_corners(t)).filter(|t| !is_collapsed(t)).collect())
        .collect();
    let total: usize = groups.iter().map(Vec::len).sum();
    let left: usize = kept.iter().map(Vec::len).sum();
    let all_collapsed = left == 0;
    if all_collapsed {
        kept = groups.iter().map(|group| distinct(group.iter().map(|&t| welded_corners(t)))).collect();
    }
    kept.retain(|triangles| !triangles.is_empty());
    let dropped = if all_collapsed { 0 } else { (total - left) as u64 };
    Welded { chunks: number_vertices(&cells, kept), dropped, all_collapsed }
}

fn cell_i32(grid: &Grid, position: DVec3) -> [i32; 3] {
    // The grid was fitted around every used position: cells are in [0, 2^24).
    grid.cell(position).map(|c| c as i32)
}

fn used_vertices(mesh: &Mesh) -> Vec<bool> {
    let mut used = vec![false; mesh.positions.len()];
    for &corner in mesh.triangles.iter().flatten() {
        used[corner as usize] = true;
    }
    used
}

/// For each used vertex the first with the same cell; for others [`NONE`].
fn first_with_equal_cell(cells: &[[i32; 3]], used: &[bool]) -> Vec<u32> {
    let mut order: Vec<([i32; 3], u32)> =
        (0u32..).zip(cells).zip(used).filter(|(_, used)| **used).map(|((v, &cell), _)| (cell, v)).collect();
    order.par_sort_unstable();
    let mut twin = vec![NONE; cells.len()];
    for run in order.chunk_by(|a, b| a.0 == b.0) {
        for &(_, v) in run {
            twin[v as usize] = run[0].1;
        }
    }
    twin
}

/// Each set of corners once, whatever its order.
fn distinct(triangles: impl Iterator<Item = [u32; 3]>) -> Vec<[u32; 3]> {
    let mut sets: Vec<[u32; 3]> = triangles
        .map(|mut t| {
            t.sort_unstable();
            // (a, a, b) and (a, b, b) are the same segment.
            if t[0] == t[1] { [t[0], t[2], t[2]] } else { t }
        })
        .collect();
    sets.sort_unstable();
    sets.dedup();
    sets
}

/// Gives every chunk vertex numbers of its own, in the order of first use, and finds out which are shared.
fn number_vertices(cells: &[[i32; 3]], groups: Vec<Vec<[u32; 3]>>) -> Vec<WeldedChunk> {
    // Of each vertex: the last chunk that used it, its number there, and whether there were several.
    let mut last_chunk = vec![NONE; cells.len()];
    let mut number = vec![NONE; cells.len()];
    let mut shared = vec![false; cells.len()];
    let mut chunks = Vec::with_capacity(groups.len());
    let mut vertices_of_chunk: Vec<Vec<u32>> = Vec::with_capacity(groups.len());
    for (chunk, mut triangles) in (0u32..).zip(groups) {
        let mut vertices = Vec::new();
        for corner in triangles.iter_mut().flatten() {
            let v = *corner as usize;
            if last_chunk[v] != chunk {
                shared[v] |= last_chunk[v] != NONE;
                last_chunk[v] = chunk;
                number[v] = vertices.len() as u32;
                vertices.push(*corner);
            }
            *corner = number[v];
        }
        chunks.push(WeldedChunk { triangles, ..WeldedChunk::default() });
        vertices_of_chunk.push(vertices);
    }
    for (chunk, vertices) in chunks.iter_mut().zip(vertices_of_chunk) {
        chunk.cells = vertices.iter().map(|&v| cells[v as usize]).collect();
        chunk.shared = vertices.iter().map(|&v| shared[v as usize]).collect();
    }
    chunks
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_grid() -> Grid {
        Grid { origin: DVec3::ZERO, step: DVec3::ONE }
    }

    #[test]
    fn vertices_that_quantize_alike_become_one() {
        let mesh = Mesh {
            positions: [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.2, 0.1], [4.0, 4.0], [-0.0, 3.9]]
                .map(|[x, y]| DVec3::new(x, y, 0.0))
                .to_vec(),
            triangles: vec![[0, 1, 2], [3, 4, 5]],
        };
        let welded = weld(&mesh, &unit_grid(), &[vec![0, 1]]);
        assert_eq!(welded.chunks.len(), 1);
        assert_eq!(welded.chunks[0].cells, [[0, 0, 0], [4, 0, 0], [0, 4, 0], [4, 4, 0]]);
        assert_eq!(welded.chunks[0].triangles, [[0, 1, 2], [1, 3, 2]]);
        assert_eq!((welded.dropped, welded.all_collapsed), (0, false));
    }

    #[test]
    fn only_vertices_of_several_chunks_are_shared() {
        let mesh = Mesh {
            positions: [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.0, 4.0]]
                .map(|[x, y]| DVec3::new(x, y, 0.0))
                .to_vec(),
            triangles: vec![[0, 1, 2], [1, 3, 2]],
        };
        let welded = weld(&mesh, &unit_grid(), &[vec![0], vec![1]]);
        assert_eq!(welded.chunks[0].shared, [false, true, true]);
        assert_eq!(welded.chunks[1].shared, [true, false, true]);
    }

    #[test]
    fn a_collapsed_triangle_goes_and_a_collapsed_part_stays() {
        let mut mesh = Mesh {
            positions: [0.0, 0.1, 5.0].map(|x| DVec3::new(x, 0.0, 0.0)).to_vec(),
            triangles: vec![[0, 1, 2], [2, 1, 0], [0, 0, 2]],
        };
        let segment = weld(&mesh, &unit_grid(), &[vec![0, 1, 2]]);
        assert!(segment.all_collapsed);
        assert_eq!(segment.dropped, 0);
        assert_eq!(segment.chunks[0].triangles, [[0, 1, 1]]);

        mesh.positions.push(DVec3::new(5.0, 5.0, 0.0));
        mesh.triangles.push([0, 2, 3]);
        let welded = weld(&mesh, &unit_grid(), &[vec![0, 1, 2], vec![3]]);
        assert_eq!((welded.dropped, welded.all_collapsed, welded.chunks.len()), (3, false, 1));
    }
}
