//! GLB 2.0 (Khronos, "glTF 2.0 Specification", section 4.4), streamed to disk.
//!
//! ```text
//! header   12 bytes: magic, version, file length (filled in at the end)
//! JSON      8 bytes + text, padded with spaces to a multiple of 4
//! BIN       8 bytes + for each geometry: positions (3 x f32), corners (u16 or u32, padded to a multiple of 4)
//! ```
//!
//! Geometries are asked for twice, one at a time: once for their counts and bounds, which the JSON needs, once for
//! their bytes. So only the document's outline is ever in memory. Written to a temporary file beside the target and
//! renamed when complete.

use std::borrow::Cow;
use std::collections::HashMap;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use glam::{DAffine3, DVec3};
use thiserror::Error;

use super::glb_json;
use crate::atomic_file::AtomicFile;
use crate::model::{Colour, Mesh, Model, PartId};
use crate::progress::Progress;

/// Why a GLB could not be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GlbError {
    /// The disk is full, the folder is missing or read-only, and so on.
    #[error("could not write {}: {source}", path.display())]
    Io {
        /// The target.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Lengths in a GLB are 32-bit.
    #[error(
        "{} would have {bytes} bytes, but a GLB holds at most 4294967295: write a folder of several files instead",
        path.display()
    )]
    TooLarge {
        /// The target.
        path: PathBuf,
        /// What it would need.
        bytes: u64,
    },
    /// A coordinate or placement that is not finite, or does not fit f32.
    #[error("could not write {}: {what} has a coordinate that is not a finite 32-bit number", path.display())]
    NotFinite {
        /// The target.
        path: PathBuf,
        /// Which part or node.
        what: String,
    },
    /// Extra properties of a node that are not JSON.
    #[error("could not write {}: the properties of node {node:?} are not JSON: {source}", path.display())]
    Extras {
        /// The target.
        path: PathBuf,
        /// Name of the node.
        node: String,
        /// What is wrong with them.
        source: serde_json::Error,
    },
    /// No triangle at all: glTF cannot express it.
    #[error("there is no triangle to write to {}", path.display())]
    Empty {
        /// The target.
        path: PathBuf,
    },
    /// The progress receiver asked to stop.
    #[error("cancelled; {} was not written", path.display())]
    Cancelled {
        /// The target.
        path: PathBuf,
    },
}

/// A geometry as it is written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Geometry {
    /// Vertex positions.
    pub positions: Vec<[f32; 3]>,
    /// Corners, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// A node of the document.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GlbNode<'a> {
    /// Its name.
    pub name: Cow<'a, str>,
    /// Index of its parent; parents stand first.
    pub parent: Option<u32>,
    /// Index into [`Document::meshes`].
    pub mesh: Option<u32>,
    /// Parent from node space.
    pub matrix: DAffine3,
    /// Extra properties, JSON text.
    pub extras: Option<&'a str>,
}

/// A mesh of the document: a geometry in a colour.
#[derive(Clone, Debug, PartialEq)]
pub struct GlbMesh<'a> {
    /// Its name; may be empty.
    pub name: Cow<'a, str>,
    /// Which geometry. Meshes that differ only in colour share it.
    pub geometry: u32,
    /// Base colour and alpha.
    pub colour: Colour,
}

/// Everything but the geometries themselves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Document<'a> {
    /// The tree.
    pub nodes: Vec<GlbNode<'a>>,
    /// What nodes show.
    pub meshes: Vec<GlbMesh<'a>>,
    /// How many geometries there are.
    pub geometries: u32,
}

/// What the JSON says about one geometry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Extent {
    pub vertices: u64,
    pub triangles: u64,
    pub min: [f32; 3],
    pub max: [f32; 3],
    /// Of its positions in the BIN chunk; the corners follow.
    pub offset: u64,
}

impl Extent {
    /// Indices are u16 where they fit; 65535 is reserved.
    pub fn has_short_indices(&self) -> bool {
        self.vertices <= 65_535
    }

    pub fn position_bytes(&self) -> u64 {
        self.vertices * 12
    }

    pub fn index_bytes(&self) -> u64 {
        self.triangles * if self.has_short_indices() { 6 } else { 12 }
    }

    /// A geometry without triangles is not written, and what shows it shows nothing.
    pub fn is_empty(&self) -> bool {
        self.triangles == 0
    }
}

