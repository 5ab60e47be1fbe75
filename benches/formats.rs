//! Forms of the DAG side by side: bytes, bits a voxel and rays a second, so that the node format is chosen by
//! measurement. Every form is made from the scene's own DAG and walked by the same plain scalar walker; its voxels (every
//! one) and first hits (every ray) are compared with the library's before anything is timed.
//!
//! `cargo bench --bench formats -- [--size 512] [--runs 3] [--resolution-log2 12] [SCENE.vxs|MODEL..]`
//! Without scenes: the sample plant of a million triangles. Prints a Markdown table a scene.
//!
//! Least and most of four scenes (the plant at 2^12 and 2^13, a castle and a platform at 2^12), relative to ours:
//!
//! | format | bytes | scalar rays/s |
//! |---|---|---|
//! | 8-wide, 4^3 leaves | 0.79 to 0.89 | 1.08 to 1.23 |
//! | 8-wide, mirrored, 16/32-bit (SSVDAG) | 0.41 to 0.50 | 1.05 to 1.18 |
//! | 64-wide, mirrored | 0.86 to 0.91 | 0.96 to 0.97 |
//! | 64-wide, 16/32-bit pointers | 0.62 to 0.69 | 0.95 to 0.99 |
//! | 64-wide, mirrored, 16/32-bit | 0.56 to 0.61 | 0.92 to 0.97 |
//! | 64-wide, single leaves inline | 0.96 to 0.99 | 0.97 to 1.00 |
//!
//! Ours stays for now: the 64-bit masks are what SIMD rays need (the bench of rays). 16/32-bit pointers would take a third
//! off the DAG, which is the smaller part of a file at 8,192^3 and the larger one from 65,536^3 on; SIMD rays through
//! them were not measured.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "formats/coded.rs"]
mod coded;
#[path = "../tests/common/mod.rs"]
mod common;
#[path = "formats/inline.rs"]
mod inline;
#[path = "formats/narrow.rs"]
mod narrow;
#[path = "formats/tree.rs"]
mod tree;
#[path = "rays/views.rs"]
#[allow(
    dead_code,
    clippy::disallowed_methods,
    reason = "made for the bench of rays, which uses all of it; its points differ"
)]
mod views;
#[path = "formats/walk.rs"]
mod walk;
#[path = "formats/words.rs"]
mod words;

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use fearless_simd::Level;
use rayon::prelude::*;
use voxsight::sample::{PlantSettings, plant};
use voxsight::scene::Scene;
use voxsight_voxel::dag::DagRef;
use voxsight_voxel::raycast::GridRay;

use coded::Coded;
use inline::Inline;
use narrow::Narrow;
use tree::Tree;
use views::{TILE, views};
use walk::{Format, first_hit, for_each_leaf};
use words::Words;

struct Options {
    size: usize,
    runs: usize,
    log2: u32,
    scenes: Vec<PathBuf>,
}

fn options() -> Options {
    let mut options = Options { size: 512, runs: 3, log2: 12, scenes: Vec::new() };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().expect("a value");
        match arg.as_str() {
            "--bench" => {}
            "--size" => options.size = value().parse().unwrap(),
            "--runs" => options.runs = value().parse().unwrap(),
            "--resolution-log2" => options.log2 = value().parse().unwrap(),
            path => options.scenes.push(path.into()),
        }
    }
    assert!(options.size.is_multiple_of(TILE), "the size must be a multiple of {TILE}");
    options
}

fn main() {
    let options = options();
    let folder = tempfile::tempdir().unwrap();
    let built = folder.path().join("built.vxs");
    if options.scenes.is_empty() {
        let settings = PlantSettings { objects: 4_000, triangles: 1_000_000, ..PlantSettings::default() };
        common::build_model(plant(&settings), options.log2, &built);
        run(&options, "sample plant", &built);
    }
    for scene in &options.scenes {
        let is_built = scene.extension().is_some_and(|e| e == "vxs");
        if !is_built {
            common::build_file(scene, options.log2, &built);
        }
        let name = scene.file_stem().unwrap_or_default().to_string_lossy();
        run(&options, &name, if is_built { scene } else { &built });
    }
}

