//! Flanged joints: weld-neck flanges, blinds, gaskets, stud bolts, nozzles on equipment.

use glam::{DAffine3, DVec3};

use super::names::{self, Bolt, Bore};
use super::plan::{PartRef, Plan};
use super::sections::Outline;
use super::shapes::{Knot, Shape, Solid, along, at, cylinder};
use crate::model::Colour;

/// Between two raised faces.
pub(super) const GASKET_M: f64 = 0.004;

/// From the raised face to the weld.
pub(super) fn flange_length(bore: Bore) -> f64 {
    bore.flange_thickness + 0.03 + bore.radius * 0.3
}

/// A weld-neck flange: raised face at the origin, neck along +Y.
pub(super) fn flange(plan: &mut Plan, bore: Bore) -> PartRef {
    plan.shared(&format!("FL-{}in-150#-WN-RF", bore.inches), || {
        let (face, disc) = (bore.bolt_radius * 0.8, 0.002 + bore.flange_thickness);
        let hub = bore.radius + (bore.bolt_radius - bore.radius) * 0.45;
        let profile = vec![
            Knot::To(0.0, 0.0),
            Knot::To(face, 0.0),
            Knot::To(face, 0.002),
            Knot::To(bore.flange_radius, 0.002),
            Knot::To(bore.flange_radius, disc),
            Knot::To(hub, disc),
            Knot::To(bore.radius, flange_length(bore) - 0.01),
            Knot::To(bore.radius, flange_length(bore)),
            Knot::To(0.0, flange_length(bore)),
        ];
        Shape::Lathe { profile, frame: DAffine3::IDENTITY }.into()
    })
}

/// A stud with a nut at each end, its middle at the origin, along Y; `grip` is what it clamps.
fn stud(plan: &mut Plan, bolt: Bolt, grip: f64) -> PartRef {
    let radius = f64::from(bolt.size) / 2000.0;
    let nut = radius * 1.6;
    let half = grip / 2.0 + nut + 0.006;
    let millimetres = (half * 400.0).round() as u32 * 5;
    plan.shared(&format!("BOLT M{}x{millimetres}", bolt.size), || {
        let hexagon = |y: f64| Shape::Prism {
            outline: Outline::Hexagon { flats: bolt.flats },
            length: nut,
            frame: at(0.0, y, 0.0),
        };
        Solid::from([
            cylinder(radius, -half, 2.0 * half, DAffine3::IDENTITY),
            hexagon(grip / 2.0),
            hexagon(-grip / 2.0 - nut),
        ])
    })
}

/// Gasket and bolts between two faces, `face` being the gasket's lower side, +Y across the joint.
fn close_joint(plan: &mut Plan, bore: Bore, face: DVec3, across: DVec3) {
    let gasket = plan.shared(&format!("GSK-{}in-150#", bore.inches), || {
        cylinder(bore.bolt_radius * 0.78, 0.0, GASKET_M, DAffine3::IDENTITY).into()
    });
    plan.put(gasket, along(face, across), names::GASKET);
    let grip = 2.0 * (bore.flange_thickness + 0.002) + GASKET_M;
    let stud = stud(plan, bore.bolt, grip);
    let middle = along(face + across * (GASKET_M / 2.0), across);
    plan.bolts(stud, middle, bore.bolt_radius, bore.bolts, names::BOLT_STEEL);
}

/// A flange that meets another face at `face`, with its gasket and bolts; the pipe leaves along `away`.
pub(super) fn flange_on(plan: &mut Plan, bore: Bore, face: DVec3, away: DVec3, colour: Colour) {
    let part = flange(plan, bore);
    plan.put(part, along(face + away * GASKET_M, away), colour);
    close_joint(plan, bore, face, away);
}

/// A nozzle from a shell: neck and flange. `root` lies inside the shell; returns the face.
pub(super) fn nozzle(
    plan: &mut Plan,
    bore: Bore,
    root: DVec3,
    direction: DVec3,
    reach: f64,
    colour: Colour,
) -> DVec3 {
    let face = root + direction * reach;
    let neck = reach - flange_length(bore);
    let millimetres = (reach * 1000.0).round();
    let part = plan.shared(&format!("NOZZLE {}in L={millimetres}", bore.inches), || {
        cylinder(bore.radius, 0.0, neck, DAffine3::IDENTITY).into()
    });
    plan.put(part, along(root, direction), colour);
    let part = flange(plan, bore);
    plan.put(part, along(face, -direction), colour);
    face
}

/// A nozzle closed by a blind flange: a manway, a spare, a vent.
pub(super) fn blind_nozzle(
    plan: &mut Plan,
    bore: Bore,
    root: DVec3,
    direction: DVec3,
    reach: f64,
    colour: Colour,
) {
    let face = nozzle(plan, bore, root, direction, reach, colour);
    blind(plan, bore, face, direction, colour);
}

/// A blind flange with gasket and bolts on the face of a flange at `face`.
pub(super) fn blind(plan: &mut Plan, bore: Bore, face: DVec3, away: DVec3, colour: Colour) {
    let part = plan.shared(&format!("FL-{}in-150#-BL-RF", bore.inches), || {
        cylinder(bore.flange_radius, 0.0, bore.flange_thickness, DAffine3::IDENTITY).into()
    });
    plan.put(part, along(face + away * GASKET_M, away), colour);
    close_joint(plan, bore, face, away);
}
