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
mod pixel_order;
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
pub(crate) use nearest::{Asked, VOXELS_BETWEEN_RAYS};
pub use nearest::{TileHits, TileTracer};
pub use sampling::{Jitter, PixelRay, RayGrid, RaysPerPixel, Tile, sample_offset};

use crate::camera::CameraRays;
use crate::exact::ExactScene;
use crate::filter::Filter;
use crate::progress::{Progress, Silent};
use crate::ray::Ray;
use source::{ImageRays, RaySource};
use tally::{Tally, TallyPool};
pub(crate) use voxel::grid_ray;

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

impl Method {
    /// What each ray does; `None` for the method that casts none.
    pub fn ray_method(self) -> Option<RayMethod> {
        match self {
            Method::Voxel => Some(RayMethod::Voxel),
            Method::Hybrid => Some(RayMethod::Hybrid),
            Method::Exact => Some(RayMethod::Exact),
            Method::Frustum => None,
        }
    }
}

/// What a ray does, in the methods that cast rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RayMethod {
    /// As [`Method::Voxel`].
    Voxel,
    /// As [`Method::Hybrid`].
    Hybrid,
    /// As [`Method::Exact`].
    Exact,
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
    /// Spend rays where drawables change. A tile of 8x8 cells in which the first sample of every cell met the same one
    /// drawable, or nothing, gets no more; that sample counts for all. With one sample a cell, one ray a pixel or
    /// less, a quarter of the cells, spread over all rows and columns, stands in for the first sample.
    ///
    /// Gains where surfaces are large in the image, costs where tiles differ, since they are cast in two parts: of a plant of
    /// 45,000 objects, one ray a pixel took 0.76 of the time amid it and 1.19 in views of all of it, and lost 1.02 of the pixels.
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
    /// Is a drawable seen through: of glass, or looked through?
    #[inline]
    pub fn is_transparent(&self, drawable: u32) -> bool {
        self.exact.is_transparent(drawable) || self.filter.is_seen_through(drawable)
    }

    /// Does it stop light?
    #[inline]
    pub fn casts(&self, drawable: u32) -> bool {
        !self.is_transparent(drawable) && !self.filter.is_hidden(drawable)
    }
}

/// The answer of a query.
///
/// `samples[d]` of `weight` parts of the image show drawable d. Where every ray counts once, `weight` is `rays`; it is more
/// where a ray stands for others that were spared ([`QuerySettings::adaptive`]) and where rays of earlier frames
/// still count ([`coherent`]).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VisibleSet {
    /// Rays cast for this answer: what it cost.
    pub rays: u64,
    /// What `hits` and `samples` are to be divided by; 0 of methods that cast no rays.
    pub weight: u64,
    /// How much of the weight met anything.
    pub hits: u64,
    /// Samples of each drawable: how much of the weight met it. A count that `u32` cannot hold stays at the most that it
    /// can, which takes more than 4,294,967,295 rays of one query (a coherent one scales its counts instead).
    pub samples: Vec<u32>,
    /// Is the drawable in the answer? True wherever there is a sample, and for drawables that a method cannot tell from
    /// one (the other owners of a voxel, everything in the frustum).
    pub visible: Vec<bool>,
}

impl VisibleSet {
    fn new(drawables: u32) -> Self {
        VisibleSet {
            rays: 0,
            weight: 0,
            hits: 0,
            samples: vec![0; drawables as usize],
            visible: vec![false; drawables as usize],
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
    let Some(method) = method.ray_method() else {
        return Some(frustum::in_frustum(scene, camera));
    };
    let source = ImageRays::new(scene, camera, settings);
    cast(scene, method, &source, false, &TallyPool::default(), progress).map(|tally| tally.found)
}

/// Casts all rays of a source. Give the tally back to the pool if the pool is to be used again.
fn cast(
    scene: &QueryScene,
    method: RayMethod,
    source: &impl RaySource,
    with_sightings: bool,
    pool: &TallyPool,
    progress: &dyn Progress,
) -> Option<Tally> {
    let tally = || pool.take(scene.exact.drawable_count(), with_sightings);
    let parts = match method {
        RayMethod::Exact => cast_all(&exact::ExactQuery(*scene), source, tally, progress),
        RayMethod::Voxel => cast_all(&voxel::VoxelQuery::new(scene), source, tally, progress),
        RayMethod::Hybrid => cast_all(&hybrid::HybridQuery::new(scene), source, tally, progress),
    };
    let mut all = None;
    let mut is_whole = true;
    for (part, is_done) in parts {
        is_whole &= is_done;
        match &mut all {
            None => all = Some(part),
            Some(all) => {
                all.merge(&part);
                pool.give(part);
            }
        }
    }
    if is_whole {
        return all;
    }
    all.into_iter().for_each(|tally| pool.give(tally));
    None
}

/// Casts all rays of a source; counting is per thread. Returns what each thread counted, and whether it was not cancelled.
fn cast_all<Q: RayQuery>(
    query: &Q,
    source: &impl RaySource,
    tally: impl Fn() -> Tally + Sync,
    progress: &dyn Progress,
) -> Vec<(Tally, bool)> {
    let next = AtomicUsize::new(0);
    rayon::broadcast(|_| {
        let mut tally = tally();
        let mut scratch = Q::Scratch::default();
        let mut rays = Vec::with_capacity(PACKET_RAYS);
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= source.batches() {
                return (tally, true);
            }
            if progress.is_cancelled() {
                return (tally, false);
            }
            for step in 0..source.steps() {
                rays.clear();
                tally.begin(index, step);
                let cast = source.rays(index, step, &mut rays);
                tally.found.rays += cast;
                tally.found.weight += cast;
                query.trace(&rays, &mut tally, &mut scratch);
                if tally.is_uniform(cast)
                    && let Some(rest) = source.rest(index, step)
                {
                    tally.repeat(rest);
                    break;
                }
            }
            progress.advance(source.cells(index));
        }
    })
}
