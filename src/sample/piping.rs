//! Lines: spools bent to a path, with fittings built in.

use glam::{DAffine3, DVec3};

pub(super) use super::fittings::Fitting;
use super::flanges::{GASKET_M, blind, flange, flange_length, flange_on};
use super::names::{self, Bore, Service, Tags, properties, weathered};
use super::plan::Plan;
use super::shapes::{Shape, along};
use crate::model::Colour;

/// Weld bevels and the like: spools shorter than this are left out.
const SHORTEST_SPOOL_M: f64 = 0.02;

/// What a run of pipe is made of.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub number: String,
    pub bore: Bore,
    pub service: Service,
}

impl Line {
    pub fn new(tags: &mut Tags, inches: u32, service: Service) -> Self {
        let bore = names::bore(inches);
        Line { number: tags.line(bore, service), bore, service }
    }
}

/// A fitting and its place on a path: which leg, and how far along it in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct InLine {
    pub leg: usize,
    pub distance: f64,
    pub fitting: Fitting,
}

/// What a run's end meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// A nozzle's face: the run begins with a flange, a gasket and bolts.
    Flanged,
    /// Nothing: the run ends with a flange and a blind.
    Blinded,
    /// Welded to something, or going on elsewhere.
    Welded,
}

/// Builds a line along `path` (area space). Fittings stand in the order in which the path meets them.
pub(super) fn run(plan: &mut Plan, line: &Line, path: &[DVec3], ends: (End, End), fittings: &[InLine]) {
    let colour = weathered(plan, line.service.colour);
    let extras = properties(&line.number, "ASTM A106 Gr.B", Some(line.bore.dn));
    plan.group_with(line.number.clone(), extras, |plan| {
        let mut spools = Spools { line, colour, number: 0, points: Vec::new() };
        for (leg, ends_of_leg) in path.windows(2).enumerate() {
            let &[from, to] = ends_of_leg else { continue };
            let direction = (to - from).normalize_or(DVec3::Y);
            if leg == 0 {
                spools.points.push(begin(plan, line.bore, from, direction, ends.0, colour));
            }
            for item in fittings.iter().filter(|item| item.leg == leg) {
                let centre = from + direction * item.distance;
                let half = item.fitting.half_length(line.bore);
                spools.points.push(centre - direction * half);
                spools.finish(plan);
                item.fitting.build(plan, line.bore, along(centre, direction), colour);
                spools.points.push(centre + direction * half);
            }
            if leg + 2 == path.len() {
                spools.points.push(begin(plan, line.bore, to, -direction, ends.1, colour));
            } else {
                spools.points.push(to);
            }
        }
        spools.finish(plan);
    });
}

/// Builds what a run has at its end `at`, from which it leaves along `away`; returns where its spool begins.
fn begin(plan: &mut Plan, bore: Bore, at: DVec3, away: DVec3, end: End, colour: Colour) -> DVec3 {
    match end {
        End::Flanged => {
            flange_on(plan, bore, at, away, colour);
            at + away * (GASKET_M + flange_length(bore))
        }
        End::Blinded => {
            let part = flange(plan, bore);
            plan.put(part, along(at, away), colour);
            blind(plan, bore, at, -away, colour);
            at + away * flange_length(bore)
        }
        End::Welded => at,
    }
}

/// The spool that is being drawn.
struct Spools<'a> {
    line: &'a Line,
    colour: Colour,
    number: u32,
    points: Vec<DVec3>,
}

impl Spools<'_> {
    /// Places the points so far as a spool of its own, relative to its first point.
    fn finish(&mut self, plan: &mut Plan) {
        let points = std::mem::take(&mut self.points);
        let length: f64 =
            points.windows(2).map(|leg| leg.first().map_or(0.0, |a| (leg[1] - *a).length())).sum();
        let Some(&first) = points.first() else { return };
        if length < SHORTEST_SPOOL_M {
            return;
        }
        self.number += 1;
        let path = points.iter().map(|point| *point - first).collect();
        // Long-radius elbows: 1.5 diameters.
        let solid =
            Shape::Sweep { path, bend_radius: self.line.bore.radius * 3.0, radius: self.line.bore.radius };
        let name = format!("{} spool {}", self.line.number, self.number);
        plan.put_new(name, solid, DAffine3::from_translation(first), self.colour);
    }
}
