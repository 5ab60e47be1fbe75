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
pub mod culling;
mod frustum;
mod hybrid;
mod sampling;
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
pub use sampling::{PixelRay, for_each_pixel_ray, sample_offset};

use crate::camera::CameraRays;
use crate::exact::{ExactScene, TriangleHit};
use crate::filter::Filter;
use crate::progress::{Progress, Silent};
use crate::ray::Ray;

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
    /// Rays per pixel, at least 1.
    pub rays_per_pixel: u32,
    /// Where the jitter begins ([`sample_offset`]). 0: the first ray goes through the pixel's middle. Another frame, or a
    /// reference that shall share no ray with the answer, begins after the last.
    pub first_sample: u32,
    /// `hybrid` accepts a voxel without asking its triangles when the voxel is smaller than this many pixels at its
    /// distance. 0: always ask, which gives what `exact` gives.
    pub accept_below_px: f64,
}

impl Default for QuerySettings {
    fn default() -> Self {
        QuerySettings { rays_per_pixel: 1, first_sample: 0, accept_below_px: 0.0 }
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

    /// One more sample.
    fn count(&mut self, drawable: u32) {
        let samples = &mut self.samples[drawable as usize];
        *samples = samples.saturating_add(1);
        self.visible[drawable as usize] = true;
    }

    /// Counts what one ray met: its first opaque drawable and, of the transparent hits, those before it.
    fn count_ray(&mut self, through: &[TriangleHit], first_opaque: Option<(u32, f64)>) {
        let end = first_opaque.map_or(f64::INFINITY, |(_, t)| t);
        let mut any = first_opaque.is_some();
        for hit in through.iter().filter(|hit| hit.t < end) {
            self.count(hit.drawable);
            any = true;
        }
        if let Some((drawable, _)) = first_opaque {
            self.count(drawable);
        }
        self.hits += u64::from(any);
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
    fn trace(&self, rays: &[Ray], found: &mut VisibleSet, scratch: &mut Self::Scratch);
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

/// As [`query`], telling `progress` of each pixel done; `None` when cancelled.
pub fn query_until(
    scene: &QueryScene,
    camera: &CameraRays,
    method: Method,
    settings: &QuerySettings,
    progress: &dyn Progress,
) -> Option<VisibleSet> {
    match method {
        Method::Frustum => Some(frustum::in_frustum(scene, camera)),
        Method::Exact => cast_all(&ExactQuery(*scene), scene, camera, settings, progress),
        Method::Voxel => cast_all(&voxel::VoxelQuery::new(scene), scene, camera, settings, progress),
        Method::Hybrid => {
            let query = hybrid::HybridQuery::new(scene);
            cast_all(&query, scene, camera, settings, progress)
        }
    }
}

/// Casts all rays of an image; counting is per thread and merged once.
fn cast_all<Q: RayQuery>(
    query: &Q,
    scene: &QueryScene,
    camera: &CameraRays,
    settings: &QuerySettings,
    progress: &dyn Progress,
) -> Option<VisibleSet> {
    let drawables = scene.exact.drawable_count();
    let tiles = sampling::tiles(camera.size());
    let samples = settings.first_sample..settings.first_sample.saturating_add(settings.rays_per_pixel);
    let next = AtomicUsize::new(0);
    let parts = rayon::broadcast(|_| {
        let mut found = VisibleSet::new(drawables);
        let mut scratch = Q::Scratch::default();
        let mut rays = Vec::with_capacity(PACKET_RAYS);
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(tile) = tiles.get(index) else { return Some(found) };
            if progress.is_cancelled() {
                return None;
            }
            for sample in samples.clone() {
                rays.clear();
                for_each_pixel_ray(camera, tile, sample..sample + 1, |pixel| {
                    rays.extend(scene.filter.clipped(&pixel.ray));
                });
                found.rays += tile.pixels();
                query.trace(&rays, &mut found, &mut scratch);
            }
            progress.advance(tile.pixels());
        }
    });
    let mut all = VisibleSet::new(drawables);
    for part in parts {
        all.merge(&part?);
    }
    Some(all)
}

struct ExactQuery<'a>(QueryScene<'a>);

impl RayQuery for ExactQuery<'_> {
    /// Hits with transparent drawables.
    type Scratch = Vec<TriangleHit>;

    fn trace(&self, rays: &[Ray], found: &mut VisibleSet, through: &mut Vec<TriangleHit>) {
        let ExactQuery(QueryScene { exact, filter, .. }) = self;
        for ray in rays {
            through.clear();
            let opaque = exact.closest_through(ray, filter, |hit| through.push(hit));
            found.count_ray(through, opaque.map(|hit| (hit.drawable, hit.t)));
        }
    }
}
