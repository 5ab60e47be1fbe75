//! Parts that a user has moved. Nothing of the scene is rebuilt for them: at its old place a moved drawable counts as hidden; at its
//! new one it is found by the triangles of a small scene of its own, and casts shadows by voxels of its own.

use std::collections::BTreeMap;
use std::ops::{ControlFlow, Range};
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use voxsight_voxel::dag::Dag;
use voxsight_voxel::grid::{Grid, GridError};
use voxsight_voxel::voxelize::{Drawables, OwnerSink, Settings, SnappedMesh, VoxelizeError, voxelize_into};

use crate::camera::{CameraRays, Plane};
use crate::exact::{ExactScene, Instance, TriangleHit, transformed_box};
use crate::filter::Filter;
use crate::loaded::LoadedScene;
use crate::lod::{Candidate, candidates};
use crate::progress::{Progress, Silent};
use crate::ray::Ray;
use crate::scene::Scene;
use crate::visibility::coherent::CoherentQuery;
use crate::visibility::culling::Culling;
use crate::visibility::{Method, QueryScene, QuerySettings, VisibleSet, query};

/// Memory for the voxels of what was moved: they serve shadows alone.
const MOST_VOXEL_BYTES: u64 = 1 << 30;

/// Where objects have been moved to: object to the motion that it has made in the world.
pub type Motions = BTreeMap<u32, DAffine3>;

/// Drawables of moved objects that are not hidden, where they are now.
pub struct Moved {
    /// Rising. Drawable i of `exact` is the i-th of these.
    drawables: Arc<[u32]>,
    placements: Arc<BTreeMap<u32, DAffine3>>,
    exact: Arc<ExactScene>,
    /// Of each drawable of `exact`.
    boxes: Arc<[(DVec3, DVec3, Range<u32>)]>,
    /// What a query of `exact` leaves out and looks through.
    filter: Filter,
}

/// Voxels of moved drawables.
#[derive(Clone, Debug)]
pub struct MovedVoxels {
    /// Where they are.
    pub grid: Grid,
    /// The occupied ones.
    pub dag: Dag,
}

