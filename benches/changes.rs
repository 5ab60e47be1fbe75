//! What a change of many parts costs: the document's own bookkeeping, and the hierarchies that are made for it.
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
use std::time::Instant;

use glam::{DAffine3, DVec3};
use voxsight::moved::Motions;
use voxsight::sample::{PlantSettings, plant};
use voxsight::viewer::document::Document;

/// Of so many runs the median is told.
const RUNS: usize = 5;

fn median(mut run: impl FnMut(usize) -> f64) -> f64 {
    let mut all: Vec<f64> = (0..RUNS).map(&mut run).collect();
    all.sort_by(f64::total_cmp);
    all[RUNS / 2]
}

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
    println!("| parts | change ms | middle ms | shown ms |\n| --- | --- | --- | --- |");
    for parts in [1, 100, 10_000, 100_000, count] {
        let mut document = Document::new(Arc::clone(&scene));
        document.select(0..parts.min(count));
        let objects = document.selected().clone();
        let mut times = [const { Vec::new() }; 3];
        let _ = median(|run| {
            let motion = DAffine3::from_translation(DVec3::X * (run + 1) as f64);
            let mut next =
                |index: usize, started: Instant| times[index].push(started.elapsed().as_secs_f64() * 1e3);
            let started = Instant::now();
            document.drag_by("Move", &objects, &Motions::new(), motion);
            next(0, started);
            let started = Instant::now();
            assert!(document.middle_of_selection().is_some());
            next(1, started);
            let started = Instant::now();
            assert!(document.shown().moved().is_some());
            next(2, started);
            0.0
        });
        let [change, middle, shown] = times.map(|mut all| {
            all.sort_by(f64::total_cmp);
            all[all.len() / 2]
        });
        println!("| {parts} | {change:.2} | {middle:.2} | {shown:.1} |");
    }
}
