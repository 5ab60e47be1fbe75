//! The viewer without a window: sessions, and the panels as a user clicks them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

#[path = "../common/mod.rs"]
mod common;

mod opening;
mod panels;
mod sessions;
mod trees;
mod window;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use voxsight::progress::Silent;
use voxsight::sample::{PlantSettings, plant};
use voxsight::viewer::load::open;
use voxsight::viewer::navigate::Motion;
use voxsight::viewer::preferences::Preferences;
use voxsight::viewer::session::Session;

use common::build_model;

/// A small plant in a folder of its own.
struct Sample {
    folder: tempfile::TempDir,
}

impl Sample {
    fn new() -> Self {
        let sample = Sample { folder: tempfile::tempdir().unwrap() };
        let settings = PlantSettings { objects: 300, triangles: 30_000, ..PlantSettings::default() };
        build_model(plant(&settings), 8, &sample.path());
        sample
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("plant.vxs")
    }

    fn session(&self) -> Session {
        session(&self.path())
    }
}

/// A session of a scene, with a window of 640 x 480.
fn session(path: &Path) -> Session {
    let mut session = Session::new(open(path, &Silent).unwrap(), Preferences::default(), || ()).unwrap();
    session.size = (640, 480);
    session
}

/// Lets time pass until something is so.
fn wait_for(session: &mut Session, what: &str, is_so: impl Fn(&Session) -> bool) {
    let began = Instant::now();
    while !is_so(session) {
        session.advance(Duration::from_millis(10), &Motion::default());
        assert!(began.elapsed() < Duration::from_secs(30), "{what} does not come");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Until glides are over.
fn rest(session: &mut Session) {
    session.advance(Duration::from_millis(10), &Motion::default());
    wait_for(session, "rest", |session| !session.navigator.is_gliding());
}
