//! Walking: feet on the ground, steps, walls.
//!
//! The body is a cylinder with rays for skin. Rays around it, in the half towards which it moves, say how far it may go in
//! each direction; of the way that is wished for, what would go farther is taken away, and what is left slides along the wall.
//! Rays down, from the height of a step above the feet, find the ground. A thing thinner than the rays are apart may
//! enter the body at its sides, not its middle.

use std::f64::consts::FRAC_PI_8;

use glam::DVec3;

use super::{Motion, Navigator, Probe};

/// Directions of the rays around the body, from straight ahead, in eighths of pi.
const FAN: [f64; 9] = [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0, -4.0];

/// Rays above one another in each of these directions.
const HEIGHTS: u32 = 5;

/// Ground is looked for under the middle and under so many points around it, so that nobody falls through a grating.
const SOLES: u32 = 6;

/// How far from the middle these are, in radii.
const SOLE: f64 = 0.6;

/// What stands in the way begins a little above what is stepped on, in step heights.
const ABOVE_STEP: f64 = 1.05;

/// The way of one test is at most this fraction of the radius, and one test is for no longer than this, seconds.
const LONGEST_WAY: f64 = 0.25;
const LONGEST_TIME: f64 = 1.0 / 60.0;

/// Who walks hurries no more than this: the tests above cost rays.
const MOST_HURRY: f64 = 10.0;

/// Steps are climbed and descended so many times as fast as the body walks, rather than in a jump.
const CLIMB: f64 = 2.0;

/// Rounds of taking away from the way what each direction does not allow, as one may bring back what another took.
const ROUNDS: u32 = 8;

/// Feet nearer to the ground than this fraction of the eye height stand on it.
const STANDING: f64 = 1e-6;

/// Who walks. Lengths in model units, times in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Of the eye above the ground.
    pub eye_height: f64,
    /// Highest step that is climbed.
    pub step_height: f64,
    /// Half as wide as the body.
    pub radius: f64,
    /// Of walking, per second.
    pub speed: f64,
    /// Acceleration of falling.
    pub gravity: f64,
    /// Falling gets no faster.
    pub most_fall_speed: f64,
}

impl Body {
    /// A grown person in a model whose unit is so many metres; `None` when that is not finite and above 0.
    pub fn person(metres_per_unit: f64) -> Option<Self> {
        let metre = metres_per_unit.recip();
        let is_length = metre > 0.0 && metre.is_finite() && metres_per_unit.is_finite();
        is_length.then_some(Body {
            eye_height: 1.7 * metre,
            step_height: 0.4 * metre,
            radius: 0.3 * metre,
            speed: 1.6 * metre,
            gravity: 9.81 * metre,
            most_fall_speed: 50.0 * metre,
        })
    }

    /// Heights above the feet between which something is in the way.
    fn upright(&self) -> (f64, f64) {
        (ABOVE_STEP * self.step_height, 1.06 * self.eye_height)
    }
}

impl Navigator {
    /// Walks for a time, in pieces so short that nothing is leapt over.
    pub(super) fn walk(&mut self, dt: f64, motion: &Motion, probe: &dyn Probe) {
        let aim = self.compass.aim(self.pose.world_from_view);
        let (ahead, right) = self.compass.level(aim.heading);
        let (axes, hurry) = motion.checked().unwrap_or((DVec3::ZERO, 1.0));
        let hurry = hurry.min(MOST_HURRY);
        let speed = hurry * self.body.speed;
        let wish = dt * speed * (axes.x * ahead + axes.y * right).clamp_length_max(1.0);
        let pieces = (wish.length() / (LONGEST_WAY * self.body.radius)).max(dt / LONGEST_TIME);
        // At least one, and few: hurry and time are bounded.
        let pieces = pieces.ceil().clamp(1.0, 1000.0) as u32;
        let piece = f64::from(pieces).recip();
        let start = self.pose.eye;
        let mut eye = start;
        for _ in 0..pieces {
            eye += self.free_way(eye, wish * piece, probe);
            eye += self.settle(eye, dt * piece, speed.max(self.body.speed), probe) * self.compass.up;
        }
        if eye != start {
            self.begin_motion();
            self.pose.eye = eye;
            self.pivot += eye - start;
        }
    }

