//! Shadow rays: is anything between a surface and a point of a light?
//!
//! # Where they start
//!
//! A ray that starts in its own surface would meet it. Against triangles it starts [`EXACT_HEIGHT`] of the scene's
//! size above the surface, far above what rounding moves a hit, far below any detail worth a shadow. Against voxels: every voxel
//! that touches a plane with normal n (length 1) has all its points within |n.x| + |n.y| + |n.z| voxels of the plane, as far as
//! the corners of a unit cube are apart along n. The overlap test widens a voxel by 1/256 on each side. A ray that starts
//! (|n.x| + |n.y| + |n.z|) (1 + 2/256) voxels above its surface has left all voxels of that plane behind: no acne on flat or
//! convex surfaces, whatever the light's slope. Things lower than that above a surface cast no shadow on it: it leaks there.
//!
//! # Where they end
//!
//! A light may be drawn, too: a panel in a ceiling has triangles and voxels of its own, which must not darken it. Rays against
//! triangles end [`LAMP_HEIGHT`] of the scene's size before the light's plane: more than what quantization moves a panel by.
//! Rays against voxels end where they enter the voxels that touch the plane, by the rule for starts: what is nearer to a lamp
//! than that does not darken it.
//!
//! # `hybrid`
//!
//! Voxels are larger than what is in them, by up to a diagonal. Seen from the receiver a diagonal s at distance t
//! covers s / t; where that is less than [`Shadows::Hybrid`]'s `tolerance` times the angle across the light, a voxel may decide:
//! it shifts a penumbra by less than this share of its width. Nearer, triangles decide: voxels name the candidates of the whole
//! packet. So they do for what is so near to a lamp that voxels cannot tell. Rays to the sky have no penumbra and little in
//! common: triangles decide all of them.
//!
//! Lost: to look for any voxel behind the ray's own first, and for triangles only where there is one (0.6 times as fast amid a
//! plant, where nearly every ray meets one); voxels for what is far away towards the sky, as if it were a lamp of 0.1 radians (0.6 to 1.1
//! times as fast as triangles alone, and wrong by a percent); packets of rays to the sky, sorted by direction (0.8 times as fast
//! as single rays, and 0.2 to 0.5 times where they start far apart).

use glam::DVec3;
use voxsight_voxel::raycast::{
    GridRay, Next, PACKET_RAYS, PacketBrick, RayCaster, RayEnds, RayPacket, VoxelHit,
};

use super::film::LightKind;
use crate::exact::TriangleRays;
use crate::ray::{Ray, spacing_of};
use crate::visibility::{Asked, QueryScene, VOXELS_BETWEEN_RAYS, grid_ray};

/// Times the sum of a normal's components, the height in voxels above a plane at which all its voxels are left behind: a voxel, and
/// what the overlap test widens it by on both sides.
pub(crate) const HEIGHT: f64 = 1.0 + 2.0 / 256.0;

/// Height above its surface at which a shadow ray against triangles starts, in largest sides of the scene.
const EXACT_HEIGHT: f64 = 1e-7;

/// Height above a lamp at which it ends, likewise: half a step of quantization is at most 2^-16 of a part.
const LAMP_HEIGHT: f64 = 1.0 / (1 << 15) as f64;

/// Rays of a packet towards the same light that start farther apart than this, in voxels, share too little to go together.
/// Measured on three scenes from outside, sun: at 16 packets are 1.4 to 1.6 times as fast as single rays; at 40, 0.9 to 1.1 times
/// that.
const VOXELS_BETWEEN_SHADOW_RAYS: f64 = 16.0;

/// How shadow rays are cast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shadows {
    /// Not at all.
    None,
    /// Against the voxels.
    Voxel,
    /// Against the triangles where a voxel could be seen in the penumbra, against the voxels beyond.
    Hybrid {
        /// Share of a penumbra's width by which a voxel may shift it: 0 for triangles only.
        tolerance: f64,
    },
    /// Against the triangles: the reference.
    Exact,
}

impl Shadows {
    /// `hybrid` with an error that is not seen.
    pub const HYBRID: Self = Shadows::Hybrid { tolerance: 1.0 / 32.0 };
}

/// A ray from a surface towards a light.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadowRay {
    /// Of the surface, world space.
    pub point: DVec3,
    /// Of the surface, on the light's side, length 1.
    pub normal: DVec3,
    /// Towards the light, length 1.
    pub direction: DVec3,
    /// How far away the light is; may be infinite.
    pub distance: f64,
    /// Normal of the light's surface, length 1; zero where it has none.
    pub lamp: DVec3,
    /// About the angle across the light, radians.
    pub spread: f64,
}

