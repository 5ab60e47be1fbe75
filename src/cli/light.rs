//! The flags of `voxsight render` about light and shadow.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;
use serde::Deserialize;

use super::numbers::{Length, parse_length, parse_vector};
use super::{Failure, usage};
use crate::render::{AreaLight, KeyLight, Lighting, SUN_ANGLE_DEG, Shadows, Sky, Sun};

/// Flags about light and shadow.
#[derive(Args)]
pub struct LightFlags {
    /// The strongest light
    #[arg(long, default_value = "sun")]
    pub light: KeyName,
    /// Direction towards the sun, world axes [default: half way up, from the left of the view without --camera]
    #[arg(long, value_parser = parse_vector, value_name = "X,Y,Z", allow_hyphen_values = true)]
    sun: Option<[f64; 3]>,
    /// Angle across the sun, degrees: the wider, the softer its shadows; 0 for hard ones [default: 0.53]
    #[arg(long, value_name = "DEG")]
    sun_angle: Option<f64>,
    /// The light from above: plain, none, or occluded by what is near (ambient occlusion) [default: plain]
    #[arg(long)]
    pub sky: Option<SkyName>,
    /// How far away things occlude the sky, such as 5m [default: any distance]
    #[arg(long, value_name = "LENGTH", value_parser = parse_length)]
    sky_reach: Option<Length>,
    /// Shining rectangles or parallelograms: a JSON list of {"corner":[x,y,z],"edge_u":[x,y,z],"edge_v":[x,y,z],"radiance":[r,g,b]}
    #[arg(long, value_name = "AREAS.json")]
    pub areas: Option<PathBuf>,
    /// A little light from the eye and the side, so that shapes in the shade keep their form, 0 to 1 [default: 1 with a sun]
    #[arg(long, value_name = "SHARE")]
    fill: Option<f64>,
    /// How shadows are found [default: hybrid; walk: none, or voxel under an occluded sky]
    #[arg(long)]
    shadows: Option<ShadowName>,
    /// With --shadows hybrid: by how much of its width a penumbra may be wrong, 0 to 1 [default: 0.03125]
    #[arg(long, value_name = "SHARE")]
    shadow_tolerance: Option<f64>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub enum KeyName {
    Headlight,
    Sun,
    None,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub enum SkyName {
    Plain,
    Occluded,
    None,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum ShadowName {
    None,
    /// Voxels only: quickest
    Voxel,
    /// Voxels far away, triangles where it matters
    Hybrid,
    /// Triangles only
    Exact,
}

/// A rectangle as a file has it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AreaFile {
    corner: [f64; 3],
    edge_u: [f64; 3],
    edge_v: [f64; 3],
    radiance: [f64; 3],
}

impl LightFlags {
    /// Refuses what does not go together.
    pub fn check(&self) -> Result<(), Failure> {
        let no_sun = self.sun.is_some() || self.sun_angle.is_some();
        if self.light != KeyName::Sun && no_sun {
            return Err(usage("--sun and --sun-angle are about the sun: leave them out, or use --light sun"));
        }
        let shadowy = self.shadows.is_some()
            || self.shadow_tolerance.is_some()
            || self.sky.is_some()
            || self.areas.is_some()
            || self.fill.is_some();
        if self.light == KeyName::Headlight && shadowy {
            return Err(usage(
                "a headlight is all the light there is, and casts no shadows: leave out --shadows, --shadow-tolerance, --sky, \
                        --areas and --fill, or use --light sun or none",
            ));
        }
        let is_dark = self.light == KeyName::None && self.sky == Some(SkyName::None) && self.areas.is_none();
        if is_dark {
            return Err(usage("nothing shines: add --areas, or leave out --light none or --sky none"));
        }
        if self.sky_reach.is_some() && self.sky != Some(SkyName::Occluded) {
            return Err(usage("--sky-reach is about --sky occluded"));
        }
        if self.shadow_tolerance.is_some() && !matches!(self.shadows, Some(ShadowName::Hybrid) | None) {
            return Err(usage("--shadow-tolerance is about --shadows hybrid"));
        }
        if self.shadows == Some(ShadowName::None) && self.sky == Some(SkyName::Occluded) {
            return Err(usage("--shadows none leaves nothing that occludes the sky: leave one of them out"));
        }
        Ok(())
    }

    /// Refuses what the GPU does not do; do voxels cast shadows?
    pub fn check_for_gpu(&self) -> Result<bool, Failure> {
        self.check()?;
        if self.areas.is_some() {
            return Err(usage("--areas are not drawn on the GPU: use render"));
        }
        if self.shadow_tolerance.is_some() {
            return Err(usage("--shadow-tolerance is about --shadows hybrid, which the GPU does not do"));
        }
        let is_occluded = self.sky == Some(SkyName::Occluded);
        match self.shadows {
            Some(ShadowName::Voxel) => Ok(true),
            None if is_occluded => Ok(true),
            Some(ShadowName::None) | None => Ok(false),
            Some(ShadowName::Hybrid | ShadowName::Exact) => {
                Err(usage("on the GPU shadows are cast by voxels: --shadows voxel or none"))
            }
        }
    }

    /// The light; lengths are in model units.
    pub fn lighting(&self, up: DVec3, metres_per_unit: f64) -> Result<Lighting, Failure> {
        let key = match self.light {
            KeyName::Headlight => return Ok(Lighting::headlight()),
            KeyName::None => KeyLight::None,
            KeyName::Sun => KeyLight::Sun(Sun {
                direction: self.sun.map_or_else(|| Sun::default_direction(up), DVec3::from),
                angle_deg: self.sun_angle.unwrap_or(SUN_ANGLE_DEG),
            }),
        };
        let sky = match self.sky {
            Some(SkyName::Plain) | None => Sky::Plain,
            Some(SkyName::None) => Sky::None,
            Some(SkyName::Occluded) => Sky::Occluded {
                reach: self.sky_reach.map_or(f64::INFINITY, |length| length.in_units(metres_per_unit)),
            },
        };
        let areas = self.areas.as_deref().map(read_areas).transpose()?.unwrap_or_default();
        let fill = self.fill.unwrap_or(if self.light == KeyName::Sun { 1.0 } else { 0.0 });
        Ok(Lighting { key, sky, areas, fill })
    }

    pub fn shadows(&self) -> Shadows {
        match self.shadows {
            Some(ShadowName::None) => Shadows::None,
            Some(ShadowName::Voxel) => Shadows::Voxel,
            Some(ShadowName::Exact) => Shadows::Exact,
            Some(ShadowName::Hybrid) | None => match self.shadow_tolerance {
                Some(tolerance) => Shadows::Hybrid { tolerance },
                None => Shadows::HYBRID,
            },
        }
    }
}

fn read_areas(path: &Path) -> Result<Vec<AreaLight>, Failure> {
    const EXAMPLE: &str = r#"[{"corner":[0,0,3],"edge_u":[1,0,0],"edge_v":[0,-1,0],"radiance":[8,8,8]}]"#;
    let told = |what: String| -> Failure {
        format!("{}: {what}; expected a list such as {EXAMPLE}", path.display()).into()
    };
    let text =
        std::fs::read_to_string(path).map_err(|e| format!("{}: cannot be read: {e}", path.display()))?;
    let areas: Vec<AreaFile> = serde_json::from_str(&text).map_err(|error| told(error.to_string()))?;
    let area = |(number, area): (usize, AreaFile)| {
        let AreaFile { corner, edge_u, edge_v, radiance } = area;
        let light = AreaLight {
            corner: corner.into(),
            edge_u: edge_u.into(),
            edge_v: edge_v.into(),
            radiance: radiance.into(),
        };
        let across = light.edge_u.cross(light.edge_v);
        if !(across.is_finite() && across.length() > 0.0 && light.corner.is_finite()) {
            return Err(told(format!("rectangle {number} has no area")));
        }
        if !(light.radiance.is_finite() && light.radiance.min_element() >= 0.0) {
            return Err(told(format!(
                "rectangle {number} shines with {radiance:?}; expected numbers of 0 and more"
            )));
        }
        Ok(light)
    };
    if areas.is_empty() {
        return Err(told("there is no rectangle in it".into()));
    }
    areas.into_iter().enumerate().map(area).collect()
}
