//! The command line as a user or a script meets it: outputs, exit codes, messages.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

#[path = "common/command.rs"]
mod command;

use std::path::{Path, PathBuf};

use command::{fails, ok};
use serde_json::Value;
use voxsight::render::id_colour;

fn json(args: &[&str]) -> Value {
    serde_json::from_str(&ok(args)).unwrap()
}

/// A folder with a small plant, its scene, and a camera.
struct Sample {
    _folder: tempfile::TempDir,
    root: PathBuf,
}

impl Sample {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().to_owned();
        let sample = Sample { _folder: folder, root };
        let (model, scene) = (sample.path("plant.glb"), sample.path("plant.vxs"));
        ok(&["generate", "plant", "--objects", "200", "--triangles", "40k", "-q", "-o", &model]);
        ok(&["build", &model, "-q", "--resolution", "512", "-o", &scene]);
        let camera =
            r#"{"eye":[30,12,30],"target":[8,3,10],"up":[0,1,0],"fov_y_deg":60,"width":120,"height":80}"#;
        std::fs::write(sample.path("camera.json"), camera).unwrap();
        sample
    }

    fn path(&self, name: &str) -> String {
        self.root.join(name).to_str().unwrap().to_owned()
    }
}

#[test]
fn the_main_job_works_from_the_command_line() {
    let sample = Sample::new();
    let (scene, camera) = (sample.path("plant.vxs"), sample.path("camera.json"));

    let info = json(&["info", &scene, "--json", "--tree"]);
    assert_eq!(info["sources"][0]["name"], "plant.glb");
    assert!(info["bounds"]["min"][1].as_f64().unwrap() < info["bounds"]["max"][1].as_f64().unwrap());
    let objects = info["counts"]["objects"].as_u64().unwrap();
    assert!((180..=220).contains(&objects), "{objects}");
    assert_eq!(info["tree"].as_array().unwrap().len() as u64, info["counts"]["nodes"].as_u64().unwrap());
    assert!(ok(&["info", &scene]).contains("512^3"));
    assert!(ok(&["verify", &scene, "-q"]).contains("is sound"));

    let found = json(&["find", &scene, "pAVing", "--json", "--limit", "3"]);
    assert!(found.as_array().is_some_and(|found| !found.is_empty() && found.len() <= 3), "{found}");

    let answer = sample.path("answer.json");
    let mut seen = Vec::new();
    for method in ["hybrid", "exact", "voxel", "frustum"] {
        ok(&["visible", &scene, "--camera", &camera, "--method", method, "--check", "-q", "--json", &answer]);
        let value: Value = serde_json::from_slice(&std::fs::read(&answer).unwrap()).unwrap();
        assert_eq!(value["method"], method);
        assert_eq!(value["rays"], if method == "frustum" { 0 } else { 120 * 80 });
        assert!(value["accuracy"]["lost_pixels"].as_f64().unwrap() < 0.02, "{method}: {}", value["accuracy"]);
        let list = value["objects"].as_array().unwrap().clone();
        assert!(list.windows(2).all(|w| w[0]["samples"].as_u64() >= w[1]["samples"].as_u64()));
        seen.push(list);
    }
    assert_eq!(seen[0], seen[1], "hybrid and exact differ");
    assert!(seen[0].len() > 20, "the camera sees {} objects", seen[0].len());

    // The id picture shows the objects that the query found, pixel for pixel, but for those behind glass.
    let picture = sample.path("ids.png");
    ok(&["render", &scene, "--camera", &camera, "--ids", "-q", "-o", &picture]);
    let ids = image::open(&picture).unwrap().into_rgb8();
    assert_eq!(ids.dimensions(), (120, 80));
    let first = &seen[1][0];
    let colour = id_colour(first["id"].as_u64().unwrap() as u32);
    let pixels = ids.pixels().filter(|pixel| pixel.0 == colour).count() as u64;
    let samples = first["samples"].as_u64().unwrap();
    assert!(pixels <= samples && pixels * 10 >= samples * 9, "{pixels} pixels, {samples} samples");
}

#[test]
fn pictures_have_the_size_asked_for_and_show_something() {
    let sample = Sample::new();
    let (scene, camera) = (sample.path("plant.vxs"), sample.path("camera.json"));
    for (name, flags) in [
        ("sun.png", vec!["--spp", "1", "--shadows", "voxel"]),
        ("exact.png", vec!["--spp", "1", "--shadows", "exact", "--sun", "-1,2,0.5"]),
        ("head.png", vec!["--light", "headlight"]),
        ("depth.png", vec!["--depth"]),
    ] {
        let picture = sample.path(name);
        let mut args = vec!["render", &scene, "--camera", &camera, "--size", "64x48", "-q", "-o", &picture];
        args.extend(flags);
        ok(&args);
        let image = image::open(&picture).unwrap().into_rgb8();
        assert_eq!(image.dimensions(), (64, 48), "{name}");
        let mut colours: Vec<[u8; 3]> = image.pixels().map(|pixel| pixel.0).collect();
        colours.sort_unstable();
        colours.dedup();
        assert!(colours.len() > 50, "{name} has {} colours", colours.len());
    }
    // Without a camera the whole scene is seen, and the camera can be kept.
    let (overview, kept) = (sample.path("overview.png"), sample.path("kept.json"));
    ok(&["render", &scene, "--size", "40x30", "-q", "--save-camera", &kept, "-o", &overview]);
    assert!(Path::new(&overview).exists());
    assert!(ok(&["visible", &scene, "--camera", &kept, "-q"]).contains("objects visible"));
}

