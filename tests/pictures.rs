//! Pictures in files: that they hold what was rendered, that interrupted ones go on, and that sequences can be split.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

#[path = "common/command.rs"]
mod command;
mod common;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use command::{fails, ok};
use common::{build_model, load, random_model};
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers};
use glam::DVec3;
use voxsight::camera::{Camera, CameraRays};
use voxsight::loaded::LoadedScene;
use voxsight::progress::{Progress, Silent};
use voxsight::render::file::{
    Fingerprint, Format, PictureError, Written, depth_range_of, render_to_file, render_to_stream, unfinished,
};
use voxsight::render::{Film, Lighting, NOBODY, RenderSettings, Renderer, Shadows, id_colour};

struct Sample {
    folder: tempfile::TempDir,
    loaded: LoadedScene,
    settings: RenderSettings,
}

impl Sample {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.vxs");
        build_model(random_model(3, 50, DVec3::ZERO), 7, &path);
        let settings = RenderSettings {
            samples_per_pixel: 2,
            lighting: Lighting::sunny(DVec3::new(0.3, 1.0, 0.2)),
            shadows: Shadows::HYBRID,
            up: DVec3::Y,
            seed: 0,
        };
        Sample { loaded: load(&path), settings, folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn camera(width: u32, height: u32) -> CameraRays {
        Camera::around(DVec3::ZERO, DVec3::splat(20.0), DVec3::ONE, DVec3::Y, width, height).rays().unwrap()
    }

    fn film(&self, camera: &CameraRays) -> Film {
        let picture = self.loaded.picture();
        Renderer::new(&picture, camera, &self.settings).rows(0..camera.size().1, &Silent).unwrap().0
    }

    fn write(
        &self,
        camera: &CameraRays,
        name: &str,
        format: Format,
        progress: &dyn Progress,
    ) -> Result<Written, PictureError> {
        let picture = self.loaded.picture();
        let renderer = Renderer::new(&picture, camera, &self.settings);
        let object_of = |drawable| self.loaded.scene().drawable_object(drawable);
        render_to_file(&renderer, &self.path(name), format, Fingerprint(17), &object_of, progress)
    }
}

#[test]
fn files_hold_the_pixels_that_were_rendered() {
    let sample = Sample::new();
    let camera = Sample::camera(75, 50);
    let film = sample.film(&camera);
    for (name, format) in [("8.png", Format::Png8), ("16.png", Format::Png16), ("p.exr", Format::Exr)] {
        let written = sample.write(&camera, name, format, &Silent).unwrap();
        assert!(matches!(written, Written::New { resumed_rows: 0, .. }), "{written:?}");
    }
    assert_eq!(image::open(sample.path("8.png")).unwrap().to_rgb8(), film.to_rgb8());
    let deep = image::open(sample.path("16.png")).unwrap();
    assert_eq!(deep.color(), image::ColorType::Rgb16);
    for (deep, shallow) in deep.to_rgb16().pixels().zip(film.to_rgb8().pixels()) {
        for (deep, shallow) in deep.0.iter().zip(shallow.0) {
            assert!((f64::from(*deep) / 257.0 - f64::from(shallow)).abs() <= 0.51, "{deep} {shallow}");
        }
    }
    let read = exr::image::read::read().no_deep_data().largest_resolution_level().all_channels();
    let read = read.first_valid_layer().all_attributes().from_file(sample.path("p.exr")).unwrap();
    let channel = |name: &str| {
        let channels = &read.layer_data.channel_data.list;
        &channels.iter().find(|channel| channel.name.to_string() == name).unwrap().sample_data
    };
    let floats = |name: &str| -> Vec<f32> { channel(name).values_as_f32().collect() };
    let colours = [floats("R"), floats("G"), floats("B")];
    let normals = [floats("N.X"), floats("N.Y"), floats("N.Z")];
    let depth = floats("Z");
    let FlatSamples::U32(ids) = channel("id") else { panic!("ids are integers") };
    let mut seen = 0;
    for (i, pixel) in film.pixels.iter().enumerate() {
        for k in 0..3 {
            let near = |read: f32, film: f32| (read - film).abs() <= 1e-3 * film.abs().max(0.1);
            assert!(
                near(colours[k][i], pixel.colour[k]) && near(normals[k][i], pixel.normal[k]),
                "pixel {i}"
            );
        }
        assert_eq!(depth[i], pixel.depth);
        let id = match pixel.drawable {
            NOBODY => NOBODY,
            drawable => sample.loaded.scene().drawable_object(drawable),
        };
        assert_eq!(ids[i], id, "pixel {i}");
        seen += u32::from(id != NOBODY);
    }
    assert!(seen > 150, "{seen}");
}

#[test]
fn ids_and_depths_are_what_a_click_on_each_pixel_would_find() {
    let mut sample = Sample::new();
    sample.settings = RenderSettings::middles(DVec3::Y);
    // Several bands.
    let camera = Sample::camera(20_000, 120);
    for (name, format) in [("ids.png", Format::Ids), ("depth.png", Format::Depth)] {
        let stop = StopAfter { pixels: 20_000 * 60, done: AtomicU64::new(0) };
        let stopped = sample.write(&camera, name, format, &stop).unwrap_err();
        assert!(matches!(stopped, PictureError::Stopped { done: 1.., .. }), "{stopped}");
        let written = sample.write(&camera, name, format, &Silent).unwrap();
        assert!(matches!(written, Written::New { resumed_rows: 1.., .. }), "{written:?}");
    }
    let ids = image::open(sample.path("ids.png")).unwrap().into_rgb8();
    let depths = image::open(sample.path("depth.png")).unwrap().into_luma16();
    let range = depth_range_of(&sample.path("depth.png")).unwrap();
    let (near, far) = (f64::from(range.near), f64::from(range.far));
    assert!(near > 1.0 && far > near, "{range:?}");
    let (query, mut seen) = (sample.loaded.query(), 0);
    for (x, y) in (0..120).flat_map(|y| (9_900..10_100).map(move |x| (x, y))) {
        let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let hit = query.exact.closest(&ray, query.filter);
        let id = hit.map_or([0; 3], |hit| id_colour(sample.loaded.scene().drawable_object(hit.drawable)));
        assert_eq!(ids.get_pixel(x, y).0, id, "{x}, {y}");
        let grey = hit.map_or(0.0, |hit| 1.0 + (hit.t - near) / (far - near) * 65_534.0);
        let found = f64::from(depths.get_pixel(x, y).0[0]);
        assert!((found - grey).abs() < 0.6, "{x}, {y}: {found}, expected {grey}");
        seen += u32::from(hit.is_some());
    }
    assert!(seen > 500, "{seen}");
}

/// Stops when so many pixels are done.
struct StopAfter {
    pixels: u64,
    done: AtomicU64,
}

impl Progress for StopAfter {
    fn stage(&self, _name: &str, _total: u64, _unit: &str) {}
    fn advance(&self, count: u64) {
        self.done.fetch_add(count, Ordering::Relaxed);
    }
    fn is_cancelled(&self) -> bool {
        self.done.load(Ordering::Relaxed) >= self.pixels
    }
}

#[test]
fn an_interrupted_picture_goes_on_and_comes_out_the_same() {
    let sample = Sample::new();
    // Wide enough for several bands.
    let camera = Sample::camera(20_000, 120);
    let settings = RenderSettings { samples_per_pixel: 1, shadows: Shadows::None, ..sample.settings.clone() };
    let sample = Sample { settings, ..sample };
    for (format, name) in [(Format::Png8, "a.png"), (Format::Exr, "a.exr")] {
        let whole = format!("whole-{name}");
        sample.write(&camera, &whole, format, &Silent).unwrap();
        let whole = std::fs::read(sample.path(&whole)).unwrap();
        let part = || {
            let names = std::fs::read_dir(sample.folder.path()).unwrap().map(|entry| entry.unwrap().path());
            let mut parts: Vec<PathBuf> =
                names.filter(|path| path.extension().is_some_and(|e| e == "part")).collect();
            assert!(parts.len() < 2, "{parts:?}");
            parts.pop()
        };
        let stop = StopAfter { pixels: 20_000 * 60, done: AtomicU64::new(0) };
        let stopped = sample.write(&camera, name, format, &stop).unwrap_err();
        let PictureError::Stopped { done, rows, .. } = stopped else { panic!("{stopped}") };
        assert!(rows == 120 && done > 0 && done < rows, "{done} of {rows}");
        let part_path = part().unwrap();
        assert!(!sample.path(name).exists());
        // A job that was killed in the middle of a band leaves something behind it; a torn disk, a wrong byte.
        let mut bytes = std::fs::read(&part_path).unwrap();
        bytes.extend([1, 2, 3]);
        std::fs::write(&part_path, &bytes).unwrap();
        let written = sample.write(&camera, name, format, &Silent).unwrap();
        assert!(matches!(written, Written::New { resumed_rows, .. } if resumed_rows == done), "{written:?}");
        assert!(std::fs::read(sample.path(name)).unwrap() == whole, "{name} differs");
        assert_eq!(part(), None);
        assert_eq!(sample.write(&camera, name, format, &Silent).unwrap(), Written::Before);

        std::fs::remove_file(sample.path(name)).unwrap();
        let last = bytes.len() - 40;
        bytes[last] ^= 1;
        std::fs::write(&part_path, &bytes).unwrap();
        let written = sample.write(&camera, name, format, &Silent).unwrap();
        assert!(matches!(written, Written::New { resumed_rows, .. } if resumed_rows < done), "{written:?}");
        assert!(std::fs::read(sample.path(name)).unwrap() == whole, "{name} differs");
        // A picture that was cut short in a copy is no picture; a part file that a killed job forgot goes.
        std::fs::write(sample.path(name), &whole[..whole.len() - 5]).unwrap();
        std::fs::write(&part_path, b"VXSPART1 cut short").unwrap();
        let written = sample.write(&camera, name, format, &Silent).unwrap();
        assert!(matches!(written, Written::New { resumed_rows: 0, .. }), "{written:?}");
        assert!(std::fs::read(sample.path(name)).unwrap() == whole, "{name} differs");
        std::fs::write(&part_path, &bytes).unwrap();
        assert_eq!(sample.write(&camera, name, format, &Silent).unwrap(), Written::Before);
        assert_eq!(part(), None);
        // Somebody else's file is left alone.
        std::fs::remove_file(sample.path(name)).unwrap();
        std::fs::write(&part_path, b"notes").unwrap();
        let foreign = sample.write(&camera, name, format, &Silent).unwrap_err();
        assert!(matches!(foreign, PictureError::Foreign(_)), "{foreign}");
        assert_eq!(std::fs::read(&part_path).unwrap(), b"notes");
        std::fs::remove_file(&part_path).unwrap();
    }
}

#[test]
fn a_picture_of_another_format_leaves_an_unfinished_one_alone() {
    let mut sample = Sample::new();
    sample.settings = RenderSettings::middles(DVec3::Y);
    let camera = Sample::camera(20_000, 120);
    let formats = [Format::Png8, Format::Png16, Format::Ids, Format::Depth];
    let rows: Vec<u32> = formats
        .iter()
        .map(|&format| {
            let stop = StopAfter { pixels: 20_000 * 60, done: AtomicU64::new(0) };
            let stopped = sample.write(&camera, "a.png", format, &stop).unwrap_err();
            let PictureError::Stopped { done, part, .. } = stopped else { panic!("{stopped}") };
            assert!(done > 0 && part.exists());
            done
        })
        .collect();
    assert_eq!(unfinished(&sample.path("a.png")).len(), 4);
    for (&format, rows) in formats.iter().zip(rows) {
        let written = sample.write(&camera, "a.png", format, &Silent).unwrap();
        assert!(matches!(written, Written::New { resumed_rows, .. } if resumed_rows == rows), "{written:?}");
    }
    assert_eq!(unfinished(&sample.path("a.png")).len(), 0);
}

#[test]
fn a_stream_gets_the_pixels_of_the_file() {
    let sample = Sample::new();
    let camera = Sample::camera(75, 50);
    let picture = sample.loaded.picture();
    let renderer = Renderer::new(&picture, &camera, &sample.settings);
    let object_of = |drawable| sample.loaded.scene().drawable_object(drawable);
    for format in [Format::Png8, Format::Png16, Format::Ids] {
        sample.write(&camera, "file.png", format, &Silent).unwrap();
        let mut bytes = Vec::new();
        render_to_stream(&renderer, format, &object_of, &mut bytes, &Silent).unwrap();
        let streamed = image::load_from_memory(&bytes).unwrap();
        assert_eq!(streamed, image::open(sample.path("file.png")).unwrap(), "{format:?}");
    }
    for format in [Format::Exr, Format::Depth] {
        render_to_stream(&renderer, format, &object_of, &mut Vec::new(), &Silent).unwrap_err();
    }
}

#[test]
fn two_jobs_do_not_make_one_picture() {
    let sample = Sample::new();
    let camera = Sample::camera(16, 16);
    // Its name tells the fingerprint: let a job that is stopped at once make one.
    let stop = StopAfter { pixels: 0, done: AtomicU64::new(0) };
    let stopped = sample.write(&camera, "p.png", Format::Png8, &stop).unwrap_err();
    let PictureError::Stopped { part, .. } = stopped else { panic!("{stopped}") };
    let part = std::fs::File::open(part).unwrap();
    part.lock().unwrap();
    let busy = sample.write(&camera, "p.png", Format::Png8, &Silent).unwrap_err();
    assert!(matches!(busy, PictureError::Busy(_)), "{busy}");
    drop(part);
    sample.write(&camera, "p.png", Format::Png8, &Silent).unwrap();
}

// --- The command ---

const PATH: &str = r#"{"keyframes":[
    {"t":0,"eye":[40,30,50],"target":[10,10,10],"up":[0,1,0],"fov_y_deg":40,"width":40,"height":30},
    {"t":0.3,"eye":[50,25,30],"target":[10,10,10],"up":[0,1,0],"fov_y_deg":40,"width":40,"height":30}],"fps":30}"#;

