//! What is built into lines: valves, tees, reducers, flanged joints.

use glam::{DAffine3, DVec3};

use super::flanges::{GASKET_M, flange, flange_length, flange_on};
use super::names::{self, Bore, properties};
use super::plan::{PartRef, Plan};
use super::shapes::{Knot, Shape, Solid, along, at, bar, block, cylinder, frame};
use crate::model::Colour;

/// Something built into a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Fitting {
    /// Two flanges, to be opened for maintenance.
    Joint,
    /// Handwheel pointing along the vector.
    GateValve(DVec3),
    /// Shorter, rounder; no handwheel.
    CheckValve,
    /// Globe valve one size below the line, between reducers; its diaphragm actuator points along the vector.
    ControlValve(DVec3),
    /// A tee with its branch along the vector.
    Tee(DVec3),
    /// A butt weld: ends one spool and begins the next.
    Weld,
}

impl Fitting {
    /// From the middle of the fitting to where its neighbouring spools end.
    pub fn half_length(self, bore: Bore) -> f64 {
        let body = self.half_body(bore);
        match self {
            Fitting::Weld => 0.0,
            Fitting::Tee(_) => body,
            Fitting::ControlValve(_) => {
                let reduced = names::bore_below(bore);
                self.half_body(reduced) + GASKET_M + flange_length(reduced) + reducer_length(bore)
            }
            _ => body + GASKET_M + flange_length(bore),
        }
    }

    /// From the middle to the body's own faces.
    fn half_body(self, bore: Bore) -> f64 {
        match self {
            Fitting::Joint => -GASKET_M / 2.0,
            Fitting::Weld => 0.0,
            Fitting::Tee(_) => bore.radius * 1.9,
            Fitting::GateValve(_) => 0.08 + bore.radius * 1.1,
            Fitting::CheckValve => 0.09 + bore.radius * 1.2,
            Fitting::ControlValve(_) => 0.10 + bore.radius * 1.3,
        }
    }

    /// Builds it; `place` has its middle at the origin and the line along +Y.
    pub fn build(self, plan: &mut Plan, bore: Bore, place: DAffine3, colour: Colour) {
        let (origin, axis) = (place.translation, place.matrix3.y_axis);
        let half = self.half_body(bore);
        match self {
            Fitting::Weld => {}
            Fitting::Joint => {
                let part = flange(plan, bore);
                let face = origin - axis * (GASKET_M / 2.0);
                plan.put(part, along(face, -axis), colour);
                flange_on(plan, bore, face, axis, colour);
            }
            Fitting::Tee(branch) => {
                let part = tee(plan, bore, half);
                plan.put(part, frame(origin, branch, axis), colour);
            }
            Fitting::CheckValve => {
                mating_flanges(plan, bore, half, place, colour);
                let name = format!("CHECK VALVE {}in 150#", bore.inches);
                let part = plan.shared(&name, || valve_body(bore, half, 1.5));
                plan.put(part, place, names::VALVE_BODY);
            }
            Fitting::GateValve(stem) => {
                mating_flanges(plan, bore, half, place, colour);
                gate_valve(plan, bore, half, frame(origin, stem, axis));
            }
            Fitting::ControlValve(stem) => {
                let reducer = reducer(plan, bore);
                for away in [axis, -axis] {
                    plan.put(reducer, along(origin + away * self.half_length(bore), -away), colour);
                }
                let bore = names::bore_below(bore);
                let half = self.half_body(bore);
                mating_flanges(plan, bore, half, place, colour);
                control_valve(plan, bore, half, frame(origin, stem, axis));
            }
        }
    }
}

/// The line's flanges on both faces of a valve.
fn mating_flanges(plan: &mut Plan, bore: Bore, half: f64, place: DAffine3, colour: Colour) {
    let (origin, axis) = (place.translation, place.matrix3.y_axis);
    for away in [axis, -axis] {
        flange_on(plan, bore, origin + away * half, away, colour);
    }
}

/// Branch along +X.
fn tee(plan: &mut Plan, bore: Bore, half: f64) -> PartRef {
    plan.shared(&format!("TEE-{}in-BW", bore.inches), || {
        let r = bore.radius;
        Solid::from([
            cylinder(r * 1.06, -half, 2.0 * half, DAffine3::IDENTITY),
            cylinder(r * 1.04, 0.0, half, along(DVec3::ZERO, DVec3::X)),
        ])
    })
}

/// A barrel between two flanges, `belly` pipe radii wide in the middle.
fn valve_body(bore: Bore, half: f64, belly: f64) -> Solid {
    let (r, disc) = (bore.radius, bore.flange_thickness + 0.002);
    let profile = vec![
        Knot::To(0.0, -half),
        Knot::To(bore.flange_radius, -half),
        Knot::To(bore.flange_radius, disc - half),
        Knot::To(r * 1.1, disc - half),
        Knot::To(r * belly, -r * 0.7),
        Knot::To(r * belly, r * 0.7),
        Knot::To(r * 1.1, half - disc),
        Knot::To(bore.flange_radius, half - disc),
        Knot::To(bore.flange_radius, half),
        Knot::To(0.0, half),
    ];
    Shape::Lathe { profile, frame: DAffine3::IDENTITY }.into()
}

