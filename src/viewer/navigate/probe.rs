//! What stands in the way: single rays through voxels and triangles.

use std::collections::HashSet;

use glam::{DVec3, IVec3};

use crate::ray::Ray;
use crate::visibility::QueryScene;

/// Voxels a side of a brick, for whose owners the DAG is asked as one.
const BRICK: f64 = 4.0;

/// Tells how far it is to the next thing.
pub trait Probe {
    /// Distance in model units from `origin`, world space, to the first thing in a direction of length 1; `None` when
    /// there is nothing up to `most`.
    fn distance(&self, origin: DVec3, direction: DVec3, most: f64) -> Option<f64>;
}

/// The solid things of a scene, as its filter leaves them: hidden drawables and what is beyond clip planes stop nobody,
/// transparent drawables do.
///
/// Bricks of voxels along the ray name the candidates, front to back, and only their triangles are asked, until one is met
/// no farther than the next brick. Voxels alone would be too coarse: they are a step's height in large scenes, and a person
/// would stand above the floor and stop before the wall. Every voxel that a triangle touches knows its owner, so that
/// the answer is that of [`ExactScene::closest`](crate::exact::ExactScene::closest). (Which is quicker: in a plant of 4,000
/// objects at 4096^3, rays of 2 m took 3.2 us here and 0.4 us there, rays without end 24 us and 1 us.)
#[derive(Clone, Copy)]
pub struct SceneProbe<'a> {
    scene: QueryScene<'a>,
}

impl<'a> SceneProbe<'a> {
    /// Of a scene, with its filter as it is now.
    pub fn new(scene: &QueryScene<'a>) -> Self {
        SceneProbe { scene: *scene }
    }

    /// The ray up to where it meets a drawable first, if it does.
    fn nearest(&self, ray: Ray) -> Option<f64> {
        let QueryScene { exact, grid, dag, owners, filter, .. } = self.scene;
        let mut ray = ray;
        let mut met = None;
        let mut asked = HashSet::new();
        // A hit on the very border of its brick may lie before it by rounding.
        let slack = 0.5 * grid.voxel_size;
        let in_bricks = |vector: DVec3| vector / BRICK;
        let origin = in_bricks(grid.grid_from_world(ray.origin));
        let direction = in_bricks(ray.direction / grid.voxel_size);
        let side = f64::from(grid.side()) / BRICK;
        for (brick, entry) in BrickWalk::new(origin, direction, (ray.t_min, ray.t_max), side) {
            if entry > ray.t_max + slack {
                break;
            }
            let Some((ordinal, _)) = dag.brick_at((brick * BRICK as i32).to_array()) else { continue };
            for owner in owners.all_of_brick(ordinal) {
                if filter.is_hidden(owner) || !asked.insert(owner) {
                    continue;
                }
                if let Some(hit) = exact.closest_of(owner, &ray) {
                    ray.t_max = hit.t;
                    met = Some(hit.t);
                }
            }
        }
        met
    }
}

impl Probe for SceneProbe<'_> {
    fn distance(&self, origin: DVec3, direction: DVec3, most: f64) -> Option<f64> {
        let ray = Ray { t_max: most, ..Ray::new(origin, direction) };
        self.nearest(self.scene.filter.clipped(&ray)?)
    }
}

/// The bricks that a ray crosses, and where it enters them, front to back (Amanatides and Woo, "A Fast Voxel Traversal
/// Algorithm for Ray Tracing", 1987). Planes are met where their position says, never by adding up, so that nothing drifts.
struct BrickWalk {
    origin: DVec3,
    direction: DVec3,
    brick: IVec3,
    entry: f64,
    end: f64,
    side: i32,
}

impl BrickWalk {
    /// Of a ray in brick units through a grid of `side` bricks a side, for t in a range.
    fn new(origin: DVec3, direction: DVec3, (t_min, t_max): (f64, f64), side: f64) -> Self {
        let (mut entry, mut end) = (t_min, t_max);
        for k in 0..3 {
            if direction[k] != 0.0 {
                let (a, b) = (-origin[k] / direction[k], (side - origin[k]) / direction[k]);
                entry = entry.max(a.min(b));
                end = end.min(a.max(b));
            } else if !(0.0..=side).contains(&origin[k]) {
                end = f64::NEG_INFINITY;
            }
        }
        // A grid has at most 2^15 bricks a side.
        let at = origin + if entry <= end { entry } else { 0.0 } * direction;
        let brick = at.floor().clamp(DVec3::ZERO, DVec3::splat(side - 1.0)).as_ivec3();
        BrickWalk { origin, direction, brick, entry, end, side: side as i32 }
    }

    /// Where the ray leaves the brick along an axis.
    fn leaves(&self, axis: usize) -> f64 {
        let far = f64::from(self.brick[axis] + i32::from(self.direction[axis] > 0.0));
        if self.direction[axis] == 0.0 {
            f64::INFINITY
        } else {
            (far - self.origin[axis]) / self.direction[axis]
        }
    }
}

impl Iterator for BrickWalk {
    type Item = (IVec3, f64);

