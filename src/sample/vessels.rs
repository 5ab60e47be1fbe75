//! Static equipment: columns, drums, heat exchangers, tanks.

use glam::{DAffine3, DVec3};

use super::access;
use super::flanges::{blind_nozzle, nozzle};
use super::instruments::gauge;
use super::names::{self, CONCRETE, STRUCTURE, Tags, bore, properties, weathered};
use super::piping::{End, Fitting, InLine, Line, run};
use super::plan::Plan;
use super::sections::Outline;
use super::shapes::{Knot, Shape, Solid, along, at, bar, block, cylinder, flat_ring, frame, turn};
use super::site::Site;

/// A vertical vessel on a skirt: heads, platforms, ladders, an overhead line down to the rack.
pub(super) fn column(plan: &mut Plan, tags: &mut Tags, site: &Site, what: &str) {
    let tag = tags.tag("T");
    let (radius, height) = (plan.between(0.8, 1.25), plan.between(13.0, 19.0));
    let skirt = 2.6;
    let axis = site.at(0.0, 0.0, 0.0);
    let base = DAffine3::from_translation(axis);
    let colour = weathered(plan, names::ALUMINIUM);
    let head = radius / 2.0;
    let extras = properties(&format!("{tag}-SHELL"), "ASTM A516 Gr.70", None);
    plan.group_with(format!("{tag} {what}"), extras, |plan| {
        skirted_shell(plan, &tag, radius, skirt, height, base, colour);
        let top = skirt + head + height;
        let mut floor = 0.0;
        let count = (height / 5.0) as u32;
        for level in 1..=count {
            let y = skirt + head + height * f64::from(level) / f64::from(count) - 0.9;
            let name = format!("Platform EL+{y:.1}");
            access::round_platform(plan, name, radius + 0.03, radius + 1.15, base * at(0.0, y, 0.0));
            // Ladders change sides, so that nobody falls more than one flight.
            let side = if level % 2 == 0 { 1.0 } else { -1.0 };
            let foot = axis + DVec3::new(side * (radius + 0.6), floor, -site.toward * 0.7);
            access::ladder(plan, y - floor, frame(foot, DVec3::Z * side, DVec3::Y));
            for turn_of in [0.25, 0.6] {
                let direction = direction_at(turn_of + 0.13 * f64::from(level));
                let root = axis + DVec3::Y * (y + 0.8) + direction * (radius - 0.05);
                blind_nozzle(plan, bore(if turn_of < 0.5 { 20 } else { 4 }), root, direction, 0.4, colour);
            }
            floor = y;
        }
        davit(plan, base * at(0.0, top + head * 0.9, 0.0), radius);
        let face =
            nozzle(plan, bore(10), axis + DVec3::Y * (top + head * 0.8), DVec3::Y, head * 0.2 + 0.35, colour);
        let over = site.at(-radius - 0.7, 0.0, 0.0);
        let route = [face + DVec3::Y * 0.9, DVec3::new(over.x, face.y + 0.9, over.z)];
        site.connect(plan, tags, face, &route, 10, names::SERVICES[1]);
        let bottom = skirt + head * 0.6;
        let side = DVec3::new(0.0, 0.0, site.toward);
        let root = axis + DVec3::Y * (bottom + 0.9) + side * (radius - 0.05);
        let face = nozzle(plan, bore(6), root, side, 0.4, colour);
        site.connect(plan, tags, face, &[face + side * 0.7], 6, names::PROCESS);
        let up = DVec3::Y * (skirt + height * 0.45);
        let root = axis + up + DVec3::X * (radius - 0.05);
        let face = nozzle(plan, bore(8), root, DVec3::X, 0.4, colour);
        site.connect(plan, tags, face, &[face + DVec3::X * 0.6], 8, names::PROCESS);
        gauge(plan, tags.tag("PI"), axis + DVec3::Y * 3.4 - side * (radius + 0.01), -side);
    });
}

fn direction_at(turns: f64) -> DVec3 {
    let round = turn((turns * 360.0) as u32, 360);
    DVec3::new(round.x, 0.0, round.y)
}

