//! The rays of a tile against one drawable, side by side: what [`ExactScene::closest_of`] gives for each, to the last
//! bit, in a fraction of the time.
//!
//! Boxes are tested in f32, sixteen rays at once, with the slack of [`super::WIDEN`]: each ray starts where it enters the
//! chunk's box, so that its coordinates are at most the box's size s. With u = 2^-24: rounding the start moves a ray by
//! at most u s, reciprocal, product, shift and sum cost 6u s, and a direction component below 2^-23 of the largest, which
//! is replaced by it, 2u s: less than 2^-20 s together, half the slack.
//!
//! Triangles are tested in f64 as in [`super::intersect`], operation by operation. Where all rays start at one point, as
//! those of a perspective camera do, the cross products are the same for all of them and are computed once.
//!
//! No closures and no iterator adapters here: what is not inlined for certain is compiled without the instructions asked
//! for.
#![allow(clippy::needless_range_loop, reason = "lanes and axes of several arrays at once")]

use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch, f32x16, f64x8};
use glam::{DAffine3, DVec3};
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;

use super::chunk_bvh::ChunkBvh;
use super::{ExactScene, WIDEN};
use crate::ray::{Ray, spacing_of};

/// Rays in a packet, at most.
pub const LANES: usize = 64;

/// Rays a SIMD register of f32, and of f64.
const F32_LANES: usize = 16;
const F64_LANES: usize = 8;

/// Bound of reciprocals of direction components, the largest component being 1.
const STEEPEST: f64 = (1 << 23) as f64;

/// Up to [`LANES`] rays of world space, such as those of a tile of 8x8 pixels, and room to work. Keep one per thread and
/// fill it again and again.
pub struct TriangleRays {
    count: usize,
    origin: [[f64; LANES]; 3],
    direction: [[f64; LANES]; 3],
    t_min: [f64; LANES],
    t_max: [f64; LANES],
    /// Those that meet the scene's box.
    in_scene: u64,
    /// All start at one point.
    one_eye: bool,
    /// In world space, for the boxes of drawables.
    world: BoxLanes,
    lanes: BoxLanes,
    /// Nodes that wait, and the rays that may meet them: of a chunk, and of the scene.
    stack: Vec<(u32, u64)>,
    top_stack: Vec<(u32, u64)>,
}

/// The rays in the space of one part or of the world, where they meet a box in which all else lies.
struct BoxLanes {
    /// f64, for triangles.
    origin: [[f64; LANES]; 3],
    direction: [[f64; LANES]; 3],
    t_enter: [f64; LANES],
    scale: [f64; LANES],
    /// f32, for boxes relative to that box's centre: the plane at c is met at `c * inverse + shift`.
    inverse: [[f32; LANES]; 3],
    shift: [[f32; LANES]; 3],
    t_max: [f32; LANES],
}

impl Default for TriangleRays {
    fn default() -> Self {
        let zero = [[0.0; LANES]; 3];
        TriangleRays {
            count: 0,
            origin: zero,
            direction: zero,
            t_min: zero[0],
            t_max: zero[0],
            in_scene: 0,
            one_eye: true,
            world: BoxLanes::new(),
            lanes: BoxLanes::new(),
            stack: Vec::new(),
            top_stack: Vec::new(),
        }
    }
}

impl TriangleRays {
    /// Replaces the rays: the first [`LANES`] of them, and the scene that they will be asked about.
    pub fn fill(&mut self, scene: &ExactScene, rays: &[Ray]) {
        self.count = rays.len().min(LANES);
        self.one_eye = true;
        // Lanes without a ray repeat the first one; nobody looks at what they meet.
        let Some(&first) = rays.first() else { return };
        for i in 0..LANES {
            let ray = rays.get(i).unwrap_or(&first);
            for k in 0..3 {
                self.origin[k][i] = ray.origin[k];
                self.direction[k][i] = ray.direction[k];
            }
            self.t_min[i] = ray.t_min;
            self.t_max[i] = ray.t_max;
            self.one_eye &= ray.origin == first.origin;
        }
        let all = self.all();
        let TriangleRays { origin, direction, t_min, t_max, world, in_scene, .. } = self;
        let space =
            Space { from_world: DAffine3::IDENTITY, min: scene.min, max: scene.max, centre: scene.centre };
        dispatch!(scene.level, simd => {
            let _ = simd;
            *in_scene = world.set_up(&space, [origin, direction], t_min, t_max, all);
        });
    }

