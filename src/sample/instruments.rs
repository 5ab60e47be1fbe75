//! Field instruments.

use glam::{DAffine3, DVec3};

use super::names;
use super::plan::Plan;
use super::shapes::{Solid, along, at, block, cylinder, frame};

/// A pressure gauge on a stub: on a pipe or shell at `root`, facing along `direction` upwards.
pub(super) fn gauge(plan: &mut Plan, tag: String, root: DVec3, facing: DVec3) {
    let part = plan.shared("PI DIAL 100", || {
        let face = along(DVec3::new(0.0, 0.30, 0.0), DVec3::Z);
        Solid::from([cylinder(0.012, 0.0, 0.26, DAffine3::IDENTITY), cylinder(0.055, -0.02, 0.045, face)])
    });
    let glass = plan.shared("SIGHT GLASS 100", || cylinder(0.05, 0.0, 0.006, DAffine3::IDENTITY).into());
    let x = DVec3::Y.cross(facing);
    let place = frame(root, x, DVec3::Y);
    plan.put_as(tag, part, place, names::BLACK);
    plan.put(glass, place * along(DVec3::new(0.0, 0.30, 0.025), DVec3::Z), names::GLASS);
}

/// A transmitter on a stand of its own.
pub(super) fn transmitter(plan: &mut Plan, tag: String, place: DAffine3) {
    plan.group(tag, |plan| {
        let stand = plan.shared("STAND 2in H1300", || {
            Solid::from([
                cylinder(0.03, 0.0, 1.3, DAffine3::IDENTITY),
                block(0.2, 0.012, 0.2, DAffine3::IDENTITY),
            ])
        });
        plan.put(stand, place, names::GALVANIZED);
        let head = plan.shared("TRANSMITTER 3051", || {
            Solid::from([
                cylinder(0.06, -0.09, 0.18, along(DVec3::new(0.0, 1.42, 0.0), DVec3::Z)),
                cylinder(0.05, 1.28, 0.1, DAffine3::IDENTITY),
                block(0.11, 0.09, 0.09, at(0.0, 1.2, 0.0)),
            ])
        });
        plan.put(head, place, names::INSTRUMENT);
    });
}
