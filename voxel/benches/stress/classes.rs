//! The classes of rays: each a generator of its own.
//!
//! Most rays aim at an occupied voxel, and half of them have coordinates that are binary fractions of few bits: these go
//! through faces, edges and corners exactly, and the exact oracle understands them.

use glam::DVec3;
use voxsight_voxel::raycast::{GridRay, PACKET_RAYS};

use super::line::power;
use super::random::Random;
use super::scenes::Scene;

/// What is special about a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// From some place outside or inside the grid towards some other, occupied or not.
    Any,
    /// Tiles of pixels of a camera.
    Camera,
    /// Along an axis.
    AxisParallel,
    /// In the plane of a voxel's face, moving along the two other axes.
    InPlane,
    /// Through an edge of a voxel, or along it.
    Edges,
    /// Through corners of voxels.
    Corners,
    /// From inside a voxel, from its faces, edges and corners.
    Inside,
    /// From up to a million grid sides away.
    Far,
    /// Almost parallel to a voxel's face, and close to it.
    Grazing,
    /// Directions with denormal, tiny and negative zero components, or tiny and huge as a whole.
    Denormal,
    /// Any of those above, with a start and an end near its target.
    Interval,
    /// Any numbers whatever, some of them not finite: only loops and differences between paths are looked for.
    Absurd,
}

impl Class {
    pub const ALL: [Class; 12] = [
        Class::Any,
        Class::Camera,
        Class::AxisParallel,
        Class::InPlane,
        Class::Edges,
        Class::Corners,
        Class::Inside,
        Class::Far,
        Class::Grazing,
        Class::Denormal,
        Class::Interval,
        Class::Absurd,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Class::Any => "any",
            Class::Camera => "camera",
            Class::AxisParallel => "axis-parallel",
            Class::InPlane => "in a face's plane",
            Class::Edges => "edges",
            Class::Corners => "corners",
            Class::Inside => "from inside",
            Class::Far => "from afar",
            Class::Grazing => "grazing",
            Class::Denormal => "denormal, -0.0",
            Class::Interval => "intervals",
            Class::Absurd => "absurd",
        }
    }

    /// Do its rays mean something?
    pub fn can_be_judged(self) -> bool {
        self != Class::Absurd
    }

    /// Up to 64 rays: side by side, or unrelated but for their class.
    pub fn rays(self, random: &mut Random, scene: &Scene) -> Vec<GridRay> {
        let few_bits = random.one_in(2) || (scene.is_small() && random.one_in(2));
        if self == Class::Absurd && random.one_in(2) {
            // Among rays of a camera, which they must leave alone.
            let mut rays = Class::Camera.rays(random, scene);
            for _ in 0..1 + random.below(4) {
                let lane = random.below(rays.len() as u64) as usize;
                rays[lane] = self.tile(random, scene, few_bits).ray;
            }
            return rays;
        }
        let count = if random.one_in(8) { 1 + random.below(PACKET_RAYS as u64) } else { PACKET_RAYS as u64 };
        if self == Class::Any || random.one_in(3) {
            return (0..count).map(|_| self.tile(random, scene, few_bits).ray).collect();
        }
        let tile = self.tile(random, scene, few_bits);
        (0..count)
            .map(|i| {
                let place = [(i % 8) as f64 - 4.0, (i / 8) as f64 - 4.0];
                let mut ray = tile.ray;
                for (step, n) in tile.steps.iter().zip(place) {
                    // Adding 0 would turn -0.0 into 0.0.
                    for k in 0..3 {
                        ray.origin[k] += n * step.origin[k];
                        if step.direction[k] != 0.0 {
                            ray.direction[k] += n * step.direction[k];
                        }
                    }
                }
                if ray.direction == DVec3::ZERO {
                    ray.direction = tile.ray.direction;
                }
                ray
            })
            .collect()
    }

    fn tile(self, random: &mut Random, scene: &Scene, few_bits: bool) -> Tile {
        let mut aim = Aim { random, scene, few_bits };
        match self {
            Class::Any => aim.any(),
            Class::Camera => aim.camera(),
            Class::AxisParallel => aim.axis_parallel(),
            Class::InPlane => aim.in_plane(),
            Class::Edges => aim.edges(),
            Class::Corners => aim.corners(),
            Class::Inside => aim.inside(),
            Class::Far => aim.far(),
            Class::Grazing => aim.grazing(),
            Class::Denormal => aim.denormal(),
            Class::Interval => aim.interval(),
            Class::Absurd => aim.absurd(),
        }
    }
}

