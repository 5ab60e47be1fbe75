//! How people get there: platforms with gratings, handrails, ladders, stairs.

use glam::{DAffine3, DVec3};

use super::names::{GALVANIZED, SAFETY_YELLOW, STRUCTURE};
use super::plan::Plan;
use super::sections::Outline;
use super::shapes::{Shape, Solid, at, bar, block, flat_ring, frame, turn, yaw};

/// Height of the top rail above the floor.
const RAIL_M: f64 = 1.1;
const RAIL_RADIUS: f64 = 0.021;
/// Rise of a step of a stair.
const STEP_M: f64 = 0.2;

/// A handrail post: foot plate at the origin.
fn post(plan: &mut Plan, place: DAffine3) {
    let part = plan.shared("HANDRAIL POST 1100", || {
        Solid::from([
            bar(DVec3::ZERO, DVec3::Y * RAIL_M, RAIL_RADIUS),
            block(0.1, 0.01, 0.08, DAffine3::IDENTITY),
        ])
    });
    plan.put(part, place, SAFETY_YELLOW);
}

/// A straight handrail from `from` to `to`, both on the floor: posts, two rails, toe plate.
pub(super) fn handrail(plan: &mut Plan, from: DVec3, to: DVec3) {
    let length = (to - from).length();
    if length < 0.2 {
        return;
    }
    let along = (to - from) / length;
    let millimetres = (length * 1000.0).round();
    let part = plan.shared(&format!("HANDRAIL L={millimetres}"), || {
        let rail = |y: f64| bar(DVec3::new(0.0, y, 0.0), DVec3::new(length, y, 0.0), RAIL_RADIUS);
        let toe = block(length - 0.01, 0.1, 0.006, at(length / 2.0, 0.01, 0.0));
        Solid::from([rail(RAIL_M), rail(RAIL_M / 2.0), toe])
    });
    let place = frame(from, along, DVec3::Y);
    plan.put(part, place, SAFETY_YELLOW);
    let spans = (length / 1.5).ceil().max(1.0) as u32;
    for at_post in 0..=spans {
        let x = length * f64::from(at_post) / f64::from(spans);
        post(plan, place * at(x, 0.0, 0.0));
    }
}

/// A rectangle of grating panels, its top at `low.y`, from `low` to `low + (x, z)`, on a channel frame.
pub(super) fn grating_floor(plan: &mut Plan, low: DVec3, x: f64, z: f64) {
    let (columns, rows) = ((x / 1.5).ceil().max(1.0), (z / 1.0).ceil().max(1.0));
    let (width, depth) = (x / columns - 0.01, z / rows - 0.01);
    let name = format!("GRATING {}x{}", (width * 1000.0).round(), (depth * 1000.0).round());
    let panel = plan.shared(&name, || {
        // The slots add the width of one bar.
        Shape::Grating { width: width - 0.014, depth, thickness: 0.03, frame: DAffine3::IDENTITY }.into()
    });
    for row in 0..rows as u32 {
        for column in 0..columns as u32 {
            let centre =
                DVec3::new((f64::from(column) + 0.5) * x / columns, -0.03, (f64::from(row) + 0.5) * z / rows);
            plan.put(panel, DAffine3::from_translation(low + centre), GALVANIZED);
        }
    }
    let mut edge = |corner: DVec3, length: f64, along_x: bool| {
        let name = format!("UPN160 L={}", (length * 1000.0).round());
        let channel = plan.shared(&name, || {
            let outline = Outline::Channel { height: 0.16, width: 0.065, thickness: 0.008 };
            Shape::Prism { outline, length, frame: DAffine3::IDENTITY }.into()
        });
        let (x, y) = if along_x { (DVec3::Z, DVec3::X) } else { (DVec3::NEG_X, DVec3::Z) };
        plan.put(channel, frame(low + corner - DVec3::Y * 0.112, x, y), STRUCTURE);
    };
    edge(DVec3::ZERO, x, true);
    edge(DVec3::new(0.0, 0.0, z - 0.065), x, true);
    edge(DVec3::new(0.065, 0.0, 0.0), z, false);
    edge(DVec3::new(x, 0.0, 0.0), z, false);
}

/// Which sides of a rectangular platform have a handrail: towards -Z, +Z, -X, +X.
pub(super) type Sides = [bool; 4];

/// A platform of gratings with handrails; top of the floor at `low.y`.
pub(super) fn platform(plan: &mut Plan, name: String, low: DVec3, x: f64, z: f64, rails: Sides) {
    plan.group(name, |plan| {
        grating_floor(plan, low, x, z);
        let [a, b, c, d] = [(0.0, 0.0), (x, 0.0), (x, z), (0.0, z)].map(|(x, z)| low + DVec3::new(x, 0.0, z));
        for (wanted, from, to) in [(rails[0], a, b), (rails[1], d, c), (rails[2], a, d), (rails[3], b, c)] {
            if wanted {
                handrail(plan, from, to);
            }
        }
    });
}

