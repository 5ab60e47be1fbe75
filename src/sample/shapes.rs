//! Primitives that parts are made of: described first, counted without being built, meshed on demand.
//!
//! Every primitive is a closed, outward oriented shell. Straight runs have no rings in between, so that pipes get
//! the long thin triangles of real CAD exports. Local +Y is the axis of everything that has one.

use std::f64::consts::TAU;

use glam::{DAffine3, DVec2, DVec3};

use super::frames::across;
pub(super) use super::frames::{along, at, frame, quarter_turn, turn, yaw};
use super::sections::{self, Outline, Plate};
use crate::model::Mesh;

/// Radius in metres at which [`Detail::fineness`] is the number of sides.
const REFERENCE_RADIUS_M: f64 = 0.1;
/// A round thing never has fewer sides.
const MIN_SIDES: u32 = 5;
/// A round thing never has more sides.
const MAX_SIDES: u32 = 4096;

/// How finely curves are divided.
#[derive(Clone, Copy, Debug)]
pub(super) struct Detail {
    /// Sides of a circle of 0.1 m radius.
    pub fineness: f64,
    /// In `[0, 1)`, different from part to part: spreads the rounding, so that the sum over many parts follows
    /// `fineness` without steps.
    pub phase: f64,
}

impl Detail {
    /// Sides of a circle; they grow with the square root of the radius, as at constant chord error.
    pub fn sides(self, radius: f64) -> u32 {
        let sides = self.fineness * libm::sqrt(radius / REFERENCE_RADIUS_M) + self.phase;
        (sides as u32).clamp(MIN_SIDES, MAX_SIDES)
    }

    /// Steps of an arc of `angle` radians, for a tube or body of the given radius.
    fn arc_steps(self, radius: f64, angle: f64) -> u32 {
        let steps = f64::from(self.sides(radius)) * angle / TAU + 0.5;
        (steps as u32).max(1)
    }

    /// Slots of a grating panel.
    fn slots(self) -> usize {
        (self.fineness * 0.7 + self.phase).clamp(3.0, 60.0) as usize
    }
}

/// A corner of a lathe's profile: (radius, height).
#[derive(Clone, Copy, Debug)]
pub(super) enum Knot {
    /// Straight to here.
    To(f64, f64),
    /// A quarter ellipse to here that leaves parallel to the axis: the upper head of a vessel.
    Closing(f64, f64),
    /// A quarter ellipse to here that arrives parallel to the axis: the lower head of a vessel.
    Opening(f64, f64),
}

/// One closed shell.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// A profile turned about +Y, listed so that height grows on the outside. It either starts and ends on the
    /// axis, or is closed into a ring.
    Lathe { profile: Vec<Knot>, frame: DAffine3 },
    /// A round bar along a path whose corners are bent.
    Sweep { path: Vec<DVec3>, bend_radius: f64, radius: f64 },
    /// A round bar bent to a ring about +Y.
    Torus { ring_radius: f64, radius: f64, frame: DAffine3 },
    /// An outline in XZ, extruded along +Y.
    Prism { outline: Outline, length: f64, frame: DAffine3 },
    /// A plate in XZ with rectangular openings, thickness along +Y.
    Plate { plate: Plate, frame: DAffine3 },
    /// A grating panel in XZ centred on the origin: a plate with slots, as many as the detail allows.
    Grating { width: f64, depth: f64, thickness: f64, frame: DAffine3 },
}

/// A part before it is meshed: shells that may interpenetrate.
#[derive(Clone, Debug, Default)]
pub(super) struct Solid(pub Vec<Shape>);

impl Solid {
    /// Triangles that [`Solid::mesh`] makes.
    pub fn triangles(&self, detail: Detail) -> u64 {
        self.0.iter().map(|shape| shape.triangles(detail)).sum()
    }

    /// The geometry, in the part's space.
    pub fn mesh(&self, detail: Detail) -> Mesh {
        let mut mesh = Mesh::default();
        for shape in &self.0 {
            shape.append(detail, &mut mesh);
        }
        mesh
    }
}

impl From<Shape> for Solid {
    fn from(shape: Shape) -> Self {
        Solid(vec![shape])
    }
}

impl<const N: usize> From<[Shape; N]> for Solid {
    fn from(shapes: [Shape; N]) -> Self {
        Solid(shapes.into())
    }
}

impl Shape {
    fn triangles(&self, detail: Detail) -> u64 {
        match self {
            Shape::Lathe { profile, .. } => {
                let (rings, sides) = lathe_rings(profile, detail);
                ring_pairs(&rings)
                    .map(|(low, high)| {
                        u64::from(sides) * u64::from((low.x > 0.0) as u8 + (high.x > 0.0) as u8)
                    })
                    .sum()
            }
            Shape::Sweep { path, bend_radius, radius } => {
                let sides = u64::from(detail.sides(*radius));
                let rings = sweep_rings(path, *bend_radius, *radius, detail).len() as u64;
                2 * sides * (rings - 1) + 2 * sides
            }
            Shape::Torus { ring_radius, radius, .. } => {
                2 * u64::from(detail.sides(*ring_radius)) * u64::from(detail.sides(*radius))
            }
            Shape::Prism { outline, .. } => 4 * outline.corners(detail).len() as u64 - 4,
            Shape::Plate { plate, .. } => plate.triangles(),
            Shape::Grating { width, depth, thickness, .. } => {
                Plate::grating(*width, *depth, *thickness, detail.slots()).triangles()
            }
        }
    }

