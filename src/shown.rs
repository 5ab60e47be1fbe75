//! A scene as a user has left it: what is hidden, cut away, looked through, and what was moved.

use std::sync::Arc;

use glam::DVec3;

use crate::camera::Plane;
use crate::exact::TriangleHit;
use crate::filter::Filter;
use crate::loaded::LoadedScene;
use crate::moved::{Motions, Moved};
use crate::ray::Ray;
use crate::visibility::QueryScene;

/// A scene as a user has left it. It does not change: another state is another one.
pub struct Shown {
    scene: Arc<LoadedScene>,
    /// As it was set.
    filter: Filter,
    /// The same, without what was moved, which is not any more where it was.
    unmoved: Filter,
    motions: Arc<Motions>,
    moved: Option<Moved>,
}

impl Shown {
    /// Without what `filter` hides and cuts away, and with objects moved by these motions.
    pub fn new(scene: Arc<LoadedScene>, filter: Filter, motions: impl Into<Arc<Motions>>) -> Self {
        let motions: Arc<Motions> = motions.into();
        let moved = (!motions.is_empty()).then(|| Moved::new(&scene, &motions, &filter));
        let mut unmoved = filter.clone();
        for &object in motions.keys() {
            scene.scene().object_drawables(object).for_each(|drawable| unmoved.set_hidden(drawable, true));
        }
        Shown { scene, filter, unmoved, motions, moved }
    }

    /// The same with other clip planes: quickly, however much is hidden and moved.
    pub fn with_planes(&self, planes: Vec<Plane>) -> Self {
        Shown {
            scene: Arc::clone(&self.scene),
            unmoved: self.unmoved.with_planes(planes.clone()),
            motions: Arc::clone(&self.motions),
            moved: self.moved.as_ref().map(|moved| moved.with_planes(planes.clone())),
            filter: self.filter.with_planes(planes),
        }
    }

    /// Where the file has it, but for what the loaded scene leaves out by itself.
    pub fn all(scene: Arc<LoadedScene>) -> Self {
        let filter = scene.query().filter.clone();
        Shown::new(scene, filter, Motions::new())
    }

    /// As the file has it.
    pub fn scene(&self) -> &Arc<LoadedScene> {
        &self.scene
    }

    /// What is hidden, cut away and looked through, moved or not.
    pub fn filter(&self) -> &Filter {
        &self.filter
    }

    /// What each object has been moved by, hidden or not.
    pub fn motions(&self) -> &Motions {
        &self.motions
    }

    /// What was moved.
    pub fn moved(&self) -> Option<&Moved> {
        self.moved.as_ref()
    }

    /// What was not moved, to ask voxels or triangles about.
    pub fn unmoved(&self) -> QueryScene<'_> {
        QueryScene { filter: &self.unmoved, ..self.scene.query() }
    }

    /// The nearest hit, of glass or not, where things are now.
    pub fn closest(&self, ray: &Ray) -> Option<TriangleHit> {
        let unmoved = self.unmoved();
        let moved = self.moved.as_ref().and_then(|moved| moved.closest(ray));
        nearest(unmoved.exact.closest(ray, unmoved.filter), moved)
    }

    /// The nearest hit that is neither of glass nor looked through. `through` is called for what is, with the nearest hit of each
    /// drawable, in no particular order; those behind the answer are to be ignored by the caller.
    pub fn closest_through(&self, ray: &Ray, mut through: impl FnMut(TriangleHit)) -> Option<TriangleHit> {
        let unmoved = self.unmoved();
        let moved = self.moved.as_ref().and_then(|moved| moved.closest_through(ray, &mut through));
        nearest(unmoved.exact.closest_through(ray, unmoved.filter, through), moved)
    }

    /// World-space normal of such a hit, on either side; zero for a triangle without area.
    pub fn normal(&self, hit: &TriangleHit) -> DVec3 {
        let moved = self.moved.as_ref().and_then(|moved| moved.normal(hit));
        moved.unwrap_or_else(|| self.scene.query().exact.normal(hit))
    }
}

fn nearest(a: Option<TriangleHit>, b: Option<TriangleHit>) -> Option<TriangleHit> {
    a.into_iter().chain(b).min_by(|a, b| a.t.total_cmp(&b.t))
}
