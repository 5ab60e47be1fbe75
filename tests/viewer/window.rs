//! A scripted session in a real window on a display of its own (Xvfb). Without that it says that it skips; with `REQUIRE_GPU=1` it fails.

use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use super::Sample;

/// An X server without a screen, ended with the test.
struct Display(Child, String);

impl Display {
    /// Starts one; `None` where there is none to start.
    fn start() -> Option<Self> {
        let number = format!(":{}", 90 + std::process::id() % 900);
        let server = Command::new("Xvfb")
            .args([&number, "-screen", "0", "1024x768x24", "-nolisten", "tcp"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let display = Display(server, number);
        let socket = format!("/tmp/.X11-unix/X{}", &display.1[1..]);
        for _ in 0..100 {
            if Path::new(&socket).exists() {
                return Some(display);
            }
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        None
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_scripted_session_picks_hides_cuts_remembers_and_records() {
    let Some(display) = Display::start() else {
        assert!(std::env::var_os("REQUIRE_GPU").is_none(), "REQUIRE_GPU is set, and there is no Xvfb");
        let _ = writeln!(std::io::stderr(), "SKIPPED: no Xvfb (Debian: apt-get install xvfb)");
        return;
    };
    let sample = Sample::new();
    let folder = sample.folder.path();
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let steps = serde_json::json!([
        {"do": "wait"},
        {"do": "screenshot", "file": file("first.png")},
        {"do": "search", "text": "pump"},
        {"do": "wait", "seconds": 0.5},
        {"do": "search", "text": ""},
        {"do": "click", "x": 0.5, "y": 0.55},
        {"do": "wait"},
        {"do": "expect", "selected": 1},
        {"do": "screenshot", "file": file("picked.png")},
        {"do": "hide"},
        {"do": "expect", "hidden": 1, "selected": 0},
        {"do": "wait"},
        {"do": "screenshot", "file": file("hidden.png")},
        {"do": "undo"},
        {"do": "add_section", "axis": "x", "at": 0.5},
        {"do": "add_bookmark", "name": "Cut"},
        {"do": "wait"},
        {"do": "screenshot", "file": file("cut.png")},
        {"do": "clear_sections"},
        {"do": "record", "on": true},
        {"do": "look_from", "side": "front"},
        {"do": "wait"},
        {"do": "record", "on": false},
        {"do": "export_route", "file": file("route.json")},
        {"do": "go_to_bookmark", "name": "Cut"},
        {"do": "wait"},
        {"do": "rename_bookmark", "name": "Cut", "to": "Cut open"},
        {"do": "click", "x": 0.5, "y": 0.55},
        {"do": "wait"},
        {"do": "expect", "selected": 1},
        {"do": "move", "by": [0.5, 0.0, 0.0]},
        {"do": "expect", "moved": 1},
        {"do": "wait"},
        {"do": "check_lost"},
        {"do": "wait"},
        {"do": "expect", "message": "; 0 parts of 16 pixels and more are missing"},
    ]);
    std::fs::write(file("steps.json"), steps.to_string()).unwrap();
    let scene = sample.path();
    let output = Command::new(env!("CARGO_BIN_EXE_voxsight"))
        .args(["view", scene.to_str().unwrap(), "--script", &file("steps.json"), "--size", "900x600"])
        .env("DISPLAY", &display.1)
        .env_remove("WAYLAND_DISPLAY")
        .env("XDG_CONFIG_HOME", folder)
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{told}");
    let picture = |name: &str| image::open(folder.join(name)).unwrap().to_rgb8();
    let (first, picked, hidden, cut) =
        (picture("first.png"), picture("picked.png"), picture("hidden.png"), picture("cut.png"));
    // The picture between the panels is bright: a sunny plant under a sky.
    let middle = |image: &image::RgbImage| {
        let (width, height) = image.dimensions();
        let pixels =
            (width * 2 / 5..width * 3 / 5).flat_map(|x| (height / 4..height * 3 / 4).map(move |y| (x, y)));
        pixels.map(|(x, y)| image.get_pixel(x, y).0).collect::<Vec<_>>()
    };
    let differ = |a: &image::RgbImage, b: &image::RgbImage| {
        middle(a).iter().zip(&middle(b)).filter(|(a, b)| a != b).count()
    };
    let bright =
        middle(&first).iter().filter(|[r, g, b]| u32::from(*r) + u32::from(*g) + u32::from(*b) > 200).count();
    assert!(bright > middle(&first).len() / 2, "{bright} of {} pixels are bright", middle(&first).len());
    assert!(differ(&first, &picked) > 20 && differ(&picked, &hidden) > 20 && differ(&first, &cut) > 100);
    let views = std::fs::read_to_string(folder.join("plant.views.json")).unwrap();
    assert!(views.contains("\"Cut open\"") && views.contains("thumbnail"), "{views}");
    assert!(folder.join("route.json").exists());
    assert!(!folder.join("voxsight").exists(), "a script leaves the user's preferences alone");
}
