//! Walks through a scene and picks what is in the middle of the picture, without a window.
//!
//! `cargo run --release --example cad_walkthrough -- scene.vxs`

use std::error::Error;
use std::sync::Arc;

use glam::{DVec3, UVec2};
use voxsight::camera::Camera;
use voxsight::gpu::marks::Marks;
use voxsight::gpu::{Context, ContextSettings};
use voxsight::loaded::LoadedScene;
use voxsight::progress::Silent;
use voxsight::render::Lighting;
use voxsight::scene::Scene;
use voxsight::viewer::pick::refine;
use voxsight::walkthrough::{Look, WalkSettings, Walkthrough};

const SIZE: (u32, u32) = (640, 400);
const FRAMES: u32 = 60;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: cad_walkthrough SCENE.vxs")?;
    let scene = Arc::new(LoadedScene::new(Scene::open(path)?, &Silent)?);
    let context = Context::new(&ContextSettings::default())?;
    let mut walk = Walkthrough::new(Arc::clone(&scene), &context, WalkSettings::default())?;

    let meta = scene.scene().meta();
    let (min, max) = (DVec3::from(meta.bounds.min), DVec3::from(meta.bounds.max));
    let (centre, up) = (0.5 * (min + max), meta.settings.up.unit());
    let around = Camera::around(min, max, DVec3::new(1.0, 0.7, 0.6), up, SIZE.0, SIZE.1);
    let (lighting, marks) = (Lighting::headlight(), Marks::default());
    let look = Look { lighting: &lighting, up, marks: &marks, shadows: None, caps: false };
    let mut camera = around;
    for frame in 0..FRAMES {
        // From outside to the middle. The first frame is a jump: nothing is known yet.
        let share = 0.9 * f64::from(frame) / f64::from(FRAMES);
        camera.eye = DVec3::from(around.eye).lerp(centre, share).into();
        let record = walk.frame(&camera, frame == 0, None, &look)?;
        if frame % 20 == 0 {
            println!("frame {frame}: {} drawables, {} triangles", record.drawn, record.triangles);
        }
    }

    // What the middle pixel shows, and the exact point of it.
    let drawables: Vec<u32> = walk.renderer().targets().drawable.read(&context)?;
    let middle = UVec2::new(SIZE.0 / 2, SIZE.1 / 2);
    let drawable = drawables[(middle.y * SIZE.0 + middle.x) as usize];
    let Some(picked) = refine(&scene.query(), &camera.rays()?, middle, drawable, None) else {
        println!("there is nothing in the middle");
        return Ok(());
    };
    let object = &scene.scene().objects()[scene.scene().drawable_object(drawable) as usize];
    println!("{} at {}, {:.3} away", scene.scene().node_path(object.node), picked.point, picked.distance);
    Ok(())
}