    fn append(&self, detail: Detail, mesh: &mut Mesh) {
        match self {
            Shape::Lathe { profile, frame } => append_lathe(profile, frame, detail, mesh),
            Shape::Sweep { path, bend_radius, radius } => {
                append_sweep(&sweep_rings(path, *bend_radius, *radius, detail), *radius, detail, mesh);
            }
            Shape::Torus { ring_radius, radius, frame } => {
                append_torus(*ring_radius, *radius, frame, detail, mesh)
            }
            Shape::Prism { outline, length, frame } => {
                sections::append_prism(&outline.corners(detail), *length, frame, mesh);
            }
            Shape::Plate { plate, frame } => plate.append(frame, mesh),
            Shape::Grating { width, depth, thickness, frame } => {
                Plate::grating(*width, *depth, *thickness, detail.slots()).append(frame, mesh);
            }
        }
    }
}

/// The profile's corners with its arcs divided, (radius, height), and the number of sides.
fn lathe_rings(profile: &[Knot], detail: Detail) -> (Vec<DVec2>, u32) {
    let widest = profile.iter().fold(0.0_f64, |widest, knot| match *knot {
        Knot::To(r, _) | Knot::Closing(r, _) | Knot::Opening(r, _) => widest.max(r),
    });
    let sides = detail.sides(widest);
    let mut rings: Vec<DVec2> = Vec::new();
    for knot in profile {
        let from = rings.last().copied().unwrap_or_default();
        let (to, closing) = match *knot {
            Knot::To(r, y) => {
                rings.push(DVec2::new(r, y));
                continue;
            }
            Knot::Closing(r, y) => (DVec2::new(r, y), true),
            Knot::Opening(r, y) => (DVec2::new(r, y), false),
        };
        let steps = detail.arc_steps(widest, TAU / 4.0).max(2);
        for step in 1..steps {
            let at = turn(step, 4 * steps);
            let at = if closing { DVec2::new(1.0 - at.x, at.y) } else { DVec2::new(at.y, 1.0 - at.x) };
            rings.push(from + (to - from) * at);
        }
        rings.push(to);
    }
    // A profile that does not end on the axis closes on itself.
    if let (Some(&first), Some(&last)) = (rings.first(), rings.last())
        && last.x > 0.0
    {
        rings.push(first);
    }
    (rings, sides)
}

