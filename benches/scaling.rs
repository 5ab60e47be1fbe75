//! How the build grows: time and memory against resolution, and against triangles, as a table and as a chart.
//!
//! `cargo bench --bench scaling -- [-o CHART.svg] [--memory 4G] [--log2 10..17] [--triangles 0.5M,1.5M,5M,15M,50M]`
//! Every point is a `voxsight build` of the sample plant in a process of its own, whose peak memory is its own too, and is
//! verified before it counts.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a bench stops at the first surprise"
)]

#[path = "scaling/chart.rs"]
mod chart;

use std::path::{Path, PathBuf};
use std::process::Command;

use chart::{AT_THE_END, PowerLaw};
use serde_json::Value;
use voxsight::lab::chart::{Axis, Chart, charts_svg};

/// Triangles of the plant that is built at several resolutions.
const TRIANGLES: u64 = 12_000_000;
/// Resolution at which plants of several sizes are built.
const LOG2: u32 = 13;
/// Triangles an object of the plant, as in real ones of this kind.
const TRIANGLES_PER_OBJECT: u64 = 267;

struct Options {
    output: Option<PathBuf>,
    memory: String,
    log2: Vec<u32>,
    triangles: Vec<u64>,
}

fn options() -> Options {
    let mut options = Options {
        output: None,
        memory: "4G".into(),
        log2: (10..=17).collect(),
        triangles: vec![500_000, 1_500_000, 5_000_000, 15_000_000, 50_000_000],
    };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().expect("a value");
        match arg.as_str() {
            "--bench" => {}
            "-o" => options.output = Some(value().into()),
            "--memory" => options.memory = value(),
            "--log2" => {
                let range = value();
                let (first, last) = range.split_once("..").expect("FIRST..LAST");
                options.log2 = (first.parse().unwrap()..=last.parse().unwrap()).collect();
            }
            "--triangles" => {
                let millions = |m: &str| (m.trim_end_matches('M').parse::<f64>().unwrap() * 1e6) as u64;
                options.triangles = value().split(',').map(millions).collect();
            }
            other => panic!("no option {other}"),
        }
    }
    options
}

/// One build.
struct Point {
    triangles: f64,
    log2: u32,
    voxels: f64,
    seconds: f64,
    voxel_seconds: f64,
    peak_bytes: f64,
    dag_bytes: f64,
    bricks: f64,
    owner_bytes: f64,
    file_bytes: f64,
}

impl Point {
    fn resolution(&self) -> f64 {
        f64::from(self.log2).exp2()
    }

    fn print(&self) {
        println!(
            "| {:.1} M | {}^3 | {:.1} M | {:.1} | {:.1} | {:.1} | {:.0} | {:.0} | {:.3} | {:.2} | {:.1} |",
            self.triangles / 1e6,
            self.resolution(),
            self.voxels / 1e6,
            self.seconds,
            self.voxel_seconds,
            self.voxels / self.voxel_seconds / 1e6,
            self.peak_bytes / 1e6,
            self.file_bytes / 1e6,
            8.0 * self.dag_bytes / self.voxels,
            self.owner_bytes / self.bricks,
            self.dag_bytes / 1e6,
        );
    }
}

fn voxsight(args: &[&str]) -> Vec<u8> {
    let run = Command::new(env!("CARGO_BIN_EXE_voxsight")).args(args).output().unwrap();
    assert!(run.status.success(), "voxsight {args:?}: {}", String::from_utf8_lossy(&run.stderr));
    run.stdout
}

fn plant(folder: &Path, triangles: u64) -> PathBuf {
    let path = folder.join(format!("plant-{triangles}.glb"));
    if !path.exists() {
        let objects = (triangles / TRIANGLES_PER_OBJECT).to_string();
        let (name, triangles) = (path.to_str().unwrap(), triangles.to_string());
        voxsight(&["generate", "plant", "--objects", &objects, "--triangles", &triangles, "-o", name]);
    }
    path
}

