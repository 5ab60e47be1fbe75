//! The accuracy laboratory end to end: the command and its files, and whether it can tell a method that is wrong.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

#[path = "common/command.rs"]
mod command;
mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use command::{fails, ok};
use common::{build_model, load, random_model};
use glam::DVec3;
use serde_json::Value;
use voxsight::camera::{Camera, CameraRays};
use voxsight::lab::lost::lost_samples;
use voxsight::lab::methods::{MethodKind, Variant};
use voxsight::lab::picture::lost_samples_by_pixel;
use voxsight::lab::report::{Report, ReportSettings};
use voxsight::lab::run::{Contestant, FIRST_REFERENCE_SAMPLE, LabError, RunSettings, run};
use voxsight::lab::space::Space;
use voxsight::lab::views::{View, ViewSettings, random_views};
use voxsight::lab::walk::{STEP, walk};
use voxsight::loaded::LoadedScene;
use voxsight::progress::{Progress, Silent};
use voxsight::visibility::culling::{CulledFrame, Culling, StageTime};
use voxsight::visibility::{Jitter, Method, QueryScene, QuerySettings, RaysPerPixel, query};

// --- The command ---

/// A folder with a small plant built at two resolutions.
struct Sample {
    _folder: tempfile::TempDir,
    root: PathBuf,
}

impl Sample {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().to_owned();
        let sample = Sample { _folder: folder, root };
        let model = sample.path("plant.glb");
        ok(&["generate", "plant", "--objects", "300", "--triangles", "60k", "-q", "-o", &model]);
        for (resolution, name) in [("512", "plant.vxs"), ("128", "coarse.vxs")] {
            ok(&["build", &model, "-q", "--resolution", resolution, "-o", &sample.path(name)]);
        }
        sample
    }

    fn path(&self, name: &str) -> String {
        self.root.join(name).to_str().unwrap().to_owned()
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.root.join(name)).unwrap()
    }

    /// Names in the folder, but for what [`Sample::new`] made.
    fn left(&self) -> Vec<String> {
        let names = std::fs::read_dir(&self.root).unwrap();
        let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| !name.ends_with(".vxs") && !name.ends_with(".glb")).collect()
    }
}