fn ring_pairs(rings: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> {
    rings.iter().zip(rings.iter().skip(1)).map(|(&low, &high)| (low, high))
}

fn append_lathe(profile: &[Knot], frame: &DAffine3, detail: Detail, mesh: &mut Mesh) {
    let (mut rings, sides) = lathe_rings(profile, detail);
    let is_ring = rings.first().is_some_and(|first| first.x > 0.0);
    if is_ring {
        rings.pop();
    }
    let starts: Vec<Ring> = rings
        .iter()
        .map(|ring| {
            let first = mesh.positions.len() as u32;
            let count = if ring.x > 0.0 { sides } else { 1 };
            mesh.positions.extend((0..count).map(|side| {
                let round = turn(side, sides) * ring.x;
                frame.transform_point3(DVec3::new(round.x, ring.y, round.y))
            }));
            Ring { first, count }
        })
        .collect();
    for (low, high) in starts.iter().zip(starts.iter().skip(1)) {
        stitch(*low, *high, mesh);
    }
    if let (true, Some(first), Some(last)) = (is_ring, starts.first(), starts.last()) {
        stitch(*last, *first, mesh);
    }
}

/// Vertices of one ring: `count` of them, or a single one for an apex.
#[derive(Clone, Copy)]
struct Ring {
    first: u32,
    count: u32,
}

/// The band between two rings of equal side count, one of which may be an apex. Outward when the rings turn from
/// +X to +Z and `high` is above `low` on the outside.
fn stitch(low: Ring, high: Ring, mesh: &mut Mesh) {
    let sides = low.count.max(high.count);
    for side in 0..sides {
        let next = (side + 1) % sides;
        let corner = |ring: Ring, side: u32| ring.first + side % ring.count;
        if high.count > 1 {
            mesh.triangles.push([corner(low, side), corner(high, side), corner(high, next)]);
        }
        if low.count > 1 {
            mesh.triangles.push([corner(low, side), corner(high, next), corner(low, next)]);
        }
    }
}

/// Centre of a swept ring and its two spokes of unit length.
struct SweptRing {
    centre: DVec3,
    u: DVec3,
    v: DVec3,
}

/// Rings along a path: two for a straight bar, `steps + 1` in each bend.
fn sweep_rings(path: &[DVec3], bend_radius: f64, radius: f64, detail: Detail) -> Vec<SweptRing> {
    let direction = |from: DVec3, to: DVec3| (to - from).normalize_or(DVec3::Y);
    let (Some(&first), Some(&second), Some(&last)) = (path.first(), path.get(1), path.last()) else {
        return Vec::new();
    };
    let along = direction(first, second);
    let mut u = across(along);
    let mut v = u.cross(along);
    let mut rings = vec![SweptRing { centre: first, u, v }];
    for corner in path.windows(3) {
        let &[before, at, after] = corner else { continue };
        let (d0, d1) = (direction(before, at), direction(at, after));
        let angle = libm::atan2(d0.cross(d1).length(), d0.dot(d1));
        let inward = (d1 - d0 * d0.dot(d1)).normalize_or(across(d0));
        // Neighbouring bends each take at most half of a short leg.
        let room = 0.49 * (at - before).length().min((after - at).length());
        let half = libm::tan(angle / 2.0);
        let tangent = (bend_radius * half).min(room);
        let bend = tangent / half;
        let centre = at - d0 * tangent + inward * bend;
        let steps = detail.arc_steps(radius, angle);
        let turned = |w: DVec3, cos: f64, sin: f64| {
            let (a, b) = (w.dot(d0), w.dot(inward));
            w + d0 * (a * cos - b * sin - a) + inward * (a * sin + b * cos - b)
        };
        for step in 0..=steps {
            let phi = angle * f64::from(step) / f64::from(steps);
            let (cos, sin) = (libm::cos(phi), libm::sin(phi));
            rings.push(SweptRing {
                centre: centre - inward * (bend * cos) + d0 * (bend * sin),
                u: turned(u, cos, sin),
                v: turned(v, cos, sin),
            });
        }
        let (cos, sin) = (libm::cos(angle), libm::sin(angle));
        (u, v) = (turned(u, cos, sin), turned(v, cos, sin));
    }
    rings.push(SweptRing { centre: last, u, v });
    rings
}

fn append_sweep(rings: &[SweptRing], radius: f64, detail: Detail, mesh: &mut Mesh) {
    let (Some(first), Some(last)) = (rings.first(), rings.last()) else { return };
    let sides = detail.sides(radius);
    let mut below = push_apex(first.centre, mesh);
    for ring in rings {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend((0..sides).map(|side| {
            let at = turn(side, sides) * radius;
            ring.centre + ring.u * at.x + ring.v * at.y
        }));
        let ring = Ring { first, count: sides };
        stitch(below, ring, mesh);
        below = ring;
    }
    let apex = push_apex(last.centre, mesh);
    stitch(below, apex, mesh);
}

fn push_apex(at: DVec3, mesh: &mut Mesh) -> Ring {
    mesh.positions.push(at);
    Ring { first: mesh.positions.len() as u32 - 1, count: 1 }
}

fn append_torus(ring_radius: f64, radius: f64, frame: &DAffine3, detail: Detail, mesh: &mut Mesh) {
    let (steps, sides) = (detail.sides(ring_radius), detail.sides(radius));
    let first = mesh.positions.len() as u32;
    for step in 0..steps {
        let out = turn(step, steps);
        for side in 0..sides {
            let tube = turn(side, sides) * radius;
            let from_axis = ring_radius + tube.x;
            mesh.positions.push(frame.transform_point3(DVec3::new(
                out.x * from_axis,
                tube.y,
                out.y * from_axis,
            )));
        }
    }
    let ring = |step: u32| Ring { first: first + (step % steps) * sides, count: sides };
    for step in 0..steps {
        // The tube turns from outside to up, which is opposite to `stitch`'s sense along the ring's direction.
        stitch(ring(step + 1), ring(step), mesh);
    }
}

/// A plain cylinder of given radius from `y` to `y + height`.
pub(super) fn cylinder(radius: f64, y: f64, height: f64, frame: DAffine3) -> Shape {
    let profile =
        vec![Knot::To(0.0, y), Knot::To(radius, y), Knot::To(radius, y + height), Knot::To(0.0, y + height)];
    Shape::Lathe { profile, frame }
}

/// A round bar from one point to another.
pub(super) fn bar(from: DVec3, to: DVec3, radius: f64) -> Shape {
    Shape::Sweep { path: vec![from, to], bend_radius: 0.0, radius }
}

/// A flat ring about +Y, from `y` to `y + height`.
pub(super) fn flat_ring(inner: f64, outer: f64, y: f64, height: f64, frame: DAffine3) -> Shape {
    let profile = vec![
        Knot::To(inner, y),
        Knot::To(outer, y),
        Knot::To(outer, y + height),
        Knot::To(inner, y + height),
    ];
    Shape::Lathe { profile, frame }
}

/// A box: its size along X, Y and Z, standing on the origin of `frame`, centred in X and Z.
pub(super) fn block(x: f64, y: f64, z: f64, frame: DAffine3) -> Shape {
    Shape::Prism { outline: Outline::Rectangle { x, z }, length: y, frame }
}
