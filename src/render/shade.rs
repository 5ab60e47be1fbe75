//! Light, shadow and colour of one ray.

use glam::DVec3;
use voxsight_voxel::raycast::{GridRay, Next, RayCaster};

use super::{RenderScene, RenderSettings};
use crate::camera::CameraRays;
use crate::exact::TriangleHit;
use crate::model::{Colour, linear_from_srgb};
use crate::ray::Ray;
use crate::visibility::QueryScene;

/// Where the light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// From the eye, as in a CAD viewer.
    Headlight,
    /// From far away: the direction towards the sun, world space, any length but 0.
    Sun(DVec3),
}

/// How shadow rays are cast.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shadows {
    /// Not at all.
    None,
    /// Against the voxels.
    Voxel,
    /// Against the triangles.
    Exact,
}

/// Transparent layers blended along one ray; more are not told apart by the eye.
const MAX_LAYERS: usize = 16;

pub(super) struct Shader<'a> {
    scene: &'a RenderScene<'a>,
    light: Light,
    shadows: Shadows,
    up: DVec3,
    to_sun: DVec3,
    /// Level, at a right angle to the sun.
    across: DVec3,
    forward: DVec3,
    /// Start of an exact shadow ray above its surface, world units: rounding of a hit is far below it, details worth a
    /// shadow are far above.
    exact_offset: f64,
    /// sRGB byte to linear.
    linear: Vec<f64>,
}

impl<'a> Shader<'a> {
    pub fn new(scene: &'a RenderScene<'a>, settings: &RenderSettings, camera: &CameraRays) -> Self {
        let to_sun = match settings.light {
            Light::Headlight => -camera.forward(),
            Light::Sun(direction) => direction.normalize_or(DVec3::Y),
        };
        Shader {
            scene,
            light: settings.light,
            shadows: settings.shadows,
            up: settings.up.normalize_or(DVec3::Y),
            to_sun,
            across: settings.up.cross(to_sun).normalize_or_zero(),
            forward: camera.forward(),
            exact_offset: scene.query.grid.voxel_size * f64::from(scene.query.grid.side()) * 1e-7,
            linear: (0..=255).map(|byte| linear_from_srgb(f64::from(byte) / 255.0)).collect(),
        }
    }

    /// Linear RGB that comes along the ray.
    pub fn radiance(&self, ray: &Ray) -> DVec3 {
        let exact = self.scene.query.exact;
        let mut layers: Vec<TriangleHit> = Vec::new();
        let opaque = exact.closest_through(ray, self.scene.query.filter, |hit| layers.push(hit));
        let end = opaque.map_or(f64::INFINITY, |hit| hit.t);
        layers.retain(|hit| hit.t < end);
        layers.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.drawable.cmp(&b.drawable)));
        layers.truncate(MAX_LAYERS);

        let mut light = DVec3::ZERO;
        let mut left = 1.0;
        for hit in &layers {
            let Colour([.., alpha]) = self.scene.colours[hit.drawable as usize];
            let alpha = f64::from(alpha) / 255.0;
            light += left * alpha * self.surface(ray, hit);
            left *= 1.0 - alpha;
        }
        light + left * opaque.map_or_else(|| self.sky(ray), |hit| self.surface(ray, &hit))
    }

    /// Light reflected by a hit surface.
    fn surface(&self, ray: &Ray, hit: &TriangleHit) -> DVec3 {
        let Colour([r, g, b, _]) = self.scene.colours[hit.drawable as usize];
        let albedo = DVec3::from([r, g, b].map(|c| self.linear[usize::from(c)]));
        let normal = self.scene.query.exact.normal(hit);
        // CAD files are careless about winding: the side that is seen is the outside.
        let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
        match self.light {
            Light::Headlight => {
                let facing = -normal.dot(ray.direction.normalize_or_zero());
                albedo * (0.12 + 0.88 * facing.max(0.0))
            }
            Light::Sun(_) => {
                let sky = 0.5 + 0.5 * normal.dot(self.up);
                let ambient = DVec3::new(0.30, 0.31, 0.34) * (0.35 + 0.65 * sky);
                let facing = normal.dot(self.to_sun);
                let lit = facing > 0.0 && !self.is_shadowed(ray.at(hit.t), normal);
                let sun = if lit { DVec3::new(1.0, 0.97, 0.90) * (0.85 * facing) } else { DVec3::ZERO };
                // A little light from the eye, so that shapes in the shade keep their form.
                let eye = 0.14 * (-normal.dot(self.forward)).max(0.0);
                // Light from the side, across the sun: walls at a right angle differ in the shade as well.
                let side = 0.10 * normal.dot(self.across).abs();
                albedo * (ambient + sun + eye + side)
            }
        }
    }

    fn is_shadowed(&self, point: DVec3, normal: DVec3) -> bool {
        let query = &self.scene.query;
        match self.shadows {
            Shadows::None => false,
            Shadows::Exact => {
                let origin = point + normal * self.exact_offset;
                query.exact.any(&Ray::new(origin, self.to_sun), query.filter)
            }
            Shadows::Voxel => {
                // Every voxel that touches a plane lies within the plane's distance |n|_1 (voxels) of it, so that a ray
                // that starts this high leaves the voxels of its own flat surface behind. 2/256: the widened overlap.
                let offset = normal.abs().element_sum() * (1.0 + 2.0 / 256.0);
                let origin = query.grid.grid_from_world(point) + normal * offset;
                self.meets_opaque_voxel(origin)
            }
        }
    }

    /// Glass casts no shadow: only a voxel with an opaque owner stops the light.
    fn meets_opaque_voxel(&self, grid_origin: DVec3) -> bool {
        let QueryScene { grid, dag, owners, filter, exact, .. } = self.scene.query;
        let start = grid.world_from_grid(grid_origin);
        let Some(ray) = filter.clipped(&Ray::new(start, self.to_sun * grid.voxel_size)) else { return false };
        let casts = |owner: u32| !exact.is_transparent(owner) && !filter.is_hidden(owner);
        let grid_ray =
            GridRay { origin: grid_origin, direction: self.to_sun, t_min: ray.t_min, t_max: ray.t_max };
        let mut met = false;
        RayCaster::new(dag).cast(&grid_ray, |hit| {
            let owners = owners.of_brick(hit.brick_ordinal(), hit.brick_mask());
            met = owners.of_voxel(hit.bit()).any(casts);
            if met { Next::End } else { Next::Voxel }
        });
        met
    }

    /// A plain sky, brighter towards the horizon.
    fn sky(&self, ray: &Ray) -> DVec3 {
        let height = ray.direction.normalize_or_zero().dot(self.up).clamp(-1.0, 1.0);
        DVec3::new(0.86, 0.89, 0.93).lerp(DVec3::new(0.42, 0.58, 0.80), height.max(0.0).sqrt())
    }
}

/// Linear RGB to sRGB bytes; values above 1 are clipped.
pub(super) fn encode(linear: DVec3) -> [u8; 3] {
    let Colour([r, g, b, _]) = Colour::from_linear([linear.x, linear.y, linear.z, 1.0]);
    [r, g, b]
}
