//! Rotating equipment: pump sets on plinths, air coolers on the rack.

use glam::{DAffine3, DVec3};

use super::access;
use super::flanges::nozzle;
use super::instruments::{gauge, transmitter};
use super::names::{self, CONCRETE, STRUCTURE, Tags, bore, properties, weathered};
use super::piping::{End, Fitting, InLine, Line, run};
use super::plan::{PartRef, Plan};
use super::rack::{RACK_Z, TOP_LEVEL};
use super::sections::{Outline, Plate};
use super::shapes::{Knot, Shape, Solid, along, at, block, cylinder, flat_ring, frame, quarter_turn, yaw};
use super::site::Site;
use super::steel::{beam, beam_x};

/// Height of a pump's shaft above the paving.
const SHAFT_M: f64 = 0.95;

/// Pumps side by side, each with its driver, suction and discharge.
pub(super) fn pumps(plan: &mut Plan, tags: &mut Tags, site: &Site, count: u32, what: &str) {
    let tag = tags.tag("P");
    let paint = plan.pick(&[names::PUMP_GREEN, names::MOTOR_BLUE, names::rgb(120, 126, 134)]);
    for (index, letter) in (0..count).zip('A'..='Z') {
        let x = 2.7 * (f64::from(index) - f64::from(count - 1) / 2.0);
        let shaft = site.at(x, SHAFT_M, 0.6);
        let name = format!("{tag}{letter}");
        let extras = properties(&format!("{name}-OH2-4x6-13"), "ASTM A216 WCB", None);
        plan.group_with(format!("{name} {what}"), extras, |plan| {
            pump_set(plan, site, shaft, paint);
            pump_piping(plan, tags, site, shaft);
        });
    }
}

/// Everything is along local Z, the pump end away from the rack.
fn pump_set(plan: &mut Plan, site: &Site, shaft: DVec3, paint: crate::model::Colour) {
    let turned = if site.toward > 0.0 { quarter_turn(2) } else { DAffine3::IDENTITY };
    let place = DAffine3::from_translation(shaft) * turned;
    let lying = along(DVec3::ZERO, DVec3::Z);
    let plinth =
        plan.shared("PUMP PLINTH 2800x1000", || block(1.0, 0.55, 2.8, at(0.0, -SHAFT_M - 0.15, -0.5)).into());
    plan.put(plinth, place, CONCRETE);
    let skid = plan.shared("BASEPLATE 2600x800", || {
        let channel = |x: f64, turn: DVec3| Shape::Prism {
            outline: Outline::Channel { height: 0.14, width: 0.06, thickness: 0.008 },
            length: 2.6,
            frame: frame(DVec3::new(x, 0.07 - SHAFT_M + 0.4, -1.8), turn, DVec3::Z),
        };
        Solid::from([
            channel(0.4, DVec3::NEG_X),
            channel(-0.4, DVec3::NEG_X),
            block(0.86, 0.02, 2.6, at(0.0, 0.54 - SHAFT_M, -0.5)),
        ])
    });
    plan.put(skid, place, STRUCTURE);
    let casing = plan.shared("PUMP CASING 4x6-13", || {
        let volute = vec![
            Knot::To(0.0, 0.15),
            Knot::To(0.17, 0.15),
            Knot::To(0.34, 0.24),
            Knot::To(0.34, 0.40),
            Knot::To(0.26, 0.46),
            Knot::To(0.11, 0.46),
            Knot::To(0.0, 0.46),
        ];
        Solid::from([
            Shape::Lathe { profile: volute, frame: lying },
            block(0.10, 0.42, 0.12, at(0.2, 0.55 - SHAFT_M, 0.3)),
            block(0.10, 0.42, 0.12, at(-0.2, 0.55 - SHAFT_M, 0.3)),
        ])
    });
    plan.put(casing, place, paint);
    let bearing = plan.shared("BEARING HOUSING OH2", || {
        let profile = vec![
            Knot::To(0.0, -0.45),
            Knot::To(0.10, -0.45),
            Knot::To(0.13, -0.40),
            Knot::To(0.13, -0.12),
            Knot::To(0.22, -0.08),
            Knot::To(0.22, 0.15),
            Knot::To(0.0, 0.15),
        ];
        Solid::from([
            Shape::Lathe { profile, frame: lying },
            block(0.14, 0.33, 0.1, at(0.0, 0.55 - SHAFT_M, -0.3)),
            cylinder(0.03, 0.1, 0.12, at(0.0, 0.0, -0.25)),
        ])
    });
    plan.put(bearing, place, paint);
    let guard = plan.shared("COUPLING GUARD", || cylinder(0.15, -0.78, 0.32, lying).into());
    plan.put(guard, place, names::SAFETY_YELLOW);
    let motor = motor(plan);
    plan.put(motor, place * at(0.0, 0.0, -0.8), names::MOTOR_BLUE);
    plan.describe(properties("M-315-4P-132kW", "EN-GJL-250", None));
}