/// A round platform about +Y of `place`, whose origin is at floor height: floor, toe plate, rails, posts, brackets.
pub(super) fn round_platform(plan: &mut Plan, name: String, inner: f64, outer: f64, place: DAffine3) {
    let size = format!("D{}", (outer * 2000.0).round());
    plan.group(name, |plan| {
        let floor = plan.shared(&format!("PLATFORM FLOOR {size}"), || {
            Solid::from([
                flat_ring(inner, outer, -0.04, 0.04, DAffine3::IDENTITY),
                flat_ring(outer, outer + 0.008, -0.1, 0.2, DAffine3::IDENTITY),
            ])
        });
        plan.put(floor, place, GALVANIZED);
        let rails = plan.shared(&format!("PLATFORM RAILS {size}"), || {
            let rail =
                |y: f64| Shape::Torus { ring_radius: outer, radius: RAIL_RADIUS, frame: at(0.0, y, 0.0) };
            Solid::from([rail(RAIL_M), rail(RAIL_M / 2.0)])
        });
        plan.put(rails, place, SAFETY_YELLOW);
        let bracket = plan.shared(&format!("BRACKET L={}", ((outer - inner) * 1000.0).round()), || {
            let arm = outer - inner + 0.1;
            Solid::from([
                bar(DVec3::new(0.0, -0.08, 0.0), DVec3::new(arm, -0.08, 0.0), 0.04),
                bar(DVec3::new(0.0, -arm, 0.0), DVec3::new(arm * 0.9, -0.08, 0.0), 0.03),
            ])
        });
        let posts = (outer * 5.0) as u32;
        for step in 0..posts {
            let angle = std::f64::consts::TAU * f64::from(step) / f64::from(posts);
            post(plan, place * yaw(angle) * at(outer, 0.0, 0.0));
            if step % 2 == 0 {
                plan.put(bracket, place * yaw(angle) * at(inner - 0.1, 0.0, 0.0), STRUCTURE);
            }
        }
    });
}

/// A ladder standing on the origin of `place`, `height` tall, climbed from +Z; a cage where it is long.
pub(super) fn ladder(plan: &mut Plan, height: f64, place: DAffine3) {
    let millimetres = (height * 1000.0).round();
    let part = plan.shared(&format!("LADDER H={millimetres}"), || {
        let mut shapes = Vec::new();
        for side in [-0.23, 0.23] {
            shapes.push(block(0.012, height + 1.0, 0.06, at(side, 0.0, 0.0)));
        }
        for rung in 1..=(height / 0.3) as u32 {
            let y = 0.3 * f64::from(rung);
            shapes.push(bar(DVec3::new(-0.23, y, 0.0), DVec3::new(0.23, y, 0.0), 0.011));
        }
        Solid(shapes)
    });
    plan.put(part, place, SAFETY_YELLOW);
    if height < 3.5 {
        return;
    }
    let cage = plan.shared(&format!("LADDER CAGE H={millimetres}"), || {
        let mut shapes = Vec::new();
        let hoops = ((height - 2.3) / 1.2) as u32;
        let arc: Vec<DVec3> = (0..=8)
            .map(|step| {
                let round = turn(step, 16) * 0.36;
                DVec3::new(round.x, 0.0, 0.32 + round.y)
            })
            .collect();
        for hoop in 0..=hoops {
            let y = DVec3::Y * (2.3 + 1.2 * f64::from(hoop));
            let mut path = vec![DVec3::new(0.36, 0.0, 0.0) + y];
            path.extend(arc.iter().map(|point| *point + y));
            path.push(DVec3::new(-0.36, 0.0, 0.0) + y);
            shapes.push(Shape::Sweep { path, bend_radius: 0.03, radius: 0.012 });
        }
        for point in arc.iter().step_by(2) {
            let low = *point + DVec3::Y * 2.3;
            shapes.push(bar(low, low + DVec3::Y * (1.2 * f64::from(hoops)), 0.01));
        }
        Solid(shapes)
    });
    plan.put(cage, place, SAFETY_YELLOW);
}

/// A straight flight along +X of `place` from the origin, `rise` up, 45 degrees or flatter: stringers, treads, rails.
pub(super) fn stairs(plan: &mut Plan, rise: f64, width: f64, place: DAffine3) {
    let steps = (rise / STEP_M).round().max(1.0);
    let going = 0.24;
    let run = steps * going;
    let top = DVec3::new(run, rise, 0.0);
    let millimetres = (rise * 1000.0).round();
    let stringer = plan.shared(&format!("STRINGER UPN200 H={millimetres}"), || {
        let outline = Outline::Rectangle { x: 0.01, z: 0.22 };
        let y = top.normalize_or(DVec3::Y);
        let frame = frame(DVec3::ZERO, DVec3::Z, y);
        Shape::Prism { outline, length: top.length(), frame }.into()
    });
    for z in [0.0, width] {
        plan.put(stringer, place * at(0.0, 0.0, z), STRUCTURE);
    }
    let tread = plan.shared("TREAD 800x240", || {
        Shape::Grating {
            width: width - 0.05,
            depth: 0.24,
            thickness: 0.03,
            frame: frame(DVec3::ZERO, DVec3::Z, DVec3::Y),
        }
        .into()
    });
    for step in 0..steps as u32 {
        let up = f64::from(step + 1);
        plan.put(tread, place * at((up - 0.5) * going, up * STEP_M - 0.03, width / 2.0), GALVANIZED);
    }
    let rail = plan.shared(&format!("STAIR RAIL H={millimetres}"), || {
        let lift = |height: f64| bar(DVec3::Y * height, top + DVec3::Y * height, RAIL_RADIUS);
        let mut shapes = vec![lift(1.0), lift(0.5)];
        for post in 0..=3 {
            let foot = top * (f64::from(post) / 3.0);
            shapes.push(bar(foot, foot + DVec3::Y, RAIL_RADIUS));
        }
        Solid(shapes)
    });
    for z in [0.0, width] {
        plan.put(rail, place * at(0.0, 0.0, z), SAFETY_YELLOW);
    }
}
