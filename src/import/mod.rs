//! Reads files into a [`Model`]: glTF/GLB, OBJ with MTL, PLY, STL, and folders of them.
//!
//! ```text
//! files      finds the models (and refuses what lies outside their folders)
//! detect     content and extension say the format
//! gltf obj ply stl   one reader a format, each makes a draft: parts, nodes, objects of one file
//! repair     drops triangles that break the promises of `model`, counted
//! assembly   joins the drafts; equal parts are stored once
//! ```
//!
//! **Nothing is trusted.** Every count is checked against the bytes that are there before memory is taken
//! for it, every index before it is used; paths that leave the model's folder are refused. A file that
//! contradicts itself is an error that says where; geometry that cannot be drawn is dropped and counted in
//! [`Imported::findings`].
//!
//! **Why own readers.** glTF: the `gltf` crate keeps transforms as f32 (a part at 435440.123456 m moves by
//! 15 mm), panics on malformed files, and cannot read KHR_mesh_quantization. OBJ: `tobj` panics on a short
//! `Kd` line, gives up at the first index out of range, splits vertices by texture coordinates, and its
//! errors have no line. STL: `stl_io` keeps ascii numbers as f32 and knows one solid a file. PLY:
//! `ply-rs-bw` reads the header; its element reader makes the import 2 to 3 times slower. `tests/import.rs`
//! compares the readers with those of `tobj`, `stl_io` and `ply-rs-bw` on real models.

mod assembly;
mod detect;
mod draft;
mod error;
mod files;
mod gltf;
mod mtl;
mod obj;
mod ply;
mod repair;
mod stl;
mod text;
mod triangulate;

use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use assembly::Assembly;
pub use detect::Format;
use draft::{Draft, Referred, Source};
pub use error::ImportError;
use files::Entry;
#[cfg(feature = "viewer")]
pub(crate) use files::length_beside;

use crate::container::{self, ReferredFile};
use crate::model::{Model, NodeId};
use crate::progress::Progress;
use crate::report::Findings;

/// Limits. The defaults hold for the largest real assemblies; raise them rather than being surprised.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImportOptions {
    /// Most levels of the assembly tree, folders and files included.
    pub max_depth: usize,
    /// Most nodes of the assembly tree, and most files and folders looked at.
    pub max_nodes: usize,
    /// Most triangles stored, each part once.
    pub max_triangles: u64,
    /// Most triangles placed, instances counted each.
    pub max_placed_triangles: u64,
}

impl Default for ImportOptions {
    fn default() -> Self {
        ImportOptions {
            max_depth: 256,
            max_nodes: 1 << 24,
            max_triangles: 1 << 32,
            max_placed_triangles: 1 << 36,
        }
    }
}

/// Which way is up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum UpAxis {
    /// +X.
    X,
    /// +Y, as in glTF.
    Y,
    /// +Z, as in most CAD.
    Z,
}

/// A file that was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// Relative to the input, `/` between folders; never absolute.
    pub name: String,
    /// Size, with the buffers and material libraries that it refers to.
    pub bytes: u64,
    /// What it was read as.
    pub format: Format,
    /// XXH3-64 of the file; if it refers to others, of its hash and theirs, each as 8 bytes, in the order of use.
    pub xxh3: u64,
    /// The files that it refers to, also those that were not read.
    pub referred: Vec<ReferredFile>,
}

impl From<&SourceFile> for container::Source {
    fn from(source: &SourceFile) -> Self {
        container::Source {
            name: source.name.clone(),
            bytes: source.bytes,
            xxh3: format!("{:016x}", source.xxh3),
            referred: source.referred.clone(),
        }
    }
}

/// What was imported.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The model; it has at least one triangle.
    pub model: Model,
    /// What was repaired, dropped and skipped.
    pub findings: Findings,
    /// The model files, in the order of the tree.
    pub sources: Vec<SourceFile>,
    /// What the format says; `None` when it does not say or the files disagree.
    pub up_axis: Option<UpAxis>,
    /// What the format says (glTF: 1); `None` when it does not say or the files disagree.
    pub metres_per_unit: Option<f64>,
}

