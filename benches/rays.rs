//! Rays a second through the voxel DAG: the scalar reference, one ray with SIMD, and packets with every instruction set
//! of this processor, beside obvhs (CWBVH and BVH2) over the level-0 triangles. Same cameras, same run.
//!
//! `cargo bench --bench rays -- [--size 1024] [--runs 5] [--resolution-log2 12] [--no-obvhs] [--views a,b]
//! [--column TEXT] [SCENE.vxs|MODEL..]`
//! Without scenes: the sample plant of a million triangles. Every fast answer is compared with the
//! reference's before anything is timed.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "rays/rivals.rs"]
mod rivals;
#[path = "rays/views.rs"]
#[allow(dead_code, reason = "the bench of visibility makes cameras of them too")]
mod views;

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use voxsight::sample::{PlantSettings, plant};
use voxsight::scene::Scene;
use voxsight_voxel::dag::DagRef;
use voxsight_voxel::raycast::{GridRay, Instructions, Next, PACKET_RAYS, RayCaster, RayPacket};

use rivals::Rivals;
use views::{Pinhole, TILE, views};

struct Options {
    size: usize,
    runs: usize,
    log2: u32,
    rivals: bool,
    views: Option<Vec<String>>,
    columns: Option<String>,
    scenes: Vec<PathBuf>,
}

fn options() -> Options {
    let mut options = Options {
        size: 1024,
        runs: 5,
        log2: 12,
        rivals: true,
        views: None,
        columns: None,
        scenes: Vec::new(),
    };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().expect("a value");
        match arg.as_str() {
            "--bench" => {}
            "--size" => options.size = value().parse().unwrap(),
            "--runs" => options.runs = value().parse().unwrap(),
            "--resolution-log2" => options.log2 = value().parse().unwrap(),
            "--no-obvhs" => options.rivals = false,
            "--views" => options.views = Some(value().split(',').map(str::to_owned).collect()),
            "--column" => options.columns = Some(value()),
            path => options.scenes.push(path.into()),
        }
    }
    assert!(options.size.is_multiple_of(TILE), "the size must be a multiple of {TILE}");
    options
}

fn main() {
    let options = options();
    let folder = tempfile::tempdir().unwrap();
    if options.scenes.is_empty() {
        let path = folder.path().join("plant.vxs");
        let settings = PlantSettings { objects: 4_000, triangles: 1_000_000, ..PlantSettings::default() };
        common::build_model(plant(&settings), options.log2, &path);
        run(&options, &path);
    }
    for scene in &options.scenes {
        if scene.extension().is_some_and(|e| e == "vxs") {
            run(&options, scene);
        } else {
            let path = folder.path().join("model.vxs");
            common::build_file(scene, options.log2, &path);
            println!("{}", scene.display());
            run(&options, &path);
        }
    }
}

/// One column of the table.
struct Column {
    name: String,
    /// Mrays/s of each view.
    rates: Vec<f64>,
}