    /// A ray has met something at `t`: boxes of drawables farther away are not asked any more.
    pub fn shorten(&mut self, ray: usize, t: f64) {
        self.world.shorten(ray, t);
    }

    /// How far apart neighbouring rays are, by and large, where they enter the scene's box; world units. 0 when none
    /// does.
    pub fn spacing(&self) -> f64 {
        let mut entries = [DVec3::ZERO; LANES];
        let mut count = 0;
        for ray in (0..self.count).filter(|&ray| self.in_scene >> ray & 1 != 0) {
            let of = |of: &[[f64; LANES]; 3]| DVec3::from([0, 1, 2].map(|k: usize| of[k][ray]));
            entries[count] = of(&self.origin) + of(&self.direction) * self.world.t_enter[ray];
            count += 1;
        }
        spacing_of(entries[..count].iter().copied())
    }

    /// All rays, as bits.
    pub fn all(&self) -> u64 {
        if self.count == 0 { 0 } else { u64::MAX >> (LANES - self.count) }
    }
}

impl ExactScene {
    /// Calls `meet` for the drawables whose boxes rays of the packet may meet before their ends, near ones first by and large.
    /// `meet` may [`TriangleRays::shorten`] rays. The packet was filled for this scene.
    pub fn visit_packet(&self, packet: &mut TriangleRays, mut meet: impl FnMut(u32, &mut TriangleRays)) {
        if self.top.nodes.is_empty() {
            return;
        }
        let mut stack = std::mem::take(&mut packet.top_stack);
        stack.clear();
        stack.push((0, packet.in_scene & packet.all()));
        while let Some((at, rays)) = stack.pop() {
            let node = &self.top.nodes[at as usize];
            let rays = dispatch!(self.level, simd => packet.world.crossing(simd, rays, node.aabb()));
            if rays == 0 {
                continue;
            }
            if node.prim_count > 0 {
                for slot in node.first_index..node.first_index + node.prim_count {
                    meet(self.top.primitive_indices[slot as usize], packet);
                }
                continue;
            }
            let first_ray = rays.trailing_zeros() as usize;
            let (near, far) = packet.world.in_order(first_ray, &self.top.nodes, node.first_index);
            stack.push((far, rays));
            stack.push((near, rays));
        }
        packet.top_stack = stack;
    }

    /// [`ExactScene::closest_of`] for those of the packet's rays that are set in `rays`, each up to and including its
    /// `t[ray]`. Returns the rays that meet the drawable, and puts where into `t`; that of the others stays. The packet
    /// was filled for this scene.
    pub fn closest_of_packet(
        &self,
        drawable: u32,
        packet: &mut TriangleRays,
        rays: u64,
        t: &mut [f64; LANES],
    ) -> u64 {
        let placed = &self.instances[drawable as usize];
        let chunk = &self.chunks[placed.chunk as usize];
        let bounds = &self.boxes[drawable as usize];
        dispatch!(self.level, simd => {
            let rays = packet.world.crossing(simd, rays & packet.in_scene, bounds);
            if rays == 0 { 0 } else { closest(simd, chunk, &placed.part_from_world, packet, rays, t) }
        })
    }
}

