//! Frames and turns from libm's sine and cosine, or none at all: equal on every machine.

use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DVec2, DVec3};

/// Cosine and sine of `step` of `steps` equal parts of a full turn.
pub(super) fn turn(step: u32, steps: u32) -> DVec2 {
    let angle = TAU * f64::from(step) / f64::from(steps);
    DVec2::new(libm::cos(angle), libm::sin(angle))
}

/// A unit vector at a right angle to `direction`, the same for the same direction.
pub(super) fn across(direction: DVec3) -> DVec3 {
    let helper = if direction.y.abs() < 0.9 { DVec3::Y } else { DVec3::X };
    helper.cross(direction).normalize_or(DVec3::Z)
}

/// Translation.
pub(super) fn at(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(x, y, z))
}

/// A frame from its origin, X and Y; Z follows. The axes must be orthonormal.
pub(super) fn frame(origin: DVec3, x: DVec3, y: DVec3) -> DAffine3 {
    DAffine3 { matrix3: DMat3::from_cols(x, y, x.cross(y)), translation: origin }
}

/// A frame whose +Y points along `direction` (any length but zero).
pub(super) fn along(origin: DVec3, direction: DVec3) -> DAffine3 {
    let y = direction.normalize_or(DVec3::Y);
    frame(origin, across(y), y)
}

/// A turn about +Y by `quarters` of 90 degrees: exact.
pub(super) fn quarter_turn(quarters: u32) -> DAffine3 {
    let x = [DVec3::X, DVec3::NEG_Z, DVec3::NEG_X, DVec3::Z][(quarters % 4) as usize];
    frame(DVec3::ZERO, x, DVec3::Y)
}

/// A turn about +Y by radians.
pub(super) fn yaw(angle: f64) -> DAffine3 {
    frame(DVec3::ZERO, DVec3::new(libm::cos(angle), 0.0, -libm::sin(angle)), DVec3::Y)
}