#[test]
fn a_comparison_writes_a_report_whose_figures_agree_and_repeat() {
    let sample = Sample::new();
    let (fine, coarse) = (sample.path("plant.vxs"), sample.path("coarse.vxs"));
    let compare = |folder: &str| {
        ok(&[
            "compare",
            &fine,
            &coarse,
            "-q",
            "-o",
            &sample.path(folder),
            "--methods",
            "frustum,voxel,hybrid",
            "--rays",
            "1,2",
            "--views",
            "5",
            "--size",
            "72x48",
            "--repeats",
            "2",
            "--seed",
            "7",
        ])
    };
    let printed = compare("first");
    let report: Value = serde_json::from_str(&sample.read("first/report.json")).unwrap();
    for file in report["files"].as_array().unwrap() {
        let path = sample.root.join("first").join(file.as_str().unwrap());
        assert!(path.metadata().unwrap().len() > 0, "{file}");
    }
    assert_eq!(
        std::fs::read_dir(sample.root.join("first")).unwrap().count(),
        report["files"].as_array().unwrap().len()
    );
    // frustum; voxel and hybrid: 2 resolutions x 2 rays; exact: 2 rays.
    let methods = report["methods"].as_array().unwrap();
    assert_eq!(methods.len(), 1 + 4 + 4 + 2);
    assert_eq!(report["views"].as_array().unwrap().len(), 5);
    assert_eq!(report["times"]["methods"].as_array().unwrap().len(), methods.len());
    for method in methods {
        let name = method["method"].as_str().unwrap();
        assert!(printed.contains(name), "{printed}");
        if name == "hybrid" {
            assert_eq!(method["times_the_floor"], 1.0, "hybrid always asks the triangles: {method}");
        }
        if name == "frustum" {
            assert_eq!(
                (&method["lost_pixels"]["worst"], &method["culled"]["worst"]),
                (&0.0.into(), &0.0.into())
            );
        }
    }

    let html = sample.read("first/report.html");
    let page = well_formed(&html);
    assert!(
        !html.contains("<script") && !html.contains("http-equiv") && !html.contains("src=\"http"),
        "not self-contained"
    );
    figures_agree(&report, &sample.read("first/frames.csv"), &page);
    assert!(page.iter().any(|e| matches!(e, Event::Open(tag, attributes) if tag == "img" && attributes.contains("data:image/png;base64,"))), "no picture");

    // Once more: all is the same but for times. Into the folder of a report, which is replaced.
    let first_files: BTreeMap<String, Vec<u8>> = folder(&sample.root.join("first"));
    compare("first");
    let again: Value = serde_json::from_str(&sample.read("first/report.json")).unwrap();
    assert_eq!(without_times(&report), without_times(&again));
    for (name, bytes) in folder(&sample.root.join("first")) {
        match name.as_str() {
            "pareto.svg" | "stages.svg" | "report.json" => {}
            "frames.csv" => assert_eq!(
                csv_without_times(&String::from_utf8(bytes).unwrap()),
                csv_without_times(std::str::from_utf8(&first_files[&name]).unwrap())
            ),
            "report.html" => assert!(
                html_without_times(&page)
                    == html_without_times(&well_formed(&String::from_utf8(bytes).unwrap())),
                "the pages differ in more than times"
            ),
            _ => assert!(bytes == first_files[&name], "{name} differs"),
        }
    }
    assert_eq!(sample.left(), ["first"], "something is left over");
}

fn folder(path: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap());
    entries.map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap())).collect()
}

fn without_times(report: &Value) -> Value {
    let mut report = report.clone();
    assert!(report.as_object_mut().unwrap().remove("times").is_some());
    report
}

fn csv_without_times(text: &str) -> Vec<String> {
    let header = text.lines().next().unwrap();
    let kept = header.split(',').take_while(|name| !name.starts_with("time")).count();
    assert!(kept > 10);
    text.lines().map(|line| line.split(',').take(kept).collect::<Vec<_>>().join(",")).collect()
}

/// The table's rows, and means over them, are those of JSON and of the page.
fn figures_agree(report: &Value, csv: &str, page: &[Event]) {
    let mut lines = csv.split("\r\n").filter(|line| !line.is_empty());
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<BTreeMap<&str, &str>> =
        lines.map(|line| names.iter().copied().zip(line.split(',')).collect()).collect();
    let mut row = rows.iter();
    for (index, method) in report["methods"].as_array().unwrap().iter().enumerate() {
        let frames = method["frames"].as_array().unwrap();
        let mut sum = 0.0;
        for (view, frame) in frames.iter().enumerate() {
            let row = row.next().expect("a line for each view and method");
            assert_eq!(
                (row["view"], row["method"]),
                (view.to_string().as_str(), method["method"].as_str().unwrap())
            );
            for name in ["reference", "answer", "wrongly_hidden", "needlessly_drawn", "needless_triangles"] {
                assert_eq!(row[name], frame[name].to_string(), "{name} of view {view}, method {index}");
            }
            for (class, px) in ["1px", "4px", "16px"].iter().enumerate() {
                let column = format!("wrongly_hidden_{px}");
                assert_eq!(row[column.as_str()], frame["classes"][class]["wrongly_hidden"].to_string());
            }
            let lost: f64 = row["lost_pixels"].parse().unwrap();
            assert_eq!(lost, frame["lost_pixels"].as_f64().unwrap());
            sum += lost;
            let time: f64 = row["time_ms"].parse().unwrap();
            let seconds = report["times"]["methods"][index]["frames"][view]["seconds"].as_f64().unwrap();
            assert!((time - 1e3 * seconds).abs() < 1e-9 && time > 0.0);
        }
        let mean = method["lost_pixels"]["mean"].as_f64().unwrap();
        assert!((mean - sum / frames.len() as f64).abs() < 1e-15);
        // The page rounds to at least two digits that count.
        for (figure, value) in [
            ("lost_pixels.mean", mean),
            ("lost_pixels.worst", method["lost_pixels"]["worst"].as_f64().unwrap()),
            ("wrongly_hidden.mean", method["wrongly_hidden"]["mean"].as_f64().unwrap()),
            ("wrongly_hidden_16px.mean", method["classes"][2]["wrongly_hidden"]["mean"].as_f64().unwrap()),
            ("needlessly_drawn.mean", method["needlessly_drawn"]["mean"].as_f64().unwrap()),
        ] {
            let shown = cell(page, index, figure);
            let number: f64 = shown.trim_start_matches("< ").trim_end_matches(" %").parse().unwrap();
            let difference = (number / 100.0 - value).abs();
            assert!(difference <= 0.006 * value + 1e-6, "{figure} of method {index}: {shown}, {value}");
        }
    }
    assert!(row.next().is_none(), "more lines than views and methods");
}

