//! What the viewer remembers between runs, in the user's configuration folder.
//!
//! Whatever is in the file, the viewer starts: what cannot be used is its default, and is told. Fields of newer
//! versions are kept.

mod folder;

pub use folder::{System, file_path};

use std::ffi::OsString;
use std::fmt::Display;
use std::fs;
use std::io;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use crate::atomic_file::write_whole;
use crate::viewer::navigate::Mode;
use crate::visibility::RaysPerPixel;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Most recently opened scenes that are remembered.
const MOST_RECENT: usize = 12;

/// Colours of the window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WindowLook {
    /// Light on dark.
    #[default]
    Dark,
    /// Dark on light.
    Light,
}

/// What the viewer remembers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Preferences {
    /// Bytes of geometry on the GPU, at most.
    pub geometry_bytes: u64,
    /// Triangles drawn in a frame, at most.
    pub triangles: u64,
    /// By how many pixels a level of detail may be wrong; 0 for the finest only.
    pub pixel_error: f64,
    /// Rays per pixel and frame that ask what is visible; `"1/16"` in the file.
    #[serde(with = "fraction")]
    pub rays_per_pixel: RaysPerPixel,
    /// Are shadows cast?
    pub shadows: bool,
    /// Rays to each light for each pixel and frame.
    pub shadow_samples: u32,
    /// Is what sections cut open drawn as solid?
    pub caps: bool,
    /// How the camera moves at first.
    pub navigation: Mode,
    /// Vertical field of view in degrees.
    pub fov_y_deg: f64,
    /// Times the usual.
    pub mouse_speed: f64,
    /// Colours of the window.
    pub look: WindowLook,
    /// Width of the panel on the left, in points of the window.
    pub left_panel: f64,
    /// And on the right.
    pub right_panel: f64,
    recent: Vec<String>,
    /// Fields that are not known here: a newer version's.
    #[serde(flatten)]
    rest: Map<String, Value>,
}

impl Default for Preferences {
    fn default() -> Self {
        Preferences {
            geometry_bytes: 256 << 20,
            triangles: 4_000_000,
            pixel_error: 0.5,
            rays_per_pixel: RaysPerPixel::SIXTEENTH,
            shadows: false,
            shadow_samples: 1,
            caps: true,
            navigation: Mode::default(),
            fov_y_deg: 60.0,
            mouse_speed: 1.0,
            look: WindowLook::default(),
            left_panel: 280.0,
            right_panel: 320.0,
            recent: Vec::new(),
            rest: Map::new(),
        }
    }
}

/// Preferences as they were found, and what people should be told about that.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loaded {
    /// All in range.
    pub preferences: Preferences,
    /// A sentence each.
    pub notes: Vec<String>,
}

/// Why preferences were not written.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    /// The environment does not say where.
    #[error("preferences are not kept: {0} is not set, which says where the user's configuration is")]
    NoFolder(&'static str),
    /// The system says no.
    #[error("{}: preferences cannot be written: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What it says.
        source: io::Error,
    },
}

impl Preferences {
    /// Reads the user's preferences.
    pub fn load() -> Loaded {
        match file_path(System::here(), std::env::var_os) {
            Ok(path) => Self::load_from(&path),
            Err(error) => Loaded { notes: vec![error.to_string()], ..Loaded::default() },
        }
    }

    /// Writes them, all or nothing.
    ///
    /// # Errors
    ///
    /// There is no folder for them, or it cannot be written.
    pub fn save(&self) -> Result<(), SaveError> {
        self.save_to(&file_path(System::here(), std::env::var_os)?)
    }

    /// Reads preferences from a file; defaults when there is none. A damaged one is moved aside.
    pub fn load_from(path: &Path) -> Loaded {
        let told =
            |note: String| Loaded { notes: vec![format!("{}: {note}", path.display())], ..Loaded::default() };
        let bytes = match fs::read(path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Loaded::default(),
            Err(error) => return told(format!("preferences cannot be read: {error}. Defaults are used")),
        };
        match serde_json::from_slice::<Map<String, Value>>(&bytes) {
            Ok(fields) => {
                let (mut preferences, mut notes) = usable(fields);
                notes.extend(preferences.bring_into_range());
                let notes = notes.into_iter().map(|note| format!("{}: {note}", path.display()));
                Loaded { preferences, notes: notes.collect() }
            }
            Err(error) => told(match set_aside(path) {
                Ok(aside) => {
                    format!("preferences are damaged ({error}): defaults are used; see {}", aside.display())
                }
                Err(why) => format!(
                    "preferences are damaged ({error}): defaults are used; the file cannot be moved aside: {why}"
                ),
            }),
        }
    }