impl Imported {
    /// Adds to the findings what the files do not say and nobody else did either, so that it is guessed.
    pub fn note_guesses(&mut self, unit_is_given: bool, up_is_given: bool) {
        let sources: Vec<String> = self.sources.iter().map(|source| source.name.clone()).collect();
        let first = || sources.first().cloned().unwrap_or_default();
        let no_unit = !unit_is_given && self.metres_per_unit.is_none();
        let no_up = !up_is_given && self.up_axis.is_none();
        self.findings.add("model without a unit: metres assumed (--unit)", u64::from(no_unit), first);
        self.findings.add("model without an up axis: z assumed (--up)", u64::from(no_up), first);
    }
}

/// Files read at the same time; enough for many cores, few enough for memory.
const FILES_AT_ONCE: usize = 32;

/// Imports model files and folders of them as one model.
///
/// A single file gives its own roots. Otherwise each folder is a node, each file a node below it that holds
/// the file's roots (or, where the file is a single shape, its object), sorted by name.
///
/// # Errors
/// The first file, in the order of the tree, that cannot be read; a limit that is exceeded; a model without any
/// triangle; cancellation through `progress`.
pub fn import(
    inputs: &[PathBuf],
    options: &ImportOptions,
    progress: &dyn Progress,
) -> Result<Imported, ImportError> {
    let mut findings = Findings::default();
    let entries = files::list(inputs, options, &mut findings)?;
    let is_single_file = matches!(entries.as_slice(), [Entry { file: Some(_), .. }]);
    progress.stage("import", bytes_on_disk(&entries), "bytes");

    let mut assembly = Assembly::default();
    let mut joined = Joined::default();
    let mut node_of_entry: Vec<NodeId> = Vec::new();
    for batch in entries.chunks(FILES_AT_ONCE) {
        let read: Vec<_> =
            batch.par_iter().map(|entry| read(entry, is_single_file, options, progress)).collect();
        for (entry, outcome) in batch.iter().zip(read) {
            let read = outcome?;
            let parent = entry.parent.and_then(|folder| node_of_entry.get(folder).copied());
            let Some(ReadFile { source, mut draft }) = read else {
                node_of_entry.push(assembly.node(&entry.name, parent, options)?);
                continue;
            };
            findings.merge(std::mem::take(&mut draft.findings));
            joined.add(&draft, &source, options)?;
            if is_single_file {
                assembly.add(&source.name, draft, parent, options)?;
            } else {
                let node = assembly.node(&entry.name, parent, options)?;
                node_of_entry.push(node);
                // OBJ, PLY and STL have no tree: a node inside a node would say nothing.
                if draft.nodes.len() == 1 && !matches!(source.format, Format::Gltf | Format::Glb) {
                    assembly.add_to_node(node, draft);
                } else {
                    assembly.add(&source.name, draft, Some(node), options)?;
                }
            }
            joined.sources.push(source);
        }
    }
    let model = assembly.finish();
    if model.objects.is_empty() {
        let file = inputs.first().map(|input| input.display().to_string()).ok_or(ImportError::NoInput)?;
        return Err(ImportError::NoTriangles { file, findings });
    }
    joined.report_disagreement(&mut findings);
    let Joined { sources, up_axis, metres_per_unit, .. } = joined;
    let (up_axis, metres_per_unit) = (up_axis.agreed(), metres_per_unit.agreed());
    Ok(Imported { model, findings, sources, up_axis, metres_per_unit })
}

fn bytes_on_disk(entries: &[Entry]) -> u64 {
    // Only for the progress bar: a file that cannot be asked fails properly when it is read.
    entries.iter().filter_map(|e| e.file.as_ref()).filter_map(|f| fs::metadata(f).ok()).map(|m| m.len()).sum()
}