fn frames(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<(String, Vec<u8>)> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap())
        .map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap()))
        .collect();
    files.sort();
    files
}

#[test]
fn shards_of_a_sequence_are_the_frames_of_the_whole() {
    let sample = Sample::new();
    let scene = sample.path("scene.vxs");
    let (scene, path) = (scene.to_str().unwrap(), sample.path("path.json"));
    std::fs::write(&path, PATH).unwrap();
    let path = path.to_str().unwrap();
    let render = |folder: &str, frames: Option<&str>, threads: &str| {
        std::fs::create_dir_all(sample.path(folder)).unwrap();
        let output = sample.path(folder).join("frame-{frame}.png");
        let mut args = vec!["render", scene, "--path", path, "--spp", "2", "--sky", "occluded", "-q"];
        args.extend(["--threads", threads, "-o", output.to_str().unwrap()]);
        args.extend(frames.iter().flat_map(|frames| ["--frames", frames]));
        ok(&args)
    };
    let told = render("whole", None, "2");
    assert!(told.contains("frames 0 to 9: 10 rendered, 0 were there"), "{told}");
    for (shard, threads) in [("7-9", "1"), ("0-2", "2"), ("3", "1"), ("4-6", "2")] {
        render("shards", Some(shard), threads);
    }
    let whole = frames(&sample.path("whole"));
    assert!(whole == frames(&sample.path("shards")), "shards differ");
    assert_eq!(whole.len(), 10);
    assert_eq!(whole[9].0, "frame-0009.png");
    assert_ne!(whole[0].1, whole[9].1);
    let again = render("whole", None, "2");
    assert!(again.contains("0 rendered, 10 were there"), "{again}");
}

