//! A walk through the sample plant: visibility, levels of detail, streaming, as one; everything but the drawing.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use std::sync::Arc;
use std::time::{Duration, Instant};

use common::{build_model, load};
use voxsight::camera::{Camera, Projection};
use voxsight::lod::density::{self, DensitySettings};
use voxsight::lod::{Choice, ChunkLevels, Selection, System, candidates};
use voxsight::sample::{PlantSettings, plant};
use voxsight::scene::Scene;
use voxsight::streaming::{
    ContainerPages, Frame, Loader, PageLayout, Priority, StreamSettings, Streamer, page,
};
use voxsight::visibility::{Method, QuerySettings, query};

/// From outside, then, after a cut, along the rack.
fn camera(frame: u32) -> Camera {
    let up = [0.0, 1.0, 0.0];
    let (eye, target) = match frame {
        0..6 => ([-20.0 + f64::from(frame), 18.0, 50.0], [20.0, 3.0, 15.0]),
        _ => {
            let x = 1.6 + 0.1 * f64::from(frame - 6);
            ([x, 1.9, 15.2], [x + 12.8, 3.4, 17.0])
        }
    };
    let projection = Projection::Perspective { fov_y_deg: 60.0 };
    Camera { eye, target, up, projection, width: 256, height: 160 }
}

#[test]
fn a_walk_stays_in_its_budgets_misses_nothing_and_holds_the_geometry_of_the_file() {
    const TRIANGLES: u64 = 60_000;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plant.vxs");
    let settings = PlantSettings { objects: 2000, triangles: 300_000, ..PlantSettings::default() };
    build_model(plant(&settings), 9, &path);
    let loaded = load(&path);
    let scene = loaded.query();
    let pages = Arc::new(ContainerPages(Arc::new(Scene::open(&path).unwrap())));
    let loader = Loader::new(Arc::clone(&pages) as _, 2).unwrap();
    let levels = ChunkLevels::new(loaded.scene());
    let settings = StreamSettings { budget: 600_000, upload: 200_000, ..StreamSettings::default() };
    let mut memory = vec![0; settings.budget as usize];
    let mut streamer = Streamer::new(settings);
    let (mut last, mut coarser, mut finest): (Option<Selection>, u32, u32) = (None, 0, 0);
    let mut come = Vec::new();
    for frame in 0..36 {
        let rays = camera(frame).rays().unwrap();
        let seen = query(&scene, &rays, Method::Hybrid, &QuerySettings::default());
        let views = candidates(scene.exact, &rays, &seen);
        assert!(views.len() > 100, "frame {frame}: {}", views.len());
        let lod = DensitySettings { budget: TRIANGLES, ..DensitySettings::default() };
        let selection = density::select(&levels, &views, &lod, last.as_ref());
        assert!(selection.triangles <= TRIANGLES, "frame {frame}");
        assert_eq!(selection.choices.len(), views.len(), "frame {frame}");
        coarser += selection.choices.iter().filter(|choice| choice.level > 0).count() as u32;
        finest += selection.choices.iter().filter(|choice| choice.level == 0).count() as u32;
        let samples = |choice: &Choice| seen.samples[choice.drawable as usize];
        let wanted: Vec<Priority> =
            selection.choices.iter().map(|c| Priority { choice: *c, samples: samples(c) }).collect();
        let boxes = query(&scene, &rays, Method::Frustum, &QuerySettings::default());
        let in_frustum: Vec<u32> = (0..).zip(&boxes.visible).filter(|(_, v)| **v).map(|(d, _)| d).collect();
        let what = Frame { wanted: &wanted, in_frustum: &in_frustum, expected: &[] };
        let bytes_of = |page: u32| pages.bytes_of(page);
        let (report, requests) = streamer.frame(&levels, &what, &bytes_of, come.drain(..), &mut memory);
        loader.request(&requests);
        // A loader that is always done before the next frame.
        let started = Instant::now();
        while !loader.is_idle() {
            come.extend(loader.fetch());
            assert!(started.elapsed() < Duration::from_secs(60), "the loader hangs");
            std::thread::yield_now();
        }
        assert!(report.failed.is_empty());
        assert!(report.resident <= settings.budget && report.written <= settings.upload, "frame {frame}");
        let is_cut = frame < 3 || (6..9).contains(&frame);
        assert!(is_cut || report.missing == 0, "frame {frame}: {} missing", report.missing);
        for choice in &report.drawn {
            let number = levels.level(choice.drawable, choice.level).page;
            let layout = PageLayout::of(&loaded.scene().levels()[number as usize]);
            let at = streamer.offset_of(number).unwrap() as usize;
            let held = page::decode(&layout, &memory[at..at + layout.bytes as usize]);
            assert_eq!(
                held,
                Some(loaded.scene().level_mesh(number).unwrap()),
                "frame {frame}, page {number}"
            );
        }
        last = Some(selection);
    }
    assert!(coarser > 1000 && finest > 100, "{coarser} {finest}");
    let levels_of = |drawable: u32| (0..levels.level_count(drawable)).map(move |level| (drawable, level));
    for (drawable, level) in (0..levels.drawable_count()).flat_map(levels_of) {
        // What selection relies on.
        let found = levels.level(drawable, level);
        let next = (level + 1 < levels.level_count(drawable)).then(|| levels.level(drawable, level + 1));
        assert!(level > 0 || found.error == 0.0);
        assert!(next.is_none_or(|next| next.triangles <= found.triangles && next.error >= found.error));
    }
}
