//! Cameras around and inside a scene.

use glam::DVec3;
use voxsight::camera::{Camera, Projection};
use voxsight::loaded::LoadedScene;

/// Two around the scene's box, one inside it, one of parallel rays.
pub fn cameras(loaded: &LoadedScene, size: (u32, u32)) -> Vec<Camera> {
    let bounds = loaded.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let centre = min + 0.5 * (max - min);
    let outside = Camera::around(min, max, DVec3::new(0.7, 0.5, 0.9), DVec3::Y, size.0, size.1);
    let other_side = Camera::around(min, max, DVec3::new(-0.3, 0.2, -0.8), DVec3::Y, size.0, size.1);
    let near = DVec3::from(outside.eye).lerp(centre, 0.75);
    let inside =
        Camera { eye: near.into(), projection: Projection::Perspective { fov_y_deg: 75.0 }, ..outside };
    let parallel = Projection::Orthographic { height: 0.6 * (max - min).length() };
    vec![outside, other_side, inside, Camera { projection: parallel, ..outside }]
}

/// Those of [`cameras`], one of parallel rays amid the scene, and one inside of object 0 if that is a unit shape.
pub fn cameras_and_amid(loaded: &LoadedScene, size: (u32, u32)) -> Vec<Camera> {
    let mut cameras = cameras(loaded, size);
    let bounds = loaded.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let centre = min + 0.5 * (max - min);
    // Much lies behind the eye and across its plane.
    let amid = Camera { eye: (centre + 0.1 * (max - centre)).into(), ..cameras[3] };
    // The objects' transforms place unit shapes: a quarter of the way in is inside of boxes.
    let part = loaded.scene().world_from_part(0).transform_point3(DVec3::splat(0.25));
    let in_part = Camera { eye: part.into(), ..cameras[2] };
    cameras.extend([amid, in_part]);
    cameras
}
