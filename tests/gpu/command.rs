//! `voxsight walk`, as a user runs it.

use super::command_line::{fails, ok};
use super::context;

/// A small plant, built by the command itself.
struct Sample(tempfile::TempDir);

impl Sample {
    fn new() -> Self {
        let sample = Sample(tempfile::tempdir().unwrap());
        let (model, scene) = (sample.path("plant.glb"), sample.path("plant.vxs"));
        ok(&["generate", "plant", "--objects", "300", "--triangles", "20k", "-q", "-o", &model]);
        ok(&["build", &model, "-o", &scene, "--resolution", "512", "-q"]);
        sample
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }
}

#[test]
fn a_walk_writes_a_table_pictures_and_a_summary() {
    if context().is_none() {
        return;
    }
    let sample = Sample::new();
    let (scene, csv, frames) =
        (sample.path("plant.vxs"), sample.path("walk.csv"), sample.path("f-{frame}.png"));
    let exact = ["--latency", "none", "--pixel-error", "0", "--rays", "1", "--check"];
    let mut args =
        vec!["walk", &scene, "--walk", "8", "--size", "96x64", "--csv", &csv, "-o", &frames, "--json"];
    args.extend(exact);
    let summary: serde_json::Value = serde_json::from_str(&ok(&args)).unwrap();
    assert!(
        summary["stages"].as_array().unwrap().iter().any(|stage| stage["name"] == "geometry"),
        "{summary}"
    );
    assert_eq!(summary["missing_late"], 0);
    // The first frame is a cut: it and those soon after it are told apart.
    assert!(summary["check"]["differ_after_cuts"].is_number(), "{summary}");
    assert!(summary["check"]["settled"]["differ_worst"].as_f64().unwrap() < 0.02, "{summary}");
    let table = std::fs::read_to_string(&csv).unwrap();
    let columns = table.lines().next().unwrap().split(',').count();
    assert_eq!(table.lines().count(), 9);
    assert!(table.lines().all(|line| line.split(',').count() == columns), "{table}");
    for frame in 0..8 {
        let picture = image::open(sample.path(&format!("f-000{frame}.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (96, 64));
    }
    // The last frame has had time to load what it sees.
    let last: Vec<&str> = table.lines().last().unwrap().split(',').collect();
    let value = |name: &str| -> f64 {
        let at = table.lines().next().unwrap().split(',').position(|column| column == name).unwrap();
        last[at].parse().unwrap()
    };
    assert!(value("check_lost") == 0.0 && value("drawn") > 0.0 && value("resident") > 0.0, "{last:?}");
    // Shadows, figures for people, and all of it in a folder that need not be there.
    let out = sample.path("results/walk");
    let mut shadowed = vec!["walk", &scene, "--walk", "2", "--size", "64x64", "--shadows", "voxel"];
    shadowed.extend(["--streaming", "each", "--out", &out, "--budget-triangles", "100k"]);
    let told = ok(&shadowed);
    assert_eq!(std::fs::read_to_string(format!("{out}/walk.csv")).unwrap().lines().count(), 3);
    let kept = std::fs::read_to_string(format!("{out}/walk.json")).unwrap();
    let kept: serde_json::Value = serde_json::from_str(&kept).unwrap();
    assert_eq!(kept["triangle_budget"], 100_000);
    assert!(told.contains("shadow") && told.contains("resident"), "{told}");
    // None of two frames has settled: that is no agreement.
    let told = ok(&["walk", &scene, "--walk", "2", "--size", "64x64", "--check"]);
    assert!(told.contains("no frame is later") && !told.contains("(worst frame"), "{told}");
}

#[test]
fn walks_that_cannot_be_are_refused_with_a_reason() {
    let sample = Sample::new();
    let scene = sample.path("plant.vxs");
    let with = |args: &[&str], code: i32| {
        let mut all = vec!["walk", &scene];
        all.extend(args);
        fails(&all, code)
    };
    assert!(with(&[], 2).contains("--path"));
    assert!(with(&["--walk", "2", "-o", "picture.png"], 2).contains("{frame}"));
    assert!(with(&["--walk", "2", "--shadows", "exact"], 2).contains("voxel"));
    assert!(with(&["--walk", "2", "--budget", "1K"], 2).contains("64K"));
    assert!(with(&["--walk", "2", "--csv", &scene], 2).contains(".csv"));
    assert!(with(&["--walk", "2", "--adapter", "no such"], 1).contains("no such"));
    assert!(with(&["--path", &sample.path("missing.json")], 1).contains("missing.json"));
    if context().is_some() {
        assert!(with(&["--walk", "2", "--size", "32x32", "--frames", "5-9"], 2).contains("0-1"));
    }
}