fn skirted_shell(
    plan: &mut Plan,
    tag: &str,
    radius: f64,
    skirt: f64,
    height: f64,
    base: DAffine3,
    colour: crate::model::Colour,
) {
    let head = radius / 2.0;
    let octagon = (0..8).map(|corner| turn(2 * corner + 1, 16) * (radius + 0.7)).collect();
    let plinth =
        Shape::Prism { outline: Outline::Polygon(octagon), length: 0.45, frame: at(0.0, -0.15, 0.0) };
    plan.put_new(format!("{tag} foundation"), plinth, base, CONCRETE);
    let skirt_profile = vec![
        Knot::To(0.0, 0.3),
        Knot::To(radius + 0.22, 0.3),
        Knot::To(radius + 0.22, 0.36),
        Knot::To(radius + 0.03, 0.36),
        Knot::To(radius + 0.03, skirt + head),
        Knot::To(0.0, skirt + head),
    ];
    plan.put_new(
        format!("{tag} skirt"),
        Shape::Lathe { profile: skirt_profile, frame: DAffine3::IDENTITY },
        base,
        STRUCTURE,
    );
    let low = skirt + head;
    let profile = vec![
        Knot::To(0.0, skirt),
        Knot::Opening(radius, low),
        Knot::To(radius, low + height),
        Knot::Closing(0.0, low + height + head),
    ];
    plan.put_new(format!("{tag} shell"), Shape::Lathe { profile, frame: DAffine3::IDENTITY }, base, colour);
    plan.describe(properties(&format!("{tag}-SHELL"), "ASTM A516 Gr.70", None));
    let band = plan.shared(&format!("CLADDING BAND D{}", (radius * 2000.0).round()), || {
        flat_ring(radius - 0.01, radius + 0.012, 0.0, 0.06, DAffine3::IDENTITY).into()
    });
    for y in 1..(height / 1.5) as u32 {
        plan.put(band, base * at(0.0, low + 1.5 * f64::from(y), 0.0), names::GALVANIZED);
    }
}

/// The little crane on top of a column.
fn davit(plan: &mut Plan, base: DAffine3, radius: f64) {
    let reach = radius + 1.3;
    let part = plan.shared(&format!("DAVIT R={}", (reach * 1000.0).round()), || {
        let path = vec![DVec3::new(0.4, -0.3, 0.0), DVec3::new(0.4, 2.0, 0.0), DVec3::new(reach, 2.0, 0.0)];
        Solid::from([
            Shape::Sweep { path, bend_radius: 0.4, radius: 0.06 },
            bar(DVec3::new(reach - 0.1, 1.4, 0.0), DVec3::new(reach - 0.1, 2.0, 0.0), 0.012),
        ])
    });
    plan.put(part, base, names::SAFETY_YELLOW);
}

/// A horizontal vessel along X with dished heads, its axis through the frame's origin, along +Y of the frame.
fn barrel(radius: f64, length: f64, head: f64) -> Solid {
    let profile = vec![
        Knot::To(0.0, -length / 2.0 - head),
        Knot::Opening(radius, -length / 2.0),
        Knot::To(radius, length / 2.0),
        Knot::Closing(0.0, length / 2.0 + head),
    ];
    Shape::Lathe { profile, frame: along(DVec3::ZERO, DVec3::X) }.into()
}

/// A saddle under a barrel of `radius` whose axis is `axis_height` above the concrete plinth's foot.
fn saddle(plan: &mut Plan, radius: f64, axis_height: f64, place: DAffine3) {
    let plinth = 0.9_f64.min(axis_height * 0.5);
    let half = radius * 0.86;
    let part = plan.shared(&format!("PLINTH {}", (half * 2000.0).round()), || {
        block(0.5, plinth + 0.15, 2.0 * half + 0.3, at(0.0, -0.15, 0.0)).into()
    });
    plan.put(part, place, CONCRETE);
    let top = axis_height - radius * 0.5;
    let part =
        plan.shared(&format!("SADDLE D{} H{}", (radius * 2000.0).round(), (top * 1000.0).round()), || {
            let web = |x: f64, width: f64| block(width, top - plinth, 2.0 * half, at(x, plinth, 0.0));
            Solid::from([
                web(0.0, 0.016),
                block(0.3, 0.02, 2.0 * half + 0.1, at(0.0, plinth, 0.0)),
                block(0.24, top - plinth, 0.014, at(0.0, plinth, half)),
                block(0.24, top - plinth, 0.014, at(0.0, plinth, -half)),
                block(0.24, top - plinth, 0.014, at(0.0, plinth, 0.0)),
            ])
        });
    plan.put(part, place, STRUCTURE);
}

