//! Writes the plant to disk.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::{Area, MAX_TRIANGLES_PER_OBJECT, PlantSettings, areas, plant};
use crate::export::glb::{self, GlbError};
use crate::model::Model;
use crate::progress::Progress;

/// Why a sample could not be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SampleError {
    /// A GLB could not be written.
    #[error(transparent)]
    Glb(#[from] GlbError),
    /// A folder could not be made or read.
    #[error("could not use folder {}: {source}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The folder holds something: an older sample's files would become part of the new one.
    #[error("folder {} is not empty: give a new folder, or empty it first", path.display())]
    NotEmpty {
        /// The folder.
        path: PathBuf,
    },
    /// A setting that makes no sense.
    #[error("{what} is {value}, but must be {expected}")]
    Setting {
        /// Which one.
        what: &'static str,
        /// What it was.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WriteSummary {
    /// The files, in the order of their content.
    pub files: Vec<PathBuf>,
    /// Objects placed.
    pub objects: u64,
    /// Triangles placed, with instancing expanded.
    pub triangles: u64,
    /// Length of all files together.
    pub bytes: u64,
}

impl WriteSummary {
    pub(super) fn add(&mut self, file: PathBuf, objects: u64, triangles: u64, bytes: u64) {
        self.files.push(file);
        self.objects += objects;
        self.triangles += triangles;
        self.bytes += bytes;
    }
}

/// Writes the plant to one file (`output` ends in `.glb`) or to an empty or new folder: a GLB for each area, in a
/// folder for each row of areas, so that the folder tree is the top of the assembly tree.
///
/// A folder is streamed area by area. A single file is made in memory first, and must stay below 4 GiB. Each file is
/// complete or absent; after an error or a cancellation a folder keeps the areas written so far.
pub fn write_plant(
    settings: &PlantSettings,
    output: &Path,
    progress: &dyn Progress,
) -> Result<WriteSummary, SampleError> {
    let per_object = settings.triangles / settings.objects.max(1);
    if per_object > MAX_TRIANGLES_PER_OBJECT {
        return Err(SampleError::Setting {
            what: "triangles per object",
            value: per_object as f64,
            expected: "at most 10000: ask for more objects",
        });
    }
    let mut summary = WriteSummary::default();
    if output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("glb")) {
        refuse_what_cannot_fit(settings, output)?;
        progress.stage("planning the plant", 0, "areas");
        write_area(&plant(settings), output.to_owned(), progress, &mut summary)?;
        return Ok(summary);
    }
    empty_folder(output)?;
    for Area { plan, fineness, world_from_area, row } in areas(settings) {
        let area = plan.model(fineness, world_from_area);
        let folder = output.join(format!("ROW-{:02}", row + 1));
        std::fs::create_dir_all(&folder)
            .map_err(|source| SampleError::Folder { path: folder.clone(), source })?;
        let name = area.nodes.first().map_or("AREA", |root| &root.name);
        let file = folder.join(format!("{name}.glb"));
        write_area(&area, file, progress, &mut summary)?;
    }
    Ok(summary)
}

fn write_area(
    area: &Model,
    file: PathBuf,
    progress: &dyn Progress,
    summary: &mut WriteSummary,
) -> Result<(), SampleError> {
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    progress.stage(&format!("writing {name}"), area.unique_triangles(), "triangles");
    let bytes = glb::write_model(&file, area, progress)?;
    summary.add(file, area.objects.len() as u64, area.placed_triangles(), bytes);
    Ok(())
}

/// Says that a file is too small a thing before hours and gigabytes have been spent.
fn refuse_what_cannot_fit(settings: &PlantSettings, output: &Path) -> Result<(), GlbError> {
    // A triangle needs at least 6 bytes of indices, and 6 of the half vertex that comes with it.
    let bytes = 12 * areas(settings).map(|area| area.plan.unique_triangles(area.fineness)).sum::<u64>();
    if bytes > u64::from(u32::MAX) {
        return Err(GlbError::TooLarge { path: output.to_owned(), bytes });
    }
    Ok(())
}

/// Makes the folder, or checks that it is empty.
pub(super) fn empty_folder(path: &Path) -> Result<(), SampleError> {
    let failed = |source| SampleError::Folder { path: path.to_owned(), source };
    std::fs::create_dir_all(path).map_err(failed)?;
    if std::fs::read_dir(path).map_err(failed)?.next().is_some() {
        return Err(SampleError::NotEmpty { path: path.to_owned() });
    }
    Ok(())
}