/// Room to work; one for each thread.
#[derive(Default)]
pub(super) struct ShadowScratch {
    packet: RayPacket,
    grid_rays: Vec<GridRay>,
    triangles: TriangleRays,
    asked: Asked,
    /// Which of the caller's rays those of the packet are.
    numbers: Vec<usize>,
    /// The caller's rays that a voxel stopped, as bits.
    stopped: u64,
    /// Rays that are left for triangles, and which of the caller's they are.
    near: Vec<(usize, Ray)>,
    lone: Vec<Ray>,
}

/// Casts shadow rays in one way.
pub(super) struct ShadowTracer<'a> {
    scene: QueryScene<'a>,
    shadows: Shadows,
    /// Every drawable casts shadows: whose voxel it is does not matter.
    all_cast: bool,
    /// [`EXACT_HEIGHT`], [`LAMP_HEIGHT`], world units.
    exact_height: f64,
    lamp_height: f64,
}

impl<'a> ShadowTracer<'a> {
    pub fn new(scene: &QueryScene<'a>, shadows: Shadows) -> Self {
        ShadowTracer {
            scene: *scene,
            shadows,
            all_cast: (0..scene.exact.drawable_count()).all(|drawable| scene.casts(drawable)),
            exact_height: scene.exact.largest_side() * EXACT_HEIGHT,
            lamp_height: scene.exact.largest_side() * LAMP_HEIGHT,
        }
    }

    /// Which of up to [`PACKET_RAYS`] rays are stopped, as bits. All go towards lights of one kind.
    pub fn stopped(&self, rays: &[ShadowRay], kind: LightKind, scratch: &mut ShadowScratch) -> u64 {
        // Those to the sky go everywhere.
        let coherent = kind != LightKind::Sky;
        debug_assert!(rays.len() <= PACKET_RAYS);
        match self.shadows {
            Shadows::None => 0,
            Shadows::Voxel => {
                let rays = rays.iter().enumerate();
                let rays = rays.filter_map(|(i, ray)| Some((i, self.voxel_ray(ray)?)));
                self.meet_voxels(rays, coherent, scratch);
                scratch.stopped
            }
            Shadows::Hybrid { tolerance } if coherent => self.stopped_by_both(rays, tolerance, scratch),
            Shadows::Hybrid { .. } | Shadows::Exact => (0..).zip(rays).fold(0, |bits, (i, ray)| {
                bits | u64::from(self.scene.exact.any(&self.exact_ray(ray), self.scene.filter)) << i
            }),
        }
    }

    /// World-space ray for triangles.
    fn exact_ray(&self, ray: &ShadowRay) -> Ray {
        let start = ray.point + ray.normal * self.exact_height;
        let end = end(ray, self.exact_height, self.lamp_height);
        Ray { t_max: end, ..Ray::new(start, ray.direction) }
    }

    /// Height above a plane at which all its voxels are left behind; 0 where there is no plane.
    fn voxel_height(&self, normal: DVec3) -> f64 {
        normal.abs().element_sum() * HEIGHT * self.scene.grid.voxel_size
    }

    /// The ray for voxels: started above those of its own surface. `None` when nothing is left of it.
    fn voxel_ray(&self, ray: &ShadowRay) -> Option<Ray> {
        let height = self.voxel_height(ray.normal);
        let start = ray.point + ray.normal * height;
        let end = end(ray, height, self.voxel_height(ray.lamp));
        self.scene.filter.clipped(&Ray { t_max: end, ..Ray::new(start, ray.direction) })
    }

    /// Casts numbered rays against the voxels: which are stopped.
    fn meet_voxels(
        &self,
        rays: impl Iterator<Item = (usize, Ray)>,
        coherent: bool,
        scratch: &mut ShadowScratch,
    ) {
        let ShadowScratch { packet, grid_rays, numbers, stopped, .. } = scratch;
        numbers.clear();
        grid_rays.clear();
        for (number, ray) in rays {
            numbers.push(number);
            grid_rays.push(grid_ray(&self.scene, &ray));
        }
        let QueryScene { owners, dag, .. } = self.scene;
        let casts = |owner: u32| self.scene.casts(owner);
        *stopped = 0;
        let visit = |ray: usize, hit: &VoxelHit| {
            // Glass casts no shadow: only a voxel with an opaque owner stops the light.
            let opaque = self.all_cast
                || owners.of_brick(hit.brick_ordinal(), hit.brick_mask()).of_voxel(hit.bit()).any(casts);
            if !opaque {
                return Next::Voxel;
            }
            *stopped |= 1 << numbers[ray];
            Next::End
        };
        let caster = RayCaster::new(dag);
        let is_packet =
            coherent && spacing_of(grid_rays.iter().map(|ray| ray.origin)) <= VOXELS_BETWEEN_SHADOW_RAYS;
        if is_packet {
            packet.fill(grid_rays.iter().copied());
            caster.cast_packet(packet, visit);
        } else {
            caster.cast_batch(grid_rays, visit);
        }
    }