/// A finned foot-mounted motor with its shaft end at the origin, body towards -Z.
fn motor(plan: &mut Plan) -> PartRef {
    plan.shared("MOTOR 315-4P", || {
        let lying = along(DVec3::ZERO, DVec3::Z);
        let mut profile =
            vec![Knot::To(0.0, -0.95), Knot::To(0.22, -0.95), Knot::To(0.25, -0.93), Knot::To(0.25, -0.76)];
        let fins = 12;
        for fin in 0..fins {
            let z = -0.72 + 0.58 * f64::from(fin) / f64::from(fins);
            profile.extend([
                Knot::To(0.22, z),
                Knot::To(0.26, z),
                Knot::To(0.26, z + 0.014),
                Knot::To(0.22, z + 0.014),
            ]);
        }
        profile.extend([
            Knot::To(0.22, -0.12),
            Knot::To(0.24, -0.12),
            Knot::To(0.24, -0.06),
            Knot::To(0.06, -0.04),
            Knot::To(0.04, 0.0),
            Knot::To(0.0, 0.0),
        ]);
        Solid::from([
            Shape::Lathe { profile, frame: lying },
            block(0.26, 0.2, 0.3, at(0.22, 0.05, -0.4)),
            block(0.5, 0.2, 0.12, at(0.0, 0.55 - SHAFT_M, -0.2)),
            block(0.5, 0.2, 0.12, at(0.0, 0.55 - SHAFT_M, -0.65)),
        ])
    })
}

/// Suction with its valve from the ground, discharge with check and gate valve up to the rack.
fn pump_piping(plan: &mut Plan, tags: &mut Tags, site: &Site, shaft: DVec3) {
    let away = DVec3::new(0.0, 0.0, -site.toward);
    let colour = weathered(plan, names::PUMP_GREEN);
    let suction = nozzle(plan, bore(6), shaft + away * 0.4, away, 0.3, colour);
    let line = Line::new(tags, 6, names::PROCESS);
    let outside = suction + away * 1.7;
    let fittings = [InLine { leg: 0, distance: 0.65, fitting: Fitting::GateValve(DVec3::Y) }];
    let ground = DVec3::new(outside.x, -0.1, outside.z);
    run(plan, &line, &[suction, outside, ground], (End::Flanged, End::Welded), &fittings);

    let discharge = nozzle(plan, bore(4), shaft + away * 0.3 + DVec3::Y * 0.25, DVec3::Y, 0.35, colour);
    let line = Line::new(tags, 4, names::PROCESS);
    let lane = site.rack.lane(plan, line.service);
    let cross = lane.y + lane.radius + 0.45 + plan.between(0.0, 0.5);
    let path = [
        discharge,
        DVec3::new(discharge.x, cross, discharge.z),
        DVec3::new(discharge.x, cross, lane.z),
        DVec3::new(discharge.x, lane.y + lane.radius * 0.6, lane.z),
    ];
    let fittings = [
        InLine { leg: 0, distance: 0.55, fitting: Fitting::CheckValve },
        InLine { leg: 0, distance: 1.15, fitting: Fitting::GateValve(away) },
        InLine { leg: 1, distance: 2.2, fitting: Fitting::Weld },
    ];
    run(plan, &line, &path, (End::Flanged, End::Welded), &fittings);
    gauge(plan, tags.tag("PI"), suction + away * 1.25 + DVec3::Y * line.bore.radius, away);
    let stand = DAffine3::from_translation(DVec3::new(shaft.x + 0.9, 0.0, shaft.z + away.z * 1.2));
    transmitter(plan, tags.tag("PT"), stand);
}

