//! Where light comes from.

use glam::DVec3;

/// Angle under which the sun is seen from the earth, degrees.
pub const SUN_ANGLE_DEG: f64 = 0.53;

/// All light of a scene, in the open as under a clear sky: sun 0.85, sky 0.3 of what a white surface can reflect. Values
/// above 1 are for linear files; pictures for screens clip them.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// The strongest light.
    pub key: KeyLight,
    /// What comes from everywhere.
    pub sky: Sky,
    /// Shining rectangles.
    pub areas: Vec<AreaLight>,
    /// A little light from the eye and from the side, so that shapes in the shade keep their form, as in a drawing: 1 for all
    /// of it (a seventh of white), 0 for none. A headlight takes none.
    pub fill: f64,
}

/// The strongest light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KeyLight {
    /// From the eye, as in a CAD viewer; it casts no shadows.
    Headlight,
    /// From far away.
    Sun(Sun),
    /// None: sky and rectangles are all there is.
    None,
}

/// A round light at an endless distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Towards the sun, world space, any length but 0.
    pub direction: DVec3,
    /// Angle across it, degrees: 0 for hard shadows, below 180.
    pub angle_deg: f64,
}

/// What comes from everywhere above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sky {
    /// Nothing: it is black.
    None,
    /// Light that nothing stops.
    Plain,
    /// Light stopped by what is nearer than `reach` (world units, may be infinite): ambient occlusion.
    Occluded {
        /// How far away things still take light.
        reach: f64,
    },
}

/// A rectangle, or any parallelogram, that shines to the side of `edge_u x edge_v`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaLight {
    /// One corner, world space.
    pub corner: DVec3,
    /// From the corner along one side.
    pub edge_u: DVec3,
    /// Along the other.
    pub edge_v: DVec3,
    /// Linear RGB that it shines with: a white wall that it fills half the view of gets about half of it.
    pub radiance: DVec3,
}

/// Light that may come to a point along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LightSample {
    /// Towards the light, length 1.
    pub direction: DVec3,
    /// Where the light is along it; infinite for sun and sky.
    pub distance: f64,
    /// Linear RGB that a white matt surface there reflects if nothing is in the way.
    pub reflected: DVec3,
    /// About the angle across the light where it is narrowest, radians; 0 for the sky, which has no edge.
    pub spread: f64,
    /// Normal of the shining surface, length 1; zero where there is none.
    pub lamp: DVec3,
}

impl Lighting {
    /// The light of a CAD viewer.
    pub fn headlight() -> Self {
        Lighting { key: KeyLight::Headlight, sky: Sky::None, areas: Vec::new(), fill: 0.0 }
    }

    /// A sun, as wide as that of the earth, and a plain sky. `direction` points towards it.
    pub fn sunny(direction: DVec3) -> Self {
        let sun = Sun { direction, angle_deg: SUN_ANGLE_DEG };
        Lighting { key: KeyLight::Sun(sun), sky: Sky::Plain, areas: Vec::new(), fill: 1.0 }
    }
}

impl Sun {
    /// Where the sun stands when nobody says otherwise: half way up, fixed in the world's axes.
    pub fn default_direction(up: DVec3) -> DVec3 {
        let side = DVec3::new(up.y, up.z, up.x);
        up + 0.43 * side - 0.34 * up.cross(side)
    }

    /// Colour and strength: what a white surface that faces it reflects.
    pub(crate) const REFLECTED: DVec3 = DVec3::new(0.85, 0.8245, 0.765);

    /// The light of one point of the sun on a surface, from numbers in `0..1`; `None` when it is behind the surface.
    pub(super) fn sample(&self, normal: DVec3, u: f64, v: f64) -> Option<LightSample> {
        let axis = self.direction.normalize_or(DVec3::Y);
        let half = 0.5 * self.angle_deg.to_radians();
        // Evenly over the cap: its height above the rim is even in cos.
        let cos = 1.0 - u * (1.0 - libm::cos(half));
        let direction = around(axis, cos, v);
        let facing = normal.dot(direction);
        (facing > 0.0).then(|| LightSample {
            direction,
            distance: f64::INFINITY,
            reflected: Self::REFLECTED * facing,
            spread: 2.0 * half,
            lamp: DVec3::ZERO,
        })
    }
}

impl AreaLight {
    /// The light of one point of the rectangle on a surface.
    pub(super) fn sample(&self, point: DVec3, normal: DVec3, u: f64, v: f64) -> Option<LightSample> {
        let to_light = self.corner + u * self.edge_u + v * self.edge_v - point;
        let distance = to_light.length();
        let direction = to_light / distance;
        let across = self.edge_u.cross(self.edge_v);
        let facing = normal.dot(direction);
        // Its area times the cosine on its side: its area as seen from here.
        let seen = -across.dot(direction);
        let (edge_u_seen, edge_v_seen) =
            (self.edge_u.reject_from_normalized(direction), self.edge_v.reject_from_normalized(direction));
        (facing > 0.0 && seen > 0.0 && distance > 0.0).then(|| LightSample {
            direction,
            distance,
            reflected: self.radiance * (facing * seen / (std::f64::consts::PI * distance * distance)),
            // As narrow as the strip between its longer edges looks from here.
            spread: seen / (distance * edge_u_seen.length().max(edge_v_seen.length()).max(f64::MIN_POSITIVE)),
            lamp: across.normalize_or_zero(),
        })
    }
}

