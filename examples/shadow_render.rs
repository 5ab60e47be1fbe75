//! The library way to a picture with soft shadows: a sun, a sky that is occluded by what is near, and what it took.
//!
//! `cargo run --release --example shadow_render -- SCENE.vxs OUT.png`

use std::error::Error;

use glam::DVec3;
use voxsight::camera::Camera;
use voxsight::loaded::LoadedScene;
use voxsight::progress::Silent;
use voxsight::render::{KeyLight, LightKind, Lighting, RenderSettings, Renderer, Shadows, Sky, Sun};
use voxsight::scene::Scene;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args_os().skip(1);
    let (Some(file), Some(output)) = (args.next(), args.next()) else {
        return Err("usage: shadow_render SCENE.vxs OUT.png".into());
    };
    let scene = LoadedScene::new(Scene::open(file)?, &Silent)?;
    let meta = scene.scene().meta();
    let (min, max, up) =
        (DVec3::from(meta.bounds.min), DVec3::from(meta.bounds.max), meta.settings.up.unit());
    let side = up.any_orthonormal_vector();
    let camera = Camera::around(min, max, up + side, up, 800, 600).rays()?;

    // A sun five degrees wide, and a sky that whatever is within a tenth of the model takes away.
    let sun = Sun { direction: 2.0 * up + side + up.cross(side), angle_deg: 5.0 };
    let sky = Sky::Occluded { reach: 0.1 * (max - min).length() };
    let settings = RenderSettings {
        samples_per_pixel: 16,
        lighting: Lighting { key: KeyLight::Sun(sun), sky, areas: Vec::new(), fill: 1.0 },
        shadows: Shadows::HYBRID,
        up,
        seed: 0,
    };
    let picture = scene.picture();
    let renderer = Renderer::new(&picture, &camera, &settings);
    let (film, cost) = renderer.rows(0..600, &Silent).ok_or("stopped")?;
    film.to_rgb8().save(output)?;
    for kind in [LightKind::Sun, LightKind::Sky] {
        println!(
            "{kind:?}: {} shadow rays in {:?} of all threads",
            cost.rays[kind as usize], cost.time[kind as usize]
        );
    }
    Ok(())
}
