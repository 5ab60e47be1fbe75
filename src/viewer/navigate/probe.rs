//! What stands in the way: single rays.

use glam::DVec3;

use crate::ray::Ray;
use crate::shown::Shown;

/// Tells how far it is to the next thing.
pub trait Probe {
    /// Distance in model units from `origin`, world space, to the first thing in a direction of length 1; `None` when
    /// there is nothing up to `most`.
    fn distance(&self, origin: DVec3, direction: DVec3, most: f64) -> Option<f64>;
}

impl Probe for Shown {
    /// Hidden drawables and what is beyond clip planes stop nobody, transparent drawables do, and what was moved stands where it is
    /// now.
    ///
    /// By triangles: in voxels, which are a step's height in large scenes, a person would stand above the floor and stop before the
    /// wall. Voxels that name the triangles to ask gave the same answers later: in a plant of 4,000 objects at 4096^3, rays of 2 m
    /// took 3.2 us with them and 0.4 us without, rays without end 24 us and 1 us.
    fn distance(&self, origin: DVec3, direction: DVec3, most: f64) -> Option<f64> {
        let ray = Ray { t_max: most, ..Ray::new(origin, direction) };
        self.closest(&ray).map(|hit| hit.t)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DAffine3;

    use super::super::{Mode, Motion, Navigator};
    use super::*;
    use crate::camera::{Camera, Plane, Projection};
    use crate::filter::Filter;
    use crate::loaded::LoadedScene;
    use crate::moved::Motions;
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
    fn a_person_stands_and_walks_in_a_plant() {
        let loaded = load();
        let (min, max) = bounds(&loaded);
        let probe = Shown::all(Arc::new(loaded));
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

    #[test]
    fn what_is_hidden_or_cut_away_stops_nobody_and_what_was_moved_does_where_it_is() {
        let loaded = Arc::new(load());
        let (min, max) = bounds(&loaded);
        let above = |object: usize| {
            let object = &loaded.scene().objects()[object];
            let (low, high) = (DVec3::from(object.min), DVec3::from(object.max));
            0.5 * (low + high) + (max.y - low.y + 100.0) * DVec3::Y
        };
        let down = |shown: &Shown, from: DVec3| shown.distance(from, DVec3::NEG_Y, f64::INFINITY);
        let all = Shown::all(Arc::clone(&loaded));
        // The highest things are met first, from straight above.
        let met = (0..loaded.scene().objects().len()).find_map(|object| {
            let from = above(object);
            let hit = all.closest(&Ray::new(from, DVec3::NEG_Y))?;
            let is_own = loaded.scene().drawable_object(hit.drawable) as usize == object;
            is_own.then_some((object, from, hit))
        });
        let (object, from, hit) = met.unwrap();
        let mut hidden = Filter::default();
        loaded.scene().object_drawables(object as u32).for_each(|drawable| hidden.set_hidden(drawable, true));
        let without = Shown::new(Arc::clone(&loaded), hidden, Motions::new());
        assert!(down(&without, from).is_none_or(|t| t > hit.t));
        let mut cut = Filter::default();
        cut.clip_by(Plane { normal: DVec3::NEG_Y, point: from - (hit.t + 0.01) * DVec3::Y });
        let below = Shown::new(Arc::clone(&loaded), cut, Motions::new());
        assert!(down(&below, from).is_none_or(|t| t > hit.t + 0.009));
        // Away from where it was, and in the way where it is now: far beside the scene.
        let aside = DVec3::X * 3.0 * (max - min).x;
        let motions = Motions::from([(object as u32, DAffine3::from_translation(aside))]);
        let moved = Shown::new(Arc::clone(&loaded), Filter::default(), motions);
        assert!(down(&moved, from).is_none_or(|t| t > hit.t));
        let found = down(&moved, from + aside).unwrap();
        assert!((found - hit.t).abs() < 1e-6 && down(&all, from + aside).is_none(), "{found} {}", hit.t);
    }
}