/// The text of a figure in the page's table.
fn cell(page: &[Event], method: usize, figure: &str) -> String {
    let row = format!("data-method=\"{method}\"");
    let figure = format!("data-figure=\"{figure}\"");
    let starts = |text: &str| {
        let text = text.to_owned();
        move |event: &Event| matches!(event, Event::Open(_, attributes) if attributes.contains(&text))
    };
    let row = page.iter().position(starts(&row)).expect("a row for each method");
    let cell = row + page[row..].iter().position(starts(&figure)).expect("the figure");
    match &page[cell + 1] {
        Event::Text(text) => text.clone(),
        other => panic!("{other:?}"),
    }
}

/// A piece of a page.
#[derive(Clone, Debug, PartialEq)]
enum Event {
    Open(String, String),
    Close(String),
    Text(String),
}

/// Takes a page apart; fails when it is not well-formed: tags unclosed or crossed, `<` or `&` as text.
fn well_formed(html: &str) -> Vec<Event> {
    let mut rest = html.strip_prefix("<!DOCTYPE html>").expect("a document type");
    let (mut events, mut open) = (Vec::new(), Vec::new());
    while !rest.is_empty() {
        let Some(tag) = rest.strip_prefix('<') else {
            let end = rest.find('<').unwrap_or(rest.len());
            let text = &rest[..end];
            let is_style = open.last().is_some_and(|tag| tag == "style");
            for (at, _) in text.match_indices('&').filter(|_| !is_style) {
                let entity = text[at..].split(';').next().unwrap();
                assert!(entity.len() < 8 && at + entity.len() < text.len(), "a bare & in {text:?}");
            }
            if !text.trim().is_empty() {
                events.push(Event::Text(text.trim().to_owned()));
            }
            rest = &rest[end..];
            continue;
        };
        // No attribute of ours holds a >: it would be escaped.
        let end = tag.find('>').expect("every tag ends");
        let (inside, after) = (&tag[..end], &tag[end + 1..]);
        assert!(!inside.contains('<'), "a tag in a tag: <{inside}>");
        assert_eq!(inside.matches('"').count() % 2, 0, "<{inside}>");
        rest = after;
        if let Some(name) = inside.strip_prefix('/') {
            assert_eq!(open.pop().as_deref(), Some(name), "a tag is closed that is not open");
            events.push(Event::Close(name.to_owned()));
            continue;
        }
        let (name, attributes) = inside.split_once(' ').unwrap_or((inside, ""));
        let name = name.trim_end_matches('/');
        events.push(Event::Open(name.to_owned(), attributes.to_owned()));
        if !inside.ends_with('/') && !["meta", "img", "br", "hr"].contains(&name) {
            open.push(name.to_owned());
        }
    }
    assert!(open.is_empty(), "left open: {open:?}");
    events
}