/// A format with its name, whatever its type.
trait Contender: Sync {
    fn name(&self) -> &str;
    fn nodes(&self) -> usize;
    fn bytes(&self) -> usize;
    /// Stops unless all voxels are those of the library's DAG.
    fn check_voxels(&self, dag: &DagRef, voxel_count: u64);
    fn first_hit(&self, log2: u32, ray: &GridRay) -> Option<[i32; 3]>;
    /// First hits of many rays, as a checksum.
    fn cast(&self, log2: u32, rays: &[GridRay]) -> u64;
}

struct Named<F> {
    name: &'static str,
    nodes: usize,
    format: F,
}

impl<F: Format> Contender for Named<F> {
    fn name(&self) -> &str {
        self.name
    }

    fn nodes(&self) -> usize {
        self.nodes
    }

    fn bytes(&self) -> usize {
        self.format.bytes()
    }

    fn check_voxels(&self, dag: &DagRef, voxel_count: u64) {
        let mut voxels = 0;
        for_each_leaf(&self.format, &mut |corner, mask| {
            let (_, mut expected) = dag.brick_at(corner).expect("a brick where the library has one");
            if F::LEAF == 1 {
                let bit = |k: usize| (corner[k] as u32 >> 1 & 1) << k;
                expected = tree::octant_of(expected, bit(0) | bit(1) | bit(2));
            }
            assert_eq!(mask, expected, "{} differs at {corner:?}", self.name);
            voxels += u64::from(mask.count_ones());
        });
        // No leaf is wrong and none comes twice: with as many voxels, none is missing.
        assert_eq!(voxels, voxel_count, "{} lacks voxels", self.name);
    }

    fn first_hit(&self, log2: u32, ray: &GridRay) -> Option<[i32; 3]> {
        first_hit(&self.format, log2, ray)
    }

    fn cast(&self, log2: u32, rays: &[GridRay]) -> u64 {
        // Scalar code, but bits are counted in one instruction where the processor can, as in the library.
        fearless_simd::dispatch!(Level::new(), simd => {
            let _ = simd;
            cast_all(&self.format, log2, rays)
        })
    }
}

#[inline(always)]
fn cast_all<F: Format>(format: &F, log2: u32, rays: &[GridRay]) -> u64 {
    let mut sum = 0;
    for ray in rays {
        if let Some(voxel) = first_hit(format, log2, ray) {
            sum += (voxel[0] ^ voxel[1] ^ voxel[2]) as u64;
        }
    }
    sum
}

/// Which of [`contenders`] is what the library has: all others are compared with it.
const OURS: usize = 2;

fn contenders(scene: &Scene) -> Vec<Box<dyn Contender>> {
    let wide = Tree::of_scene(scene);
    let (octree, voxels) = (wide.split(2), wide.split(1));
    let (wide_mirrored, octree_mirrored) = (wide.merge_mirrored(), octree.merge_mirrored());
    let mut all: Vec<Box<dyn Contender>> = Vec::new();
    macro_rules! add {
        ($name:expr, $format:ty, $tree:expr) => {
            let (name, nodes, format) = ($name, $tree.node_count(), <$format>::pack(&$tree));
            all.push(Box::new(Named { name, nodes, format }))
        };
    }
    add!("8-wide to the voxel", Words<1, 1, false>, voxels);
    add!("8-wide, 4^3 leaves", Words<1, 2, false>, octree);
    add!("64-wide, 4^3 leaves (ours)", Words<2, 2, false>, wide);
    add!("8-wide, mirrored", Words<1, 2, true>, octree_mirrored);
    add!("64-wide, mirrored", Words<2, 2, true>, wide_mirrored);
    add!("8-wide, 16/32-bit pointers", Coded<false>, octree);
    add!("8-wide, mirrored, 16/32-bit (SSVDAG)", Coded<true>, octree_mirrored);
    add!("64-wide, 16 or 32 bits a node", Narrow<false, false>, wide);
    add!("64-wide, 16/32-bit pointers", Narrow<true, false>, wide);
    add!("64-wide, mirrored, 16/32-bit", Narrow<true, true>, wide_mirrored);
    add!("64-wide, single leaves inline", Inline, wide);
    all
}