/// Writes a model, instancing kept: a part that is placed often is stored once. Returns the file's length.
///
/// Placements are f64 matrices. Positions are f32, relative to the part's origin, or to the middle of the part's box
/// where the origin is so far away that f32 would be coarse. `progress` advances by the triangles stored.
pub fn write_model(path: &Path, model: &Model, progress: &dyn Progress) -> Result<u64, GlbError> {
    let origins: Vec<DVec3> = model.parts.iter().map(|part| near_origin(&part.mesh)).collect();
    let document = document_of(model, &origins);
    write(path, &document, progress, |index, geometry| {
        let (Some(part), Some(origin)) = (model.parts.get(index as usize), origins.get(index as usize))
        else {
            return;
        };
        let local = |position: &DVec3| (*position - *origin).as_vec3().to_array();
        geometry.positions.extend(part.mesh.positions.iter().map(local));
        geometry.triangles.extend_from_slice(&part.mesh.triangles);
    })
}

/// Zero for a part near its own origin, and for an empty one; else a point in its middle that f32 holds exactly.
fn near_origin(mesh: &Mesh) -> DVec3 {
    let low = mesh.positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = mesh.positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    if mesh.positions.is_empty() {
        return DVec3::ZERO;
    }
    let farthest = low.abs().max(high.abs()).max_element();
    // At 16 times its own size from the origin, a part has lost 4 of the 24 bits of f32.
    if farthest > 16.0 * (high - low).max_element() {
        ((low + high) / 2.0).as_vec3().as_dvec3()
    } else {
        DVec3::ZERO
    }
}

fn document_of<'a>(model: &'a Model, origins: &[DVec3]) -> Document<'a> {
    let mut nodes: Vec<GlbNode<'a>> = model
        .nodes
        .iter()
        .map(|node| GlbNode {
            name: Cow::Borrowed(&node.name),
            parent: node.parent,
            extras: node.extras.as_deref(),
            ..GlbNode::default()
        })
        .collect();
    let mut meshes = Vec::new();
    let mut mesh_of: HashMap<(PartId, Colour), u32> = HashMap::new();
    for object in &model.objects {
        let mesh = *mesh_of.entry((object.part, object.colour)).or_insert_with(|| {
            let name = model.parts.get(object.part as usize).map_or("", |part| &part.name);
            meshes.push(GlbMesh { name: name.into(), geometry: object.part, colour: object.colour });
            meshes.len() as u32 - 1
        });
        let origin = origins.get(object.part as usize).copied().unwrap_or_default();
        if let Some(node) = nodes.get_mut(object.node as usize) {
            node.mesh = Some(mesh);
            node.matrix = object.world_from_part * DAffine3::from_translation(origin);
        }
    }
    make_relative(&mut nodes);
    Document { nodes, meshes, geometries: model.parts.len() as u32 }
}

/// Turns placements in the world into placements in the parent, as glTF wants: only nodes with a mesh have one, and
/// what stands below such a node must not be moved twice.
fn make_relative(nodes: &mut [GlbNode]) {
    // Placement in the world of each node so far; parents stand before their children.
    let mut in_world: Vec<DAffine3> = Vec::with_capacity(nodes.len());
    for node in nodes {
        let parent = node.parent.and_then(|parent| in_world.get(parent as usize).copied());
        let parent = parent.unwrap_or(DAffine3::IDENTITY);
        if node.mesh.is_none() {
            in_world.push(parent);
            continue;
        }
        in_world.push(node.matrix);
        if parent != DAffine3::IDENTITY {
            node.matrix = parent.inverse() * node.matrix;
        }
    }
}