fn html_without_times(page: &[Event]) -> Vec<Event> {
    let (mut kept, mut depth) = (Vec::new(), 0);
    for event in page {
        match event {
            Event::Open(tag, attributes) if depth > 0 || attributes.contains("class=\"time\"") => {
                assert!(!["img", "br", "meta"].contains(&tag.as_str()));
                depth += i32::from(!attributes.ends_with('/'));
            }
            Event::Close(_) if depth > 0 => depth -= 1,
            Event::Text(_) if depth > 0 => {}
            other => kept.push(other.clone()),
        }
    }
    assert!(kept.len() > 300 && kept.len() < page.len());
    kept
}

#[test]
fn walks_and_paths_are_compared_frame_by_frame() {
    let sample = Sample::new();
    let scene = sample.path("plant.vxs");
    let walked = sample.path("walked");
    ok(&[
        "compare",
        &scene,
        "-q",
        "-o",
        &walked,
        "--methods",
        "voxel",
        "--walk",
        "4",
        "--size",
        "32x32",
        "--repeats",
        "1",
    ]);
    let report: Value = serde_json::from_str(&sample.read("walked/report.json")).unwrap();
    assert_eq!(
        (&report["views"][3]["name"], &report["settings"]["is_path"]),
        (&"frame 3".into(), &true.into())
    );
    // The cameras of the walk as a path: frame 0 of the path is frame 0 of the walk.
    let cameras: Vec<Value> = (0..2).map(|i| report["views"][i]["camera"].clone()).collect();
    let keyframes: Vec<Value> = cameras
        .into_iter()
        .zip([0.0, 0.1])
        .map(|(mut camera, t)| {
            camera["t"] = t.into();
            camera
        })
        .collect();
    let path = sample.path("path.json");
    std::fs::write(&path, serde_json::json!({"keyframes": keyframes, "fps": 20}).to_string()).unwrap();
    let followed = sample.path("followed");
    ok(&["compare", &scene, "-q", "-o", &followed, "--methods", "voxel", "--path", &path, "--repeats", "1"]);
    let along: Value = serde_json::from_str(&sample.read("followed/report.json")).unwrap();
    assert_eq!(along["views"].as_array().unwrap().len(), 3);
    assert_eq!(along["methods"][0]["frames"][0], report["methods"][0]["frames"][0]);
}

