//! The voxel core alone: triangles in, DAG and owners out. The sample plant, or a model, at one or more resolutions:
//! time, rates, sizes. Before anything is timed, a result is checked: by validation, against a build with other settings,
//! and at samples against the overlap test of single voxels.
//!
//! `cargo bench --bench voxelize -- [--objects 45000] [--triangles 12000000] [--model FILE] [--runs 3] [LOG2 ...]`
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

use std::hint::black_box;
use std::time::Instant;

use glam::{DAffine3, DVec3};
use voxsight::import::{ImportOptions, import};
use voxsight::model::Model;
use voxsight::progress::Silent;
use voxsight::sample::{PlantSettings, plant};
use voxsight_voxel::dag::owners::OwnersIndex;
use voxsight_voxel::dag::{DagRef, OwnersRef};
use voxsight_voxel::grid::Grid;
use voxsight_voxel::voxelize::overlap::TriangleOverlap;
use voxsight_voxel::voxelize::{Drawables, Settings, SnappedMesh, Streamed, voxelize_into};

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

fn build(drawables: &Placed, settings: &Settings) -> (Streamed, Vec<u64>) {
    let mut pages = Vec::new();
    let voxels = voxelize_into(&drawables.grid, drawables, settings, &mut pages).unwrap();
    (voxels, pages)
}

/// Stops at a wrong result; prints the sizes of a right one.
fn check_and_describe(drawables: &Placed) {
    let (voxels, pages) = build(drawables, &Settings::default());
    let (dag, directory) = (&voxels.dag, &voxels.owner_directory);
    // One task, but for dense cells, and smaller blocks.
    let whole = Settings { memory: None, task_triangles: u64::MAX, task_bricks: u64::MAX, block_height: 2 };
    let (other, other_pages) = build(drawables, &whole);
    assert!(*dag == other.dag, "settings change the DAG");
    assert!((directory, &pages) == (&other.owner_directory, &other_pages), "settings change the owners");
    drop((other, other_pages));

    let (view, s) = DagRef::validate(&dag.shape, &dag.words, &dag.counts, &dag.leaves).unwrap();
    let index = OwnersIndex::validate(directory, &pages, s.bricks, drawables.count()).unwrap();
    let owners = OwnersRef::new(directory, &pages, &index);
    owners.check_masks(&view).unwrap();
    check_samples(drawables, view, owners, s.bricks);

    let log2 = drawables.grid.log2;
    let triangles = drawables.model.placed_triangles() as f64;
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

/// Both ways: of sampled triangles, every voxel around a corner that they touch is theirs; of sampled voxels, every owner has a
/// triangle that touches them.
fn check_samples(drawables: &Placed, dag: DagRef, owners: OwnersRef, bricks: u64) {
    const SAMPLES: u64 = 2000;
    let mut random = oorandom::Rand64::new(1);
    let mut mesh = SnappedMesh::default();
    let corners = |mesh: &SnappedMesh, t: [u32; 3]| t.map(|corner| mesh.vertices[corner as usize]);
    let mut touched = 0;
    for sample in 0..SAMPLES {
        let drawable = random.rand_range(0..drawables.count().into()) as u32;
        drawables.load(drawable, &mut mesh);
        let Some(last) = (mesh.triangles.len() as u64).checked_sub(1) else { continue };
        let triangle = corners(&mesh, mesh.triangles[random.rand_range(0..last + 1) as usize]);
        let overlap = TriangleOverlap::new(triangle);
        for offset in 0..5 * 5 * 5 {
            let at = triangle[0].map(|c| c >> 8);
            let voxel = [at[0] + offset % 5 - 2, at[1] + offset / 5 % 5 - 2, at[2] + offset / 25 - 2];
            if voxel.iter().any(|&c| c < 0 || c >> dag.log2() > 0) || !overlap.touches_cell(voxel, 0) {
                continue;
            }
            touched += 1;
            let (ordinal, mask) = dag.brick_at(voxel).expect("no brick where a triangle is");
            let is_owner = owners.of_brick(ordinal, mask).of_voxel(bit_of(voxel)).any(|d| d == drawable);
            assert!(is_owner, "sample {sample}: {voxel:?} does not know drawable {drawable}");
        }
    }
    let every = bricks.div_ceil(SAMPLES).max(1);
    let mut owned = 0;
    dag.for_each_brick(|corner, ordinal, mask| {
        if ordinal % every != 0 {
            return;
        }
        let bit = mask.trailing_zeros();
        let voxel = [0, 2, 4].map(|shift| (bit >> shift & 3) as i32);
        let voxel = [0, 1, 2].map(|k| corner[k] + voxel[k]);
        for drawable in owners.of_brick(ordinal, mask).of_voxel(bit) {
            owned += 1;
            drawables.load(drawable, &mut mesh);
            let touches = |&t: &[u32; 3]| TriangleOverlap::new(corners(&mesh, t)).touches_cell(voxel, 0);
            assert!(mesh.triangles.iter().any(touches), "{voxel:?} is not touched by its owner {drawable}");
        }
    });
    assert!(touched > 0 && owned > 0, "nothing was checked");
}

/// A voxel's bit in its brick's mask.
fn bit_of(voxel: [i32; 3]) -> u32 {
    (voxel[0] & 3 | (voxel[1] & 3) << 2 | (voxel[2] & 3) << 4) as u32
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
        check_and_describe(&drawables);
        let mut times: Vec<f64> = (0..runs)
            .map(|_| {
                let started = Instant::now();
                black_box(build(&drawables, &Settings::default()));
                started.elapsed().as_secs_f64()
            })
            .collect();
        times.sort_by(f64::total_cmp);
        let seconds = times[times.len() / 2];
        println!("2^{log2}: {seconds:.2} s ({times:.2?}), {:.2} M triangles/s", triangles / seconds / 1e6);
    }
}
