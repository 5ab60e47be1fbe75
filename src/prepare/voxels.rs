//! The scene's drawables as the voxelizer wants them: level 0, as it will be decoded, snapped to the grid.

use std::io::{self, Write};
use std::ops::ControlFlow;

use glam::{DAffine3, DMat3, DVec3};
use voxsight_voxel::grid::Grid;
use voxsight_voxel::voxelize::{Drawables, OwnerSink, SnappedMesh};

use crate::container::write::SectionWriter;
use crate::geometry::{LevelMesh, decode};
use crate::progress::Progress;

/// Level 0 of one chunk.
pub(super) struct ChunkGeometry {
    pub offset: [i32; 3],
    pub step: glam::Vec3,
    pub mesh: LevelMesh,
}

/// Objects x chunks, in the order of the drawables.
pub(super) struct SceneDrawables<'a> {
    pub grid: Grid,
    /// (object placement, chunk) of each drawable.
    pub placed: Vec<(DAffine3, u32)>,
    pub chunks: &'a [ChunkGeometry],
    pub progress: &'a dyn Progress,
}

impl Drawables for SceneDrawables<'_> {
    fn count(&self) -> u32 {
        self.placed.len() as u32
    }

    fn load(&self, drawable: u32, mesh: &mut SnappedMesh) {
        let (world_from_part, chunk) = self.placed[drawable as usize];
        let ChunkGeometry { offset, step, mesh: level } = &self.chunks[chunk as usize];
        let grid_from_part = grid_from_part(&self.grid, &world_from_part);
        mesh.vertices.clear();
        mesh.vertices.extend(level.vertices.iter().map(|&q| {
            let part = decode(*offset, q, *step).as_dvec3();
            self.grid.snap(grid_from_part.transform_point3(part))
        }));
        mesh.triangles.clear();
        mesh.triangles.extend_from_slice(&level.triangles);
    }

    fn advance(&self, triangles: u64) -> ControlFlow<()> {
        self.progress.advance(triangles);
        if self.progress.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// Part space to grid space in one map: the large translations cancel once, in f64.
fn grid_from_part(grid: &Grid, world_from_part: &DAffine3) -> DAffine3 {
    let scale = DVec3::splat(grid.voxel_size.recip());
    DAffine3 {
        matrix3: DMat3::from_diagonal(scale) * world_from_part.matrix3,
        translation: grid.grid_from_world(world_from_part.translation),
    }
}

/// The section of the container that takes owner pages.
pub(super) struct OwnerSection<'a>(pub SectionWriter<'a>);

impl OwnerSink for OwnerSection<'_> {
    fn append(&mut self, words: &[u64]) -> io::Result<()> {
        self.0.write_all(bytemuck::cast_slice(words))
    }
}