    fn next(&mut self) -> Option<(IVec3, f64)> {
        let is_inside =
            self.brick.cmpge(IVec3::ZERO).all() && self.brick.cmplt(IVec3::splat(self.side)).all();
        if self.entry > self.end || !is_inside {
            return None;
        }
        let found = (self.brick, self.entry);
        let leaves = DVec3::from([0, 1, 2].map(|axis| self.leaves(axis)));
        let axis = leaves.min_position();
        self.brick[axis] += if self.direction[axis] > 0.0 { 1 } else { -1 };
        self.entry = self.entry.max(leaves[axis]);
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::Random;
    use super::super::{Mode, Motion, Navigator};
    use super::*;
    use crate::camera::{Camera, Plane, Projection};
    use crate::filter::Filter;
    use crate::loaded::LoadedScene;
    use crate::prepare::{BuildSettings, Resolution, build};
    use crate::progress::Silent;
    use crate::report::Findings;
    use crate::sample::{PlantSettings, cameras, plant};
    use crate::scene::Scene;

    const PLANT: PlantSettings = PlantSettings { objects: 300, triangles: 30_000, seed: 5 };

    /// A plant, every second object of it transparent.
    fn load() -> LoadedScene {
        let mut model = plant(&PLANT);
        model.objects.iter_mut().step_by(2).for_each(|object| object.colour.0[3] = 90);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("plant.vxs");
        let settings = BuildSettings { resolution: Resolution::Log2(8), ..BuildSettings::default() };
        build(model, Vec::new(), Findings::default(), &settings, &file, &Silent).unwrap();
        LoadedScene::new(Scene::open(&file).unwrap(), &Silent).unwrap()
    }

    fn bounds(loaded: &LoadedScene) -> (DVec3, DVec3) {
        let bounds = loaded.scene().meta().bounds;
        (bounds.min.into(), bounds.max.into())
    }

    #[test]
    fn the_voxels_lead_to_what_the_triangles_say() {
        let loaded = load();
        let (min, max) = bounds(&loaded);
        let mut cut = Filter::default();
        let middle = min + 0.5 * (max - min);
        cut.clip_by(Plane { normal: DVec3::new(1.0, 0.2, 0.3), point: middle });
        (0..loaded.query().exact.drawable_count()).step_by(7).for_each(|d| cut.set_hidden(d, true));
        let (mut hits, mut through_glass) = ([0; 2], [0; 2]);
        for (run, filter) in [Filter::default(), cut].into_iter().enumerate() {
            let scene = QueryScene { filter: &filter, ..loaded.query() };
            let probe = SceneProbe::new(&scene);
            let mut random = Random::new(61);
            for round in 0..20_000 {
                // From in the scene and from around it; some along the axes, some short.
                let origin = middle + random.vector() * (max - min) * if round % 4 == 0 { 2.0 } else { 0.5 };
                let drawables = scene.exact.drawable_count();
                let (low, high) = scene.exact.drawable_box((random.unit() * f64::from(drawables)) as u32);
                let direction = match round % 7 {
                    0 => random.vector() * DVec3::Y,
                    1 | 2 => random.vector(),
                    _ => low + 0.5 * (high - low) - origin,
                };
                let Some(direction) = direction.try_normalize() else { continue };
                let most = if round % 2 == 0 { f64::INFINITY } else { 4.0 * random.unit() };
                let ray = Ray { t_max: most, ..Ray::new(origin, direction) };
                let expected = scene.exact.closest(&ray, &filter);
                let found = probe.distance(origin, direction, most);
                let is_same = match (found, expected) {
                    (Some(found), Some(expected)) => (found - expected.t).abs() <= 1e-9,
                    (found, expected) => found.is_none() && expected.is_none(),
                };
                assert!(is_same, "seed 61, round {round}: {found:?} {expected:?}, {ray:?}");
                hits[run] += u32::from(found.is_some());
                through_glass[run] +=
                    u32::from(expected.is_some_and(|e| scene.exact.is_transparent(e.drawable)));
            }
        }
        assert!(hits.iter().all(|&hits| hits > 1000), "{hits:?}");
        assert!(through_glass.iter().all(|&glass| glass > 100), "{through_glass:?}");
    }

    #[test]
    fn a_person_stands_and_walks_in_a_plant() {
        let loaded = load();
        let (min, max) = bounds(&loaded);
        let query = loaded.query();
        let probe = SceneProbe::new(&query);
        let view = cameras(&PLANT)[0];
        let camera = Camera {
            eye: view.eye,
            target: view.target,
            up: view.up,
            projection: Projection::Perspective { fov_y_deg: view.fov_y_deg },
            width: 64,
            height: 48,
        };
        let mut navigator = Navigator::new(min, max, DVec3::Y, 1.0).unwrap();
        navigator.set_camera(&camera).unwrap();
        navigator.set_mode(Mode::Walk);
        let ahead = Motion { forward: 1.0, ..Motion::default() };
        let walked = |navigator: &mut Navigator, seconds: u32, motion: Motion| {
            (0..60 * seconds).for_each(|_| navigator.step(1.0 / 60.0, &motion, &probe));
            DVec3::from(navigator.camera((64, 48)).eye)
        };
        let standing = walked(&mut navigator, 2, Motion::default());
        let ground = probe.distance(standing, DVec3::NEG_Y, 10.0).unwrap();
        assert!((1.69..1.71).contains(&ground), "{standing}: {ground} above the ground");
        let there = walked(&mut navigator, 3, ahead);
        assert!(there.distance(standing) > 1.0, "{standing} {there}");
        assert!(probe.distance(there, DVec3::NEG_Y, 10.0).unwrap() > 1.2, "{there}");
    }
}
