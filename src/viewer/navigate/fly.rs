//! Looking around and flying.

use std::f64::consts::FRAC_PI_2;

use glam::DVec2;

use super::{Mode, Motion, Navigator, Probe, rows};

/// Distance ahead that is flown in a second, as a fraction of it.
const RATE: f64 = 0.8;

/// Slowest and fastest flight, scene diagonals a second.
const SPEEDS: (f64, f64) = (0.002, 0.3);

/// Seconds in which the speed comes nearer to what it should be by a factor of e. Less than a quarter of `1 / RATE`, so
/// that who flies at a wall slows down in time and does not swing.
const SETTLING_SECONDS: f64 = 0.25;

/// A step takes no longer than this, seconds: after a stall of the window the way is not made up for in one leap.
const LONGEST_STEP: f64 = 0.25;

impl Navigator {
    /// Turns about the eye by a drag or move of so many pixels (x to the right, y down), a quarter turn for the height of the
    /// window; the horizon is level.
    pub fn look(&mut self, pixels: DVec2, size: (u32, u32)) {
        if pixels == DVec2::ZERO || !pixels.is_finite() {
            return;
        }
        self.begin_motion();
        let depth = self.depth();
        self.pose.world_from_view = self.turned(pixels, FRAC_PI_2 / rows(size));
        self.pivot = self.pose.eye + depth * self.pose.forward();
    }

    /// Moves on by a time in seconds, as the keys ask, in the modes [`Mode::Fly`] and [`Mode::Walk`]. Call it every frame, also
    /// when no key is down: the speed settles, and who walks may fall.
    pub fn step(&mut self, dt: f64, motion: &Motion, probe: &dyn Probe) {
        // A glide goes its way unless a key is down.
        let is_gliding = self.is_gliding() && motion.checked().is_none();
        if dt.is_nan() || dt <= 0.0 || is_gliding {
            return;
        }
        let dt = dt.min(LONGEST_STEP);
        match self.mode {
            Mode::Orbit => {}
            Mode::Fly => self.fly(dt, motion, probe),
            Mode::Walk => self.walk(dt, motion, probe),
        }
    }

    fn fly(&mut self, dt: f64, motion: &Motion, probe: &dyn Probe) {
        let way = self.fly_way(dt, probe);
        let Some((axes, hurry)) = motion.checked() else { return };
        self.begin_motion();
        let (forward, right) = (self.pose.forward(), self.pose.right());
        let direction = axes.x * forward + axes.y * right + axes.z * self.compass.up;
        let moved = hurry * way * direction.clamp_length_max(1.0);
        self.pose.eye += moved;
        // What is looked at goes along: its depth is what a later pan or change of projection is measured by.
        self.pivot += moved;
    }

