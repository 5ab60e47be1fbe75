//! The pipe rack: steel frames on foundations, the lines it carries, cable trays, a walkway on top.

use glam::{DAffine3, DVec3};

use super::access;
use super::names::{self, GALVANIZED, SERVICES, STRUCTURE, Service, Tags};
use super::piping::{End, Fitting, InLine, Line, run};
use super::plan::Plan;
use super::sections::Outline;
use super::shapes::{Shape, Solid, at, bar, block, frame};
use super::steel::{COLUMN_FOOT_M, beam, beam_x, beam_z, foundation};

/// Distance between two frames of the rack.
pub(super) const BAY_M: f64 = 6.0;
/// The rack's columns stand at these Z.
pub(super) const RACK_Z: [f64; 2] = [14.0, 22.0];
/// Top of steel of the levels that carry pipes.
pub(super) const PIPE_LEVELS: [f64; 2] = [5.0, 7.6];
/// Top of steel of the level that carries cables and the walkway.
pub(super) const TOP_LEVEL: f64 = 10.2;
/// Height of a pipe shoe: the pipe's underside above the steel.
const SHOE_M: f64 = 0.1;

/// A line on the rack that equipment may be connected to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lane {
    pub y: f64,
    pub z: f64,
    pub radius: f64,
    pub service: Service,
}

/// What the equipment must know of the rack.
pub(super) struct Rack {
    pub lanes: Vec<Lane>,
}

impl Rack {
    /// One of the lines that carry `service`, or any line if none does.
    pub fn lane(&self, plan: &mut Plan, service: Service) -> Lane {
        let same: Vec<Lane> =
            self.lanes.iter().copied().filter(|lane| lane.service.code == service.code).collect();
        plan.pick(if same.is_empty() { &self.lanes } else { &same })
    }
}

/// Builds a rack of `bays` bays from `x0` on.
pub(super) fn rack(plan: &mut Plan, tags: &mut Tags, x0: f64, bays: u32) -> Rack {
    plan.group("Steel", |plan| {
        for at_frame in 0..=bays {
            let x = x0 + BAY_M * f64::from(at_frame);
            plan.group(format!("Frame {}", at_frame + 1), |plan| portal(plan, x));
        }
        for bay in 0..bays {
            plan.group(format!("Bay {}", bay + 1), |plan| {
                let braced = bay == 0 || bay % 4 == 2;
                longitudinals(plan, x0 + BAY_M * f64::from(bay), braced);
            });
        }
    });
    let mut lanes = Vec::new();
    for (level, &y) in PIPE_LEVELS.iter().enumerate() {
        plan.group(format!("Lines EL+{y:.1}"), |plan| lines(plan, tags, x0, bays, y, level == 0, &mut lanes));
    }
    plan.group("Cables", |plan| cable_trays(plan, x0, bays));
    plan.group("Walkway", |plan| walkway(plan, x0, bays));
    Rack { lanes }
}

fn portal(plan: &mut Plan, x: f64) {
    let foot = COLUMN_FOOT_M;
    let column = beam(plan, "HEB300", 0.3, 0.3, TOP_LEVEL - foot);
    for z in RACK_Z {
        foundation(plan, x, z);
        plan.put(column, at(x, foot, z), STRUCTURE);
    }
    let [near, far] = RACK_Z;
    let span = beam(plan, "IPE360", 0.36, 0.17, far - near - 0.3);
    let stiffener = plan.shared("GUSSET 250", || {
        let corners = [(0.0, 0.0), (0.25, 0.0), (0.0, 0.25)].map(|(x, z)| glam::DVec2::new(x, z));
        Shape::Prism { outline: Outline::Polygon(corners.into()), length: 0.012, frame: DAffine3::IDENTITY }
            .into()
    });
    for level in PIPE_LEVELS.into_iter().chain([TOP_LEVEL]) {
        plan.put(span, beam_z(DVec3::new(x, level - 0.18, near + 0.15)), STRUCTURE);
        let under = level - 0.36;
        plan.put(stiffener, frame(DVec3::new(x, under, near + 0.15), DVec3::NEG_Y, DVec3::X), STRUCTURE);
        let mirrored = frame(DVec3::new(x, under, far - 0.15), DVec3::NEG_Z, DVec3::X);
        plan.put(stiffener, mirrored, STRUCTURE);
    }
}