/// Why moved drawables have no voxels.
#[derive(Debug, thiserror::Error)]
pub enum MovedError {
    /// They were moved too far apart for the size of a voxel.
    #[error("parts were moved too far apart for shadows: {0}")]
    Grid(#[from] GridError),
    /// Their DAG outgrows its form.
    #[error(transparent)]
    Voxelize(#[from] VoxelizeError),
}

impl Moved {
    /// Of a scene in which `filter` hides and cuts.
    pub fn new(scene: &LoadedScene, motions: &Motions, filter: &Filter) -> Self {
        let (all, query) = (scene.scene(), scene.query());
        let placed = |(&object, motion): (&u32, &DAffine3)| (object, *motion * all.world_from_part(object));
        let placements: BTreeMap<u32, DAffine3> = motions.iter().map(placed).collect();
        let drawables: Vec<u32> = placements
            .keys()
            .flat_map(|&object| all.object_drawables(object))
            .filter(|&drawable| !filter.is_hidden(drawable))
            .collect();
        let instance = |&drawable: &u32| Instance {
            chunk: all.drawables()[drawable as usize].chunk,
            // Drawables are those of the placed objects.
            world_from_part: placements[&all.drawable_object(drawable)],
            transparent: query.exact.is_transparent(drawable),
        };
        let instances: Vec<Instance> = drawables.iter().map(instance).collect();
        let exact = query.exact.with_instances(&instances);
        let mut own = Filter::default();
        filter.clip_planes().iter().for_each(|&plane| own.clip_by(plane));
        for (index, &drawable) in (0..).zip(&drawables) {
            own.set_seen_through(index, filter.is_seen_through(drawable));
        }
        let boxes = (0..exact.drawable_count()).map(|index| {
            let (min, max) = exact.drawable_box(index);
            (min, max, index..index + 1)
        });
        Moved {
            boxes: boxes.collect(),
            drawables: drawables.into(),
            placements: placements.into(),
            exact: exact.into(),
            filter: own,
        }
    }

    /// The same with other clip planes.
    pub fn with_planes(&self, planes: Vec<Plane>) -> Self {
        let Moved { drawables, placements, exact, boxes, filter } = self;
        Moved {
            drawables: Arc::clone(drawables),
            placements: Arc::clone(placements),
            exact: Arc::clone(exact),
            boxes: Arc::clone(boxes),
            filter: filter.with_planes(planes),
        }
    }

    /// Moved drawables that are not hidden, rising.
    pub fn drawables(&self) -> &[u32] {
        &self.drawables
    }

    /// Corners of a box around all of them; `None` of none.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let boxes = self.boxes.iter().map(|(min, max, _)| (*min, *max));
        boxes.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// Where a moved object is placed now.
    pub fn world_from_part(&self, object: u32) -> Option<DAffine3> {
        self.placements.get(&object).copied()
    }

    /// The nearest hit with a moved drawable, of glass or not, where it is now; its drawable is the scene's.
    pub fn closest(&self, ray: &Ray) -> Option<TriangleHit> {
        self.exact.closest(ray, &self.filter).map(|hit| self.of_scene(hit))
    }

    /// The same of what is neither of glass nor looked through; `through` as in [`ExactScene::closest_through`].
    pub fn closest_through(&self, ray: &Ray, mut through: impl FnMut(TriangleHit)) -> Option<TriangleHit> {
        let hit = self.exact.closest_through(ray, &self.filter, |hit| through(self.of_scene(hit)));
        hit.map(|hit| self.of_scene(hit))
    }

    fn of_scene(&self, hit: TriangleHit) -> TriangleHit {
        TriangleHit { drawable: self.drawables[hit.drawable as usize], ..hit }
    }

    /// Normal of such a hit.
    pub fn normal(&self, hit: &TriangleHit) -> Option<DVec3> {
        let index = self.drawables.binary_search(&hit.drawable).ok()?;
        Some(self.exact.normal(&TriangleHit { drawable: index as u32, ..*hit }))
    }

    /// World-space box of a moved object, hidden or not; `None` where it has not moved.
    pub fn object_box(&self, scene: &Scene, object: u32) -> Option<(DVec3, DVec3)> {
        let motion = self.placements.get(&object)? * scene.world_from_part(object).inverse();
        let record = &scene.objects()[object as usize];
        Some(transformed_box(&motion, record.min.into(), record.max.into()))
    }

    /// World-space box of a moved drawable.
    pub fn drawable_box(&self, drawable: u32) -> Option<(DVec3, DVec3)> {
        let index = self.drawables.binary_search(&drawable).ok()?;
        Some(self.exact.drawable_box(index as u32))
    }

    /// The scene of moved drawables alone, numbered from 0 in the order of [`Moved::drawables`]: for methods that ask no voxels, since
    /// these are those of `scene`, which they come from.
    fn query<'a>(&'a self, scene: &QueryScene<'a>) -> QueryScene<'a> {
        QueryScene { exact: &self.exact, filter: &self.filter, object_boxes: &self.boxes, ..*scene }
    }

    /// Those that a camera may see, with their samples: all in its view, whatever may hide them; `rays`, which go by triangles
    /// (`RayMethod::Exact`), tell how large they look. Rising by drawable.
    pub fn candidates(
        &self,
        scene: &QueryScene,
        camera: &CameraRays,
        rays: &mut CoherentQuery,
    ) -> Vec<(Candidate, u32)> {
        if self.drawables.is_empty() {
            return Vec::new();
        }
        let scene = self.query(scene);
        let in_view = query(&scene, camera, Method::Frustum, &QuerySettings::default());
        // `Silent` never cancels.
        let Some(seen) = rays.frame(&scene, camera, &Silent) else { return Vec::new() };
        let seen = VisibleSet { visible: in_view.visible, ..seen.found };
        let of_scene = |candidate: Candidate| {
            let index = candidate.drawable as usize;
            (Candidate { drawable: self.drawables[index], ..candidate }, seen.samples[index])
        };
        candidates(&self.exact, camera, &seen).into_iter().map(of_scene).collect()
    }

    /// Voxels of those that stop light, `voxel_size` world units a side; `None` where none does.
    ///
    /// # Errors
    ///
    /// They reach farther than a grid of such voxels can, or take more than a gigabyte; `progress` was cancelled.
    pub fn voxels(
        &self,
        voxel_size: f64,
        progress: &dyn Progress,
    ) -> Result<Option<MovedVoxels>, MovedError> {
        let exact = &self.exact;
        let casts = |&index: &u32| !exact.is_transparent(index) && !self.filter.is_seen_through(index);
        let casting: Vec<u32> = (0..exact.drawable_count()).filter(casts).collect();
        let bounds = casting.iter().map(|&index| exact.drawable_box(index));
        let Some((min, max)) = bounds.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))) else { return Ok(None) };
        let grid = Grid::with_voxel_size(min, max, voxel_size)?;
        let drawables = Casting { grid, exact, drawables: &casting, progress };
        let settings = Settings { memory: Some(MOST_VOXEL_BYTES), ..Settings::default() };
        let dag = voxelize_into(&grid, &drawables, &settings, &mut NoOwners)?.dag;
        Ok(Some(MovedVoxels { grid, dag }))
    }
}

/// Drawables of a scene as the voxelizer wants them.
struct Casting<'a> {
    grid: Grid,
    exact: &'a ExactScene,
    drawables: &'a [u32],
    progress: &'a dyn Progress,
}

/// Nobody asks whose the voxels are.
struct NoOwners;

impl OwnerSink for NoOwners {
    fn append(&mut self, _: &[u64]) -> std::io::Result<()> {
        Ok(())
    }
}

impl Drawables for Casting<'_> {
    fn count(&self) -> u32 {
        self.drawables.len() as u32
    }

    fn advance(&self, triangles: u64) -> ControlFlow<()> {
        self.progress.advance(triangles);
        if self.progress.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn load(&self, drawable: u32, mesh: &mut SnappedMesh) {
        let index = self.drawables[drawable as usize];
        let chunk = &self.exact.chunks()[self.exact.chunk_of(index) as usize];
        let world_from_part = self.exact.world_from_part(index);
        mesh.vertices.clear();
        mesh.triangles.clear();
        for triangle in 0..chunk.triangle_count() {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(chunk.triangle(triangle).map(|corner| {
                self.grid.snap(self.grid.grid_from_world(world_from_part.transform_point3(corner)))
            }));
            mesh.triangles.push([first, first + 1, first + 2]);
        }
    }
}
