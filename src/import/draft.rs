//! What one file says, before it is joined with the others: every format's reader makes a [`Draft`].

use std::path::Path;

use bytemuck::cast_slice;
use glam::DAffine3;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::error::{ImportError, excerpt};
use super::repair::MAX_COORDINATE;
use super::{ImportOptions, UpAxis};
use crate::container::ReferredFile;
use crate::model::{Colour, Mesh, Part};
use crate::progress::Progress;
use crate::report::Findings;

/// One model file, read into memory, and all that a reader may know of the world.
pub(super) struct Source<'a> {
    /// As in reports and errors.
    pub name: &'a str,
    /// Where it lies, to find the files beside it.
    pub path: &'a Path,
    /// All of it.
    pub bytes: &'a [u8],
    /// Nodes above its roots.
    pub depth: usize,
    pub options: &'a ImportOptions,
    pub progress: &'a dyn Progress,
}

impl Source<'_> {
    /// The file's name without folder and extension: what a shape without a name is called.
    pub fn stem(&self) -> String {
        self.path.file_stem().map_or_else(|| "model".to_owned(), |stem| stem.to_string_lossy().into_owned())
    }

    pub fn syntax(&self, line: u64, expected: &'static str, found: &[u8]) -> ImportError {
        ImportError::Syntax { file: self.name.to_owned(), line, expected, found: excerpt(found) }
    }

    pub fn invalid(
        &self,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> ImportError {
        let file = self.name.to_owned();
        ImportError::Invalid { file, place: place.into(), expected: expected.into(), found: found.into() }
    }

    pub fn truncated(&self, what: impl Into<String>, expected: u64, found: u64) -> ImportError {
        ImportError::Truncated { file: self.name.to_owned(), what: what.into(), expected, found }
    }

    pub fn too_many(&self, what: &'static str, limit: u64, advice: &'static str) -> ImportError {
        ImportError::TooMany { file: self.name.to_owned(), what, limit, advice }
    }

    pub fn check_cancelled(&self) -> Result<(), ImportError> {
        if self.progress.is_cancelled() { Err(ImportError::Cancelled) } else { Ok(()) }
    }
}

/// A part and the hash of its geometry, which finds equal ones.
pub(super) struct HashedPart {
    pub part: Part,
    pub fingerprint: u64,
}

impl HashedPart {
    pub fn new(name: String, mesh: Mesh) -> Self {
        let mut hasher = Xxh3::new();
        hasher.update(cast_slice(&mesh.positions));
        hasher.update(cast_slice(&mesh.triangles));
        HashedPart { fingerprint: hasher.digest(), part: Part { name, mesh } }
    }
}

/// A piece of one named shape that has one colour.
pub(super) struct Piece {
    /// Name of the piece among the others: that of its material.
    pub label: String,
    pub colour: Colour,
    /// Index in [`Draft::parts`].
    pub part: u32,
}

/// An object, not yet joined with those of other files.
pub(super) struct DraftObject {
    /// Index in [`Draft::parts`].
    pub part: u32,
    pub world_from_part: DAffine3,
    pub colour: Colour,
}

/// A node of the tree below the file.
pub(super) struct DraftNode {
    pub name: String,
    /// Index in [`Draft::nodes`]; smaller than the node's own.
    pub parent: Option<u32>,
    pub extras: Option<String>,
    pub object: Option<DraftObject>,
    /// Nodes above it in the file.
    depth: usize,
}

/// The content of one file.
#[derive(Default)]
pub(super) struct Draft {
    pub parts: Vec<HashedPart>,
    /// Depth-first pre-order: readers add them so.
    pub nodes: Vec<DraftNode>,
    pub findings: Findings,
    pub up_axis: Option<UpAxis>,
    pub metres_per_unit: Option<f64>,
    pub referred: Referred,
}

/// Files that a model refers to, as they were read.
#[derive(Default)]
pub(super) struct Referred {
    pub bytes: u64,
    pub files: Vec<ReferredFile>,
    /// Of each file, in the order of first use.
    hashes: Vec<u64>,
}

impl Referred {
    /// A file that was looked for at a path relative to the model's folder, but was not there, or could not be read.
    pub fn add_unread(&mut self, path: &Path) {
        self.add_file(path, None);
    }

    fn add_file(&mut self, path: &Path, bytes: Option<u64>) {
        let folders: Vec<_> = path.iter().map(|name| name.to_string_lossy()).collect();
        self.files.push(ReferredFile { name: folders.join("/"), bytes });
    }

    /// One that was read.
    pub fn add(&mut self, path: &Path, content: &[u8]) {
        self.add_file(path, Some(content.len() as u64));
        self.bytes += content.len() as u64;
        self.hashes.push(xxh3_64(content));
    }

    /// The hash of a model file, or of that and those of the files it refers to.
    pub fn hash_with(&self, model: &[u8]) -> u64 {
        let own = xxh3_64(model);
        if self.hashes.is_empty() {
            return own;
        }
        let mut hasher = Xxh3::new();
        std::iter::once(&own).chain(&self.hashes).for_each(|hash| hasher.update(&hash.to_le_bytes()));
        hasher.digest()
    }
}