/// Line along +Y, stem along +X.
fn gate_valve(plan: &mut Plan, bore: Bore, half: f64, place: DAffine3) {
    let r = bore.radius;
    let (bonnet, stem) = (r * 2.2 + 0.05, r * 4.5 + 0.15);
    let body = plan.shared(&format!("GATE VALVE {}in 150#", bore.inches), || {
        let mut solid = valve_body(bore, half, 1.35);
        let up = along(DVec3::ZERO, DVec3::X);
        let profile = vec![
            Knot::To(0.0, 0.0),
            Knot::To(r * 1.2, 0.0),
            Knot::To(r * 1.0, bonnet * 0.7),
            Knot::To(r * 1.5, bonnet * 0.7),
            Knot::To(r * 1.5, bonnet),
            Knot::To(r * 0.7, bonnet),
            Knot::To(r * 0.4, stem * 0.85),
            Knot::To(0.0, stem * 0.85),
        ];
        solid.0.push(Shape::Lathe { profile, frame: up });
        solid.0.push(cylinder(0.012 + r * 0.06, stem * 0.8, stem * 0.45, up));
        solid
    });
    plan.put(body, place, names::VALVE_BODY);
    plan.describe(properties(&format!("HV-{}-150", bore.inches), "ASTM A216 WCB", Some(bore.dn)));
    let wheel_radius = 0.06 + r * 1.4;
    let wheel = plan.shared(&format!("HANDWHEEL D{}", (wheel_radius * 2000.0).round()), || {
        let rim = 0.008 + wheel_radius * 0.04;
        let spoke = |x: f64, z: f64| {
            bar(DVec3::new(-x, 0.0, -z) * wheel_radius, DVec3::new(x, 0.0, z) * wheel_radius, rim * 0.7)
        };
        Solid::from([
            Shape::Torus { ring_radius: wheel_radius, radius: rim, frame: DAffine3::IDENTITY },
            cylinder(rim * 2.4, -rim, rim * 2.5, DAffine3::IDENTITY),
            spoke(1.0, 0.0),
            spoke(0.0, 1.0),
        ])
    });
    plan.put(wheel, place * along(DVec3::X * stem, DVec3::X), names::HANDWHEEL_RED);
}

/// Line along +Y, actuator along +X.
fn control_valve(plan: &mut Plan, bore: Bore, half: f64, place: DAffine3) {
    let r = bore.radius;
    let up = along(DVec3::ZERO, DVec3::X);
    let body = plan.shared(&format!("GLOBE VALVE {}in 150#", bore.inches), || {
        let mut solid = valve_body(bore, half, 1.7);
        let profile = vec![
            Knot::To(0.0, 0.0),
            Knot::To(r * 1.3, 0.0),
            Knot::To(r * 1.3, r * 2.3),
            Knot::To(0.05, r * 2.3),
            Knot::To(0.05, r * 2.3 + 0.25),
            Knot::To(0.0, r * 2.3 + 0.25),
        ];
        solid.0.push(Shape::Lathe { profile, frame: up });
        solid
    });
    plan.put(body, place, names::VALVE_BODY);
    let (seat, width) = (r * 2.3 + 0.25, 0.12 + r * 1.3);
    let actuator = plan.shared(&format!("ACTUATOR DIAPHRAGM {}", (width * 2000.0).round()), || {
        let profile = vec![
            Knot::To(0.0, 0.0),
            Knot::To(width * 0.5, 0.0),
            Knot::Opening(width, 0.06),
            Knot::To(width * 1.12, 0.06),
            Knot::To(width * 1.12, 0.09),
            Knot::To(width, 0.09),
            Knot::Closing(width * 0.2, 0.22),
            Knot::To(width * 0.2, 0.30),
            Knot::To(0.0, 0.30),
        ];
        Shape::Lathe { profile, frame: DAffine3::IDENTITY }.into()
    });
    plan.put(actuator, place * along(DVec3::X * seat, DVec3::X), names::HANDWHEEL_RED);
    let positioner = plan.shared("POSITIONER DVC", || block(0.14, 0.18, 0.1, at(0.0, -0.09, 0.0)).into());
    plan.put(positioner, place * at(seat * 0.85, 0.0, 0.12), names::INSTRUMENT);
}

fn reducer_length(bore: Bore) -> f64 {
    0.05 + bore.radius * 1.6
}

/// A concentric reducer to the next smaller bore: the large end at the origin, the small one along +Y.
fn reducer(plan: &mut Plan, bore: Bore) -> PartRef {
    let reduced = names::bore_below(bore);
    plan.shared(&format!("RED-{}x{}in-BW", bore.inches, reduced.inches), || {
        let length = reducer_length(bore);
        let profile = vec![
            Knot::To(0.0, 0.0),
            Knot::To(bore.radius, 0.0),
            Knot::To(bore.radius, length * 0.2),
            Knot::To(reduced.radius, length * 0.8),
            Knot::To(reduced.radius, length),
            Knot::To(0.0, length),
        ];
        Shape::Lathe { profile, frame: DAffine3::IDENTITY }.into()
    })
}
