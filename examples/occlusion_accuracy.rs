//! The library way to compare methods of culling: views inside a scene, a reference, both errors, what was lost.
//!
//! `cargo run --release --example occlusion_accuracy -- SCENE.vxs`

use std::error::Error;

use voxsight::lab::methods::MethodKind;
use voxsight::lab::report::{Report, ReportSettings};
use voxsight::lab::run::{Contestant, RunSettings, run};
use voxsight::lab::space::Space;
use voxsight::lab::views::{ViewSettings, random_views};
use voxsight::loaded::LoadedScene;
use voxsight::progress::Silent;
use voxsight::scene::Scene;
use voxsight::visibility::RaysPerPixel;

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args_os().nth(1).ok_or("usage: occlusion_accuracy SCENE.vxs")?;
    let scenes = [LoadedScene::new(Scene::open(file)?, &Silent)?];
    let [scene] = &scenes;

    let space = Space::new(scene.query(), scene.scene().meta());
    let (views, rejected) = random_views(&space, &ViewSettings { count: 10, seed: 1, size: (256, 256) })?;
    let mut contestants = Vec::new();
    for name in ["voxel", "hybrid", "exact"] {
        // Anything that implements `Culling` can take part.
        let kind = MethodKind::named(name)?;
        let (variant, culling) =
            (kind.variant(scene, RaysPerPixel::ONE), kind.make(scene, RaysPerPixel::ONE));
        contestants.push(Contestant { variant, scene, culling });
    }
    let settings = RunSettings::default();
    let outcome = run(scene, &views, &mut contestants, &settings, &Silent)?;

    let source = ReportSettings { views: "10 random views".into(), is_path: false, seed: 1, run: settings };
    let report = Report::new(&scenes, views, Some(rejected), source, &outcome);
    for method in &report.methods {
        let (lost, ms) = (100.0 * method.lost_pixels.mean, 1e3 * method.time.distribution.median);
        println!("{}: {ms:.1} ms a view, {lost:.4} % of the pixels lost", method.variant);
        for lost in method.lost.iter().take(3) {
            println!("  {:8.2} px in {} views: {}", lost.lost.pixels, lost.lost.views, lost.path);
        }
    }
    Ok(())
}