fn longitudinals(plan: &mut Plan, x: f64, braced: bool) {
    let length = BAY_M - 0.3;
    let tie = beam(plan, "IPE240", 0.24, 0.12, length);
    let mid = beam(plan, "IPE270", 0.27, 0.135, RACK_Z[1] - RACK_Z[0] - 0.3);
    for level in PIPE_LEVELS.into_iter().chain([TOP_LEVEL]) {
        for z in RACK_Z {
            plan.put(tie, beam_x(DVec3::new(x + 0.15, level - 0.12, z)), STRUCTURE);
        }
        if level == TOP_LEVEL {
            let under_walkway = DVec3::new(x + BAY_M / 2.0, level - 0.135, RACK_Z[0] + 0.15);
            plan.put(mid, beam_z(under_walkway), STRUCTURE);
        }
    }
    if braced {
        let (low, high) = (COLUMN_FOOT_M + 0.33, PIPE_LEVELS[0] - 0.3);
        let brace = plan.shared("BRACE CHS139.7", || {
            Shape::Sweep {
                path: vec![DVec3::ZERO, DVec3::new(BAY_M - 0.4, high - low, 0.0)],
                bend_radius: 0.0,
                radius: 0.07,
            }
            .into()
        });
        for z in RACK_Z {
            plan.put(brace, at(x + 0.2, low, z - 0.08), STRUCTURE);
            // The same member turned about the bay's middle, beside the first.
            let turned = frame(DVec3::new(x + BAY_M - 0.2, low, z + 0.08), DVec3::NEG_X, DVec3::Y);
            plan.put(brace, turned, STRUCTURE);
        }
    }
}

/// Fills one level with parallel lines.
fn lines(
    plan: &mut Plan,
    tags: &mut Tags,
    x0: f64,
    bays: u32,
    level: f64,
    lowest: bool,
    lanes: &mut Vec<Lane>,
) {
    let mut z = RACK_Z[0] + 0.45;
    let mut loops = 0;
    loop {
        let inches =
            plan.pick(if lowest { &[4, 6, 6, 8, 10, 12, 16, 3] } else { &[2, 3, 3, 4, 6, 8, 10, 4] });
        let service = plan.pick(&SERVICES);
        let bore = names::bore(inches);
        let centre = z + bore.flange_radius;
        if centre + bore.flange_radius > RACK_Z[1] - 0.4 {
            return;
        }
        z = centre + bore.flange_radius + 0.06;
        let lane = Lane { y: level + SHOE_M + bore.radius, z: centre, radius: bore.radius, service };
        lanes.push(lane);
        let line = Line::new(tags, inches, service);
        let has_loop = bays >= 2 && service.code != "FW" && plan.chance(0.45);
        loops += u32::from(has_loop);
        rack_line(plan, &line, lane, x0, bays, has_loop.then_some(loops));
        let shoe = plan.shared(&format!("SHOE {inches}in"), || {
            Solid::from([
                block(0.3, 0.01, 0.1, DAffine3::IDENTITY),
                block(0.3, SHOE_M + bore.radius * 0.1, 0.01, DAffine3::IDENTITY),
            ])
        });
        for frame in 0..=bays {
            plan.put(shoe, at(x0 + BAY_M * f64::from(frame), level, centre), STRUCTURE);
        }
    }
}

