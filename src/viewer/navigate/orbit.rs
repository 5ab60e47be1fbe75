//! Turning about the pivot, pan and zoom.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::{NEAREST, Navigator, rows};
use crate::ray::Ray;

/// What a step of zoom leaves of the distance.
const ZOOM_PER_STEP: f64 = 0.85;

/// Steps of one call count up to this many.
const MOST_STEPS: f64 = 100.0;

/// Where nothing is ahead, zoom moves as if something were so far away at least, as a fraction of the scene's diagonal:
/// the way through empty space never becomes endless.
const LEAST_FREE_REACH: f64 = 0.02;

/// Zoom goes no farther from the scene than so many of its diagonals, and shows no more of them in a parallel projection.
const FARTHEST: f64 = 1e3;

impl Navigator {
    /// Turns the view about the pivot, which stays where it is in the picture, as on a turntable: what is before the pivot
    /// follows a drag of so many pixels (x to the right, y down), half a turn for the height of the window.
    pub fn orbit(&mut self, pixels: DVec2, size: (u32, u32)) {
        if pixels == DVec2::ZERO || !pixels.is_finite() {
            return;
        }
        self.begin_motion();
        let world_from_view = self.turned(pixels, PI / rows(size));
        self.pose = self.pose.turned_about(self.pivot, world_from_view);
    }

    /// Moves the eye sideways so that what is at the pivot's depth follows the cursor exactly. `pixels` is the drag, x to the
    /// right, y down.
    pub fn pan(&mut self, pixels: DVec2, size: (u32, u32)) {
        if pixels == DVec2::ZERO || !pixels.is_finite() {
            return;
        }
        self.begin_motion();
        self.bring_pivot_ahead();
        let moved = pixels * (self.height_at_pivot() / rows(size));
        self.pose.eye += moved.y * self.pose.up() - moved.x * self.pose.right();
    }

    /// Zooms by so many steps, in where positive, towards what is under the cursor, which stays under it. `towards` is the
    /// camera's ray through the cursor, `distance` how far along it, in model units, something is.
    ///
    /// The eye comes nearer to it by a share of the distance, down to a millionth of the scene and never through it. Where
    /// nothing is there (`None`), it goes on at no less than a certain pace, through the pivot if need be. In a parallel
    /// projection the picture's height changes instead.
    pub fn zoom(&mut self, steps: f64, towards: &Ray, distance: Option<f64>) {
        let Some(direction) = towards.direction.try_normalize() else { return };
        let is_usable = steps.is_finite() && towards.origin.is_finite();
        if steps == 0.0 || !is_usable || distance.is_some_and(|distance| !distance.is_finite()) {
            return;
        }
        self.begin_motion();
        let scale = ZOOM_PER_STEP.powf(steps.clamp(-MOST_STEPS, MOST_STEPS));
        match self.parallel_height {
            Some(height) => self.scale_picture(height, scale, towards.origin),
            None => self.approach(scale, direction, distance),
        }
        self.bring_pivot_ahead();
    }

    /// Scales the distance along a direction of length 1.
    fn approach(&mut self, scale: f64, direction: DVec3, distance: Option<f64>) {
        let nearest = NEAREST * self.diagonal();
        let reach = distance.unwrap_or_else(|| {
            // The pivot's depth is along the view, the ray is not.
            let slant = direction.dot(self.pose.forward()).max(0.1);
            (self.depth() / slant).max(LEAST_FREE_REACH * self.diagonal())
        });
        // From nearer than the nearest the way back begins there: it takes no longer than from there.
        let ahead = reach.max(nearest) * (1.0 - scale);
        let most = if distance.is_some() { (reach - nearest).max(0.0) } else { reach };
        let eye = self.pose.eye + ahead.min(most) * direction;
        if scale < 1.0 || eye.distance(self.centre()) < FARTHEST * self.diagonal() {
            self.pose.eye = eye;
        }
    }

    /// Scales a parallel picture about a point of it.
    fn scale_picture(&mut self, height: f64, scale: f64, about: DVec3) {
        let (least, most) = (NEAREST * self.diagonal(), FARTHEST * self.diagonal());
        // A camera that was set may be beyond the limits; zoom does not jump to them.
        let scaled = (height * scale).clamp(least.min(height), most.max(height));
        // Rays may start anywhere along the view.
        let apart = about - self.pose.eye;
        let sideways = apart - apart.dot(self.pose.forward()) * self.pose.forward();
        self.pose.eye += (1.0 - scaled / height) * sideways;
        self.parallel_height = Some(scaled);
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Random, SIZE, navigator, pixel};
    use super::*;

    /// A navigator that was moved about, some in parallel projection.
    fn anywhere(random: &mut Random, round: usize) -> Navigator {
        let mut navigator = navigator(DVec3::ZERO, [DVec3::Y, DVec3::Z][round % 2]);
        navigator.set_parallel(round.is_multiple_of(3));
        navigator.orbit(500.0 * random.vector().truncate(), SIZE);
        navigator.pan(300.0 * random.vector().truncate(), SIZE);
        navigator.set_pivot(random.vector() * 30.0);
        navigator
    }

    fn horizon_tilt(navigator: &Navigator) -> f64 {
        navigator.pose.right().dot(navigator.compass.up).abs()
    }