fn run(options: &Options, name: &str, path: &Path) {
    let scene = Scene::open(path).unwrap();
    let (dag, log2) = (scene.dag(), scene.grid().log2);
    let voxels = scene.meta().dag.voxel_count;
    let contenders = contenders(&scene);
    let container = scene.container();
    let stored = size_of_val(container.dag_nodes()) + size_of_val(container.dag_leaves());
    assert_eq!(contenders[OURS].bytes(), stored, "ours is not what the library stores");
    contenders.par_iter().for_each(|contender| contender.check_voxels(&dag, voxels));

    // rates[contender][view], Mrays/s; last the library's own scalar reference.
    let mut rates = vec![Vec::new(); contenders.len() + 1];
    let mut hit_shares = Vec::new();
    for view in views(&scene, options.size) {
        let tiles = view.camera.tiles();
        let rays: Vec<GridRay> = tiles.iter().flat_map(|&tile| view.camera.grid_rays(tile)).collect();
        let hits = check_rays(&dag, log2, &contenders, &rays);
        hit_shares.push(format!("{} {:.0} %", view.name, 100.0 * hits as f64 / rays.len() as f64));
        let mut seconds = vec![Vec::new(); rates.len()];
        // In turns, so that all share what the machine does meanwhile.
        for _ in 0..options.runs {
            for (contender, times) in contenders.iter().zip(&mut seconds) {
                times.push(time(|| contender.cast(log2, &rays)));
            }
            let reference = |ray| dag.first_hit(ray).map_or(0, |(voxel, _)| voxel[0] as u64);
            seconds[contenders.len()].push(time(|| rays.iter().map(reference).sum()));
        }
        for (rates, times) in rates.iter_mut().zip(seconds) {
            rates.push(rays.len() as f64 / median(times) / 1e6);
        }
    }

    let triangles = scene.meta().counts.placed_triangles;
    println!("\n### {name}, 2^{log2}: {triangles} triangles, {voxels} voxels\n");
    println!("Hits: {}.\n", hit_shares.join(", "));
    println!("| format | nodes | bytes | of ours | bits/voxel | Mrays/s | of ours | least to most |");
    println!("|---|--:|--:|--:|--:|--:|--:|--:|");
    for (contender, rate) in contenders.iter().zip(&rates) {
        let bytes = contender.bytes();
        let mut ratios: Vec<f64> = rate.iter().zip(&rates[OURS]).map(|(a, b)| a / b).collect();
        ratios.sort_by(f64::total_cmp);
        println!(
            "| {} | {} | {bytes} | {:.3} | {:.4} | {:.2} | {:.2} | {:.2} to {:.2} |",
            contender.name(),
            contender.nodes(),
            bytes as f64 / contenders[OURS].bytes() as f64,
            8.0 * bytes as f64 / voxels as f64,
            median(rate.clone()),
            median(ratios.clone()),
            ratios[0],
            ratios[ratios.len() - 1],
        );
    }
    println!("\nThe library's scalar reference: {:.2} Mrays/s.", median(rates.pop().unwrap()));
    println!(
        "Beside the format: {} bytes of brick counts, {} bytes of owners.",
        size_of_val(container.dag_counts()),
        size_of_val(container.owner_directory()) + size_of_val(container.owner_pages())
    );
}

/// First hits of all contenders, equal to the library's. Returns the hits.
fn check_rays(dag: &DagRef, log2: u32, contenders: &[Box<dyn Contender>], rays: &[GridRay]) -> usize {
    let is_hit = |ray: &&GridRay| {
        let expected = dag.first_hit(ray).map(|(voxel, _)| voxel);
        for contender in contenders {
            assert_eq!(contender.first_hit(log2, ray), expected, "{}: {ray:?}", contender.name());
        }
        expected.is_some()
    };
    rays.par_iter().filter(is_hit).count()
}

fn time(work: impl FnOnce() -> u64) -> f64 {
    let started = Instant::now();
    black_box(work());
    started.elapsed().as_secs_f64()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2])
}
