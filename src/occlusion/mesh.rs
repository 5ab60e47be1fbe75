//! Level-0 triangles of a chunk as the rasterizer reads them.

use crate::exact::ChunkBvh;

/// Triangles that are set up together.
pub(super) const LANES: usize = 16;

/// Coordinates of `LANES` triangles, part space: corner by corner x, y, z, each for all triangles side by side. Lanes
/// without a triangle hold one that is a point, which covers nothing.
pub(super) type TriangleBlock = [[f32; LANES]; 9];

/// A chunk's triangles, in blocks.
#[derive(Clone, Debug, Default)]
pub struct OccluderMesh {
    pub(super) blocks: Vec<TriangleBlock>,
    triangles: u32,
}

impl OccluderMesh {
    /// Of a chunk, in the order of its hierarchy: neighbours stay together.
    pub fn of_chunk(chunk: &ChunkBvh) -> Self {
        let triangles: Vec<[[f32; 3]; 3]> = (0..chunk.triangle_count())
            .map(|index| chunk.triangle(index).map(|corner| corner.as_vec3().to_array()))
            .collect();
        Self::new(&triangles)
    }

    /// Of triangles of part space.
    pub fn new(triangles: &[[[f32; 3]; 3]]) -> Self {
        let block = |group: &[[[f32; 3]; 3]]| {
            let [at, ..] = group[0];
            let mut block = [[0.0; LANES]; 9];
            for lane in 0..LANES {
                let corners = group.get(lane).copied().unwrap_or([at; 3]);
                corners.as_flattened().iter().zip(&mut block).for_each(|(&value, row)| row[lane] = value);
            }
            block
        };
        OccluderMesh {
            blocks: triangles.chunks(LANES).map(block).collect(),
            triangles: triangles.len() as u32,
        }
    }

    /// Triangles in it.
    pub fn triangle_count(&self) -> u32 {
        self.triangles
    }
}

/// One triangle of a block.
#[inline(always)]
pub(super) fn corners(block: &TriangleBlock, lane: usize) -> [[f32; 3]; 3] {
    [0, 3, 6].map(|k| [block[k][lane], block[k + 1][lane], block[k + 2][lane]])
}