#[test]
fn the_demo_writes_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    let text = ok(&["demo", "-q", "--out", out.to_str().unwrap(), "--resolution", "512", "--size", "96x60"]);
    for word in ["hybrid", "exact", "lost pixels", "wrongly hidden"] {
        assert!(text.contains(word), "{text}");
    }
    for file in ["plant.vxs", "inside.json", "inside.png", "overview.png", "inside-accuracy.json"] {
        assert!(out.join(file).exists(), "{file} is missing");
    }
}

#[test]
fn a_folder_of_models_and_copies_of_one_are_built() {
    let sample = Sample::new();
    let (model, copies, scene) = (sample.path("plant.glb"), sample.path("copies"), sample.path("copies.vxs"));
    ok(&["generate", "copies", &model, "--copies", "3", "--overlap", "0.8", "-q", "-o", &copies]);
    ok(&["build", &copies, "-q", "--resolution", "256", "-o", &scene]);
    let one = json(&["info", &sample.path("plant.vxs"), "--json"]);
    let three = json(&["info", &scene, "--json"]);
    let count = |info: &Value, what: &str| info["counts"][what].as_u64().unwrap();
    assert_eq!(count(&three, "objects"), 3 * count(&one, "objects"));
    assert_eq!(count(&three, "placed_triangles"), 3 * count(&one, "placed_triangles"));
    assert_eq!(three["sources"].as_array().unwrap().len(), 3);
}

#[test]
fn settings_are_recorded() {
    let sample = Sample::new();
    let scene = sample.path("mm.vxs");
    let flags =
        ["--unit", "mm", "--up", "x", "--voxel-size", "1in", "--no-lod", "--max-position-error", "0.5"];
    let (model, report) = (sample.path("plant.glb"), sample.path("report.json"));
    let mut args = vec!["build", &model, "-q", "-o", &scene, "--report", &report, "--json"];
    args.extend(flags);
    let printed = json(&args);
    let written: Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    assert_eq!(printed, written);
    assert!(
        written["stages"].as_array().unwrap().iter().all(|stage| stage["seconds"].as_f64().unwrap() >= 0.0)
    );
    let info = json(&["info", &scene, "--json"]);
    assert_eq!(info["settings"]["unit"], "mm");
    assert_eq!(info["settings"]["up"], "X");
    assert_eq!(info["settings"]["lod"], false);
    assert!((info["grid"]["voxel_size"].as_f64().unwrap() - 25.4).abs() < 1e-9);
    assert_eq!(info["counts"]["levels"], info["counts"]["chunks"]);
}

#[test]
fn trouble_is_told_with_a_reason_and_an_exit_code() {
    let sample = Sample::new();
    let (model, scene, camera) =
        (sample.path("plant.glb"), sample.path("plant.vxs"), sample.path("camera.json"));
    let (missing, out) = (sample.path("missing.glb"), sample.path("out.vxs"));
    assert!(fails(&["build", &missing, "-o", &out], 1).contains("missing.glb"));
    assert!(!Path::new(&out).exists());
    fails(&["build", &model], 2);
    assert!(fails(&["build", &model, "--resolution", "1000", "-o", &out], 2).contains("power of two"));
    assert!(
        fails(&["build", &model, "--voxel-size", "1", "--resolution", "512", "-o", &out], 2)
            .contains("cannot be used")
    );
    assert!(fails(&["build", &model, "--voxel-size", "1um", "-o", &out], 1).contains("131,072"));
    assert!(fails(&["build", &model, "--memory", "1M", "-o", &out], 1).contains("memory"));
    assert!(fails(&["info", &model], 1).contains("GLB"));
    assert!(fails(&["find", &scene, "no such part"], 1).contains("no such part"));
    assert!(fails(&["visible", &scene, "--camera", &scene], 1).contains("plant.vxs"));
    std::fs::write(
        &camera,
        r#"{"eye":[0,0,0],"target":[0,0,0],"up":[0,1,0],"fov_y_deg":60,"width":9,"height":9}"#,
    )
    .unwrap();
    assert!(fails(&["visible", &scene, "--camera", &camera], 1).contains("target"));
    assert!(fails(&["render", &scene, "-o", "picture.jpg"], 2).contains(".png"));
    // Nothing is replaced by mistake, and a missing folder is noticed before the work.
    assert!(fails(&["build", &model, "-o", &model], 2).contains(".vxs"));
    assert!(fails(&["visible", &scene, "--json", &scene], 2).contains(".json"));
    let nowhere = sample.path("missing/answer.json");
    assert!(fails(&["visible", &scene, "--json", &nowhere], 1).contains("no folder"));
    assert!(fails(&["generate", "plant", "-o", "plant.obj"], 2).contains(".glb"));
    fails(&["generate", "copies", &model, "--copies", "0", "-o", &out], 2);
    fails(&["render", &scene, "--ids", "--spp", "2", "-o", "picture.png"], 2);
    let no_shadow = ["render", &scene, "--light", "headlight", "--shadows", "exact", "-o", "picture.png"];
    assert!(fails(&no_shadow, 2).contains("headlight"));
    let error = fails(&["generate", "copies", &model, "--copies", "2", "--overlap=-1", "-o", &out], 1);
    assert!(error.contains("overlap"), "{error}");
}