/// A horizontal drum on saddles with a platform on top, a manway, a level gauge, relief and process lines.
pub(super) fn drum(plan: &mut Plan, tags: &mut Tags, site: &Site, what: &str) {
    let tag = tags.tag("V");
    let (radius, length) = (plan.between(0.9, 1.3), plan.between(4.5, 5.6));
    let axis_height = radius + 2.2;
    let axis = site.at(0.0, axis_height, 0.0);
    let colour = weathered(plan, names::VESSEL_WHITE);
    let side = DVec3::new(0.0, 0.0, site.toward);
    let extras = properties(&format!("{tag}-SHELL"), "ASTM A516 Gr.70", None);
    plan.group_with(format!("{tag} {what}"), extras, |plan| {
        plan.put_new(
            format!("{tag} shell"),
            barrel(radius, length, radius / 2.0),
            DAffine3::from_translation(axis),
            colour,
        );
        for x in [-0.3, 0.3] {
            saddle(plan, radius, axis_height, DAffine3::from_translation(site.at(x * length, 0.0, 0.0)));
        }
        let up = |x: f64| axis + DVec3::new(x, radius - 0.06, 0.0);
        blind_nozzle(plan, bore(20), up(length * 0.22), DVec3::Y, 0.45, colour);
        let face = nozzle(plan, bore(6), up(-length * 0.42), DVec3::Y, 0.45, colour);
        site.connect(plan, tags, face, &[face + DVec3::Y * 0.8], 6, names::SERVICES[1]);
        let face = nozzle(plan, bore(8), up(length * 0.42), DVec3::Y, 0.45, colour);
        site.connect(plan, tags, face, &[face + DVec3::Y * 1.2], 8, names::PROCESS);
        // Drain: down, a valve, into the ground.
        let root = axis - DVec3::Y * (radius - 0.06) + DVec3::X * length * 0.1;
        let face = nozzle(plan, bore(3), root, DVec3::NEG_Y, 0.4, colour);
        let line = Line::new(tags, 3, names::PROCESS);
        let fittings = [InLine { leg: 0, distance: 0.75, fitting: Fitting::GateValve(-side) }];
        run(plan, &line, &[face, DVec3::new(face.x, -0.1, face.z)], (End::Flanged, End::Welded), &fittings);
        level_gauge(plan, tags, axis + DVec3::X * (length / 2.0 + radius * 0.40), radius);
        let deck = axis + DVec3::new(-length * 0.3, radius + 0.25, -0.9);
        access::platform(plan, format!("{tag} platform"), deck, length * 0.85, 1.8, [true, true, true, true]);
        let foot = DVec3::new(deck.x + 0.5, site.centre.y, axis.z - site.toward * (radius + 0.35));
        access::ladder(plan, deck.y - foot.y, frame(foot, DVec3::X * -site.toward, DVec3::Y));
        gauge(plan, tags.tag("PI"), axis + DVec3::new(-length * 0.1, radius, 0.0), -side);
    });
}

/// A level glass beside a head of a vessel.
fn level_gauge(plan: &mut Plan, tags: &mut Tags, root: DVec3, radius: f64) {
    let height = radius * 1.1;
    let name = format!("H={}", (height * 1000.0).round());
    plan.group(tags.tag("LG"), |plan| {
        let standpipe = plan.shared(&format!("LEVEL STANDPIPE {name}"), || {
            let arm =
                |y: f64| vec![DVec3::new(-0.3, y, 0.0), DVec3::new(0.25, y, 0.0), DVec3::new(0.25, 0.0, 0.0)];
            let pipe = |y: f64| Shape::Sweep { path: arm(y), bend_radius: 0.06, radius: 0.024 };
            Solid::from([pipe(-height / 2.0), pipe(height / 2.0)])
        });
        plan.put(standpipe, DAffine3::from_translation(root), names::ALUMINIUM);
        let back = plan.shared(&format!("LEVEL GAUGE {name}"), || {
            block(0.07, height * 0.7, 0.09, at(0.25, -height * 0.35, 0.0)).into()
        });
        plan.put(back, DAffine3::from_translation(root), names::BLACK);
        let glass = plan.shared(&format!("LEVEL GLASS {name}"), || {
            block(0.02, height * 0.6, 0.04, at(0.30, -height * 0.3, 0.0)).into()
        });
        plan.put(glass, DAffine3::from_translation(root), names::GLASS);
    });
}