#[inline(always)]
fn closest<S: Simd>(
    simd: S,
    chunk: &ChunkBvh,
    part_from_world: &DAffine3,
    packet: &mut TriangleRays,
    rays: u64,
    t: &mut [f64; LANES],
) -> u64 {
    let TriangleRays { origin, direction, t_min, one_eye, lanes, stack, .. } = packet;
    let space = Space { from_world: *part_from_world, min: chunk.min, max: chunk.max, centre: chunk.centre };
    let rays = lanes.set_up(&space, [origin, direction], t_min, t, rays);
    if rays == 0 || chunk.bvh.nodes.is_empty() {
        return 0;
    }
    let mut met = 0;
    stack.clear();
    stack.push((0, rays));
    while let Some((at, rays)) = stack.pop() {
        let node = &chunk.bvh.nodes[at as usize];
        let rays = lanes.crossing(simd, rays, node.aabb());
        if rays == 0 {
            continue;
        }
        if node.prim_count > 0 {
            for triangle in node.first_index..node.first_index + node.prim_count {
                let corners = chunk.triangle(triangle);
                met |= if *one_eye {
                    lanes.meet::<S, true>(simd, corners, rays, t_min, t)
                } else {
                    lanes.meet::<S, false>(simd, corners, rays, t_min, t)
                };
            }
            continue;
        }
        let (near, far) = lanes.in_order(rays.trailing_zeros() as usize, &chunk.bvh.nodes, node.first_index);
        stack.push((far, rays));
        stack.push((near, rays));
    }
    met
}

/// A space, and a box in it in which all that matters lies.
struct Space {
    from_world: DAffine3,
    min: DVec3,
    max: DVec3,
    centre: DVec3,
}

impl BoxLanes {
    /// Nothing yet.
    fn new() -> Self {
        let (zero, zero32) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        BoxLanes {
            origin: zero,
            direction: zero,
            t_enter: zero[0],
            scale: zero[0],
            inverse: zero32,
            shift: zero32,
            t_max: zero32[0],
        }
    }

    /// Ends a ray at `t`.
    #[inline(always)]
    fn shorten(&mut self, ray: usize, t: f64) {
        self.t_max[ray] = box_t_max(t, self.t_enter[ray], self.scale[ray]);
    }

    /// Moves rays into a space and to where they enter its box. Returns those of `rays` that do.
    #[inline(always)]
    fn set_up(
        &mut self,
        space: &Space,
        [origin, direction]: [&[[f64; LANES]; 3]; 2],
        t_min: &[f64; LANES],
        t_max: &[f64; LANES],
        rays: u64,
    ) -> u64 {
        let (min, max, centre) = (space.min.to_array(), space.max.to_array(), space.centre.to_array());
        let m = space.from_world.matrix3.to_cols_array_2d();
        let offset = space.from_world.translation.to_array();
        let mut inside = 0;
        for group in 0..LANES / F64_LANES {
            let start = group * F64_LANES;
            if rays >> start & 0xff == 0 {
                continue;
            }
            let mut enters = [false; F64_LANES];
            for lane in 0..F64_LANES {
                let i = start + lane;
                let (mut t_in, mut t_out, mut scale) = (t_min[i], t_max[i], 0.0);
                let mut inverses = [0.0; 3];
                for k in 0..3 {
                    // In the order in which glam adds.
                    let o =
                        m[0][k] * origin[0][i] + m[1][k] * origin[1][i] + m[2][k] * origin[2][i] + offset[k];
                    let d = m[0][k] * direction[0][i] + m[1][k] * direction[1][i] + m[2][k] * direction[2][i];
                    let inverse = 1.0 / d;
                    let (a, b) = ((min[k] - o) * inverse, (max[k] - o) * inverse);
                    let parallel = d == 0.0;
                    let within = o >= min[k] && o <= max[k];
                    let everywhere = if within { f64::INFINITY } else { f64::NEG_INFINITY };
                    t_in = larger(t_in, if parallel { -everywhere } else { smaller(a, b) });
                    t_out = smaller(t_out, if parallel { everywhere } else { larger(a, b) });
                    scale = larger(scale, d.abs());
                    inverses[k] = inverse;
                    self.origin[k][i] = o;
                    self.direction[k][i] = d;
                }
                enters[lane] = t_in <= t_out && scale > 0.0;
                self.t_enter[i] = t_in;
                self.scale[i] = scale;
                for k in 0..3 {
                    let entry = (self.origin[k][i] + t_in * self.direction[k][i] - centre[k]) as f32;
                    let steep = smaller(larger(scale * inverses[k], -STEEPEST), STEEPEST) as f32;
                    self.inverse[k][i] = steep;
                    self.shift[k][i] = -(entry * steep);
                }
                self.t_max[i] = box_t_max(t_max[i], t_in, scale);
            }
            for lane in 0..F64_LANES {
                inside |= u64::from(enters[lane]) << (start + lane);
            }
        }
        inside & rays
    }