fn run(options: &Options, path: &Path) {
    let scene = Scene::open(path).unwrap();
    let dag = scene.dag();
    println!(
        "{}: 2^{}, {} triangles, {} voxels, DAG {:.1} MB",
        path.display(),
        scene.grid().log2,
        scene.meta().counts.placed_triangles,
        scene.meta().dag.voxel_count,
        (size_of_val(scene.container().dag_nodes()) + size_of_val(scene.container().dag_leaves())) as f64
            / 1e6
    );
    let rivals = options.rivals.then(|| Rivals::build(&scene));
    let views = views(&scene, options.size)
        .into_iter()
        .filter(|view| options.views.as_ref().is_none_or(|names| names.iter().any(|n| n == view.name)));
    let wanted = |name: &str| options.columns.as_ref().is_none_or(|text| name.contains(text));
    let mut columns: Vec<Column> = Vec::new();
    let mut names = Vec::new();
    let (mut incoherent, mut incoherent_names): (Vec<Column>, Vec<String>) = Default::default();
    let one_core = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let all_cores = rayon::ThreadPoolBuilder::new().build().unwrap();
    for view in views {
        let camera = &view.camera;
        let hits = check(&dag, camera);
        let rays = camera.pixels() as f64;
        names.push(format!("{} ({:.0}% hit)", view.name, 100.0 * hits as f64 / rays));
        let mut column = 0;
        let mut time = |name: String, pool: &rayon::ThreadPool, work: &(dyn Fn() -> u64 + Sync)| {
            if !wanted(&name) {
                return;
            }
            let rate = rays / pool.install(|| median_seconds(options.runs, work)) / 1e6;
            if columns.len() == column {
                columns.push(Column { name, rates: Vec::new() });
            }
            columns[column].rates.push(rate);
            column += 1;
        };
        time("scalar".into(), &one_core, &|| scalar(&dag, camera));
        for instructions in Instructions::available() {
            let caster = RayCaster::new(dag).with_instructions(instructions);
            time(format!("one ray {instructions:?}"), &one_core, &|| single(&caster, camera));
            time(format!("packet {instructions:?}"), &one_core, &|| packets(&caster, camera));
        }
        let caster = RayCaster::new(dag);
        time(format!("packet, {} threads", all_cores.current_num_threads()), &all_cores, &|| {
            packets(&caster, camera)
        });
        if let Some(rivals) = &rivals {
            rivals.check(&scene, camera, &dag);
            time("obvhs CWBVH".into(), &one_core, &|| rivals.cwbvh(&scene, camera));
            time("obvhs BVH2".into(), &one_core, &|| rivals.bvh2(&scene, camera));
        }

        // From the hits, over the hemisphere: does anything lie in the way?
        let bounced = bounced(&dag, camera);
        if bounced.len() < 10_000 {
            continue;
        }
        check_batch(&dag, &bounced);
        let mut column = 0;
        incoherent_names.push(format!("{} ({} rays)", view.name, bounced.len()));
        let mut time = |name: String, work: &(dyn Fn() -> u64 + Sync)| {
            if !wanted(&name) {
                return;
            }
            let seconds = one_core.install(|| median_seconds(options.runs, work));
            if incoherent.len() == column {
                incoherent.push(Column { name, rates: Vec::new() });
            }
            incoherent[column].rates.push(bounced.len() as f64 / seconds / 1e6);
            column += 1;
        };
        time("scalar".into(), &|| bounced.iter().filter(|ray| dag.any_hit(ray)).count() as u64);
        for instructions in Instructions::available() {
            let caster = RayCaster::new(dag).with_instructions(instructions);
            time(format!("batch {instructions:?}"), &|| {
                let mut hits = 0;
                caster.cast_batch(&bounced, |_, _| {
                    hits += 1;
                    Next::End
                });
                hits
            });
        }
        if let Some(rivals) = &rivals {
            time("obvhs CWBVH".into(), &|| rivals.cwbvh_any(&scene, &bounced));
        }
    }
    print_table(&names, &columns);
    if !incoherent.is_empty() {
        println!("any hit, cosine-weighted from the hits of the view:");
        print_table(&incoherent_names, &incoherent);
    }
}

/// A ray from before each hit, over the hemisphere of the entered face.
fn bounced(dag: &DagRef, camera: &Pinhole) -> Vec<GridRay> {
    let mut random = oorandom::Rand64::new(9);
    let mut rays = Vec::new();
    for tile in camera.tiles() {
        for ray in camera.grid_rays(tile) {
            let Some((voxel, t)) = dag.first_hit(&ray) else { continue };
            let point = ray.origin + t * ray.direction;
            let inside = point - voxel.as_vec();
            let axis = (0..3).max_by(|&a, &b| ((inside[a] - 0.5).abs()).total_cmp(&(inside[b] - 0.5).abs()));
            let mut normal = glam::DVec3::ZERO;
            normal[axis.unwrap()] = -ray.direction[axis.unwrap()].signum();
            let on_sphere = loop {
                let p = glam::DVec3::new(random.rand_float(), random.rand_float(), random.rand_float()) * 2.0
                    - 1.0;
                if p.length_squared() <= 1.0 && p != glam::DVec3::ZERO {
                    break p.normalize_or_zero();
                }
            };
            rays.push(GridRay::new(point + 1.5 * normal, normal * 1.001 + on_sphere));
        }
    }
    rays
}

trait AsVec {
    fn as_vec(&self) -> glam::DVec3;
}

impl AsVec for [i32; 3] {
    fn as_vec(&self) -> glam::DVec3 {
        glam::DVec3::from(self.map(f64::from))
    }
}