#[test]
fn every_method_takes_part_and_its_figures_make_sense() {
    let sample = Sample::new();
    let scene = sample.path("plant.vxs");
    let names = "frustum,voxel,hybrid,adaptive,coherent,coherent-voxel,hzm,hzb";
    ok(&[
        "compare",
        &scene,
        "-q",
        "-o",
        &sample.path("all"),
        "--methods",
        names,
        "--rays",
        "1/4,1",
        "--walk",
        "3",
        "--size",
        "80x60",
        "--repeats",
        "1",
        "--still",
        "4",
        "--reference",
        "hybrid",
    ]);
    let report: Value = serde_json::from_str(&sample.read("all/report.json")).unwrap();
    assert_eq!(report["settings"]["reference_method"], "hybrid");
    assert!(report["files"].as_array().unwrap().contains(&"frames.svg".into()), "a way has a chart by frame");
    let methods = report["methods"].as_array().unwrap();
    assert_eq!(methods.len(), 1 + 5 * 2 + 2 + 2, "boxes take no rays");
    let named = |name: &str, rays: f64| {
        let is = |m: &&Value| {
            m["method"] == name && (m["rays_per_pixel"].is_null() || m["rays_per_pixel"] == rays)
        };
        methods.iter().find(is).unwrap_or_else(|| panic!("{name} {rays}"))
    };
    let mean = |method: &Value, figure: &str| method[figure]["mean"].as_f64().unwrap();
    for method in methods {
        let frames = method["frames"].as_array().unwrap();
        let with_loss = frames.iter().filter(|frame| frame["wrongly_hidden"] != 0).count();
        assert_eq!(method["views_with_loss"], with_loss, "{}", method["method"]);
        let rays: f64 = frames.iter().map(|frame| frame["rays"].as_f64().unwrap()).sum::<f64>() / 3.0;
        assert_eq!(method["rays_cast"].as_f64().unwrap(), rays);
    }
    // A method that forgets is shown one frame; one that remembers four of 1/4 ray, and some questions.
    assert_eq!(named("hybrid", 0.25)["rays_cast"], 80.0 * 60.0 / 4.0);
    let coherent = named("coherent", 0.25);
    let cast = coherent["rays_cast"].as_f64().unwrap();
    assert!((80.0 * 60.0..=80.0 * 60.0 * 1.25).contains(&cast), "{cast}");
    assert!(coherent["times_the_floor"].is_null() && named("hybrid", 0.25)["times_the_floor"] == 1.0);
    assert!(mean(coherent, "lost_pixels") < mean(named("hybrid", 0.25), "lost_pixels"), "it remembers");
    for boxes in ["hzm", "hzb"] {
        let boxes = named(boxes, 0.0);
        assert_eq!(boxes["rays_cast"], 0.0);
        assert!(mean(boxes, "lost_pixels") < 0.01, "{boxes}");
        assert!(mean(boxes, "needlessly_drawn") > mean(named("hybrid", 1.0), "needlessly_drawn"));
    }
    let culled = mean(named("hzb", 0.0), "culled_of_hidden");
    assert!(culled >= mean(named("hzm", 0.0), "culled_of_hidden") && culled <= 1.0, "{culled}");
    assert_eq!(mean(named("frustum", 0.0), "culled_of_hidden"), 0.0);
}

#[test]
fn bad_arguments_are_refused_with_a_reason_before_the_work() {
    let sample = Sample::new();
    let (scene, out) = (sample.path("plant.vxs"), sample.path("out"));
    let with = |args: &[&str], code: i32| {
        let mut all = vec!["compare", &scene, "-o", &out, "--size", "16x16"];
        all.extend(args);
        fails(&all, code)
    };
    let error = with(&["--methods", "hybrid,magic"], 2);
    assert!(error.contains("magic") && error.contains("frustum"), "{error}");
    assert!(with(&["--rays", "3/4"], 2).contains("1/16"));
    assert!(with(&["--still", "0"], 2).contains("0"));
    assert!(with(&["--reference", "voxel"], 2).contains("hybrid"));
    assert!(with(&["--reference-rays", "8"], 1).contains("at least 16"));
    assert!(with(&["--views", "3", "--walk", "3"], 2).contains("cannot be used with"));
    assert!(with(&["--views", "0"], 2).contains("0"));
    assert!(with(&["--path", &sample.path("missing.json")], 1).contains("missing.json"));
    std::fs::write(sample.path("plant.json"), "{}").unwrap();
    assert!(with(&["--path", &sample.path("plant.json")], 1).contains("keyframes"));
    std::fs::remove_file(sample.path("plant.json")).unwrap();
    // Another model is no other resolution.
    ok(&["generate", "plant", "--objects", "40", "--triangles", "9k", "-q", "-o", &sample.path("other.glb")]);
    let other = sample.path("other.vxs");
    ok(&["build", &sample.path("other.glb"), "-q", "--resolution", "64", "-o", &other]);
    assert!(with(&[&other, "--views", "1"], 1).contains("other.vxs is not the same model"));
    // Nothing is replaced by mistake.
    assert!(fails(&["compare", &scene, "-o", &scene], 1).contains("file of this name"));
    let root = sample.root.to_str().unwrap();
    assert!(fails(&["compare", &scene, "-o", root], 1).contains("in it"));
    assert!(fails(&["compare", &scene, "-o", &sample.path("no/where")], 1).contains("no folder"));
    assert_eq!(sample.left(), [""; 0], "something was written");
}