    /// Those of `rays` that may cross a box before their ends.
    #[inline(always)]
    fn crossing<S: Simd>(&self, simd: S, rays: u64, bounds: &Aabb) -> u64 {
        let (low, high) = (bounds.min.to_array(), bounds.max.to_array());
        let mut found = 0;
        for group in 0..LANES / F32_LANES {
            let start = group * F32_LANES;
            if rays >> start & 0xffff == 0 {
                continue;
            }
            let mut t_in = f32x16::splat(simd, 0.0);
            let mut t_out = load_f32(simd, &self.t_max, start);
            for k in 0..3 {
                let inverse = load_f32(simd, &self.inverse[k], start);
                let shift = load_f32(simd, &self.shift[k], start);
                let a = f32x16::splat(simd, low[k]).mul_add(inverse, shift);
                let b = f32x16::splat(simd, high[k]).mul_add(inverse, shift);
                t_in = t_in.max(a.min(b));
                t_out = t_out.min(a.max(b));
            }
            found |= t_in.simd_le(t_out).to_bitmask() << start;
        }
        found & rays
    }

    /// Two nodes side by side, from `left` on: which of them the ray meets before the other, by and large.
    #[inline(always)]
    fn in_order(&self, ray: usize, nodes: &[Bvh2Node], left: u32) -> (u32, u32) {
        let (first, second) = (nodes[left as usize].aabb(), nodes[left as usize + 1].aabb());
        let apart = ((second.min + second.max) - (first.min + first.max)).to_array();
        let mut along = 0.0;
        for k in 0..3 {
            along += f64::from(apart[k]) * self.direction[k][ray];
        }
        if along >= 0.0 { (left, left + 1) } else { (left + 1, left) }
    }

    /// Tests `rays` against a triangle. Returns those that meet it no farther than at their `t`, which becomes that.
    #[inline(always)]
    fn meet<S: Simd, const ONE_EYE: bool>(
        &mut self,
        simd: S,
        corners: [DVec3; 3],
        rays: u64,
        t_min: &[f64; LANES],
        t: &mut [f64; LANES],
    ) -> u64 {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let normal_lanes = splat(simd, normal);
        // Where all rays start, if they do.
        let first = rays.trailing_zeros() as usize & (LANES - 1);
        let eye = DVec3::new(self.origin[0][first], self.origin[1][first], self.origin[2][first]);
        let (a, b, c) = (corners[0] - eye, corners[1] - eye, corners[2] - eye);
        let edges = [splat(simd, c.cross(b)), splat(simd, a.cross(c)), splat(simd, b.cross(a))];
        let height = f64x8::splat(simd, normal.dot(a));
        let zero = f64x8::splat(simd, 0.0);
        let mut met = 0;
        for group in 0..LANES / F64_LANES {
            let start = group * F64_LANES;
            if rays >> start & 0xff == 0 {
                continue;
            }
            let direction = load(simd, &self.direction, start);
            let (u, v, w, height) = if ONE_EYE {
                (dot(direction, edges[0]), dot(direction, edges[1]), dot(direction, edges[2]), height)
            } else {
                let origin = load(simd, &self.origin, start);
                let a = minus(splat(simd, corners[0]), origin);
                let b = minus(splat(simd, corners[1]), origin);
                let c = minus(splat(simd, corners[2]), origin);
                let (u, v, w) = (cross(c, b), cross(a, c), cross(b, a));
                (dot(direction, u), dot(direction, v), dot(direction, w), dot(normal_lanes, a))
            };
            let below = u.simd_lt(zero) | v.simd_lt(zero) | w.simd_lt(zero);
            let above = u.simd_gt(zero) | v.simd_gt(zero) | w.simd_gt(zero);
            let among = rays >> start & 0xff & !(below & above).to_bitmask();
            if among == 0 {
                continue;
            }
            let slope = dot(normal_lanes, direction);
            let at = height / slope;
            let from = f64x8::from_slice(simd, &t_min[start..start + F64_LANES]);
            let to = f64x8::from_slice(simd, &t[start..start + F64_LANES]);
            let in_time = at.simd_ge(from) & at.simd_le(to) & at.simd_lt(f64x8::splat(simd, f64::INFINITY));
            let hits = among & in_time.to_bitmask() & !slope.simd_eq(zero).to_bitmask();
            if hits == 0 {
                continue;
            }
            let found = at.as_slice();
            for lane in 0..F64_LANES {
                if hits >> lane & 1 != 0 {
                    let i = start + lane;
                    t[i] = found[lane];
                    self.shorten(i, found[lane]);
                }
            }
            met |= hits << start;
        }
        met
    }
}

