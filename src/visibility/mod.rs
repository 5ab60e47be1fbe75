//! Visibility queries: what does a camera see?
//!
//! A ray of the query gives one sample to the first opaque drawable that it meets and one to every transparent drawable
//! before that. Methods ([`Method`]) differ in how they find them:
//!
//! - `frustum`: every drawable whose box meets the view pyramid; no samples.
//! - `voxel`: the first occupied voxel wins: all its owners become visible, the sample goes to the first of them.
//! - `hybrid`: the voxels along the ray name the candidates, their triangles decide.
//! - `exact`: triangles only, the reference.

mod accuracy;
pub mod coherent;
pub mod culling;
mod exact;
mod frustum;
mod hybrid;
mod nearest;
mod sampling;
mod source;
mod tally;
mod voxel;

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use serde::Serialize;
use voxsight_voxel::dag::{DagRef, OwnersRef};
use voxsight_voxel::grid::Grid;
use voxsight_voxel::raycast::PACKET_RAYS;

pub use accuracy::{Accuracy, ClassError, accuracy};
pub(crate) use nearest::Asked;
pub use nearest::{TileHits, TileTracer};
pub use sampling::{Jitter, PixelRay, RayGrid, RaysPerPixel, Tile, sample_offset};

use crate::camera::CameraRays;
use crate::exact::ExactScene;
use crate::filter::Filter;
use crate::progress::{Progress, Silent};
use crate::ray::Ray;
use source::{ImageRays, RaySource};
use tally::Tally;

/// How visibility is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// The first occupied voxel wins.
    Voxel,
    /// Voxels propose, triangles decide.
    Hybrid,
    /// Triangles only.
    Exact,
    /// Boxes against the view pyramid, no occlusion.
    Frustum,
}

/// Settings of a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuerySettings {
    /// Rays per pixel.
    pub rays_per_pixel: RaysPerPixel,
    /// Where the sequence of samples begins ([`sample_offset`]). Another frame, or a reference that shall share no ray
    /// with the answer, begins after the last.
    pub first_sample: u32,
    /// Where in their cells the rays of a sample go.
    pub jitter: Jitter,
    /// Spend rays where drawables change: a tile of 8x8 cells in which the first sample of every cell met the same one
    /// drawable, or nothing, gets no more; that sample counts for all.
    pub adaptive: bool,
}

impl Default for QuerySettings {
    fn default() -> Self {
        QuerySettings {
            rays_per_pixel: RaysPerPixel::ONE,
            first_sample: 0,
            jitter: Jitter::Scattered,
            adaptive: false,
        }
    }
}

/// A scene as the queries see it.
#[derive(Clone, Copy)]
pub struct QueryScene<'a> {
    /// Level-0 triangles.
    pub exact: &'a ExactScene,
    /// Grid of the voxels.
    pub grid: Grid,
    /// Occupied voxels.
    pub dag: DagRef<'a>,
    /// Who occupies them.
    pub owners: OwnersRef<'a>,
    /// What is left out.
    pub filter: &'a Filter,
    /// World-space boxes of the objects and the range of their drawables, for `frustum`.
    pub object_boxes: &'a [(DVec3, DVec3, Range<u32>)],
}

impl QueryScene<'_> {
    /// World-space box of the object that a drawable is of.
    pub fn object_box(&self, drawable: u32) -> (DVec3, DVec3) {
        // Objects are in the order of their drawables.
        let object = self.object_boxes.partition_point(|(_, _, drawables)| drawables.end <= drawable);
        self.object_boxes
            .get(object)
            .map_or((DVec3::NEG_INFINITY, DVec3::INFINITY), |&(min, max, _)| (min, max))
    }
}

/// The answer of a query.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VisibleSet {
    /// Rays cast.
    pub rays: u64,
    /// Rays that met anything.
    pub hits: u64,
    /// Samples of each drawable.
    pub samples: Vec<u32>,
    /// Is the drawable in the answer? True wherever there is a sample, and for drawables that a method cannot tell from
    /// one (the other owners of a voxel, everything in the frustum).
    pub visible: Vec<bool>,
}

impl VisibleSet {
    fn new(drawables: u32) -> Self {
        VisibleSet {
            rays: 0,
            hits: 0,
            samples: vec![0; drawables as usize],
            visible: vec![false; drawables as usize],
        }
    }

