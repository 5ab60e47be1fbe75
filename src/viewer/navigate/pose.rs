//! Where the eye is and how it is turned.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat3, DQuat, DVec3};

use crate::camera::{Camera, CameraError};

/// Turning ends so far from straight up and down: a tenth of a degree before.
pub(super) const MOST_PITCH: f64 = FRAC_PI_2 - 0.1 * std::f64::consts::PI / 180.0;

/// A view nearer to straight up or down than this, as the length of its level part, says less about its heading than the
/// picture's up does.
const LEAST_LEVEL: f64 = 1e-6;

/// An eye and its orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// World space.
    pub eye: DVec3,
    /// View space is x to the right, y up in the picture, z towards who looks.
    pub world_from_view: DQuat,
}

impl Pose {
    /// Of a camera, which is checked.
    pub fn of(camera: &Camera) -> Result<Self, CameraError> {
        let forward = camera.rays()?.forward();
        let eye = DVec3::from(camera.eye);
        let up = DVec3::from(camera.up);
        let right = up.try_normalize().and_then(|up| forward.cross(up).try_normalize());
        let right = right.ok_or(CameraError::Up { up })?;
        Ok(Pose { eye, world_from_view: orientation(right, right.cross(forward), forward) })
    }

    /// Length 1.
    pub fn right(&self) -> DVec3 {
        self.world_from_view * DVec3::X
    }

    /// Up in the picture, length 1.
    pub fn up(&self) -> DVec3 {
        self.world_from_view * DVec3::Y
    }

    /// Along the view, length 1.
    pub fn forward(&self) -> DVec3 {
        self.world_from_view * DVec3::NEG_Z
    }

    /// The same view turned to another orientation about a point, which stays where it is in the picture.
    pub fn turned_about(&self, point: DVec3, world_from_view: DQuat) -> Self {
        let in_view = self.world_from_view.inverse() * (point - self.eye);
        Pose { eye: point - world_from_view * in_view, world_from_view }
    }
}

fn orientation(right: DVec3, up: DVec3, forward: DVec3) -> DQuat {
    DQuat::from_mat3(&DMat3::from_cols(right, up, -forward)).normalize()
}

/// A view with a level horizon, radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Aim {
    /// Turned to the right from the compass' ahead.
    pub heading: f64,
    /// Above the horizon, -pi/2 (straight down) to pi/2.
    pub pitch: f64,
}

/// The world's directions, all of length 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Compass {
    /// Against gravity.
    pub up: DVec3,
    /// What heading 0 looks along: -Z where Y is up, +Y where Z is.
    ahead: DVec3,
    /// To the right of that: +X in both.
    right: DVec3,
}

impl Compass {
    /// `None` when `up` has no direction.
    pub fn new(up: DVec3) -> Option<Self> {
        let up = up.try_normalize()?;
        let side = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
        let right = (side - side.dot(up) * up).try_normalize()?;
        Some(Compass { up, ahead: up.cross(right), right })
    }

    /// Level directions of a heading: along it, and to the right of it.
    pub fn level(&self, heading: f64) -> (DVec3, DVec3) {
        let (sin, cos) = heading.sin_cos();
        (cos * self.ahead + sin * self.right, cos * self.right - sin * self.ahead)
    }

    /// The orientation of a view with a level horizon.
    pub fn orientation(&self, aim: Aim) -> DQuat {
        let (ahead, right) = self.level(aim.heading);
        let (sin, cos) = aim.pitch.sin_cos();
        orientation(right, cos * self.up - sin * ahead, cos * ahead + sin * self.up)
    }

    /// Heading and pitch of any orientation; its roll is left out.
    pub fn aim(&self, world_from_view: DQuat) -> Aim {
        let forward = world_from_view * DVec3::NEG_Z;
        let rise = forward.dot(self.up);
        let flat = forward - rise * self.up;
        let level = flat.length();
        let ahead = if level > LEAST_LEVEL { flat } else { -rise * (world_from_view * DVec3::Y) };
        let heading = ahead.dot(self.right).atan2(ahead.dot(self.ahead));
        Aim { heading, pitch: rise.atan2(level) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ahead_is_away_from_who_stands_in_front_whatever_is_up() {
        let y_up = Compass::new(DVec3::Y).unwrap().level(0.0);
        assert_eq!(y_up, (DVec3::NEG_Z, DVec3::X));
        let z_up = Compass::new(DVec3::Z * 3.0).unwrap().level(0.0);
        assert_eq!(z_up, (DVec3::Y, DVec3::X));
        assert!(Compass::new(DVec3::ZERO).is_none() && Compass::new(DVec3::NAN).is_none());
    }

    #[test]
    fn an_aim_is_what_its_orientation_was_made_from() {
        let mut random = oorandom::Rand64::new(7);
        for round in 0..2000 {
            let up = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(0.3, -0.7, 0.2)][round % 4];
            let compass = Compass::new(up).unwrap();
            let mut unit = || 2.0 * random.rand_float() - 1.0;
            let pitch = if round % 5 == 0 { FRAC_PI_2.copysign(unit()) } else { unit() * MOST_PITCH };
            let aim = Aim { heading: unit() * 3.0, pitch };
            let found = compass.aim(compass.orientation(aim));
            let apart = (found.heading - aim.heading).abs() + (found.pitch - aim.pitch).abs();
            assert!(apart < 1e-9, "seed 7, round {round}: {aim:?} {found:?}");
        }
    }
}