/// A control valve between block valves with a bypass, on the ground beside the rack, fed from it.
pub(super) fn control_station(plan: &mut Plan, tags: &mut Tags, site: &Site) {
    let tag = tags.tag("FV");
    plan.group(format!("{tag} control station"), |plan| {
        let service = plan.pick(&names::SERVICES);
        let line = Line::new(tags, 4, service);
        let away = DVec3::new(0.0, 0.0, -site.toward);
        let (low, high) = (site.at(-1.9, 0.7, 0.0), site.at(1.9, 0.7, 0.0));
        let lane = site.rack.lane(plan, service);
        let top = lane.y + lane.radius + 0.5;
        let up = |at: DVec3| DVec3::new(at.x, top, at.z);
        let into = |at: DVec3| DVec3::new(at.x, top, lane.z);
        let down = |at: DVec3| DVec3::new(at.x, lane.y + lane.radius * 0.6, lane.z);
        let tee = Fitting::Tee(away);
        let fittings = [
            InLine { leg: 2, distance: 1.2, fitting: tee },
            InLine { leg: 3, distance: 0.9, fitting: Fitting::GateValve(DVec3::Y) },
            InLine { leg: 3, distance: 1.9, fitting: Fitting::ControlValve(DVec3::Y) },
            InLine { leg: 3, distance: 2.9, fitting: Fitting::GateValve(DVec3::Y) },
            InLine { leg: 4, distance: top - low.y - 1.2, fitting: tee },
        ];
        let path = [down(low), into(low), up(low), low, high, up(high), into(high), down(high)];
        run(plan, &line, &path, (End::Welded, End::Welded), &fittings[..]);
        let bypass = Line::new(tags, 4, service);
        let level = top - 1.2;
        let path = [low, low + away * 0.6, high + away * 0.6, high].map(|at| DVec3::new(at.x, level, at.z));
        let fittings = [InLine { leg: 1, distance: 1.9, fitting: Fitting::GateValve(away) }];
        run(plan, &bypass, &path, (End::Welded, End::Welded), &fittings);
        let support = plan.shared("PIPE SUPPORT H640", || {
            Solid::from([
                cylinder(0.04, 0.0, 0.62, DAffine3::IDENTITY),
                block(0.2, 0.012, 0.2, DAffine3::IDENTITY),
            ])
        });
        for x in [-1.55, 1.55] {
            plan.put(support, DAffine3::from_translation(site.at(x, 0.0, 0.0)), STRUCTURE);
        }
        transmitter(plan, tags.tag("FT"), DAffine3::from_translation(site.at(2.6, 0.0, 0.0)));
    });
}

/// A forced-draught air cooler over one bay of the rack: legs, plenum, fans, tube bundle, headers.
pub(super) fn air_cooler(plan: &mut Plan, tags: &mut Tags, x: f64, bay: f64) {
    let tag = tags.tag("A");
    let (near, far) = (RACK_Z[0] + 1.7, RACK_Z[1] - 0.2);
    let (deck, depth) = (TOP_LEVEL + 2.6, far - near);
    let middle = DVec3::new(x + bay / 2.0, 0.0, (near + far) / 2.0);
    let place = |y: f64| DAffine3::from_translation(middle + DVec3::Y * y);
    let width = bay - 0.3;
    plan.group_with(
        format!("{tag} Air cooler"),
        properties(&format!("{tag}-BUNDLE"), "SA-179", None),
        |plan| {
            let leg = beam(plan, "HEB160", 0.16, 0.16, deck - TOP_LEVEL);
            for dx in [-0.5, 0.5] {
                for dz in [-0.5, 0.5] {
                    plan.put(
                        leg,
                        place(TOP_LEVEL) * at(dx * (width - 0.2), 0.0, dz * (depth - 0.2)),
                        STRUCTURE,
                    );
                }
            }
            let edge = beam(plan, "IPE200", 0.2, 0.1, width);
            for z in [near, far] {
                plan.put(edge, beam_x(DVec3::new(middle.x - width / 2.0, deck - 0.1, z)), STRUCTURE);
            }
            let paint = weathered(plan, names::GALVANIZED);
            let bundle = plan.shared("BUNDLE SIDE FRAME", || {
                let frame_plate =
                    Plate::with_openings(width, depth, 0.5, &[[0.08, 0.08, width - 0.08, depth - 0.08]]);
                Shape::Plate { plate: frame_plate, frame: at(-width / 2.0, 0.0, -depth / 2.0) }.into()
            });
            plan.put(bundle, place(deck + 0.75), paint);
            let tubes = plan.shared("FINNED TUBE ROWS", || {
                let grate = width - 0.25;
                Shape::Grating {
                    width: grate,
                    depth: depth - 0.25,
                    thickness: 0.2,
                    frame: DAffine3::IDENTITY,
                }
                .into()
            });
            plan.put(tubes, place(deck + 0.9), names::ALUMINIUM);
            for side in [-0.5, 0.5] {
                let header =
                    plan.shared("HEADER BOX", || block(width - 0.2, 0.45, 0.28, DAffine3::IDENTITY).into());
                plan.put(header, place(deck + 0.78) * at(0.0, 0.0, side * (depth + 0.3)), paint);
            }
            let plenum = plan.shared("PLENUM", || {
                let hole = 0.35;
                let plate = Plate::with_openings(
                    width,
                    depth,
                    0.03,
                    &[
                        [hole, 0.5, width / 2.0 - 0.1, depth - 0.5],
                        [width / 2.0 + 0.1, 0.5, width - hole, depth - 0.5],
                    ],
                );
                let skirt =
                    Plate::with_openings(width, depth, 0.45, &[[0.02, 0.02, width - 0.02, depth - 0.02]]);
                let low = at(-width / 2.0, 0.0, -depth / 2.0);
                Solid::from([
                    Shape::Plate { plate, frame: low },
                    Shape::Plate { plate: skirt, frame: low * at(0.0, 0.31, 0.0) },
                ])
            });
            plan.put(plenum, place(deck), paint);
            let radius = (width / 4.0).min(depth / 4.0) + 0.1;
            for side in [-0.25, 0.25] {
                plan.group(tags.tag("K"), |plan| {
                    fan(plan, radius, place(deck - 0.45) * at(side * width, 0.0, 0.0))
                });
            }
        },
    );
}