/// Two shell-and-tube exchangers, one above the other.
pub(super) fn exchangers(plan: &mut Plan, tags: &mut Tags, site: &Site, what: &str) {
    let tag = tags.tag("E");
    let (radius, length) = (plan.between(0.42, 0.58), 4.8);
    let side = DVec3::new(0.0, 0.0, site.toward);
    plan.group(format!("{tag}A/B {what}"), |plan| {
        for (row, letter) in ["A", "B"].into_iter().enumerate() {
            // Two shells side by side.
            let axis = site.at(0.0, 1.5, 1.9 * row as f64 - 0.95);
            let name = format!("{tag}{letter}");
            let extras =
                properties(&format!("{name}-BEM-{}", (radius * 2000.0).round()), "ASTM A516 Gr.70", None);
            plan.group_with(name, extras, |plan| exchanger(plan, tags, site, axis, radius, length));
        }
        gauge(plan, tags.tag("TI"), site.at(0.0, 1.5 + radius, -0.95), -side);
    });
}

fn exchanger(plan: &mut Plan, tags: &mut Tags, site: &Site, axis: DVec3, radius: f64, length: f64) {
    let colour = weathered(plan, names::ALUMINIUM);
    let painted = weathered(plan, STRUCTURE);
    let size = (radius * 2000.0).round();
    let place = DAffine3::from_translation(axis);
    let half = length / 2.0;
    let lying = along(DVec3::ZERO, DVec3::X);
    let shell =
        plan.shared(&format!("EXCHANGER SHELL {size}"), || cylinder(radius, -half, length, lying).into());
    plan.put(shell, place, colour);
    let channel = plan.shared(&format!("EXCHANGER CHANNEL {size}"), || {
        let flange = radius + 0.11;
        let profile = vec![
            Knot::To(0.0, 0.0),
            Knot::To(flange, 0.0),
            Knot::To(flange, 0.07),
            Knot::To(radius, 0.07),
            Knot::To(radius, 0.75),
            Knot::To(flange, 0.75),
            Knot::To(flange, 0.82),
            Knot::To(0.0, 0.82),
        ];
        Shape::Lathe { profile, frame: lying }.into()
    });
    plan.put(channel, place * at(half + 0.08, 0.0, 0.0), painted);
    let cover =
        plan.shared(&format!("EXCHANGER COVER {size}"), || cylinder(radius + 0.11, 0.0, 0.08, lying).into());
    plan.put(cover, place * at(half + 0.905, 0.0, 0.0), painted);
    let rear = plan.shared(&format!("EXCHANGER REAR HEAD {size}"), || {
        let profile = vec![
            Knot::To(0.0, 0.0),
            Knot::To(radius + 0.11, 0.0),
            Knot::To(radius + 0.11, 0.08),
            Knot::To(radius, 0.08),
            Knot::To(radius, 0.25),
            Knot::Closing(0.0, 0.25 + radius / 2.0),
        ];
        Shape::Lathe { profile, frame: along(DVec3::ZERO, DVec3::NEG_X) }.into()
    });
    plan.put(rear, place * at(-half - 0.08, 0.0, 0.0), painted);
    let girth = plan.shared(&format!("GIRTH FLANGE {size}"), || {
        flat_ring(radius - 0.02, radius + 0.11, -0.035, 0.07, lying).into()
    });
    let bolt = plan.shared("BOLT M24x210", || {
        let nut = |y: f64| Shape::Prism {
            outline: Outline::Hexagon { flats: 0.036 },
            length: 0.02,
            frame: at(0.0, y, 0.0),
        };
        Solid::from([cylinder(0.012, -0.105, 0.21, DAffine3::IDENTITY), nut(-0.098), nut(0.078)])
    });
    for x in [-half - 0.04, half + 0.04] {
        plan.put(girth, place * at(x, 0.0, 0.0), painted);
        let joint = place * at(x, 0.0, 0.0) * lying;
        plan.bolts(bolt, joint, radius + 0.065, 28, names::BOLT_STEEL);
    }
    plan.bolts(bolt, place * at(half + 0.9, 0.0, 0.0) * lying, radius + 0.065, 28, names::BOLT_STEEL);
    for x in [-half * 0.6, half * 0.6] {
        saddle(plan, radius, axis.y, DAffine3::from_translation(DVec3::new(axis.x + x, 0.0, axis.z)));
    }
    let up = DVec3::Y * (radius - 0.05);
    let face = nozzle(plan, bore(6), axis + up - DVec3::X * half * 0.8, DVec3::Y, 0.35, colour);
    site.connect(plan, tags, face, &[face + DVec3::Y * 0.8], 6, names::PROCESS);
    let face = nozzle(plan, bore(8), axis + up + DVec3::X * (half + 0.45), DVec3::Y, 0.35, painted);
    site.connect(plan, tags, face, &[face + DVec3::Y * 0.8], 8, names::COOLING_WATER);
    let face = nozzle(plan, bore(8), axis - up + DVec3::X * (half + 0.45), DVec3::NEG_Y, 0.33, painted);
    let line = Line::new(tags, 8, names::COOLING_WATER);
    run(plan, &line, &[face, DVec3::new(face.x, -0.1, face.z)], (End::Flanged, End::Welded), &[]);
    blind_nozzle(plan, bore(4), axis - up + DVec3::X * half * 0.75, DVec3::NEG_Y, 0.3, colour);
}

