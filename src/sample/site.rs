//! Where a piece of equipment stands, and how its lines find the rack.

use glam::DVec3;

use super::names::{Service, Tags};
use super::piping::{End, Fitting, InLine, Line, run};
use super::plan::Plan;
use super::rack::Rack;

/// A place beside the rack.
pub(super) struct Site<'a> {
    /// Middle of the place on the ground, area space.
    pub centre: DVec3,
    /// Towards the rack: +1 or -1 along Z.
    pub toward: f64,
    pub rack: &'a Rack,
}

impl Site<'_> {
    /// A point at `x` along the rack, `y` up and `z` towards the rack from the place's middle.
    pub fn at(&self, x: f64, y: f64, z: f64) -> DVec3 {
        self.centre + DVec3::new(x, y, z * self.toward)
    }

    /// A line from a nozzle's face through `route`, then up or down to a free height above one of the rack's lines,
    /// across, and into that line from above.
    pub fn connect(
        &self,
        plan: &mut Plan,
        tags: &mut Tags,
        face: DVec3,
        route: &[DVec3],
        inches: u32,
        service: Service,
    ) {
        let line = Line::new(tags, inches, service);
        let lane = self.rack.lane(plan, service);
        // Crossings share the gap between two levels of lines.
        let mut cross = lane.y + lane.radius + 0.45 + plan.between(0.0, 0.5);
        let last = route.last().copied().unwrap_or(face);
        if (last.x, last.z) == (face.x, face.z) {
            // A line that has risen from its nozzle does not turn back on itself.
            cross = cross.max(last.y);
        }
        let mut path = vec![face];
        path.extend_from_slice(route);
        path.extend([
            DVec3::new(last.x, cross, last.z),
            DVec3::new(last.x, cross, lane.z),
            DVec3::new(last.x, lane.y + lane.radius * 0.6, lane.z),
        ]);
        let path = straightened(&path);
        let mut fittings = Vec::new();
        for (leg, ends) in path.windows(2).enumerate() {
            let &[from, to] = ends else { continue };
            let (length, rise) = ((to - from).length(), to.y - from.y);
            let outwards = DVec3::new(0.0, 0.0, -self.toward);
            let distance = if from.y < 1.6 && rise > 0.0 { 1.4 - from.y } else { length * 0.5 };
            let valve = line.bore.radius * 8.0 + 0.7;
            if rise > 0.0 && distance > valve && length - distance > valve {
                let fitting = if plan.chance(0.7) { Fitting::GateValve(outwards) } else { Fitting::Joint };
                fittings.push(InLine { leg, distance, fitting });
            } else if rise == 0.0 && length > 4.0 {
                fittings.push(InLine { leg, distance: length * 0.5, fitting: Fitting::Weld });
            } else if rise < 0.0 && length > 5.0 {
                fittings.push(InLine { leg, distance: length * 0.5, fitting: Fitting::Joint });
            }
        }
        run(plan, &line, &path, (End::Flanged, End::Welded), &fittings);
    }
}

/// The path without points that repeat, or lie on the straight line between their neighbours.
fn straightened(path: &[DVec3]) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = Vec::with_capacity(path.len());
    for &point in path {
        if let [.., before, last] = kept[..] {
            let (d0, d1) = (last - before, point - last);
            if d0.cross(d1).length() < 1e-9 && d0.dot(d1) > 0.0 {
                kept.pop();
            }
        }
        if kept.last().is_none_or(|last| (point - *last).length() > 1e-6) {
            kept.push(point);
        }
    }
    kept
}
