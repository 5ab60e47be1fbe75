//! Light as shaders have it.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::render::{KeyLight, Lighting, Sky, Sun};

/// Sun and sky of a frame: `Light` of `shaders/light.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "told where shaders read them")]
pub struct LightUniform {
    pub up: [f32; 3],
    pub key: u32,
    pub sun: [f32; 3],
    pub fill: f32,
    pub across: [f32; 3],
    pub sky: u32,
    pub sun_reflected: [f32; 3],
    pub has_shadows: u32,
    pub has_glass: u32,
    pub has_caps: u32,
    pub padding_0: u32,
    pub padding_1: u32,
}

impl LightUniform {
    /// Of a scene with this up direction. Shining rectangles are not drawn: [`crate::render`] does.
    pub fn new(lighting: &Lighting, up: DVec3, has_shadows: bool, has_glass: bool) -> Self {
        let up = up.normalize_or(DVec3::Y);
        let single = |v: DVec3| v.as_vec3().to_array();
        let (key, sun) = match lighting.key {
            KeyLight::Headlight => (0, DVec3::ZERO),
            KeyLight::Sun(sun) => (1, sun.direction.normalize_or(DVec3::Y)),
            KeyLight::None => (2, DVec3::ZERO),
        };
        let sky = match lighting.sky {
            Sky::None => 0,
            Sky::Plain => 1,
            Sky::Occluded { .. } => 2,
        };
        LightUniform {
            up: single(up),
            key,
            sun: single(sun),
            fill: lighting.fill as f32,
            across: single(up.cross(sun).normalize_or_zero()),
            sky,
            sun_reflected: single(Sun::REFLECTED),
            has_shadows: has_shadows.into(),
            has_glass: has_glass.into(),
            ..LightUniform::default()
        }
    }
}