    /// Writes them to a file, all or nothing; its folder is made when there is none. A damaged file there is moved aside.
    ///
    /// # Errors
    ///
    /// The file cannot be written, or what stands there cannot be read.
    pub fn save_to(&self, path: &Path) -> Result<(), SaveError> {
        let mut in_range = self.clone();
        in_range.bring_into_range();
        let write = || {
            match fs::read(path) {
                Ok(bytes) if serde_json::from_slice::<Map<String, Value>>(&bytes).is_err() => {
                    set_aside(path)?;
                }
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::NotFound => {
                    path.parent().map_or(Ok(()), fs::create_dir_all)?;
                }
                Err(error) => return Err(error),
            }
            let mut text = serde_json::to_vec_pretty(&in_range)?;
            text.push(b'\n');
            write_whole(path, &text)
        };
        write().map_err(|source| SaveError::File { path: path.into(), source })
    }

    /// Recently opened scenes, newest first.
    pub fn recent(&self) -> impl Iterator<Item = &Path> {
        self.recent.iter().map(Path::new)
    }

    /// Remembers an opened scene, by its absolute path. One whose path is no Unicode is not remembered.
    pub fn remember(&mut self, scene: &Path) {
        let scene = std::path::absolute(scene).unwrap_or(scene.into());
        let Some(scene) = scene.to_str() else { return };
        self.recent.insert(0, scene.to_owned());
        self.trim_recent();
    }

    /// Forgets a scene, such as one that is no longer there.
    pub fn forget(&mut self, scene: &Path) {
        self.recent.retain(|recent| Path::new(recent) != scene);
    }

    /// Each once, where it is newest, and not too many.
    fn trim_recent(&mut self) {
        let mut seen = std::collections::HashSet::new();
        self.recent.retain(|scene| seen.insert(scene.clone()));
        self.recent.truncate(MOST_RECENT);
    }

    /// Brings all values into their ranges, and says which were not.
    pub fn bring_into_range(&mut self) -> Vec<String> {
        self.trim_recent();
        let changes = [
            limit("geometry_bytes", &mut self.geometry_bytes, 16 << 20..=1 << 40),
            limit("triangles", &mut self.triangles, 10_000..=1_000_000_000),
            limit("pixel_error", &mut self.pixel_error, 0.0..=100.0),
            limit("shadow_samples", &mut self.shadow_samples, 1..=64),
            limit("fov_y_deg", &mut self.fov_y_deg, 10.0..=120.0),
            limit("mouse_speed", &mut self.mouse_speed, 0.05..=20.0),
            limit("left_panel", &mut self.left_panel, 80.0..=4000.0),
            limit("right_panel", &mut self.right_panel, 80.0..=4000.0),
        ];
        changes.into_iter().flatten().collect()
    }
}

/// Brings a value into its range, and says so. What is no number becomes the least.
fn limit<T: PartialOrd + Copy + Display>(
    name: &str,
    value: &mut T,
    range: RangeInclusive<T>,
) -> Option<String> {
    let found = *value;
    if range.contains(&found) {
        return None;
    }
    *value = if found > *range.end() { *range.end() } else { *range.start() };
    Some(format!("{name} is {found}, expected {} to {}; {value} is used", range.start(), range.end()))
}

/// The defaults with all fields of the file that can be used, and notes about the others.
fn usable(fields: Map<String, Value>) -> (Preferences, Vec<String>) {
    let (mut preferences, mut notes) = (Preferences::default(), Vec::new());
    let mut taken = Map::new();
    // One after the other, so that one that cannot be used costs nothing but itself.
    for (name, value) in fields {
        taken.insert(name.clone(), value);
        match serde_json::from_value(Value::Object(taken.clone())) {
            Ok(with_it) => preferences = with_it,
            Err(error) => {
                taken.remove(&name);
                notes.push(format!("{name} cannot be used ({error}); its default is used"));
            }
        }
    }
    (preferences, notes)
}

/// Moves a damaged file to a name that is free; its new path.
fn set_aside(path: &Path) -> io::Result<PathBuf> {
    let aside = |ending: String| {
        let mut name = OsString::from(path);
        name.push(ending);
        PathBuf::from(name)
    };
    let mut to = aside(".damaged".into());
    // Ends: there are fewer files than numbers.
    let mut number = 2u64;
    while fs::symlink_metadata(&to).is_ok() {
        to = aside(format!(".damaged-{number}"));
        number += 1;
    }
    fs::rename(path, &to)?;
    Ok(to)
}

/// Rays per pixel as people write them.
mod fraction {
    use crate::visibility::RaysPerPixel;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(rays: &RaysPerPixel, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(rays)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<RaysPerPixel, D::Error> {
        String::deserialize(from)?.parse().map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests;