/// A storage tank with a cone roof, a ladder, roof rails and a bund wall.
pub(super) fn tank(plan: &mut Plan, tags: &mut Tags, site: &Site, what: &str) {
    let tag = tags.tag("TK");
    let (radius, height) = (plan.between(2.9, 3.5), plan.between(5.5, 8.0));
    let axis = site.at(0.0, 0.0, 0.0);
    let base = DAffine3::from_translation(axis);
    let colour = weathered(plan, names::VESSEL_WHITE);
    let side = DVec3::new(0.0, 0.0, site.toward);
    plan.group(format!("{tag} {what}"), |plan| {
        let foot = cylinder(radius + 0.4, -0.1, 0.4, DAffine3::IDENTITY);
        plan.put_new(format!("{tag} foundation"), foot, base, CONCRETE);
        let profile = vec![
            Knot::To(0.0, 0.3),
            Knot::To(radius, 0.3),
            Knot::To(radius, height),
            Knot::To(0.0, height + radius * 0.18),
        ];
        plan.put_new(
            format!("{tag} shell"),
            Shape::Lathe { profile, frame: DAffine3::IDENTITY },
            base,
            colour,
        );
        plan.describe(properties(&format!("{tag}-SHELL"), "ASTM A36", None));
        let stiffener = plan.shared(&format!("WIND GIRDER D{}", (radius * 2000.0).round()), || {
            flat_ring(radius - 0.01, radius + 0.1, 0.0, 0.012, DAffine3::IDENTITY).into()
        });
        for y in 1..=(height / 1.9) as u32 {
            plan.put(stiffener, base * at(0.0, 1.9 * f64::from(y), 0.0), colour);
        }
        let rails = format!("{tag} roof rails");
        access::round_platform(plan, rails, radius - 0.35, radius - 0.03, base * at(0.0, height + 0.12, 0.0));
        let foot = axis + DVec3::X * (radius + 0.18);
        access::ladder(plan, height + 0.1, frame(foot, DVec3::NEG_Z, DVec3::Y));
        blind_nozzle(plan, bore(20), axis - side * (radius - 0.06) + DVec3::Y * 1.0, -side, 0.4, colour);
        blind_nozzle(plan, bore(8), axis + DVec3::Y * (height + radius * 0.1), DVec3::Y, 0.6, colour);
        let face = nozzle(
            plan,
            bore(8),
            axis + side * (radius - 0.06) + DVec3::new(0.9, 0.9, 0.0),
            side,
            0.45,
            colour,
        );
        site.connect(plan, tags, face, &[face + side * 1.6], 8, names::SERVICES[8]);
        bund(plan, &tag, axis, radius + 1.3);
    });
}

/// A low concrete wall around a tank.
fn bund(plan: &mut Plan, tag: &str, centre: DVec3, half: f64) {
    let wall = plan.shared(&format!("BUND WALL L={}", (half * 2000.0).round()), || {
        block(2.0 * half, 0.75, 0.2, DAffine3::IDENTITY).into()
    });
    for quarter in 0..4 {
        let place =
            DAffine3::from_translation(centre) * super::shapes::quarter_turn(quarter) * at(0.0, -0.15, half);
        plan.put_as(format!("{tag} bund {}", quarter + 1), wall, place, CONCRETE);
    }
}