/// A ray, and what leads from it to its neighbours.
struct Tile {
    ray: GridRay,
    /// Where it meets what it is aimed at.
    t_target: f64,
    steps: [Step; 2],
}

#[derive(Clone, Copy, Default)]
struct Step {
    origin: DVec3,
    direction: DVec3,
}

/// Step of the direction: rays from one point.
fn fan(step: DVec3) -> Step {
    Step { origin: DVec3::ZERO, direction: step }
}

/// Step of the origin: parallel rays.
fn shift(step: DVec3) -> Step {
    Step { origin: step, direction: DVec3::ZERO }
}

/// The power of two not above the largest component.
fn magnitude(v: DVec3) -> f64 {
    let largest = v.abs().max_element();
    f64::from_bits(largest.to_bits() & f64::INFINITY.to_bits())
}

/// The axes along which the direction is not largest.
fn across(direction: DVec3) -> [DVec3; 2] {
    let d = direction.abs();
    let main = (0..3).fold(0, |main, k| if d[k] > d[main] { k } else { main });
    [DVec3::AXES[(main + 1) % 3], DVec3::AXES[(main + 2) % 3]]
}

/// The generators, and what they share.
struct Aim<'a> {
    random: &'a mut Random,
    scene: &'a Scene,
    few_bits: bool,
}