#[cfg(unix)]
#[test]
fn an_interrupted_comparison_leaves_nothing() {
    use std::io::Read;
    let sample = Sample::new();
    let (scene, out) = (sample.path("plant.vxs"), sample.path("out"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_voxsight"))
        .args(["compare", &scene, "-o", &out, "--views", "1000", "--size", "256x256"])
        .stderr(std::process::Stdio::piped())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    // The reference of a thousand views takes minutes: when the stage before is told to be over, it has begun.
    let mut told = [0; 4];
    child.stderr.as_mut().unwrap().read_exact(&mut told).unwrap();
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("nothing was written"), "{text}");
    assert_eq!(sample.left(), [""; 0]);
}

// --- The library ---

/// Hides what it is told to hide; its time is one millisecond for each frame since the last reset.
struct Forgetful {
    object: u32,
    drawables: std::ops::Range<u32>,
    frames: u32,
}

impl Culling for Forgetful {
    fn name(&self) -> String {
        "forgetful".into()
    }

    fn reset(&mut self) {
        self.frames = 0;
    }

    fn frame(&mut self, scene: &QueryScene, camera: &CameraRays, _: &dyn Progress) -> Option<CulledFrame> {
        self.frames += 1;
        let fine = QuerySettings {
            rays_per_pixel: RaysPerPixel::rays(16),
            first_sample: FIRST_REFERENCE_SAMPLE,
            ..QuerySettings::default()
        };
        let mut found = query(scene, camera, Method::Exact, &fine);
        for drawable in self.drawables.clone() {
            (found.visible[drawable as usize], found.samples[drawable as usize]) = (false, 0);
        }
        let seconds = 1e-3 * f64::from(self.frames);
        Some(CulledFrame { found, stages: vec![StageTime { stage: "forget", seconds }] })
    }
}

/// A scene, and views of it.
fn random_scene(seed: u64, folder: &Path) -> (LoadedScene, Vec<View>) {
    let path = folder.join(format!("{seed}.vxs"));
    build_model(random_model(seed, 60, DVec3::splat(1e4)), 8, &path);
    let loaded = load(&path);
    let bounds = loaded.scene().meta().bounds;
    let views = (0..3)
        .map(|i| {
            let from = DVec3::new(0.7 - 0.6 * f64::from(i), 0.5, 0.9);
            let camera = Camera::around(bounds.min.into(), bounds.max.into(), from, DVec3::Y, 61, 47);
            View { name: format!("view {i}"), camera, starts_anew: i != 1 }
        })
        .collect();
    (loaded, views)
}

fn variant(method: &str) -> Variant {
    Variant { method: method.into(), rays_per_pixel: None, resolution: None, keeps_state: false }
}

#[test]
fn a_method_that_drops_one_part_is_told_on_with_its_name_and_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let (loaded, views) = random_scene(11, folder.path());
    let scenes = [loaded];
    let [loaded] = &scenes;
    let settings = RunSettings { repeats: 2, ..RunSettings::default() };
    // An object that all views see.
    let object_of = |drawable| loaded.scene().drawable_object(drawable);
    let seen: Vec<BTreeMap<u32, u64>> = views
        .iter()
        .map(|view| {
            let rays = view.camera.rays().unwrap();
            query(&loaded.query(), &rays, Method::Exact, &settings.reference_query()).by_object(object_of)
        })
        .collect();
    let object = *seen[0].keys().find(|object| seen.iter().all(|view| view.contains_key(object))).unwrap();

    let drawables = loaded.scene().object_drawables(object);
    let culling = Box::new(Forgetful { object, drawables, frames: 100 });
    let name = loaded.scene().node_path(loaded.scene().objects()[culling.object as usize].node);
    let exact = MethodKind::named("exact").unwrap().make(loaded, RaysPerPixel::ONE);
    let mut contestants = [
        Contestant { variant: variant("forgetful"), scene: loaded, culling },
        Contestant { variant: variant("exact"), scene: loaded, culling: exact },
    ];
    let outcome = run(loaded, &views, &mut contestants, &settings, &Silent).unwrap();
    let source = ReportSettings { views: "three".into(), is_path: false, seed: 0, run: settings };
    let report = Report::new(&scenes, views.clone(), None, source, &outcome);

    let method = &report.methods[0];
    assert_eq!(method.lost.len(), 1, "{:?}", method.lost);
    let pixels: f64 = seen.iter().map(|view| view[&object] as f64 / 16.0).sum();
    assert_eq!(
        (method.lost[0].path.as_str(), method.lost[0].lost.pixels, method.lost[0].lost.views),
        (name.as_str(), pixels, 3)
    );
    for (view, frame) in method.frames.iter().enumerate() {
        let all: u64 = seen[view].values().sum();
        assert_eq!(frame.accuracy.lost_pixels, seen[view][&object] as f64 / all as f64, "view {view}");
        assert_eq!((frame.accuracy.needlessly_drawn, frame.lost_objects), (0, 1));
    }
    let worst = (0..3).max_by(|&a, &b| {
        method.frames[a].accuracy.lost_pixels.total_cmp(&method.frames[b].accuracy.lost_pixels)
    });
    assert_eq!(Some(method.worst_view), worst);
    // State lives from frame to frame, and ends where a view starts anew: view 1 goes on after view 0.
    let milliseconds: Vec<f64> = method.time.frames.iter().map(|time| (1e3 * time.seconds).round()).collect();
    assert_eq!(milliseconds, [1.0, 2.0, 1.0]);
}