    #[test]
    fn an_orbit_keeps_the_pivot_in_its_pixel_and_the_horizon_level() {
        let mut random = Random::new(11);
        for round in 0..500 {
            let mut navigator = anywhere(&mut random, round);
            let pivot = navigator.pivot();
            let before = pixel(&navigator, pivot);
            for _ in 0..10 {
                navigator.orbit(2000.0 * random.vector().truncate(), SIZE);
                let apart = pixel(&navigator, pivot).distance(before);
                assert!(apart < 1e-6, "seed 11, round {round}: {apart} pixels");
                assert!(horizon_tilt(&navigator) < 1e-12, "seed 11, round {round}");
                let rise = navigator.pose.up().dot(navigator.compass.up);
                assert!(rise > 1e-3, "seed 11, round {round}: tipped over, {rise}");
            }
        }
    }

    #[test]
    fn what_is_before_the_pivot_follows_an_orbit() {
        let mut navigator = navigator(DVec3::ZERO, DVec3::Z);
        navigator.set_pivot(DVec3::ZERO);
        let near = -10.0 * navigator.pose.forward();
        let before = pixel(&navigator, near);
        navigator.orbit(DVec2::new(20.0, 0.0), SIZE);
        assert!(pixel(&navigator, near).x > before.x + 1.0, "a drag to the right");
        let before = pixel(&navigator, near);
        navigator.orbit(DVec2::new(0.0, 20.0), SIZE);
        assert!(pixel(&navigator, near).y > before.y + 1.0, "a drag down");
    }

    #[test]
    fn a_pan_carries_the_pivots_depth_with_the_cursor() {
        let mut random = Random::new(12);
        for round in 0..500 {
            let mut navigator = anywhere(&mut random, round);
            navigator.bring_pivot_ahead();
            let aside = random.vector() * 5.0;
            let forward = navigator.pose.forward();
            let point = navigator.pivot() + aside - aside.dot(forward) * forward;
            let drag = random.vector().truncate() * 400.0;
            let expected = pixel(&navigator, point) + drag;
            navigator.pan(drag, SIZE);
            let apart = pixel(&navigator, point).distance(expected);
            assert!(apart < 1e-6, "seed 12, round {round}: {apart} pixels");
        }
    }

    #[test]
    fn zoom_keeps_what_is_under_the_cursor_and_comes_back() {
        let mut random = Random::new(13);
        for round in 0..500 {
            let mut navigator = anywhere(&mut random, round);
            let rays = navigator.camera(SIZE).rays().unwrap();
            let cursor = DVec2::new(random.unit() * 640.0, random.unit() * 480.0);
            let ray = rays.ray(cursor.x, cursor.y);
            let point = ray.at(5.0 + 40.0 * random.unit());
            let start = navigator.pose.eye;
            for steps in [1.0, 3.0, 0.25, -3.0, -0.25, -1.0] {
                let ray = navigator.camera(SIZE).rays().unwrap().ray(cursor.x, cursor.y);
                navigator.zoom(steps, &ray, Some(point.distance(ray.origin)));
                let apart = pixel(&navigator, point).distance(cursor);
                assert!(apart < 1e-6, "seed 13, round {round}: {apart} pixels");
            }
            assert!(navigator.pose.eye.distance(start) < 1e-9, "seed 13, round {round}");
        }
    }

    #[test]
    fn zoom_slows_before_a_wall_never_passes_it_and_gets_away_from_it() {
        let mut navigator = navigator(DVec3::ZERO, DVec3::Y);
        let ray = navigator.camera(SIZE).rays().unwrap().ray(100.0, 100.0);
        let direction = ray.direction.normalize_or_zero();
        let wall = ray.origin + 50.0 * direction;
        let distance = |navigator: &Navigator| (wall - navigator.pose.eye).dot(direction);
        let mut way_before = f64::INFINITY;
        for _ in 0..400 {
            let before = distance(&navigator);
            navigator.zoom(1.0, &ray, Some(before));
            let way = before - distance(&navigator);
            assert!(way <= way_before + 1e-12 && way >= 0.0 && distance(&navigator) > 0.0);
            way_before = way;
        }
        let nearest = distance(&navigator);
        assert!(nearest < 1e-3, "came near: {nearest}");
        // A hundred steps, not thousands, from there to where it began.
        (0..120).for_each(|_| navigator.zoom(-1.0, &ray, Some(distance(&navigator))));
        assert!(distance(&navigator) > 50.0, "{}", distance(&navigator));
    }

    #[test]
    fn zoom_goes_on_where_nothing_is_and_keeps_the_pivot_ahead() {
        let mut navigator = navigator(DVec3::ZERO, DVec3::Y);
        let start = navigator.pose.eye;
        let ray = navigator.camera(SIZE).rays().unwrap().ray(320.0, 240.0);
        (0..200).for_each(|_| navigator.zoom(1.0, &ray, None));
        let way = navigator.pose.eye.distance(start);
        assert!(way > 1.5 * start.length(), "through the pivot and on: {way}");
        assert!((navigator.pivot() - navigator.pose.eye).dot(navigator.pose.forward()) > 0.0);
        (0..2000).for_each(|_| navigator.zoom(-1.0, &ray, None));
        assert!(navigator.pose.eye.length() <= FARTHEST * navigator.diagonal());
        let lost = navigator.camera(SIZE);
        navigator.zoom(f64::NAN, &ray, None);
        navigator.zoom(1.0, &Ray::new(DVec3::ZERO, DVec3::ZERO), None);
        navigator.orbit(DVec2::NAN, SIZE);
        navigator.pan(DVec2::INFINITY, SIZE);
        assert_eq!(navigator.camera(SIZE), lost, "what is no number moves nothing");
    }
}