    /// Voxels where they are fine enough, triangles before.
    fn stopped_by_both(&self, rays: &[ShadowRay], tolerance: f64, scratch: &mut ShadowScratch) -> u64 {
        let filter = self.scene.filter;
        // From here on voxels decide; never where the light has no size.
        let diagonal = 3f64.sqrt() * self.scene.grid.voxel_size;
        // Nor where the ray is still in the voxels of its own surface.
        let fine = |ray: &ShadowRay| {
            let own = self.voxel_height(ray.normal) / ray.normal.dot(ray.direction).max(f64::MIN_POSITIVE);
            (diagonal / (tolerance * ray.spread)).max(own)
        };
        // Where they cannot any more: before a lamp's own voxels.
        let far_end =
            |ray: &ShadowRay| end(ray, self.exact_height, self.lamp_height.max(self.voxel_height(ray.lamp)));
        // The far part first: it is quick, and what it stops needs no triangles.
        let far = rays.iter().enumerate().filter_map(|(i, ray)| {
            let far = Ray { t_min: fine(ray), t_max: far_end(ray), ..self.exact_ray(ray) };
            (far.t_min < far.t_max).then(|| filter.clipped(&far)).flatten().map(|far| (i, far))
        });
        self.meet_voxels(far, true, scratch);
        let mut stopped = scratch.stopped;
        for (i, ray) in rays.iter().enumerate() {
            if stopped >> i & 1 != 0 {
                continue;
            }
            let whole = self.exact_ray(ray);
            let last = Ray { t_min: far_end(ray).max(fine(ray)), ..whole };
            let is_stopped = last.t_min < last.t_max && self.scene.exact.any(&last, filter);
            stopped |= u64::from(is_stopped) << i;
        }
        let mut near = std::mem::take(&mut scratch.near);
        near.clear();
        near.extend(rays.iter().enumerate().filter(|(i, _)| stopped >> i & 1 == 0).filter_map(|(i, ray)| {
            let whole = self.exact_ray(ray);
            filter.clipped(&Ray { t_max: fine(ray).min(whole.t_max), ..whole }).map(|ray| (i, ray))
        }));
        stopped |= self.stopped_by_triangles(&near, scratch);
        scratch.near = near;
        stopped
    }

    /// Which of some numbered rays meet a triangle: voxels name the candidates.
    fn stopped_by_triangles(&self, rays: &[(usize, Ray)], scratch: &mut ShadowScratch) -> u64 {
        let ShadowScratch { packet, triangles, asked, lone, .. } = scratch;
        let QueryScene { exact, owners, dag, .. } = self.scene;
        let mut waiting = match rays.len() {
            0 => return 0,
            count => u64::MAX >> (PACKET_RAYS - count),
        };
        lone.clear();
        lone.extend(rays.iter().map(|&(_, ray)| ray));
        asked.begin(exact.drawable_count());
        packet.fill(lone.iter().map(|ray| grid_ray(&self.scene, ray)));
        triangles.fill(exact, lone);
        let mut ends = [0.0; PACKET_RAYS];
        lone.iter().zip(&mut ends).for_each(|(ray, end)| *end = ray.t_max);
        let mut ask = |drawable: u32, triangles: &mut TriangleRays| {
            if !self.scene.casts(drawable) {
                return 0;
            }
            let mut t = ends;
            let met = exact.closest_of_packet(drawable, triangles, waiting, &mut t);
            waiting &= !met;
            met
        };
        let each = |bits: u64| (0..PACKET_RAYS).filter(move |ray| bits >> ray & 1 != 0);
        if triangles.spacing() > VOXELS_BETWEEN_RAYS * self.scene.grid.voxel_size {
            // Each ray would cross bricks of its own.
            exact.visit_packet(triangles, |drawable, triangles| {
                each(ask(drawable, triangles)).for_each(|ray| triangles.shorten(ray, f64::NEG_INFINITY));
            });
        } else {
            RayCaster::new(dag).cast_bricks(packet, |brick: &PacketBrick, left: &mut RayEnds| {
                for owner in owners.all_of_brick(brick.ordinal()).filter(|&owner| asked.is_new(owner)) {
                    each(ask(owner, triangles)).for_each(|ray| left.shorten(ray, f64::NEG_INFINITY));
                }
            });
        }
        rays.iter().enumerate().fold(0, |bits, (i, &(number, _))| bits | (!waiting >> i & 1) << number)
    }
}

/// Where a ray that starts at this height above its surface ends: at `lamp_height` before the light's plane.
fn end(ray: &ShadowRay, height: f64, lamp_height: f64) -> f64 {
    let facing = ray.lamp.dot(ray.direction);
    if facing == 0.0 {
        return ray.distance;
    }
    // Lifted, it is nearer to the light's plane, or farther, all along.
    let nearer = height * ray.normal.dot(ray.lamp) * facing.signum();
    ray.distance - (nearer + lamp_height) / facing.abs()
}