fn build(folder: &Path, triangles: u64, log2: u32, memory: &str) -> Point {
    let model = plant(folder, triangles);
    let scene = folder.join("plant.vxs");
    let (model, scene) = (model.to_str().unwrap(), scene.to_str().unwrap());
    let resolution = (1u64 << log2).to_string();
    let args = ["build", model, "-o", scene, "--resolution", &resolution, "--memory", memory, "--json"];
    let report: Value = serde_json::from_slice(&voxsight(&args)).unwrap();
    voxsight(&["verify", scene]);
    let stages = report["stages"].as_array().unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    let point = Point {
        triangles: number(&report["meta"]["counts"]["placed_triangles"]),
        log2,
        voxels: number(&report["meta"]["dag"]["voxel_count"]),
        seconds: number(&report["seconds"]),
        voxel_seconds: stages
            .iter()
            .find(|stage| stage["name"] == "voxels")
            .map_or(0.0, |stage| number(&stage["seconds"])),
        peak_bytes: stages.iter().map(|stage| number(&stage["peak_bytes"])).fold(0.0, f64::max),
        dag_bytes: number(&report["report"]["statistics"]["dag_traversal_bytes"]),
        bricks: number(&report["meta"]["dag"]["brick_count"]),
        owner_bytes: number(&report["report"]["statistics"]["owner_bytes"]),
        file_bytes: number(&report["file_bytes"]),
    };
    point.print();
    point
}

fn law(name: &str, points: &[Point], x: fn(&Point) -> f64, y: fn(&Point) -> f64) -> PowerLaw {
    PowerLaw { name: name.into(), points: points.iter().map(|p| (x(p), y(p))).collect() }
}

/// What the points are drawn against.
struct Against {
    title: &'static str,
    label: &'static str,
    name: fn(f64) -> String,
    x: fn(&Point) -> f64,
}

/// Time and memory; prints their slopes.
fn charts(points: &[Point], against: &Against) -> [Chart; 2] {
    let x = against.x;
    let time = [law("whole build", points, x, |p| p.seconds), law("voxels", points, x, |p| p.voxel_seconds)];
    let memory = [
        law("peak memory", points, x, |p| p.peak_bytes / 1e6),
        law("file", points, x, |p| p.file_bytes / 1e6),
        law("DAG alone", points, x, |p| p.dag_bytes / 1e6),
    ];
    [chart(against, "build time", "seconds", &time), chart(against, "memory", "MB", &memory)]
}

fn chart(against: &Against, what: &str, y_label: &str, laws: &[PowerLaw]) -> Chart {
    let title = format!("{}: {what}", against.title);
    for law in laws {
        let (whole, end) = (law.slope(law.points.len()), law.slope(AT_THE_END));
        println!("{title}, {} against {}: slope {whole:.2}, at the end {end:.2}", law.name, against.label);
    }
    let y_name: fn(f64) -> String = |y| if y < 1.0 { format!("{y}") } else { format!("{y:.0}") };
    Chart {
        title,
        x: Axis { label: against.label.into(), name: against.name, marks_at_points: true },
        y: Axis { label: y_label.into(), name: y_name, marks_at_points: false },
        curves: laws.iter().enumerate().map(|(colour, law)| law.curve(colour)).collect(),
    }
}

fn main() {
    let options = options();
    let folder = tempfile::tempdir().unwrap();
    println!(
        "| triangles | grid | voxels | build, s | of it voxels, s | M voxels/s | peak, MB | file, MB | bits a voxel | \
         owners, B a brick | DAG, MB |\n|{}",
        " --- |".repeat(11)
    );
    let by_resolution: Vec<Point> =
        options.log2.iter().map(|&log2| build(folder.path(), TRIANGLES, log2, &options.memory)).collect();
    let by_triangles: Vec<Point> =
        options.triangles.iter().map(|&count| build(folder.path(), count, LOG2, &options.memory)).collect();

    let against_resolution = Against {
        title: "Sample plant, 12 M triangles",
        label: "voxels a side",
        name: |x| format!("{:.0}K", x / 1024.0),
        x: Point::resolution,
    };
    let against_triangles = Against {
        title: "Sample plants at 8192^3",
        label: "triangles",
        name: |x| format!("{:.1} M", x / 1e6),
        x: |p| p.triangles,
    };
    let charts: Vec<Chart> = charts(&by_resolution, &against_resolution)
        .into_iter()
        .chain(charts(&by_triangles, &against_triangles))
        .collect();
    if let Some(output) = options.output {
        std::fs::write(&output, charts_svg(&charts, 1300, 2).unwrap()).unwrap();
    }
}