impl Aim<'_> {
    /// In 0 .. 1; with few bits, 0 quite often.
    fn fraction(&mut self) -> f64 {
        if !self.few_bits {
            return self.random.unit();
        }
        let bits = self.random.pick(&[0, 1, 2, 3, 5, 10, 20]);
        self.random.below(1 << bits) as f64 * power(-bits)
    }

    /// The low corner of an occupied voxel.
    fn corner(&mut self) -> DVec3 {
        DVec3::from_array(self.scene.voxel(self.random).map(f64::from))
    }

    /// A point of an occupied voxel.
    fn target(&mut self) -> DVec3 {
        self.corner() + DVec3::new(self.fraction(), self.fraction(), self.fraction())
    }

    /// Not 0. With few bits, whole numbers.
    fn direction(&mut self) -> DVec3 {
        loop {
            let direction = if self.few_bits {
                let n = 1 << self.random.pick(&[0, 1, 2, 3, 6, 10, 16]);
                DVec3::new(self.random.around_0(n), self.random.around_0(n), self.random.around_0(n))
            } else {
                DVec3::new(self.random.unit(), self.random.unit(), self.random.unit()) * 2.0 - 1.0
            };
            if direction != DVec3::ZERO {
                return direction;
            }
        }
    }

    /// Whole numbers up to 4, not all 0: such rays pass lattice points again and again.
    fn lattice_direction(&mut self) -> DVec3 {
        loop {
            let n = self.random.pick(&[1, 1, 2, 4]);
            let direction =
                DVec3::new(self.random.around_0(n), self.random.around_0(n), self.random.around_0(n));
            if direction != DVec3::ZERO {
                return direction;
            }
        }
    }

    /// Up to three grid sides; sometimes a million.
    fn distance(&mut self) -> f64 {
        if self.random.one_in(12) {
            return self.afar();
        }
        self.random.pick(&[0.01, 0.2, 1.0, 3.0]) * self.random.unit() * self.scene.side()
    }

    /// From ten grid sides to a million.
    fn afar(&mut self) -> f64 {
        let sides = if self.random.one_in(2) { 1e6 } else { 10f64.powf(1.0 + 5.0 * self.random.unit()) };
        sides * self.scene.side()
    }

    /// Through the target, from about that far away. Steps shift it by a fraction of a voxel.
    fn through(&mut self, target: DVec3, direction: DVec3, distance: f64) -> Tile {
        let wanted = distance / direction.abs().max_element();
        // Few bits, so that the origin is exact; whole steps of a lattice direction keep to the lattice.
        let t_target = if self.few_bits && wanted > 0.0 {
            magnitude(DVec3::splat(wanted)) * (16 + self.random.below(16)) as f64 / 16.0
        } else {
            wanted
        };
        let step = power(-(self.random.below(8) as i32));
        Tile {
            ray: GridRay::new(target - t_target * direction, direction),
            t_target,
            steps: across(direction).map(|axis| shift(axis * step)),
        }
    }

    fn any(&mut self) -> Tile {
        let side = self.scene.side();
        let mut point = |reach: f64| {
            let at = DVec3::new(self.random.unit(), self.random.unit(), self.random.unit());
            let point = at * reach - (reach - side) / 2.0;
            if self.few_bits { (point * 8.0).round() / 8.0 } else { point }
        };
        let (origin, place) = (point(3.0 * side), point(side));
        let origin = if self.random.one_in(4) { place } else { origin };
        let target = if self.random.one_in(2) { self.target() } else { self.any_place() };
        let difference = target - origin;
        if self.few_bits {
            // The direction is what is rounded.
            let unit = magnitude(difference) * power(-8);
            let rounded = if unit > 0.0 { (difference / unit).round() } else { DVec3::X };
            return Tile { ray: GridRay::new(origin, rounded), t_target: unit, steps: Default::default() };
        }
        let direction = if difference == DVec3::ZERO { DVec3::X } else { difference };
        Tile { ray: GridRay::new(origin, direction), t_target: 1.0, steps: Default::default() }
    }

    fn any_place(&mut self) -> DVec3 {
        DVec3::new(self.random.unit(), self.random.unit(), self.random.unit()) * self.scene.side()
    }

    fn camera(&mut self) -> Tile {
        let (target, direction, distance) = (self.target(), self.direction(), self.distance());
        let mut tile = self.through(target, direction, distance);
        let pixel = magnitude(direction) * power(-(3 + self.random.below(12) as i32));
        let pixel = if self.few_bits { pixel.max(1.0) } else { pixel };
        tile.steps = across(direction).map(|axis| fan(axis * pixel));
        tile
    }

    fn axis_parallel(&mut self) -> Tile {
        let (target, axis) = (self.target(), self.random.axis());
        let direction = DVec3::AXES[axis] * self.random.sign() * power(self.random.around_0(3) as i32);
        let distance = self.distance();
        self.through(target, direction, distance)
    }

    fn in_plane(&mut self) -> Tile {
        let axis = self.random.axis();
        let (mut target, mut direction, distance) = (self.target(), self.direction(), self.distance());
        target[axis] = target[axis].floor() + self.random.pick(&[0.0, 1.0]);
        direction[axis] = 0.0;
        if direction == DVec3::ZERO {
            direction[(axis + 1) % 3] = self.random.sign();
        }
        direction[axis] = self.random.pick(&[0.0, -0.0]);
        let mut tile = self.through(target, direction, distance);
        // The origin keeps to the plane: 0 times t added nothing.
        let to_next_plane = shift(DVec3::AXES[axis]);
        let along = (axis + 1 + self.random.below(2) as usize) % 3;
        let step = if self.few_bits { 1.0 } else { magnitude(direction) * power(-5) };
        tile.steps = [to_next_plane, fan(DVec3::AXES[along] * step)];
        tile
    }

    fn edges(&mut self) -> Tile {
        let axis = self.random.axis();
        let mut target = self.corner() + DVec3::AXES[(axis + 1) % 3] * self.random.pick(&[0.0, 1.0]);
        target[axis] += self.fraction();
        let direction = match self.random.below(4) {
            0 => DVec3::AXES[axis] * self.random.sign(),
            1 => self.direction(),
            _ => self.lattice_direction(),
        };
        let distance = self.distance();
        let mut tile = self.through(target, direction, distance);
        tile.steps = across(direction).map(shift);
        tile
    }

    fn corners(&mut self) -> Tile {
        let corner = self.corner();
        let target = corner + DVec3::from_array([0; 3].map(|_| self.random.pick(&[0.0, 1.0])));
        let direction = if self.random.one_in(4) { self.direction() } else { self.lattice_direction() };
        let distance = self.distance();
        let mut tile = self.through(target, direction, distance);
        tile.steps = across(direction).map(shift);
        tile
    }

    fn inside(&mut self) -> Tile {
        let (target, direction) = (self.target(), self.direction());
        let mut tile = self.through(target, direction, 0.0);
        let step =
            if self.few_bits { 1.0 } else { magnitude(direction) * power(-(self.random.below(8) as i32)) };
        if self.random.one_in(2) {
            tile.steps = across(direction).map(|axis| fan(axis * step));
        }
        tile
    }

    fn far(&mut self) -> Tile {
        let (target, direction) = (self.target(), self.direction());
        let distance = self.afar();
        let mut tile = self.through(target, direction, distance);
        if !self.few_bits && self.random.one_in(2) {
            let pixel = magnitude(direction) * power(-(20 + self.random.below(20) as i32));
            tile.steps = across(direction).map(|axis| fan(axis * pixel));
        }
        tile
    }

    fn grazing(&mut self) -> Tile {
        let axis = self.random.axis();
        let mut target = self.target();
        let (mut direction, distance) = (self.direction(), self.distance());
        let lift = power(-(4 + self.random.below(if self.few_bits { 17 } else { 45 }) as i32));
        target[axis] = target[axis].floor() + self.random.pick(&[0.0, 1.0]) + self.random.sign() * lift;
        let flattening = power(2 + self.random.below(if self.few_bits { 14 } else { 50 }) as i32);
        if self.few_bits {
            // Whole numbers: the others grow instead.
            direction = self.lattice_direction() * flattening;
            direction[axis] = self.random.around_0(3);
        } else {
            direction[axis] /= flattening;
        }
        if direction == DVec3::ZERO {
            direction[(axis + 1) % 3] = 1.0;
        }
        let mut tile = self.through(target, direction, distance);
        let slope = if self.few_bits { 1.0 } else { magnitude(direction) * power(-50) };
        tile.steps = [fan(DVec3::AXES[axis] * slope), shift(DVec3::AXES[(axis + 1) % 3])];
        tile
    }

    fn denormal(&mut self) -> Tile {
        let (target, mut direction, distance) = (self.target(), self.direction(), self.distance());
        let tiny = [0.0, -0.0, 5e-324, -5e-324, 1e-310, -1e-310, f64::MIN_POSITIVE, -1e-200, 1e-30, -1e-18];
        for _ in 0..1 + self.random.below(2) {
            direction[self.random.axis()] = self.random.pick(&tiny);
        }
        if direction.abs().max_element() < 1e-10 {
            direction[self.random.axis()] = self.random.sign();
        }
        let mut tile = self.through(target, direction, distance);
        let power_of_two = self.random.pick(&[0, 0, -60, -1000, -1060, 21, 900]);
        tile.ray.direction *= power(power_of_two / 2);
        tile.ray.direction *= power(power_of_two - power_of_two / 2);
        tile.t_target /= power(power_of_two / 2);
        tile.t_target /= power(power_of_two - power_of_two / 2);
        tile
    }

    fn interval(&mut self) -> Tile {
        let class = Class::ALL[self.random.below(Class::Interval as u64) as usize];
        let mut tile = class.tile(self.random, self.scene, self.few_bits);
        // A voxel's width, roughly, of the ray's parameter.
        let width = 1.0 / magnitude(tile.ray.direction);
        let (ray, t) = (&mut tile.ray, tile.t_target);
        if !(t.is_finite() && width.is_finite()) {
            return tile;
        }
        let mut beside = |t: f64| match self.random.below(4) {
            0 => t,
            1 => t + width * self.random.around_0(32) / 4.0,
            2 => t * self.random.around_0(8) / 4.0,
            _ => t + width * (self.random.unit() - 0.5),
        };
        ray.t_min = beside(t);
        ray.t_max = beside(ray.t_min);
        match self.random.below(6) {
            0 => ray.t_min = f64::NEG_INFINITY,
            1 => ray.t_max = f64::INFINITY,
            2 => ray.t_min = 0.0,
            // Usually not empty.
            _ if ray.t_min > ray.t_max && !self.random.one_in(4) => {
                std::mem::swap(&mut ray.t_min, &mut ray.t_max);
            }
            _ => {}
        }
        tile
    }

    fn absurd(&mut self) -> Tile {
        let mut tile = self.any();
        let mut number = || match self.random.below(6) {
            0 => f64::MAX * (2.0 * self.random.unit() - 1.0),
            1 => self.random.pick(&[0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 5e-324, f64::MAX]),
            2 => self.random.around_0(1 << 20),
            _ => f64::from_bits(self.random.bits()),
        };
        let mut replaced = |value: &mut f64| {
            // Seldom enough that some of them still hit the grid.
            if number() > 1e9 {
                *value = number();
            }
        };
        let ray = &mut tile.ray;
        replaced(&mut ray.t_min);
        replaced(&mut ray.t_max);
        for k in 0..3 {
            replaced(&mut ray.origin[k]);
            replaced(&mut ray.direction[k]);
        }
        tile
    }
}
