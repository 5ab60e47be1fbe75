//! A scene made ready for queries and pictures: the container, its triangles in hierarchies, its voxels.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::container::{ContainerError, Problem};
use crate::exact::{ChunkMesh, ExactScene, Instance};
use crate::filter::Filter;
use crate::model::Colour;
use crate::progress::Progress;
use crate::render::RenderScene;
use crate::scene::Scene;
use crate::visibility::QueryScene;

/// An opened scene with everything that CPU queries need.
pub struct LoadedScene {
    scene: Scene,
    exact: ExactScene,
    colours: Vec<Colour>,
    object_boxes: Vec<(DVec3, DVec3, Range<u32>)>,
    filter: Filter,
}

impl AsRef<Scene> for LoadedScene {
    fn as_ref(&self) -> &Scene {
        &self.scene
    }
}

impl LoadedScene {
    /// Decodes level 0 of all chunks and builds the hierarchies over them.
    ///
    /// # Errors
    ///
    /// A geometry page is damaged; cancelled.
    pub fn new(scene: Scene, progress: &dyn Progress) -> Result<Self, ContainerError> {
        progress.stage("load triangles", scene.chunks().len() as u64, "chunks");
        let chunks: Result<Vec<ChunkMesh>, ContainerError> = scene
            .chunks()
            .par_iter()
            .map(|chunk| {
                if progress.is_cancelled() {
                    return Err(ContainerError::new(scene.container().path(), Problem::Cancelled));
                }
                let mesh = scene.level_mesh(chunk.first_level)?;
                let positions = scene.level_positions(chunk.first_level, &mesh);
                progress.advance(1);
                Ok(ChunkMesh { positions, triangles: mesh.triangles })
            })
            .collect();
        let objects = scene.objects();
        let instances: Vec<Instance> = scene
            .drawables()
            .iter()
            .map(|drawable| Instance {
                chunk: drawable.chunk,
                world_from_part: scene.world_from_part(drawable.object),
                transparent: objects[drawable.object as usize].colour[3] < 255,
            })
            .collect();
        let colours = scene.drawables().iter().map(|d| Colour(objects[d.object as usize].colour)).collect();
        let object_boxes = objects
            .iter()
            .enumerate()
            .map(|(id, object)| (object.min.into(), object.max.into(), scene.object_drawables(id as u32)))
            .collect();
        let exact = ExactScene::new(chunks?, &instances);
        Ok(LoadedScene { scene, exact, colours, object_boxes, filter: Filter::default() })
    }

    /// The opened container.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What queries and pictures leave out; nothing at first.
    pub fn filter_mut(&mut self) -> &mut Filter {
        &mut self.filter
    }

    /// For [`crate::visibility::query`].
    pub fn query(&self) -> QueryScene<'_> {
        QueryScene {
            exact: &self.exact,
            grid: self.scene.grid(),
            dag: self.scene.dag(),
            owners: self.scene.owners(),
            filter: &self.filter,
            object_boxes: &self.object_boxes,
        }
    }

    /// For [`crate::render::render`].
    pub fn picture(&self) -> RenderScene<'_> {
        RenderScene { query: self.query(), colours: &self.colours }
    }
}