#[test]
fn lost_objects_are_those_that_item_buffers_count() {
    let folder = tempfile::tempdir().unwrap();
    for seed in [21, 22] {
        let (loaded, views) = random_scene(seed, folder.path());
        let scene = loaded.query();
        let fine = RunSettings::default().reference_query();
        let mut lost_anything = 0;
        for view in &views {
            let camera = view.camera.rays().unwrap();
            let reference = query(&scene, &camera, Method::Exact, &fine);
            let mut answer = query(&scene, &camera, Method::Voxel, &QuerySettings::default());
            // Something large is lost, too.
            answer.visible[7] = false;
            let found =
                lost_samples(&reference, &answer, |drawable| loaded.scene().drawable_object(drawable));
            // An item buffer a sample, in the plainest way.
            let mut expected: BTreeMap<u32, u64> = BTreeMap::new();
            let mut by_pixel = Vec::new();
            for row in 0..camera.size().1 {
                for column in 0..camera.size().0 {
                    let mut lost = 0;
                    for sample in 0..16 {
                        let (x, y) = Jitter::Scattered.offset(FIRST_REFERENCE_SAMPLE + sample, column, row);
                        let ray = camera.ray(f64::from(column) + x, f64::from(row) + y);
                        let mut items = Vec::new();
                        let opaque = scene.exact.closest_through(&ray, scene.filter, |hit| items.push(hit));
                        items.retain(|hit| opaque.is_none_or(|opaque| hit.t < opaque.t));
                        for hit in items.into_iter().chain(opaque) {
                            if !answer.visible[hit.drawable as usize] {
                                *expected.entry(loaded.scene().drawable_object(hit.drawable)).or_default() +=
                                    1;
                                lost += 1;
                            }
                        }
                    }
                    by_pixel.push(lost);
                }
            }
            assert_eq!(found, expected, "seed {seed}, {}", view.name);
            lost_anything += found.len();
            let marked = lost_samples_by_pixel(&scene, &camera, &fine, &answer, &Silent).unwrap();
            assert_eq!(marked, by_pixel, "seed {seed}, {}: what is painted red", view.name);
        }
        assert!(lost_anything > 3, "seed {seed}: a test of nothing");
    }
}

