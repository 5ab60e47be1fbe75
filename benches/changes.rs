//! What a drag of many parts costs at each move of the mouse: the document's own bookkeeping, what the window waits for, and when the
//! scene is shown as it then is.
//!
//! `cargo bench --bench changes -- [SCENE.vxs]`; without a scene: a sample plant of 200,000 objects.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "../tests/common/mod.rs"]
mod common;

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{DAffine3, DVec3};
use voxsight::moved::Motions;
use voxsight::sample::{PlantSettings, plant};
use voxsight::shown::Shown;
use voxsight::viewer::document::Document;

/// Of so many runs the median is told.
const RUNS: usize = 5;

fn main() {
    let folder = tempfile::tempdir().unwrap();
    let path = std::env::args().skip(1).find(|arg| arg != "--bench").map_or_else(
        || {
            let path = folder.path().join("plant.vxs");
            let settings =
                PlantSettings { objects: 200_000, triangles: 20_000_000, ..PlantSettings::default() };
            common::build_model(plant(&settings), 12, &path);
            path
        },
        Into::into,
    );
    let scene = Arc::new(common::load(&path));
    let count = scene.scene().objects().len() as u32;
    println!(
        "| parts | change ms | window waits ms | shown after ms | made at once ms |\n| --- | --- | --- | --- | --- |"
    );
    for parts in [1, 100, 1000, 10_000, 100_000, count].map(|parts| parts.min(count)) {
        let mut document = Document::new(Arc::clone(&scene));
        document.select(0..parts);
        let objects = document.selected().clone();
        let mut times = [const { Vec::new() }; 4];
        for run in 0..RUNS {
            let motion = DAffine3::from_translation(DVec3::X * (run + 1) as f64);
            let milliseconds = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
            let started = Instant::now();
            document.drag_by("Move", &objects, &Motions::new(), motion);
            times[0].push(milliseconds(started));
            let started = Instant::now();
            let mut is_shown = document.shown_soon().1;
            times[1].push(milliseconds(started));
            while !is_shown {
                std::thread::sleep(Duration::from_micros(100));
                is_shown = document.shown_soon().1;
            }
            times[2].push(milliseconds(started));
            // The same on this thread: what the window would wait for.
            let (filter, motions) = (document.shown().filter().clone(), document.state().motions.clone());
            let started = Instant::now();
            assert!(
                Shown::new(Arc::clone(&scene), filter, motions)
                    .moved()
                    .is_some_and(|moved| !moved.drawables().is_empty())
            );
            times[3].push(milliseconds(started));
        }
        let [change, waits, after, at_once] = times.map(|mut all| {
            all.sort_by(f64::total_cmp);
            all[RUNS / 2]
        });
        println!("| {parts} | {change:.2} | {waits:.2} | {after:.1} | {at_once:.1} |");
    }
}
