//! Saved views, in a file beside the scene: cameras, and what was hidden, seen through and cut away.

mod nodes;
mod thumbnail;

pub use nodes::{Found, find_nodes, node_paths};
pub use thumbnail::Thumbnail;

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::atomic_file::write_whole;
use crate::camera::{Camera, CameraError, DVec3Json, Plane};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Format of the file; newer ones have higher numbers.
const FORMAT: u32 = 1;
/// The name of a view that was given none.
const UNNAMED: &str = "View";

/// A saved view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bookmark {
    /// What people call it. [`Bookmarks`] makes it unique.
    pub name: String,
    /// Where it is seen from; its size is that of the window then.
    pub camera: Camera,
    /// Assembly nodes that were hidden, as [`node_paths`] writes them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub hidden: Vec<String>,
    /// Where most was hidden: those that were not, instead; empty where `hidden` tells.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shown: Vec<String>,
    /// Those that were seen through, likewise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub xray: Vec<String>,
    /// What is on their outer sides was cut away.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub planes: Vec<SectionPlane>,
    /// What it looks like.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thumbnail: Option<Thumbnail>,
}

/// A section plane, world space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SectionPlane {
    /// A point of it.
    pub point: DVec3Json,
    /// Points to what is kept; any length but 0.
    pub normal: DVec3Json,
}

impl From<Plane> for SectionPlane {
    fn from(plane: Plane) -> Self {
        SectionPlane { point: plane.point.into(), normal: plane.normal.into() }
    }
}

impl From<SectionPlane> for Plane {
    fn from(plane: SectionPlane) -> Self {
        Plane { point: plane.point.into(), normal: plane.normal.into() }
    }
}

/// Why a view cannot be kept or used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ViewError {
    /// Nothing can be seen by it.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Nothing can be cut by it.
    #[error("a section plane needs a finite point and a finite normal that is not zero; they are {0:?}")]
    Plane(SectionPlane),
}

/// Why a file of saved views cannot be read or written. Whatever stands there is left as it is.
#[derive(Debug, thiserror::Error)]
pub enum BookmarkError {
    /// The system says no.
    #[error("{}: saved views cannot be {doing}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// `read` or `written`.
        doing: &'static str,
        /// What it says.
        source: io::Error,
    },
    /// Of a newer program.
    #[error(
        "{}: saved views of format {format}; this Voxsight reads format {FORMAT}. Use a newer Voxsight; the file is \
         left as it is", path.display()
    )]
    Newer {
        /// The file.
        path: PathBuf,
        /// As it says.
        format: u64,
    },
    /// Not a file of saved views, or not whole, or with a field that is not known.
    #[error(
        "{}: expected saved views, {{\"format\":{FORMAT},\"views\":[...]}}: {source}. Mend the file or move it away; \
         it is left as it is", path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        source: serde_json::Error,
    },
    /// A view in it cannot be used.
    #[error(
        "{}: the saved view \"{name}\": {source}. Mend the file or move it away; it is left as it is", path.display()
    )]
    View {
        /// The file.
        path: PathBuf,
        /// Of the view.
        name: String,
        /// What is wrong.
        source: ViewError,
    },
}

/// The file's format alone.
#[derive(Deserialize)]
struct FormatOnly {
    format: u64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BookmarkFile<Views> {
    format: u32,
    views: Views,
}

/// Saved views in the order that people gave them, each with a name of its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bookmarks {
    views: Vec<Bookmark>,
}

impl Bookmark {
    /// Checks the numbers.
    fn check(&self) -> Result<(), ViewError> {
        self.camera.rays()?;
        for plane in &self.planes {
            let (point, normal) = (DVec3::from(plane.point), DVec3::from(plane.normal));
            if !(point.is_finite() && normal.try_normalize().is_some()) {
                return Err(ViewError::Plane(*plane));
            }
        }
        Ok(())
    }
}

impl Bookmarks {
    /// In order.
    pub fn views(&self) -> &[Bookmark] {
        &self.views
    }