    /// How far a time at the speed of flight goes, and the speed after it: it falls or rises exponentially to what suits the
    /// distance ahead, and the way is the integral of that, so that the rate of frames makes no difference.
    fn fly_way(&mut self, dt: f64, probe: &dyn Probe) -> f64 {
        let (slowest, fastest) = (SPEEDS.0 * self.diagonal(), SPEEDS.1 * self.diagonal());
        let ahead = probe.distance(self.pose.eye, self.pose.forward(), fastest / RATE);
        let suited = ahead.map_or(fastest, |distance| (RATE * distance).clamp(slowest, fastest));
        let excess = self.fly_speed.unwrap_or(suited) - suited;
        let left = (-dt / SETTLING_SECONDS).exp();
        self.fly_speed = Some(suited + excess * left);
        suited * dt + excess * SETTLING_SECONDS * (1.0 - left)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::testing::{Boxes, Random, SIZE, navigator, pixel};
    use super::*;

    /// A wall at z = -40, ahead of an eye at z = 40.
    fn towards_a_wall() -> (Navigator, Boxes) {
        let mut navigator = navigator(DVec3::ZERO, DVec3::Y);
        navigator.look_from(super::super::Side::FRONT, 0.0);
        navigator.pose.eye = DVec3::new(0.0, 0.0, 40.0);
        navigator.set_mode(Mode::Fly);
        let wall = (DVec3::new(-90.0, -90.0, -41.0), DVec3::new(90.0, 90.0, -40.0));
        (navigator, Boxes(vec![wall]))
    }

    const AHEAD: Motion = Motion { forward: 1.0, right: 0.0, up: 0.0, hurry: 1.0 };

    #[test]
    fn looking_turns_about_the_eye_with_a_level_horizon_and_never_over() {
        let mut random = Random::new(21);
        for round in 0..500 {
            let mut navigator = navigator(DVec3::ZERO, [DVec3::Y, DVec3::Z][round % 2]);
            let eye = navigator.pose.eye;
            navigator.look(random.vector().truncate() * 3000.0, SIZE);
            assert_eq!(navigator.pose.eye, eye);
            assert!(navigator.pose.right().dot(navigator.compass.up).abs() < 1e-12, "seed 21, round {round}");
            assert!(navigator.pose.up().dot(navigator.compass.up) > 1e-3, "seed 21, round {round}");
            let middle = pixel(&navigator, navigator.pivot());
            assert!(middle.distance(DVec2::new(320.0, 240.0)) < 1e-6, "the pivot is looked at");
        }
        let mut navigator = navigator(DVec3::ZERO, DVec3::Y);
        let before = navigator.compass.aim(navigator.pose.world_from_view);
        navigator.look(DVec2::new(10.0, 10.0), SIZE);
        let after = navigator.compass.aim(navigator.pose.world_from_view);
        assert!(after.heading > before.heading && after.pitch < before.pitch, "right and down");
    }

    #[test]
    fn a_step_of_twice_the_time_is_two_steps() {
        for (frames, tolerance) in [(30, 1e-2), (240, 1e-3)] {
            let way = |frames: u32| {
                let (mut navigator, wall) = towards_a_wall();
                (0..4 * frames).for_each(|_| navigator.step(1.0 / f64::from(frames), &AHEAD, &wall));
                40.0 - navigator.pose.eye.z
            };
            let (once, twice) = (way(frames), way(2 * frames));
            assert!((once - twice).abs() < tolerance * once, "{frames} frames a second: {once} {twice}");
        }
        // Where nothing is ahead, but for rounding.
        let (mut one, _) = towards_a_wall();
        one.fly_speed = Some(1.0);
        let mut two = one.clone();
        one.step(0.2, &AHEAD, &Boxes::default());
        (0..2).for_each(|_| two.step(0.1, &AHEAD, &Boxes::default()));
        assert!(one.pose.eye.distance(two.pose.eye) < 1e-12);
    }

    #[test]
    fn flight_slows_before_a_wall_smoothly_and_keeps_to_its_limits() {
        let (mut navigator, wall) = towards_a_wall();
        let diagonal = navigator.diagonal();
        let mut before: Option<f64> = None;
        for frame in 0..600 {
            navigator.step(1.0 / 60.0, &AHEAD, &wall);
            let speed = navigator.fly_speed.unwrap();
            assert!((SPEEDS.0 * diagonal..=SPEEDS.1 * diagonal).contains(&speed), "frame {frame}: {speed}");
            if let Some(before) = before {
                assert!((speed / before - 1.0).abs() < 0.1, "frame {frame}: {before} {speed}");
            }
            before = Some(speed);
            if navigator.pose.eye.z < -39.0 {
                break;
            }
        }
        assert!(before.unwrap() < 0.05 * diagonal, "{before:?}");
        // Something passes close by: the speed follows within a few frames, not at once.
        navigator.fly_speed = Some(SPEEDS.1 * diagonal);
        navigator.step(1.0 / 60.0, &Motion::default(), &wall);
        assert!(navigator.fly_speed.unwrap() > 0.9 * SPEEDS.1 * diagonal);
    }

    #[test]
    fn keys_move_along_their_axes_diagonals_no_faster() {
        let (start, nothing) = (towards_a_wall().0, Boxes::default());
        let moved = |motion: Motion| {
            let mut navigator = start.clone();
            navigator.step(0.1, &motion, &nothing);
            navigator.pose.eye - start.pose.eye
        };
        let way = 0.1 * SPEEDS.1 * start.diagonal();
        let still = Motion::default();
        for (motion, expected) in [
            (AHEAD, DVec3::NEG_Z),
            (Motion { right: -1.0, ..still }, DVec3::NEG_X),
            (Motion { up: 5.0, ..still }, DVec3::Y),
            (Motion { forward: 1.0, hurry: 3.0, ..still }, 3.0 * DVec3::NEG_Z),
            (Motion { forward: 1.0, right: 1.0, ..still }, DVec3::new(0.5f64.sqrt(), 0.0, -0.5f64.sqrt())),
            (Motion { forward: f64::NAN, ..still }, DVec3::ZERO),
        ] {
            assert!(moved(motion).distance(way * expected) < 1e-9, "{motion:?}: {}", moved(motion));
        }
    }
}