#[test]
fn bad_flags_are_refused_before_the_work() {
    let sample = Sample::new();
    let scene = sample.path("scene.vxs");
    let scene = scene.to_str().unwrap();
    let file = |name: &str, text: &str| {
        std::fs::write(sample.path(name), text).unwrap();
        sample.path(name).to_str().unwrap().to_owned()
    };
    let path = file("path.json", PATH);
    let areas =
        file("areas.json", r#"[{"corner":[0,0,0],"edge_u":[1,0,0],"edge_v":[2,0,0],"radiance":[1,1,1]}]"#);
    let no_areas = file("none.json", "[]");
    let out = sample.path("out.png").to_str().unwrap().to_owned();
    let exr = sample.path("out.exr").to_str().unwrap().to_owned();
    let numbered = sample.path("out-{frame}.png").to_str().unwrap().to_owned();
    for (args, expected, code) in [
        (vec!["--path", &path, "-o", &out], "{frame}", 2),
        (vec!["--path", &path, "-o", &numbered, "--frames", "5-12"], "frames 0 to 9", 1),
        (vec!["--path", &path, "-o", &numbered, "--frames", "5-2"], "0-299", 2),
        (vec!["--frames", "1-2", "-o", &out], "--path", 2),
        (vec!["-o", &out, "--sun-angle", "190"], "0 to 180", 2),
        (vec!["-o", &out, "--shadow-tolerance", "2"], "0 to 1", 2),
        (vec!["-o", &out, "--shadows", "exact", "--shadow-tolerance", "0.5"], "hybrid", 2),
        (vec!["-o", &out, "--sky-reach", "3m"], "occluded", 2),
        (vec!["-o", &out, "--light", "headlight", "--sky", "occluded"], "headlight", 2),
        (vec!["-o", &out, "--light", "none", "--sun", "0,1,0"], "--light sun", 2),
        (vec!["-o", &out, "--areas", &areas], "no area", 1),
        (vec!["-o", &out, "--spp", "1,2"], "--report", 2),
        (vec!["-o", &out, "--spp", "70000"], "65536", 2),
        (vec!["-o", &exr, "--bits", "16"], "--bits", 2),
        (vec!["-o", "-", "--depth"], "need a file", 2),
        (vec!["-o", &out, "--sky", "occluded", "--shadows", "none"], "--shadows none", 2),
        (vec!["-o", &out, "--light", "headlight", "--shadow-tolerance", "0.5"], "headlight", 2),
        (vec!["-o", &out, "--light", "none", "--areas", &no_areas], "no rectangle", 1),
        (vec!["-o", &out, "--fill", "2"], "0 to 1", 2),
        (vec!["-o", &out, "--light", "none", "--sky", "none"], "nothing shines", 2),
        (vec!["-o", &out, "--sun", "0,0,0"], "a direction", 2),
        (vec!["-o", "picture.jpg"], ".png or .exr", 2),
        (vec![], "--output", 2),
    ] {
        let args: Vec<&str> = ["render", scene].into_iter().chain(args).collect();
        let error = fails(&args, code);
        assert!(error.contains(expected), "{args:?}: {error}");
    }
    assert!(!sample.path("out.png").exists());
}

#[test]
fn a_report_of_shadows_says_what_each_way_costs_and_gets_wrong() {
    let sample = Sample::new();
    let fine = sample.path("fine.vxs");
    build_model(random_model(3, 50, DVec3::ZERO), 9, &fine);
    let (scene, fine) = (sample.path("scene.vxs"), fine);
    let folder = sample.path("report");
    let told = ok(&[
        "render",
        scene.to_str().unwrap(),
        fine.to_str().unwrap(),
        "--report",
        folder.to_str().unwrap(),
        "--spp",
        "1,4",
        "--size",
        "80x60",
        "--sky",
        "occluded",
        "-q",
    ]);
    assert!(told.contains("hybrid 512") && told.contains("sky"), "{told}");
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("report.json")).unwrap()).unwrap();
    for file in report["files"].as_array().unwrap() {
        assert!(folder.join(file.as_str().unwrap()).metadata().unwrap().len() > 0, "{file}");
    }
    let pictures = report["pictures"].as_array().unwrap();
    assert_eq!(pictures.len(), 2 * (1 + 2 * 2));
    let error = |shadows: &str, resolution: u64, figure: &str| {
        let is = |p: &&serde_json::Value| {
            p["shadows"] == shadows && p["resolution"] == resolution && p["samples_per_pixel"] == 4
        };
        let sun = &pictures.iter().find(is).unwrap()["lights"][0];
        assert_eq!(sun["light"], "sun");
        sun["same_samples"][figure].as_f64().unwrap()
    };
    let (coarse, fine) = (error("voxel", 128, "mean_error"), error("voxel", 512, "mean_error"));
    assert!(fine > 0.0 && fine < 0.5 * coarse, "finer voxels are better: {coarse} {fine}");
    assert!(error("hybrid", 128, "mean_error") < 0.2 * coarse);
    let exact = pictures.iter().filter(|p| p["shadows"] == "exact");
    let converged: Vec<f64> =
        exact.map(|p| p["lights"][0]["converged"]["mean_error"].as_f64().unwrap()).collect();
    assert!(converged[1] < converged[0] && converged[1] > 0.0, "more samples are better: {converged:?}");
    assert_eq!(report["times"].as_array().unwrap().len(), pictures.len());
}