/// Batches of every instruction set find what the reference finds.
fn check_batch(dag: &DagRef, rays: &[GridRay]) {
    let expected: Vec<_> = rays.par_iter().map(|ray| dag.first_hit(ray).map(|(voxel, _)| voxel)).collect();
    for instructions in Instructions::available() {
        let mut found = vec![None; rays.len()];
        RayCaster::new(*dag).with_instructions(instructions).cast_batch(rays, |ray, hit| {
            found[ray] = Some(hit.voxel);
            Next::End
        });
        assert_eq!(found, expected, "a batch differs from the reference ({instructions:?})");
    }
}

fn print_table(names: &[String], columns: &[Column]) {
    print!("{:<22}", "Mrays/s");
    columns.iter().for_each(|column| print!(" | {:>17}", column.name));
    println!();
    for (row, name) in names.iter().enumerate() {
        print!("{name:<22}");
        columns.iter().for_each(|column| print!(" | {:>17.2}", column.rates[row]));
        println!();
    }
    print!("{:<22}", "median");
    columns.iter().for_each(|column| print!(" | {:>17.2}", median(column.rates.clone())));
    println!();
    print!("{:<22}", "median of ratios");
    for column in columns {
        let ratios = column.rates.iter().zip(&columns[0].rates).map(|(rate, scalar)| rate / scalar);
        print!(" | {:>16.2}x", median(ratios.collect()));
    }
    println!();
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let (lower, upper) = (values[(values.len() - 1) / 2], values[values.len() / 2]);
    0.5 * (lower + upper)
}

fn median_seconds(runs: usize, work: &(dyn Fn() -> u64 + Sync)) -> f64 {
    let times = (0..runs).map(|_| {
        let started = Instant::now();
        black_box(work());
        started.elapsed().as_secs_f64()
    });
    median(times.collect())
}

/// All rays by the reference, one by one and by packets of every instruction set: equal. Returns the hits.
fn check(dag: &DagRef, camera: &Pinhole) -> u64 {
    let hits = std::sync::atomic::AtomicU64::new(0);
    camera.tiles().into_par_iter().for_each_init(RayPacket::default, |packet, tile| {
        let rays: Vec<GridRay> = camera.grid_rays(tile).collect();
        let expected: Vec<_> = rays.iter().map(|ray| dag.first_hit(ray).map(|(voxel, _)| voxel)).collect();
        hits.fetch_add(expected.iter().flatten().count() as u64, std::sync::atomic::Ordering::Relaxed);
        for instructions in Instructions::available() {
            let caster = RayCaster::new(*dag).with_instructions(instructions);
            let one_by_one: Vec<_> = rays.iter().map(|ray| caster.first_hit(ray).map(|hit| hit.0)).collect();
            assert_eq!(one_by_one, expected, "one ray differs from the reference ({instructions:?})");
            packet.fill(rays.iter().copied());
            let mut found = vec![None; rays.len()];
            caster.cast_packet(packet, |ray, hit| {
                assert!(found[ray].is_none());
                found[ray] = Some(hit.voxel);
                Next::End
            });
            assert_eq!(found, expected, "a packet differs from the reference ({instructions:?})");
        }
    });
    hits.into_inner()
}

/// What a hit adds to the checksum, so that nothing is optimized away.
#[inline]
fn digest(voxel: [i32; 3]) -> u64 {
    (voxel[0] ^ voxel[1] ^ voxel[2]) as u64
}

fn scalar(dag: &DagRef, camera: &Pinhole) -> u64 {
    let tile_sum = |tile| {
        let mut sum = 0;
        for ray in camera.grid_rays(tile) {
            dag.cast(&ray, |hit| {
                sum += digest(hit.voxel);
                Next::End
            });
        }
        sum
    };
    camera.tiles().into_par_iter().map(tile_sum).sum()
}

fn single(caster: &RayCaster, camera: &Pinhole) -> u64 {
    let tile_sum = |tile| {
        let mut sum = 0;
        for ray in camera.grid_rays(tile) {
            caster.cast(&ray, |hit| {
                sum += digest(hit.voxel);
                Next::End
            });
        }
        sum
    };
    camera.tiles().into_par_iter().map(tile_sum).sum()
}

fn packets(caster: &RayCaster, camera: &Pinhole) -> u64 {
    let tile_sum = |packet: &mut RayPacket, tile| {
        let mut sum = 0;
        assert_eq!(packet.fill(camera.grid_rays(tile)), PACKET_RAYS);
        caster.cast_packet(packet, |_, hit| {
            sum += digest(hit.voxel);
            Next::End
        });
        sum
    };
    camera.tiles().into_par_iter().map_init(RayPacket::default, tile_sum).sum()
}