    /// What is left of a level way of an eye when walls are regarded.
    fn free_way(&self, eye: DVec3, wish: DVec3, probe: &dyn Probe) -> DVec3 {
        let Some(ahead) = wish.try_normalize() else { return DVec3::ZERO };
        let aside = ahead.cross(self.compass.up);
        let length = wish.length();
        let limits = FAN.map(|eighths| {
            let (sin, cos) = (eighths * FRAC_PI_8).sin_cos();
            let direction = cos * ahead + sin * aside;
            (direction, self.allowed(eye, direction, length, probe))
        });
        let mut way = wish;
        for _ in 0..ROUNDS {
            for (direction, allowed) in limits {
                way -= (way.dot(direction) - allowed).max(0.0) * direction;
            }
        }
        // A corner: what one wall asks for the other forbids.
        let is_allowed = |(direction, allowed): (DVec3, f64)| way.dot(direction) <= allowed + 1e-3 * length;
        if limits.into_iter().all(is_allowed) { way } else { DVec3::ZERO }
    }

    /// How far the body may move in a level direction, at most `length`: less than 0 where something has entered it already.
    fn allowed(&self, eye: DVec3, direction: DVec3, length: f64, probe: &dyn Probe) -> f64 {
        let (up, radius) = (self.compass.up, self.body.radius);
        let feet = eye - self.body.eye_height * up;
        let (low, high) = self.body.upright();
        let spacing = (high - low) / f64::from(HEIGHTS - 1);
        let heights = (0..HEIGHTS).map(|i| low + f64::from(i) * spacing);
        let hits =
            heights.filter_map(|height| probe.distance(feet + height * up, direction, radius + length));
        let free = hits.fold(radius + length, f64::min) - radius;
        // Rails and pipes that lie between the rays above one another.
        let rim = feet + radius * direction + high * up;
        let free = if probe.distance(rim, -up, high - low).is_some() { free.min(0.0) } else { free };
        free.max(-0.5 * length)
    }

    /// How far an eye rises in a time, or falls where negative: up and down steps at a speed, else by gravity.
    fn settle(&mut self, eye: DVec3, dt: f64, speed: f64, probe: &dyn Probe) -> f64 {
        let fallen_with = std::mem::take(&mut self.fall_speed);
        // No ground below in the scene: nobody falls out of the world.
        let Some(drop) = self.drop_below(eye, probe) else { return 0.0 };
        let Body { eye_height, step_height, gravity, most_fall_speed, .. } = self.body;
        if drop.abs() <= STANDING * eye_height {
            return 0.0;
        }
        let climbed = CLIMB * speed * dt;
        if drop < 0.0 || (fallen_with == 0.0 && drop <= step_height) {
            return -drop.clamp(-climbed, climbed);
        }
        let fallen = fallen_with * dt + 0.5 * gravity * dt * dt;
        if fallen < drop {
            self.fall_speed = (fallen_with + gravity * dt).min(most_fall_speed);
        }
        -fallen.min(drop)
    }

    /// From the feet down to the ground: negative where it is above them, by a step at most. `None` where there is no ground
    /// within the scene's bounds.
    fn drop_below(&self, eye: DVec3, probe: &dyn Probe) -> Option<f64> {
        let Body { eye_height, step_height, radius, .. } = self.body;
        let up = self.compass.up;
        let knee = eye - (eye_height - step_height) * up;
        let lowest = DVec3::select(up.cmpge(DVec3::ZERO), self.min, self.max);
        // A little farther, for ground that is the very bottom of the scene.
        let most = (knee - lowest).dot(up) + step_height;
        let (ahead, right) = self.compass.level(0.0);
        let soles = (0..SOLES).map(|i| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / f64::from(SOLES)).sin_cos();
            knee + SOLE * radius * (cos * ahead + sin * right)
        });
        let under = soles.chain([knee]).filter_map(|sole| probe.distance(sole, -up, most));
        under.min_by(f64::total_cmp).map(|distance| distance - step_height)
    }
}

#[cfg(test)]
mod tests;