/// One line along the rack: battery-limit valves, welds, an expansion loop, an end that turns down or is blinded.
fn rack_line(plan: &mut Plan, line: &Line, lane: Lane, x0: f64, bays: u32, expansion: Option<u32>) {
    let end = x0 + BAY_M * f64::from(bays) + 1.2;
    let point = |x: f64, y: f64| DVec3::new(x, y, lane.z);
    let start = x0 - 1.2;
    let mut path = vec![point(start, lane.y)];
    let mut fittings = Vec::new();
    let add = |fittings: &mut Vec<InLine>, leg: usize, distance: f64, fitting: Fitting| {
        fittings.push(InLine { leg, distance, fitting });
    };
    // Block valves stand beyond the first frame, one behind the other.
    let valve = 2.0 + plan.between(0.4, 1.2);
    let first = if plan.chance(0.35) { Fitting::GateValve(DVec3::Y) } else { Fitting::Joint };
    add(&mut fittings, 0, valve, first);
    let straight_to = |fittings: &mut Vec<InLine>, leg: usize, from: f64, to: f64, clear: f64| {
        for bay in 1..=bays {
            let x = x0 + BAY_M * f64::from(bay) - 2.0;
            if x > from + clear && x < to - 1.2 && bay % 2 == 0 {
                add(fittings, leg, x - from, Fitting::Weld);
            }
        }
    };
    if let Some(rank) = expansion {
        // Loops of neighbouring lines are nested.
        let half = 0.9 + 0.22 * f64::from(rank % 6);
        let middle = x0 + BAY_M * (f64::from(bays / 2) + 0.5);
        let top = lane.y + (0.75 + 0.16 * f64::from(rank % 6)).min(1.5);
        straight_to(&mut fittings, 0, start, middle - half, 5.0);
        path.extend([
            point(middle - half, lane.y),
            point(middle - half, top),
            point(middle + half, top),
            point(middle + half, lane.y),
        ]);
        straight_to(&mut fittings, 4, middle + half, end, 1.0);
    } else {
        straight_to(&mut fittings, 0, start, end, 5.0);
    }
    path.push(point(end, lane.y));
    let mut ends = (End::Welded, End::Welded);
    if lane.y < PIPE_LEVELS[1] && plan.chance(0.5) {
        // Down into the ground.
        path.push(point(end, -0.1));
    } else {
        ends.1 = End::Blinded;
    }
    run(plan, line, &path, ends, &fittings);
}

/// Three ladder trays with their cables on the top level, far side.
fn cable_trays(plan: &mut Plan, x0: f64, bays: u32) {
    let half_bay = BAY_M / 2.0;
    let tray = plan.shared("CABLE TRAY 600 L=3000", || {
        let mut shapes = Vec::new();
        for z in [-0.3, 0.29] {
            shapes.push(block(half_bay, 0.1, 0.012, at(half_bay / 2.0, 0.0, z)));
        }
        for rung in 0..6 {
            shapes.push(block(0.03, 0.02, 0.59, at(0.25 + 0.5 * f64::from(rung), 0.005, -0.005)));
        }
        Solid(shapes)
    });
    let colours = [names::BLACK, names::rgb(44, 44, 48), names::rgb(178, 84, 32), names::rgb(60, 66, 84)];
    for row in 0..3 {
        let z = RACK_Z[1] - 0.7 - 0.8 * f64::from(row);
        plan.group(format!("Tray {}", row + 1), |plan| {
            for piece in 0..2 * bays {
                plan.put(tray, at(x0 + half_bay * f64::from(piece), TOP_LEVEL + 0.06, z), GALVANIZED);
            }
            let length = BAY_M * f64::from(bays);
            for cable in 0..4 {
                let radius = plan.between(0.018, 0.04);
                let colour = plan.pick(&colours);
                let across = z - 0.2 + 0.13 * f64::from(cable);
                let name = format!("CABLE {}-{}", row + 1, cable + 1);
                let from = DVec3::new(0.0, radius, 0.0);
                plan.put_new(
                    name,
                    bar(from, from + DVec3::X * length, radius),
                    at(x0, TOP_LEVEL + 0.085, across),
                    colour,
                );
            }
        });
    }
}

fn walkway(plan: &mut Plan, x0: f64, bays: u32) {
    let low = DVec3::new(x0, TOP_LEVEL + 0.05, RACK_Z[0] + 0.3);
    for bay in 0..bays {
        let x = BAY_M * f64::from(bay);
        let rails = [true, true, bay == 0, bay + 1 == bays];
        access::platform(plan, format!("Walkway {}", bay + 1), low + DVec3::X * x, BAY_M, 1.2, rails);
    }
}
