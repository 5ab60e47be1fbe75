//! What can be compared: one line a method.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::loaded::LoadedScene;
use crate::visibility::culling::{Culling, FreshQuery};
use crate::visibility::{Method, QuerySettings};

/// A kind of culling and how to make one.
pub struct MethodKind {
    /// Name in arguments, tables and files.
    pub name: &'static str,
    /// For people: how it finds what is visible.
    pub about: &'static str,
    /// Rays per pixel are a parameter of it.
    pub takes_rays: bool,
    /// The voxels' resolution is a parameter of it.
    pub uses_voxels: bool,
    make: fn(&LoadedScene, RaysPerPixel) -> Made,
}

/// A method that is ready, or why there is none.
type Made = Result<Box<dyn Culling>, MethodError>;

/// Every method. Adding one is a line here.
#[rustfmt::skip]
pub const METHODS: &[MethodKind] = &[
    MethodKind { name: "frustum", about: "boxes against the view pyramid, no occlusion", takes_rays: false, uses_voxels: false, make: |_, _| fresh(Method::Frustum, RaysPerPixel::ONE) },
    MethodKind { name: "voxel", about: "the first occupied voxel along each ray wins", takes_rays: true, uses_voxels: true, make: |_, rays| fresh(Method::Voxel, rays) },
    MethodKind { name: "hybrid", about: "voxels propose, their triangles decide", takes_rays: true, uses_voxels: true, make: |_, rays| fresh(Method::Hybrid, rays) },
    MethodKind { name: "exact", about: "rays against all triangles", takes_rays: true, uses_voxels: false, make: |_, rays| fresh(Method::Exact, rays) },
];

/// The method that is the sampling floor: the truth at the same rays.
pub const FLOOR: &str = "exact";

fn fresh(method: Method, rays: RaysPerPixel) -> Made {
    let rays_per_pixel = rays.whole().ok_or(MethodError::BelowOne(rays))?;
    let settings = QuerySettings { rays_per_pixel, ..QuerySettings::default() };
    Ok(Box::new(FreshQuery { method, settings }))
}

impl MethodKind {
    /// The method of a name.
    ///
    /// # Errors
    ///
    /// There is none; the error lists those that there are.
    pub fn named(name: &str) -> Result<&'static Self, MethodError> {
        METHODS.iter().find(|kind| kind.name == name).ok_or_else(|| MethodError::Unknown(name.to_owned()))
    }

    /// Makes one for a scene. Rays per pixel do not matter where the method takes none.
    ///
    /// # Errors
    ///
    /// It cannot work with so few rays.
    pub fn make(&self, scene: &LoadedScene, rays: RaysPerPixel) -> Result<Box<dyn Culling>, MethodError> {
        (self.make)(scene, rays)
    }
}

/// Why there is no such method.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MethodError {
    /// No method of this name.
    #[error("there is no method \"{0}\"; there are {names}", names = METHODS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", "))]
    Unknown(String),
    /// Less than a ray per pixel needs coherence over frames.
    #[error(
        "{0} rays per pixel: below 1 needs coherence over frames, which no method has yet; use 1 or more"
    )]
    BelowOne(RaysPerPixel),
}

/// Rays per pixel: N rays a pixel, or one ray every N pixels (`1/N`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RaysPerPixel {
    rays: u32,
    /// 1 unless `rays` is.
    pixels: u32,
}

impl RaysPerPixel {
    /// One.
    pub const ONE: Self = RaysPerPixel { rays: 1, pixels: 1 };
    /// As many as any command takes.
    const MOST: u32 = 65_536;

    /// As a number.
    pub fn get(self) -> f64 {
        f64::from(self.rays) / f64::from(self.pixels)
    }

    /// As a whole number; `None` below 1.
    pub fn whole(self) -> Option<u32> {
        (self.pixels == 1).then_some(self.rays)
    }
}

impl FromStr for RaysPerPixel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (rays, pixels) = text.trim().split_once('/').unwrap_or((text.trim(), "1"));
        match (rays.trim().parse(), pixels.trim().parse()) {
            (Ok(rays), Ok(1)) if (1..=Self::MOST).contains(&rays) => Ok(RaysPerPixel { rays, pixels: 1 }),
            (Ok(1), Ok(pixels)) if (1..=Self::MOST).contains(&pixels) => Ok(RaysPerPixel { rays: 1, pixels }),
            _ => Err(format!("expected rays per pixel such as 4, 1 or 1/16, found \"{text}\"")),
        }
    }
}

impl fmt::Display for RaysPerPixel {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        if self.pixels == 1 { write!(to, "{}", self.rays) } else { write!(to, "1/{}", self.pixels) }
    }
}

impl Serialize for RaysPerPixel {
    /// As a number, for programs that plot.
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_f64(self.get())
    }
}

/// A method with its parameters: a point of a curve.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Variant {
    /// [`Culling::name`].
    pub method: String,
    /// `None` where the method takes none.
    pub rays_per_pixel: Option<RaysPerPixel>,
    /// Voxels a side; `None` where the method does not use them.
    pub resolution: Option<u32>,
}

impl Variant {
    /// The method with its resolution: one curve of a plot.
    pub fn curve(&self) -> String {
        match self.resolution {
            Some(resolution) => format!("{} {resolution}\u{b3}", self.method),
            None => self.method.clone(),
        }
    }
}

impl fmt::Display for Variant {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        write!(to, "{}", self.curve())?;
        match self.rays_per_pixel {
            Some(rays) => write!(to, ", {rays} {}", if rays.get() > 1.0 { "rays/px" } else { "ray/px" }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_per_pixel_are_whole_or_a_fraction_of_one() {
        for (text, value, shown) in
            [("4", 4.0, "4"), (" 1/16 ", 0.0625, "1/16"), ("1/1", 1.0, "1"), ("65536", 65536.0, "65536")]
        {
            let rays: RaysPerPixel = text.parse().unwrap();
            assert_eq!((rays.get(), rays.to_string().as_str()), (value, shown), "{text}");
        }
        for bad in ["0", "1/0", "-1", "3/4", "0.5", "1/", "", "65537", "1/65537", "many"] {
            assert!(bad.parse::<RaysPerPixel>().unwrap_err().contains("1/16"), "{bad}");
        }
    }

    #[test]
    fn every_method_has_a_name_of_its_own() {
        for kind in METHODS {
            assert!(std::ptr::eq(MethodKind::named(kind.name).unwrap(), kind), "{}", kind.name);
        }
        let error = MethodKind::named("magic").err().unwrap().to_string();
        assert!(error.contains("magic") && error.contains("hybrid"), "{error}");
    }
}