/// Fan ring, hub, blades and motor; the axis stands up.
fn fan(plan: &mut Plan, radius: f64, place: DAffine3) {
    let size = (radius * 2000.0).round();
    let ring = plan.shared(&format!("FAN RING D{size}"), || {
        flat_ring(radius, radius + 0.03, 0.0, 0.45, DAffine3::IDENTITY).into()
    });
    plan.put(ring, place, names::GALVANIZED);
    let hub = plan.shared("FAN HUB", || cylinder(0.14, 0.14, 0.16, DAffine3::IDENTITY).into());
    plan.put(hub, place, names::BLACK);
    let blade = plan.shared(&format!("FAN BLADE D{size}"), || {
        // Pitched by a third: 3-4-5 triangle.
        let pitch = frame(DVec3::new(0.1, 0.22, 0.0), DVec3::new(0.0, 0.6, 0.8), DVec3::X);
        Shape::Prism { outline: Outline::Rectangle { x: 0.3, z: 0.02 }, length: radius - 0.13, frame: pitch }
            .into()
    });
    for at_blade in 0..6 {
        let angle = std::f64::consts::TAU * f64::from(at_blade) / 6.0;
        plan.put(blade, place * yaw(angle), names::rgb(206, 200, 180));
    }
    let motor = motor(plan);
    let upright = frame(DVec3::new(0.0, -0.05, 0.0), DVec3::X, DVec3::NEG_Z);
    plan.put(motor, place * upright, names::MOTOR_BLUE);
}

/// A stair tower up to the rack's walkway, on the rack's near side.
pub(super) fn stair_tower(plan: &mut Plan, tags: &mut Tags, site: &Site) {
    let width = 0.85;
    let levels = [0.0, 2.5, 5.1, 7.6, TOP_LEVEL];
    // Two lanes of flights side by side, landings at their ends.
    let depth = 2.0 * width + 0.25;
    let low_z = RACK_Z[0] - 0.5 - depth;
    plan.group(tags.tag("ST"), |plan| {
        let post = beam(plan, "HEB160", 0.16, 0.16, TOP_LEVEL + 1.1);
        for x in [-2.6, 2.6] {
            for z in [low_z - 0.1, low_z + depth + 0.1] {
                plan.put(post, at(site.centre.x + x, 0.0, z), STRUCTURE);
            }
        }
        for (flight, step) in levels.windows(2).enumerate() {
            let &[from, to] = step else { continue };
            let rise = to - from;
            let run = (rise / 0.2).round() * 0.24;
            let forth = flight % 2 == 0;
            let place = if forth {
                at(site.centre.x - run / 2.0, from, low_z)
            } else {
                // Climbing towards -X: half a turn, so that the width runs the other way.
                at(site.centre.x + run / 2.0, from, low_z + depth) * quarter_turn(2)
            };
            access::stairs(plan, rise, width, place);
            let landing = site.centre.x + if forth { run / 2.0 } else { -run / 2.0 - 1.1 };
            let low = DVec3::new(landing, to, low_z);
            // The last landing reaches over to the walkway.
            let is_last = to == TOP_LEVEL;
            let reach = if is_last { RACK_Z[0] + 0.3 - low_z } else { depth };
            let rails = [true, !is_last, !forth, forth];
            access::platform(plan, format!("Landing EL+{to:.1}"), low, 1.1, reach, rails);
        }
    });
}
