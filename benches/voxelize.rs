//! The voxel core alone: triangles in, DAG and owners out. The sample plant, or a model, at one or more resolutions:
//! time, rates, sizes. The first result is checked by validation before anything is timed.
//!
//! `cargo bench --bench voxelize -- [--objects 45000] [--triangles 12000000] [--model FILE] [--runs 3] [LOG2 ...]`
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

use std::time::Instant;

use glam::{DAffine3, DVec3};
use voxsight::import::{ImportOptions, import};
use voxsight::model::Model;
use voxsight::progress::Silent;
use voxsight::sample::{PlantSettings, plant};
use voxsight_voxel::dag::owners::OwnersIndex;
use voxsight_voxel::dag::{DagRef, OwnersRef};
use voxsight_voxel::grid::Grid;
use voxsight_voxel::voxelize::{Drawables, Settings, SnappedMesh, voxelize_into};

/// Objects as drawables, straight from the model.
struct Placed<'a> {
    grid: Grid,
    model: &'a Model,
}

impl Drawables for Placed<'_> {
    fn count(&self) -> u32 {
        self.model.objects.len() as u32
    }

    fn load(&self, drawable: u32, mesh: &mut SnappedMesh) {
        let object = &self.model.objects[drawable as usize];
        let part = &self.model.parts[object.part as usize].mesh;
        let scale = DAffine3::from_scale(DVec3::splat(self.grid.voxel_size.recip()));
        let grid_from_part = scale * DAffine3::from_translation(-self.grid.origin) * object.world_from_part;
        mesh.vertices.clear();
        mesh.vertices
            .extend(part.positions.iter().map(|&p| self.grid.snap(grid_from_part.transform_point3(p))));
        mesh.triangles.clear();
        mesh.triangles.extend_from_slice(&part.triangles);
    }
}

fn bounds(model: &Model) -> (DVec3, DVec3) {
    let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for object in &model.objects {
        for &p in &model.parts[object.part as usize].mesh.positions {
            let world = object.world_from_part.transform_point3(p);
            bounds = (bounds.0.min(world), bounds.1.max(world));
        }
    }
    bounds
}

fn main() {
    let mut settings = PlantSettings { objects: 45_000, triangles: 12_000_000, seed: 1 };
    let (mut runs, mut file, mut resolutions) = (3, None, Vec::new());
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--objects" => settings.objects = args.next().unwrap().parse().unwrap(),
            "--triangles" => settings.triangles = args.next().unwrap().parse().unwrap(),
            "--model" => file = args.next(),
            "--runs" => runs = args.next().unwrap().parse().unwrap(),
            log2 => resolutions.push(log2.parse::<u32>().unwrap()),
        }
    }
    if resolutions.is_empty() {
        resolutions.push(13);
    }
    let model = match file {
        Some(file) => import(&[file.into()], &ImportOptions::default(), &Silent).unwrap().model,
        None => plant(&settings),
    };
    let (min, max) = bounds(&model);
    let triangles = model.placed_triangles() as f64;
    for log2 in resolutions {
        let grid = Grid::around(min, max, log2).unwrap();
        let drawables = Placed { grid, model: &model };
        let mut times = Vec::new();
        for run in 0..runs {
            let started = Instant::now();
            let mut pages = Vec::new();
            let voxels = voxelize_into(&grid, &drawables, &Settings::default(), &mut pages).unwrap();
            times.push(started.elapsed().as_secs_f64());
            if run > 0 {
                continue;
            }
            let (dag, directory) = (&voxels.dag, &voxels.owner_directory);
            let (view, s) = DagRef::validate(&dag.shape, &dag.words, &dag.counts, &dag.leaves).unwrap();
            let index = OwnersIndex::validate(directory, &pages, s.bricks, drawables.count()).unwrap();
            OwnersRef::new(directory, &pages, &index).check_masks(&view).unwrap();
            let owner_bytes = (size_of_val(&directory[..]) + size_of_val(&pages[..])) as f64;
            println!(
                "2^{log2}: {:.1} M voxels in {:.2} M bricks; {} leaves, {} nodes: {:.3} bits/voxel; counts {:.1} MB; \
                 owners {:.1} MB in {} pages: {:.2} B/brick; {} tasks loaded {:.2} times the triangles",
                s.voxels as f64 / 1e6,
                s.bricks as f64 / 1e6,
                s.distinct_leaves,
                s.nodes,
                8.0 * s.traversal_bytes as f64 / s.voxels as f64,
                s.count_bytes as f64 / 1e6,
                owner_bytes / 1e6,
                directory.len(),
                owner_bytes / s.bricks as f64,
                voxels.cost.tasks,
                voxels.cost.loaded_triangles as f64 / triangles,
            );
        }
        times.sort_by(f64::total_cmp);
        let seconds = times[times.len() / 2];
        println!("2^{log2}: {seconds:.2} s ({times:.2?}), {:.2} M triangles/s", triangles / seconds / 1e6);
    }
}