impl Draft {
    /// Adds a node below `parent`; an empty name is replaced by an invented one.
    pub fn node(
        &mut self,
        source: &Source,
        name: String,
        parent: Option<u32>,
        extras: Option<String>,
    ) -> Result<u32, ImportError> {
        let depth = parent.and_then(|p| self.nodes.get(p as usize)).map_or(0, |parent| parent.depth + 1);
        if source.depth + depth >= source.options.max_depth {
            let limit = source.options.max_depth as u64;
            return Err(source.too_many(
                "levels of the assembly tree",
                limit,
                "flatten it or raise max_depth",
            ));
        }
        let id = self.nodes.len();
        if id >= source.options.max_nodes {
            return Err(too_many_nodes(source.name, source.options));
        }
        let name = if name.trim().is_empty() { format!("node {id}") } else { name };
        self.nodes.push(DraftNode { name, parent, extras, object: None, depth });
        Ok(id as u32)
    }

    /// Gives `node` the shape made of `pieces`: its own object if there is one piece, a child node a piece if
    /// there are several. An object with a useless transform is left out and counted; the nodes stay.
    pub fn place(
        &mut self,
        source: &Source,
        node: u32,
        world_from_part: DAffine3,
        pieces: &[Piece],
    ) -> Result<(), ImportError> {
        let fault = transform_fault(&world_from_part);
        for piece in pieces {
            let at = match pieces {
                [_] => node,
                _ => self.node(source, piece.label.clone(), Some(node), None)?,
            };
            let Some(at) = self.nodes.get_mut(at as usize) else { continue };
            match fault {
                Some(fault) => {
                    self.findings.add(fault, 1, || format!("{}: node \"{}\"", source.name, at.name))
                }
                None => {
                    at.object = Some(DraftObject { part: piece.part, world_from_part, colour: piece.colour });
                }
            }
        }
        Ok(())
    }

    /// Triangles of a shape made of `pieces`.
    pub fn triangles_of(&self, pieces: &[Piece]) -> u64 {
        pieces.iter().map(|piece| self.triangles(piece.part)).sum()
    }

    /// Triangles of all objects.
    pub fn placed_triangles(&self) -> u64 {
        self.nodes
            .iter()
            .filter_map(|node| node.object.as_ref())
            .map(|object| self.triangles(object.part))
            .sum()
    }

    fn triangles(&self, part: u32) -> u64 {
        self.parts.get(part as usize).map_or(0, |part| part.part.mesh.triangles.len() as u64)
    }

    /// Tidies a mesh's bookkeeping: stores it and returns its index, or counts it as empty.
    pub fn part(&mut self, part: HashedPart, place: impl FnOnce() -> String) -> Option<u32> {
        if part.part.mesh.triangles.is_empty() {
            self.findings.add("meshes dropped: no triangle in them", 1, place);
            return None;
        }
        self.parts.push(part);
        Some(self.parts.len() as u32 - 1)
    }
}

pub(super) fn too_many_nodes(file: &str, options: &ImportOptions) -> ImportError {
    ImportError::TooMany {
        file: file.to_owned(),
        what: "nodes in the assembly tree",
        limit: options.max_nodes as u64,
        advice: "import fewer files at once, or raise max_nodes",
    }
}

pub(super) fn too_many_placed(file: &str, options: &ImportOptions) -> ImportError {
    ImportError::TooMany {
        file: file.to_owned(),
        what: "triangles placed",
        limit: options.max_placed_triangles,
        advice: "import fewer files at once, or raise max_placed_triangles",
    }
}

/// Why an object with this placement cannot be shown, if so.
fn transform_fault(world_from_part: &DAffine3) -> Option<&'static str> {
    let columns = world_from_part.to_cols_array();
    if columns.iter().any(|c| !c.is_finite() || c.abs() > MAX_COORDINATE) {
        return Some("objects dropped: a number of the transform is not finite or beyond 1e15");
    }
    // Determinant over the product of the columns' lengths (Hadamard's bound) is 1 for right angles, and 0
    // for a flattened space, whatever the unit. Rounding leaves some 1e-16 of a product with a flattening.
    let m = world_from_part.matrix3;
    let bound = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
    // Written so that a bound of 0 is singular.
    let is_regular = m.determinant().abs() > 1e-13 * bound;
    (!is_regular).then_some("objects dropped: the transform is singular (a zero scale)")
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat, DVec3};

    use super::*;

    #[test]
    fn a_zero_scale_is_singular_however_it_is_rotated_and_a_small_one_is_not() {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -2.0);
        for (scale, singular) in [
            (DVec3::new(1.0, 0.0, 1.0), true),
            (DVec3::ZERO, true),
            (DVec3::splat(1e-9), false),
            (DVec3::new(1000.0, -1.0, 1e-6), false),
        ] {
            let matrix = DMat3::from_quat(turn) * DMat3::from_diagonal(scale) * DMat3::from_quat(turn * turn);
            let fault = transform_fault(&DAffine3::from_mat3(matrix));
            assert_eq!(fault.is_some(), singular, "scale {scale}");
        }
        assert!(transform_fault(&DAffine3::from_translation(DVec3::new(0.0, 1e16, 0.0))).is_some());
        assert!(transform_fault(&DAffine3::from_translation(DVec3::new(0.0, f64::NAN, 0.0))).is_some());
    }
}