#[test]
fn the_render_farm_template_passes_and_runs() {
    use std::io::Write;
    use std::process::Command;
    if Command::new("openjd").arg("--version").output().is_err() {
        // Not `eprintln`, of which nothing is seen when the test passes.
        let _ = writeln!(std::io::stderr(), "SKIPPED: no openjd (pip install openjd-cli)");
        return;
    }
    let sample = Sample::new();
    let template = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/render_farm.yaml");
    let run = |args: &[&str]| {
        let output = Command::new("openjd").args(args).output().unwrap();
        let told =
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        (output.status.success(), told)
    };
    let template = template.to_str().unwrap();
    let (passed, told) = run(&["check", template]);
    assert!(passed, "{told}");
    std::fs::write(sample.path("path.json"), PATH).unwrap();
    std::fs::create_dir(sample.path("farm")).unwrap();
    let parameter = |name: &str, value: &str| format!("{name}={value}");
    let file = |name: &str| sample.path(name).to_str().unwrap().to_owned();
    let parameters = [
        parameter("Scene", &file("scene.vxs")),
        parameter("Path", &file("path.json")),
        parameter("Output", &file("farm")),
        parameter("LastFrame", "9"),
        parameter("FramesPerTask", "4"),
        parameter("Samples", "1"),
        parameter("Voxsight", env!("CARGO_BIN_EXE_voxsight")),
    ];
    let mut args = vec!["run", template];
    parameters.iter().for_each(|parameter| args.extend(["-p", parameter]));
    let (passed, told) = run(&args);
    assert!(passed, "{told}");
    // The farm's frames are those of one run.
    std::fs::create_dir(sample.path("one")).unwrap();
    let output = file("one/frame-{frame}.png");
    ok(&["render", &file("scene.vxs"), "--path", &file("path.json"), "--spp", "1", "-q", "-o", &output]);
    let farm = frames(&sample.path("farm"));
    assert_eq!(farm.len(), 10, "{told}");
    assert!(farm == frames(&sample.path("one")), "a farm renders other frames");
}
