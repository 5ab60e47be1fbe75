//! Steelwork in general: rolled beams, foundations, decks, lighting poles.

use glam::{DAffine3, DVec3};

use super::access;
use super::names::{self, CONCRETE, GALVANIZED, STRUCTURE, properties, weathered};
use super::plan::{PartRef, Plan};
use super::sections::Outline;
use super::shapes::{Shape, Solid, at, bar, block, cylinder, frame};

/// Top of a foundation above the paving.
const FOUNDATION_M: f64 = 0.3;
/// Underside of a column: on its foundation's grout and base plate.
pub(super) const COLUMN_FOOT_M: f64 = FOUNDATION_M + 0.07;

/// A rolled beam, shared by section and length, along local +Y.
pub(super) fn beam(plan: &mut Plan, section: &str, height: f64, width: f64, length: f64) -> PartRef {
    plan.shared(&format!("{section} L={}", (length * 1000.0).round()), || {
        let outline =
            Outline::ISection { height, width, web: 0.008 + height * 0.01, flange: 0.008 + height * 0.03 };
        Shape::Prism { outline, length, frame: DAffine3::IDENTITY }.into()
    })
}

/// A frame for a beam along +X whose section stands upright, axis through `from`.
pub(super) fn beam_x(from: DVec3) -> DAffine3 {
    frame(from, DVec3::Z, DVec3::X)
}

/// A frame for a beam along +Z whose section stands upright, axis through `from`.
pub(super) fn beam_z(from: DVec3) -> DAffine3 {
    frame(from, DVec3::NEG_X, DVec3::Z)
}

/// A concrete foundation block with its base plate and anchor bolts.
pub(super) fn foundation(plan: &mut Plan, x: f64, z: f64) {
    let block_part = plan.shared("FOUNDATION 900", || {
        Solid::from([
            block(0.9, FOUNDATION_M + 0.15, 0.9, at(0.0, -0.15, 0.0)),
            block(0.7, 0.04, 0.7, at(0.0, FOUNDATION_M, 0.0)),
        ])
    });
    plan.put(block_part, at(x, 0.0, z), CONCRETE);
    let plate = plan.shared("BASE PLATE 500", || block(0.5, 0.03, 0.5, at(0.0, 0.04, 0.0)).into());
    plan.put(plate, at(x, FOUNDATION_M, z), STRUCTURE);
    let anchor = plan.shared("ANCHOR BOLT M24", || {
        let nut = Shape::Prism {
            outline: Outline::Hexagon { flats: 0.036 },
            length: 0.02,
            frame: DAffine3::IDENTITY,
        };
        Solid::from([cylinder(0.012, -0.05, 0.11, DAffine3::IDENTITY), nut])
    });
    plan.bolts(anchor, at(x, FOUNDATION_M + 0.07, z), 0.28, 4, names::BOLT_STEEL);
}

/// A steel table with a floor of gratings at `floor` and a handrail around; `size` along X and Z. Stairs lead up to it
/// on the side of `stairs_toward` (along Z).
pub(super) fn deck(
    plan: &mut Plan,
    tag: String,
    centre: DVec3,
    size: [f64; 2],
    floor: f64,
    stairs_toward: f64,
) {
    let [x, z] = size;
    plan.group_with(tag, properties("DECK", "S355J2", None), |plan| {
        let low = centre - DVec3::new(x / 2.0, 0.0, z / 2.0);
        let foot = COLUMN_FOOT_M;
        let column = beam(plan, "HEB240", 0.24, 0.24, floor - 0.1 - foot);
        let along = beam(plan, "IPE300", 0.3, 0.15, x / 2.0 - 0.24);
        let across = beam(plan, "IPE300", 0.3, 0.15, z - 0.24);
        for column_at in [0.0, x / 2.0, x] {
            for z in [low.z, low.z + z] {
                foundation(plan, low.x + column_at, z);
                plan.put(column, at(low.x + column_at, foot, z), STRUCTURE);
                if column_at < x {
                    let from = DVec3::new(low.x + column_at + 0.12, floor - 0.26, z);
                    plan.put(along, beam_x(from), STRUCTURE);
                }
            }
        }
        for rib in 0..=4 {
            let at_rib = low.x + x * f64::from(rib) / 4.0;
            plan.put(across, beam_z(DVec3::new(at_rib, floor - 0.26, low.z + 0.12)), STRUCTURE);
        }
        let is_high = stairs_toward > 0.0;
        let floor_low = DVec3::new(low.x, floor, low.z);
        access::platform(plan, "Floor".into(), floor_low, x, z, [is_high, !is_high, true, true]);
        // Stairs rise along X outside one border, to a landing that leaves a gap in its rail.
        let (border, side) = if is_high { (low.z + z, low.z + z + 0.1) } else { (low.z, low.z - 1.05) };
        let (landing, width) = (1.0, 0.95);
        let corner = |x: f64| DVec3::new(x, floor, border);
        access::handrail(plan, corner(low.x), corner(low.x + x - landing));
        let start = low.x + x - landing - (floor / 0.2).round() * 0.24;
        access::stairs(plan, floor, width - 0.1, at(start, 0.0, side));
        let landing_low = DVec3::new(low.x + x - landing, floor, side);
        let rails = [!is_high, is_high, false, true];
        access::platform(plan, "Landing".into(), landing_low, landing, width, rails);
    });
}

/// A lighting pole with two lamps.
pub(super) fn lighting_pole(plan: &mut Plan, tag: String, x: f64, z: f64) {
    plan.group_with(tag, properties("LP-9000", "S235JR", None), |plan| {
        let pole = plan.shared("LIGHTING POLE 9000", || {
            Solid::from([
                cylinder(0.09, 0.0, 9.0, DAffine3::IDENTITY),
                block(0.4, 0.3, 0.4, DAffine3::IDENTITY),
                bar(DVec3::new(-0.9, 8.9, 0.0), DVec3::new(0.9, 8.9, 0.0), 0.04),
            ])
        });
        plan.put(pole, at(x, 0.0, z), GALVANIZED);
        let lamp = plan.shared("FLOODLIGHT 400W", || block(0.5, 0.14, 0.35, DAffine3::IDENTITY).into());
        for side in [-0.75, 0.75] {
            let colour = weathered(plan, names::CABINET);
            plan.put(lamp, at(x + side, 8.72, z), colour);
        }
    });
}