#[inline(always)]
fn load_f32<S: Simd>(simd: S, lanes: &[f32; LANES], start: usize) -> f32x16<S> {
    f32x16::from_slice(simd, &lanes[start..start + F32_LANES])
}

#[inline(always)]
fn load<S: Simd>(simd: S, lanes: &[[f64; LANES]; 3], start: usize) -> [f64x8<S>; 3] {
    [
        f64x8::from_slice(simd, &lanes[0][start..start + F64_LANES]),
        f64x8::from_slice(simd, &lanes[1][start..start + F64_LANES]),
        f64x8::from_slice(simd, &lanes[2][start..start + F64_LANES]),
    ]
}

#[inline(always)]
fn splat<S: Simd>(simd: S, v: DVec3) -> [f64x8<S>; 3] {
    [f64x8::splat(simd, v.x), f64x8::splat(simd, v.y), f64x8::splat(simd, v.z)]
}

#[inline(always)]
fn minus<S: Simd>(a: [f64x8<S>; 3], b: [f64x8<S>; 3]) -> [f64x8<S>; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `t` as a parameter of the box rays, rounded up generously: a box at just this distance is still entered.
#[inline(always)]
fn box_t_max(t: f64, t_enter: f64, scale: f64) -> f32 {
    let t = (t - t_enter) * scale;
    (t * (1.0 + WIDEN) + f64::from(f32::MIN_POSITIVE)) as f32 * (1.0 + 4.0 * f32::EPSILON)
}

/// The larger; `a` when `b` is not a number (0 times infinity, of a ray in a plane of the box).
#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// The smaller; `a` when `b` is not a number.
#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

/// In glam's order of operations.
#[inline(always)]
fn dot<S: Simd>(a: [f64x8<S>; 3], b: [f64x8<S>; 3]) -> f64x8<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// In glam's order of operations.
#[inline(always)]
fn cross<S: Simd>(a: [f64x8<S>; 3], b: [f64x8<S>; 3]) -> [f64x8<S>; 3] {
    [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]]
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use oorandom::Rand64;

    use super::*;
    use crate::exact::{ChunkMesh, Instance};

    fn number(random: &mut Rand64, scale: f64) -> f64 {
        (random.rand_float() - 0.5) * scale
    }

    fn point(random: &mut Rand64, scale: f64) -> DVec3 {
        DVec3::from([0.0; 3].map(|_: f64| number(random, scale)))
    }

    /// A soup of triangles, some flat in a plane of an axis, placed with rotation, mirroring and uneven scale.
    fn scene(random: &mut Rand64) -> ExactScene {
        let triangles = random.rand_range(1..60) as usize;
        let mut positions = Vec::new();
        for _ in 0..triangles {
            let (at, size) = (point(random, 2.0), [1.0, 0.1, 0.01][random.rand_range(0..3) as usize]);
            let flat = random.rand_range(0..6) as usize;
            for _ in 0..3 {
                let mut corner = at + point(random, size);
                if flat < 3 {
                    corner[flat] = 0.25;
                }
                positions.push(corner.as_vec3());
            }
        }
        let triangles = (0..triangles as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let turn = DMat3::from_rotation_y(number(random, 6.0)) * DMat3::from_rotation_x(number(random, 6.0));
        let scale =
            DVec3::from([0.0; 3].map(|_: f64| number(random, 2.0).signum() * number(random, 12.0).exp2()));
        let is_plain = random.rand_range(0..3) == 0;
        let matrix = if is_plain { DMat3::IDENTITY } else { turn * DMat3::from_diagonal(scale) };
        let far = [0.0, 10.0, 1e7][random.rand_range(0..3) as usize];
        let instance = Instance {
            chunk: 0,
            world_from_part: DAffine3::from_mat3_translation(matrix, point(random, far)),
            transparent: false,
        };
        ExactScene::new(vec![ChunkMesh { positions, triangles }], &[instance])
    }

    #[test]
    fn a_packet_meets_what_its_rays_meet_alone_to_the_last_bit() {
        const SEED: u128 = 11;
        let mut random = Rand64::new(SEED);
        let mut packet = TriangleRays::default();
        let (mut hits, mut misses) = (0u64, 0u64);
        for round in 0..3_000 {
            let scene = scene(&mut random);
            let world = scene.world_from_part(0);
            // Eyes near, within and far, and rays that share one or none, some along axes of the part.
            let reach = [1.0, 3.0, 1e3, 1e6][random.rand_range(0..4) as usize];
            let (eye, one_eye) = (point(&mut random, reach), random.rand_range(0..2) == 0);
            let count = random.rand_range(1..LANES as u64 + 1) as usize;
            let aim = point(&mut random, 2.0);
            let along = random.rand_range(0..8) as usize;
            let rays: Vec<Ray> = (0..count)
                .map(|_| {
                    let mut from = if one_eye { eye } else { eye + point(&mut random, 1.0) };
                    let to = aim + point(&mut random, 0.5);
                    let mut direction = to - from;
                    if along < 3 {
                        direction = DVec3::ZERO;
                        direction[along] = if round % 2 == 0 { 1.0 } else { -1.0 };
                        from = to - direction;
                    }
                    let (origin, direction) =
                        (world.transform_point3(from), world.transform_vector3(direction));
                    let t_min = [0.0, random.rand_float()][random.rand_range(0..2) as usize];
                    Ray { t_min, ..Ray::new(origin, direction) }
                })
                .collect();
            packet.fill(&scene, &rays);
            let asked = packet.all() & if round % 3 == 0 { random.rand_u64() } else { u64::MAX };
            let limits: [f64; LANES] = std::array::from_fn(|_| match random.rand_range(0..3) {
                0 => f64::INFINITY,
                1 => 1.0 + number(&mut random, 0.5),
                _ => random.rand_float() * reach,
            });
            let mut t = limits;
            let met = scene.closest_of_packet(0, &mut packet, asked, &mut t);
            for (i, ray) in rays.iter().enumerate() {
                let alone = scene.closest_of(0, &Ray { t_max: limits[i], ..*ray }).map(|hit| hit.t);
                let expected = alone.filter(|_| asked >> i & 1 != 0);
                let found = (met >> i & 1 != 0).then_some(t[i]);
                assert_eq!(found, expected, "seed {SEED}, round {round}, ray {i}: {ray:?}");
                if found.is_none() {
                    assert_eq!(t[i], limits[i], "seed {SEED}, round {round}, ray {i}: a miss moved the end");
                }
                hits += u64::from(found.is_some());
                misses += u64::from(found.is_none());
            }
            assert_eq!(met & !asked, 0, "seed {SEED}, round {round}");
        }
        assert!(hits > 5_000 && misses > 5_000, "{hits} hits, {misses} misses: too few to mean anything");
    }
}
