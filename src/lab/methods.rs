//! What can be compared: one line a method.

use std::fmt;
use std::sync::Arc;

use serde::Serialize;

use crate::loaded::LoadedScene;
use crate::occlusion::OcclusionScene;
use crate::occlusion::hzb::{Hzb, HzbSettings};
use crate::occlusion::hzm::{Hzm, HzmSettings};
use crate::visibility::coherent::CoherentQuery;
use crate::visibility::culling::{Culling, FreshQuery};
use crate::visibility::{Method, QuerySettings, RayMethod, RaysPerPixel};

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
    /// It keeps what earlier frames found.
    pub keeps_state: bool,
    make: Make,
}

/// Makes a method for a scene.
type Make = fn(&LoadedScene, RaysPerPixel) -> Box<dyn Culling>;

/// Every method. Adding one is a line here.
#[rustfmt::skip]
pub static METHODS: &[MethodKind] = &[
    MethodKind { name: "frustum", about: "boxes against the view pyramid, no occlusion", takes_rays: false, uses_voxels: false, keeps_state: false, make: |_, _| fresh(Method::Frustum, RaysPerPixel::ONE, false) },
    MethodKind { name: "voxel", about: "the first occupied voxel along each ray wins", takes_rays: true, uses_voxels: true, keeps_state: false, make: |_, rays| fresh(Method::Voxel, rays, false) },
    MethodKind { name: "hybrid", about: "voxels propose, their triangles decide", takes_rays: true, uses_voxels: true, keeps_state: false, make: |_, rays| fresh(Method::Hybrid, rays, false) },
    MethodKind { name: "adaptive", about: "hybrid, whose rays beyond the first a pixel (beyond a quarter of fewer) go where drawables change", takes_rays: true, uses_voxels: true, keeps_state: false, make: |_, rays| fresh(Method::Hybrid, rays, true) },
    MethodKind { name: "coherent", about: "hybrid, which keeps what earlier frames found", takes_rays: true, uses_voxels: true, keeps_state: true, make: |_, rays| coherent(RayMethod::Hybrid, rays) },
    MethodKind { name: "coherent-voxel", about: "voxel, which keeps what earlier frames found", takes_rays: true, uses_voxels: true, keeps_state: true, make: |_, rays| coherent(RayMethod::Voxel, rays) },
    MethodKind { name: "hzm", about: "boxes against the depth of a few good occluders (Peng and Cao 2013)", takes_rays: false, uses_voxels: false, keeps_state: false, make: hzm },
    MethodKind { name: "hzb", about: "boxes against the depth of what the last frame saw, in two passes", takes_rays: false, uses_voxels: false, keeps_state: true, make: hzb },
    MethodKind { name: "exact", about: "rays against all triangles", takes_rays: true, uses_voxels: false, keeps_state: false, make: |_, rays| fresh(Method::Exact, rays, false) },
];

/// The method that is the sampling floor: the truth at the same rays.
pub const FLOOR: &str = "exact";

fn hzm(scene: &LoadedScene, _: RaysPerPixel) -> Box<dyn Culling> {
    let exact = scene.query().exact;
    Box::new(Hzm::new(Arc::new(OcclusionScene::new(exact)), exact, HzmSettings::default()))
}

fn hzb(scene: &LoadedScene, _: RaysPerPixel) -> Box<dyn Culling> {
    Box::new(Hzb::new(Arc::new(OcclusionScene::new(scene.query().exact)), HzbSettings::default()))
}

fn fresh(method: Method, rays: RaysPerPixel, adaptive: bool) -> Box<dyn Culling> {
    let settings = QuerySettings { rays_per_pixel: rays, adaptive, ..QuerySettings::default() };
    Box::new(FreshQuery { method, settings })
}

fn coherent(method: RayMethod, rays: RaysPerPixel) -> Box<dyn Culling> {
    Box::new(CoherentQuery::of(method, rays))
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
    pub fn make(&self, scene: &LoadedScene, rays: RaysPerPixel) -> Box<dyn Culling> {
        (self.make)(scene, rays)
    }

    /// What [`MethodKind::make`] makes, for tables.
    pub fn variant(&self, scene: &LoadedScene, rays: RaysPerPixel) -> Variant {
        Variant {
            method: self.name.to_owned(),
            rays_per_pixel: self.takes_rays.then_some(rays),
            resolution: self.uses_voxels.then(|| scene.scene().grid().side()),
            keeps_state: self.keeps_state,
        }
    }
}

/// Why there is no such method.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MethodError {
    /// No method of this name.
    #[error("there is no method \"{0}\"; there are {names}", names = METHODS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", "))]
    Unknown(String),
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
    /// It keeps what earlier frames found.
    pub keeps_state: bool,
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
    fn every_method_has_a_name_of_its_own() {
        for kind in METHODS {
            assert!(std::ptr::eq(MethodKind::named(kind.name).unwrap(), kind), "{}", kind.name);
        }
        let error = MethodKind::named("magic").err().unwrap().to_string();
        assert!(error.contains("magic") && error.contains("hybrid"), "{error}");
    }
}