/// Writes a document whose geometries come from `fill`, which is called with an empty geometry, twice for each index
/// in order, and must give the same both times. Returns the file's length.
pub fn write(
    path: &Path,
    document: &Document,
    progress: &dyn Progress,
    mut fill: impl FnMut(u32, &mut Geometry),
) -> Result<u64, GlbError> {
    let mut geometry = Geometry::default();
    let mut each = |visit: &mut dyn FnMut(u32, &Geometry) -> Result<(), GlbError>| {
        for index in 0..document.geometries {
            if progress.is_cancelled() {
                return Err(GlbError::Cancelled { path: path.to_owned() });
            }
            geometry.positions.clear();
            geometry.triangles.clear();
            fill(index, &mut geometry);
            visit(index, &geometry)?;
        }
        Ok(())
    };

    let mut extents = Vec::with_capacity(document.geometries as usize);
    let mut bin_length = 0;
    each(&mut |index, geometry| {
        let extent = measure(geometry, bin_length).ok_or_else(|| {
            let name =
                document.meshes.iter().find(|mesh| mesh.geometry == index).map_or("", |mesh| &mesh.name);
            GlbError::NotFinite { path: path.to_owned(), what: format!("part {name:?}") }
        })?;
        if !extent.is_empty() {
            bin_length += extent.position_bytes() + extent.index_bytes().next_multiple_of(4);
        }
        extents.push(extent);
        Ok(())
    })?;
    if bin_length == 0 {
        return Err(GlbError::Empty { path: path.to_owned() });
    }
    if bin_length > u64::from(u32::MAX) {
        return Err(GlbError::TooLarge { path: path.to_owned(), bytes: bin_length });
    }

    let io_error = |source: io::Error| GlbError::Io { path: path.to_owned(), source };
    let json = glb_json::prepare(path, document, &extents, bin_length)?;
    let mut file = BufWriter::with_capacity(1 << 20, AtomicFile::create(path).map_err(io_error)?);
    // The header and the JSON chunk's header are written when the lengths are known.
    file.write_all(&[0; 20]).map_err(io_error)?;
    let json_length = write_json(&mut file, &json).map_err(io_error)?;
    let length = 20 + json_length + 8 + bin_length;
    if length > u64::from(u32::MAX) {
        return Err(GlbError::TooLarge { path: path.to_owned(), bytes: length });
    }
    file.write_all(&chunk_header(bin_length, *b"BIN\0")).map_err(io_error)?;
    each(&mut |index, geometry| {
        if !geometry.triangles.is_empty() {
            write_geometry(&mut file, geometry, extents[index as usize]).map_err(io_error)?;
            progress.advance(geometry.triangles.len() as u64);
        }
        Ok(())
    })?;

    let finish = || -> io::Result<()> {
        let mut file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(b"glTF\x02\0\0\0")?;
        file.write_all(&(length as u32).to_le_bytes())?;
        file.write_all(&chunk_header(json_length, *b"JSON"))?;
        Ok(file.commit()?)
    };
    finish().map_err(io_error)?;
    Ok(length)
}

fn chunk_header(length: u64, kind: [u8; 4]) -> [u8; 8] {
    let mut header = [0; 8];
    header[..4].copy_from_slice(&(length as u32).to_le_bytes());
    header[4..].copy_from_slice(&kind);
    header
}

/// Counts and bounds; `None` if a coordinate is not finite.
fn measure(geometry: &Geometry, offset: u64) -> Option<Extent> {
    let mut extent = Extent {
        vertices: geometry.positions.len() as u64,
        triangles: geometry.triangles.len() as u64,
        min: [f32::INFINITY; 3],
        max: [f32::NEG_INFINITY; 3],
        offset,
    };
    for position in &geometry.positions {
        for ((low, high), coordinate) in extent.min.iter_mut().zip(&mut extent.max).zip(position) {
            if !coordinate.is_finite() {
                return None;
            }
            *low = low.min(*coordinate);
            *high = high.max(*coordinate);
        }
    }
    Some(extent)
}

/// Returns the padded length.
fn write_json(file: &mut impl Write, json: &impl serde::Serialize) -> io::Result<u64> {
    let mut counted = Counted { inner: file, bytes: 0 };
    serde_json::to_writer(&mut counted, json)?;
    while !counted.bytes.is_multiple_of(4) {
        counted.write_all(b" ")?;
    }
    Ok(counted.bytes)
}

struct Counted<'a, W> {
    inner: &'a mut W,
    bytes: u64,
}

impl<W: Write> Write for Counted<'_, W> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(buffer)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

fn write_geometry(file: &mut impl Write, geometry: &Geometry, extent: Extent) -> io::Result<()> {
    for coordinate in geometry.positions.as_flattened() {
        file.write_all(&coordinate.to_le_bytes())?;
    }
    for corner in geometry.triangles.as_flattened() {
        if extent.has_short_indices() {
            file.write_all(&(*corner as u16).to_le_bytes())?;
        } else {
            file.write_all(&corner.to_le_bytes())?;
        }
    }
    let padding = extent.index_bytes().next_multiple_of(4) - extent.index_bytes();
    file.write_all(&[0; 3][..padding as usize])
}