/// What a surface reflects of a plain sky: brighter above than below.
pub(super) fn sky_reflected(normal: DVec3, up: DVec3) -> DVec3 {
    let above = 0.5 + 0.5 * normal.dot(up);
    DVec3::new(0.30, 0.31, 0.34) * (0.35 + 0.65 * above)
}

/// One direction of the sky over a surface, as often as it counts there (evenly in cos^2).
pub(super) fn sky_sample(normal: DVec3, reach: f64, up: DVec3, u: f64, v: f64) -> LightSample {
    let direction = around(normal, (1.0 - u).sqrt(), v);
    LightSample {
        direction,
        distance: reach,
        reflected: sky_reflected(normal, up),
        spread: 0.0,
        lamp: DVec3::ZERO,
    }
}

/// The sky itself, brighter towards the horizon.
pub(super) fn sky_radiance(direction: DVec3, up: DVec3) -> DVec3 {
    let height = direction.normalize_or_zero().dot(up).clamp(-1.0, 1.0);
    DVec3::new(0.86, 0.89, 0.93).lerp(DVec3::new(0.42, 0.58, 0.80), height.max(0.0).sqrt())
}

/// A direction with this cosine to an axis of length 1, at the turn `v` around it (`0..1`).
fn around(axis: DVec3, cos: f64, v: f64) -> DVec3 {
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let (side, other) = axis.any_orthonormal_pair();
    let turn = v * std::f64::consts::TAU;
    axis * cos + (side * libm::cos(turn) + other * libm::sin(turn)) * sin
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that fill the square evenly.
    fn square(count: u32) -> impl Iterator<Item = (f64, f64)> {
        (0..count).map(crate::visibility::sample_offset)
    }

    #[test]
    fn the_sun_is_a_round_disc_of_the_asked_angle() {
        let sun = Sun { direction: DVec3::new(1.0, 2.0, -0.5), angle_deg: 20.0 };
        let axis = sun.direction.normalize_or_zero();
        let samples: Vec<LightSample> = square(4096).filter_map(|(u, v)| sun.sample(axis, u, v)).collect();
        assert_eq!(samples.len(), 4096);
        let angles = samples.iter().map(|s| s.direction.dot(axis).min(1.0).acos().to_degrees());
        let widest = angles.fold(0.0, f64::max);
        assert!((9.9..=10.0 + 1e-9).contains(&widest), "{widest}");
        let mean = samples.iter().map(|s| s.direction).sum::<DVec3>() / 4096.0;
        assert!(mean.normalize_or_zero().dot(axis) > 1.0 - 1e-6, "{mean}");
        // Half of the disc's area lies within half of its height.
        let inner =
            samples.iter().filter(|s| 1.0 - s.direction.dot(axis) < 0.5 * (1.0 - 10f64.to_radians().cos()));
        let share = inner.count() as f64 / 4096.0;
        assert!((share - 0.5).abs() < 0.01, "{share}");
        let behind = sun.sample(-axis, 0.5, 0.5);
        assert_eq!(behind, None);
    }

    #[test]
    fn a_rectangle_lights_as_its_form_factor_says() {
        // A square of side 2 at height 1 over the middle of a floor: the form factor of its four quarters
        // (Howell, configuration factor B-4 with a = b = c): 4 x 0.1385.
        let light = AreaLight {
            corner: DVec3::new(-1.0, 1.0, -1.0),
            edge_u: DVec3::X * 2.0,
            edge_v: DVec3::Z * 2.0,
            radiance: DVec3::ONE,
        };
        let sum = |light: AreaLight| {
            let samples = square(20_000).filter_map(|(u, v)| light.sample(DVec3::ZERO, DVec3::Y, u, v));
            samples.map(|s| s.reflected.x).sum::<f64>() / 20_000.0
        };
        // X x Z points down, to the floor.
        let lit = sum(light);
        assert!((lit - 0.5541).abs() < 1e-3, "{lit}");
        let turned = AreaLight { edge_u: light.edge_v, edge_v: light.edge_u, ..light };
        assert_eq!(sum(turned), 0.0, "its back is dark");
    }

    #[test]
    fn directions_of_the_sky_lie_above_the_surface_evenly_in_cos_squared() {
        let normal = DVec3::new(0.3, -0.8, 0.2).normalize_or_zero();
        let cosines: Vec<f64> = square(4096)
            .map(|(u, v)| sky_sample(normal, f64::INFINITY, DVec3::Y, u, v).direction.dot(normal))
            .collect();
        assert!(cosines.iter().all(|&c| c > 0.0));
        let below = cosines.iter().filter(|&&c| c * c < 0.25).count() as f64 / 4096.0;
        assert!((below - 0.25).abs() < 0.01, "{below}");
    }
}