#[test]
fn views_and_walks_stay_in_free_space_and_repeat() {
    let sample = Sample::new();
    let loaded = load(Path::new(&sample.path("plant.vxs")));
    let space = Space::new(loaded.query(), loaded.scene().meta());
    let settings = ViewSettings { count: 25, seed: 3, size: (32, 24) };
    let (views, rejected) = random_views(&space, &settings).unwrap();
    assert_eq!(views.len(), 25);
    assert!(rejected.too_close > 0 && rejected.in_the_open > 0, "{rejected:?}");
    assert_eq!(random_views(&space, &settings).unwrap(), (views.clone(), rejected));
    let (fewer, _) = random_views(&space, &ViewSettings { count: 9, ..settings }).unwrap();
    assert_eq!(fewer, views[..9]);
    let (others, _) = random_views(&space, &ViewSettings { seed: 4, ..settings }).unwrap();
    assert!(others.iter().zip(&views).all(|(other, view)| other.camera != view.camera));
    let is_free = |camera: &Camera| {
        // Against all voxels around the eye, without rays.
        let (grid, dag) = (loaded.scene().grid(), loaded.scene().dag());
        let at = grid.grid_from_world(camera.eye.into()).floor().as_ivec3();
        !dag.is_occupied(at.to_array())
    };
    for view in &views {
        assert!(is_free(&view.camera), "{view:?}");
        let seen =
            query(&loaded.query(), &view.camera.rays().unwrap(), Method::Exact, &QuerySettings::default());
        // A long model fills little of an image that holds all of it.
        let least = if view.name.starts_with("inside") { 0.1 } else { 0.01 };
        assert!(seen.hits as f64 >= least * seen.weight as f64, "{} sees next to nothing", view.name);
    }

    let frames = ViewSettings { count: 240, ..settings };
    let (walked, _) = walk(&space, &frames).unwrap();
    assert_eq!(walk(&space, &frames).unwrap().0, walked);
    let step = STEP * space.person;
    let mut way = 0.0;
    for pair in walked.windows(2) {
        let (a, b) = (DVec3::from(pair[0].camera.eye), DVec3::from(pair[1].camera.eye));
        assert!(is_free(&pair[1].camera) && a.distance(b) < 1.0001 * step, "{pair:?}");
        let look = |view: &View| {
            (DVec3::from(view.camera.target) - DVec3::from(view.camera.eye)).normalize_or_zero()
        };
        assert!(look(&pair[0]).dot(look(&pair[1])) > 0.99, "the head jerks: {pair:?}");
        way += a.distance(b);
    }
    assert!(way > 0.5 * 240.0 * step, "the walker stands for half of the time: {way}");
    assert!(walked[0].starts_anew && !walked[1..].iter().any(|view| view.starts_anew));
}

#[test]
fn a_run_that_compares_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (loaded, views) = random_scene(31, folder.path());
    let contestant = || Contestant {
        variant: variant("frustum"),
        scene: &loaded,
        culling: MethodKind::named("frustum").unwrap().make(&loaded, RaysPerPixel::ONE),
    };
    let good = RunSettings::default();
    let refused = |views: &[View], contestants: &mut [Contestant], settings: RunSettings| {
        matches!(run(&loaded, views, contestants, &settings, &Silent), Err(LabError::Settings(_)))
    };
    assert!(refused(&[], &mut [contestant()], good));
    assert!(refused(&views, &mut [], good));
    assert!(refused(&views, &mut [contestant()], RunSettings { reference_rays: 15, ..good }));
    assert!(refused(&views, &mut [contestant()], RunSettings { repeats: 0, ..good }));
}