    fn merge(&mut self, other: &VisibleSet) {
        self.rays += other.rays;
        self.hits += other.hits;
        for (mine, theirs) in self.samples.iter_mut().zip(&other.samples) {
            *mine = mine.saturating_add(*theirs);
        }
        for (mine, theirs) in self.visible.iter_mut().zip(&other.visible) {
            *mine |= theirs;
        }
    }

    /// Drawables in the answer.
    pub fn visible_count(&self) -> usize {
        self.visible.iter().filter(|&&visible| visible).count()
    }

    /// Samples and visibility of objects: `object_of` maps a drawable to its object.
    pub fn by_object(&self, object_of: impl Fn(u32) -> u32) -> BTreeMap<u32, u64> {
        let mut objects = BTreeMap::new();
        for (drawable, (&samples, &visible)) in self.samples.iter().zip(&self.visible).enumerate() {
            if visible {
                *objects.entry(object_of(drawable as u32)).or_default() += u64::from(samples);
            }
        }
        objects
    }
}

/// What the rays of a query find.
trait RayQuery: Sync {
    /// Working memory of a thread.
    type Scratch: Default;

    /// Counts what each of the rays meets. They are those of one sample of a tile, at most [`PACKET_RAYS`], already cut to
    /// what the filter leaves.
    fn trace(&self, rays: &[Ray], tally: &mut Tally, scratch: &mut Self::Scratch);
}

/// Asks what the camera sees. Uses all threads of the current rayon pool; the answer does not depend on their number.
pub fn query(
    scene: &QueryScene,
    camera: &CameraRays,
    method: Method,
    settings: &QuerySettings,
) -> VisibleSet {
    let nothing = || VisibleSet::new(scene.exact.drawable_count());
    // `Silent` never cancels.
    query_until(scene, camera, method, settings, &Silent).unwrap_or_else(nothing)
}

/// As [`query`], telling `progress` of each cell done; `None` when cancelled.
pub fn query_until(
    scene: &QueryScene,
    camera: &CameraRays,
    method: Method,
    settings: &QuerySettings,
    progress: &dyn Progress,
) -> Option<VisibleSet> {
    if method == Method::Frustum {
        return Some(frustum::in_frustum(scene, camera));
    }
    let source = ImageRays::new(scene, camera, settings);
    cast(scene, method, &source, false, progress).map(|tally| tally.found)
}

/// Casts all rays of a source with a method that casts rays.
fn cast(
    scene: &QueryScene,
    method: Method,
    source: &impl RaySource,
    with_sightings: bool,
    progress: &dyn Progress,
) -> Option<Tally> {
    let tally = || Tally::new(scene.exact.drawable_count(), with_sightings);
    match method {
        Method::Frustum => Some(tally()),
        Method::Exact => cast_all(&exact::ExactQuery(*scene), source, tally, progress),
        Method::Voxel => cast_all(&voxel::VoxelQuery::new(scene), source, tally, progress),
        Method::Hybrid => cast_all(&hybrid::HybridQuery::new(scene), source, tally, progress),
    }
}

/// Casts all rays of a source; counting is per thread and merged once.
fn cast_all<Q: RayQuery>(
    query: &Q,
    source: &impl RaySource,
    tally: impl Fn() -> Tally + Sync,
    progress: &dyn Progress,
) -> Option<Tally> {
    let next = AtomicUsize::new(0);
    let parts = rayon::broadcast(|_| {
        let mut tally = tally();
        let mut scratch = Q::Scratch::default();
        let mut rays = Vec::with_capacity(PACKET_RAYS);
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= source.batches() {
                return Some(tally);
            }
            if progress.is_cancelled() {
                return None;
            }
            for sample in 0..source.samples() {
                rays.clear();
                tally.begin(index, sample);
                let cast = source.rays(index, sample, &mut rays);
                tally.found.rays += cast;
                query.trace(&rays, &mut tally, &mut scratch);
                let left = u64::from(source.samples() - 1 - sample);
                if source.is_adaptive() && left > 0 && tally.repeat_if_uniform(cast, left) {
                    break;
                }
            }
            progress.advance(source.cells(index));
        }
    });
    let mut all = tally();
    for part in parts {
        all.merge(part?);
    }
    Some(all)
}