struct ReadFile {
    source: SourceFile,
    draft: Draft,
}

/// Reads one file; `None` for a folder.
fn read(
    entry: &Entry,
    is_single_file: bool,
    options: &ImportOptions,
    progress: &dyn Progress,
) -> Result<Option<ReadFile>, ImportError> {
    let Some(path) = entry.file.as_deref() else { return Ok(None) };
    if progress.is_cancelled() {
        return Err(ImportError::Cancelled);
    }
    let name = &entry.shown;
    let bytes = fs::read(path).map_err(|source| ImportError::Io { file: name.clone(), source })?;
    let format = detect::detect(name, path, &bytes)?;
    let depth = if is_single_file { 0 } else { entry.depth + 1 };
    let source = Source { name, path, bytes: &bytes, depth, options, progress };
    let mut draft = match format {
        Format::Gltf | Format::Glb => gltf::read(&source),
        Format::Obj => obj::read(&source),
        Format::Ply => ply::read(&source),
        Format::Stl => stl::read(&source),
    }?;
    if let Some(said) = misleading_extension(path, format) {
        draft.findings.add("files read by their content, not by their extension", 1, || {
            format!("{name}: {format}, not {said}")
        });
    }
    let size = bytes.len() as u64;
    progress.advance(size);
    let xxh3 = draft.referred.hash_with(&bytes);
    let Referred { bytes: more, files: referred, .. } = std::mem::take(&mut draft.referred);
    let source = SourceFile { name: name.clone(), bytes: size + more, format, xxh3, referred };
    Ok(Some(ReadFile { source, draft }))
}

fn misleading_extension(path: &Path, format: Format) -> Option<Format> {
    let is_gltf = |format| matches!(format, Format::Gltf | Format::Glb);
    Format::from_extension(path).filter(|&said| said != format && !(is_gltf(said) && is_gltf(format)))
}

/// What all files together say.
#[derive(Default)]
struct Joined {
    sources: Vec<SourceFile>,
    triangles: u64,
    placed_triangles: u64,
    up_axis: Agreement<UpAxis>,
    metres_per_unit: Agreement<f64>,
}

impl Joined {
    fn add(
        &mut self,
        draft: &Draft,
        source: &SourceFile,
        options: &ImportOptions,
    ) -> Result<(), ImportError> {
        self.up_axis.hear(draft.up_axis);
        self.metres_per_unit.hear(draft.metres_per_unit);
        self.triangles += draft.parts.iter().map(|p| p.part.mesh.triangles.len() as u64).sum::<u64>();
        if self.triangles > options.max_triangles {
            return Err(ImportError::TooMany {
                file: source.name.clone(),
                what: "triangles",
                limit: options.max_triangles,
                advice: "import fewer files at once, or raise max_triangles",
            });
        }
        self.placed_triangles = self.placed_triangles.saturating_add(draft.placed_triangles());
        if self.placed_triangles > options.max_placed_triangles {
            return Err(draft::too_many_placed(&source.name, options));
        }
        Ok(())
    }

    fn report_disagreement(&self, findings: &mut Findings) {
        if self.up_axis == Agreement::Broken || self.metres_per_unit == Agreement::Broken {
            let formats = || self.sources.first().map_or_else(String::new, |s| s.name.clone());
            findings.add("files disagree on unit or up axis: tell them with --unit and --up", 1, formats);
        }
    }
}

/// Whether all files say the same; one that says nothing does not agree with one that does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Agreement<T> {
    #[default]
    Silent,
    On(Option<T>),
    Broken,
}

impl<T: Copy + PartialEq> Agreement<T> {
    fn hear(&mut self, said: Option<T>) {
        *self = match *self {
            Agreement::Silent => Agreement::On(said),
            Agreement::On(before) if before == said => *self,
            _ => Agreement::Broken,
        };
    }

    fn agreed(self) -> Option<T> {
        match self {
            Agreement::On(said) => said,
            Agreement::Silent | Agreement::Broken => None,
        }
    }
}