    /// Adds a view at the end; its index. If its name is taken it gets a number: a second "Pump" becomes "Pump 2".
    ///
    /// # Errors
    ///
    /// Its camera or a plane of it cannot be used.
    pub fn add(&mut self, view: Bookmark) -> Result<usize, ViewError> {
        view.check()?;
        let name = self.free_name(&view.name, None);
        self.views.push(Bookmark { name, ..view });
        Ok(self.views.len() - 1)
    }

    /// Gives a view another name, or that with a number if it is taken; the name that it has now. `None` when there is
    /// no such view.
    pub fn rename(&mut self, index: usize, name: &str) -> Option<&str> {
        let name = self.free_name(name, Some(index));
        let view = self.views.get_mut(index)?;
        view.name = name;
        Some(&view.name)
    }

    /// Takes a view out of the list.
    pub fn remove(&mut self, index: usize) -> Option<Bookmark> {
        (index < self.views.len()).then(|| self.views.remove(index))
    }

    /// The name, with a number if a view other than `own` has it.
    fn free_name(&self, name: &str, own: Option<usize>) -> String {
        let name = Some(name.trim()).filter(|name| !name.is_empty()).unwrap_or(UNNAMED);
        let is_free =
            |name: &str| self.views.iter().enumerate().all(|(i, view)| Some(i) == own || view.name != name);
        let mut free = name.to_owned();
        // Ends: there are fewer views than numbers.
        let mut number = 2u64;
        while !is_free(&free) {
            free = format!("{name} {number}");
            number += 1;
        }
        free
    }

    // --- The file ---

    /// Where the views of a scene are kept: `plant.views.json` beside `plant.vxs`.
    pub fn path_beside(scene: &Path) -> PathBuf {
        let is_scene = scene.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vxs"));
        let name = if is_scene { scene.file_stem() } else { scene.file_name() };
        let mut name = name.map(OsString::from).unwrap_or_default();
        name.push(".views.json");
        scene.with_file_name(name)
    }

    /// Reads the views; none when there is no file.
    ///
    /// # Errors
    ///
    /// The file is newer, damaged or has what cannot be used.
    pub fn load(path: &Path) -> Result<Self, BookmarkError> {
        let bytes = match fs::read(path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(source) => return Err(BookmarkError::File { path: path.into(), doing: "read", source }),
        };
        let damaged = |source| BookmarkError::Damaged { path: path.into(), source };
        // First, as a newer format may have anything else.
        let FormatOnly { format } = serde_json::from_slice(&bytes).map_err(damaged)?;
        if format > FORMAT.into() {
            return Err(BookmarkError::Newer { path: path.into(), format });
        }
        if format == 0 {
            return Err(damaged(serde::de::Error::custom("format 0 was never used")));
        }
        let file: BookmarkFile<Vec<Bookmark>> = serde_json::from_slice(&bytes).map_err(damaged)?;
        let mut bookmarks = Self::default();
        for view in file.views {
            let name = view.name.clone();
            bookmarks.add(view).map_err(|source| BookmarkError::View { path: path.into(), name, source })?;
        }
        Ok(bookmarks)
    }

    /// Reads the views, changes them, and writes them: what others have saved meanwhile stays.
    ///
    /// # Errors
    ///
    /// As [`Bookmarks::load`] and [`Bookmarks::save`]; nothing has changed then.
    pub fn change(path: &Path, change: impl FnOnce(&mut Self)) -> Result<Self, BookmarkError> {
        let mut bookmarks = Self::load(path)?;
        change(&mut bookmarks);
        bookmarks.save(path)?;
        Ok(bookmarks)
    }

    /// Writes the views, all or nothing.
    ///
    /// # Errors
    ///
    /// The file cannot be written, or what stands there could not be read: it would be lost.
    pub fn save(&self, path: &Path) -> Result<(), BookmarkError> {
        Self::load(path)?;
        let file = BookmarkFile { format: FORMAT, views: &self.views };
        let failed = |source| BookmarkError::File { path: path.into(), doing: "written", source };
        let mut text = serde_json::to_vec_pretty(&file).map_err(|error| failed(error.into()))?;
        text.push(b'\n');
        write_whole(path, &text).map_err(failed)
    }
}

#[cfg(test)]
mod tests;
