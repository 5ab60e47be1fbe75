//! A model as imported: parts, objects and the assembly tree, before any preprocessing.
//!
//! Everything here is f64, so that a model at map coordinates loses nothing before its parts are made local
//! (`prepare::localise`). Lengths are in model units, axes as in the file.

use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

/// Index of a [`Node`] in [`Model::nodes`].
pub type NodeId = u32;
/// Index of a [`Part`] in [`Model::parts`].
pub type PartId = u32;

/// Colour of an object: sRGB-encoded red, green, blue, and linear alpha (255 = opaque).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Colour(pub [u8; 4]);

impl Default for Colour {
    /// A light neutral grey, what CAD viewers show for a part without material.
    fn default() -> Self {
        Colour([190, 190, 190, 255])
    }
}

impl Colour {
    /// From linear RGB and alpha in `[0, 1]`; values outside are clamped, NaN becomes 0.
    pub fn from_linear(rgba: [f64; 4]) -> Self {
        let [r, g, b, a] = rgba.map(|c| c.clamp(0.0, 1.0));
        let [r, g, b] = [r, g, b].map(srgb_from_linear);
        // `as u8` maps NaN to 0.
        Colour([r, g, b, a].map(|c| (c * 255.0).round() as u8))
    }
}

/// The sRGB transfer function (IEC 61966-2-1): a linear value in `0..=1` to encoded.
pub fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 }
}

/// The inverse of the sRGB transfer function: an encoded value in `0..=1` to linear.
pub fn linear_from_srgb(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { libm::pow((encoded + 0.055) / 1.055, 2.4) }
}

/// A triangle soup with shared vertices, in the part's own space.
///
/// The importer promises: every coordinate is finite, every index is below `positions.len()`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions in part space.
    pub positions: Vec<DVec3>,
    /// Corners of each triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// One geometry, stored once however often it is placed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// Name of the geometry in the file (mesh name, group name); may be empty.
    pub name: String,
    /// The input geometry.
    pub mesh: Mesh,
}

/// One node of the assembly tree.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Node {
    /// What the user sees and searches for; never empty (the importer invents `node 12` and the like).
    pub name: String,
    /// `None` for a root. Parents stand before their children.
    pub parent: Option<NodeId>,
    /// The file's extra properties of this node (part number and so on) as JSON text.
    pub extras: Option<String>,
}

/// One placed occurrence of a part: what people pick, hide and count.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Its leaf in the assembly tree. A node carries at most one object.
    pub node: NodeId,
    /// Which geometry.
    pub part: PartId,
    /// Placement: part space to model (world) space. May mirror or scale unevenly; always finite.
    pub world_from_part: DAffine3,
    /// Base colour and alpha.
    pub colour: Colour,
}

/// An imported model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The assembly tree in depth-first pre-order: a parent before its children, a subtree without gaps.
    pub nodes: Vec<Node>,
    /// Distinct geometries. Every part is used by at least one object.
    pub parts: Vec<Part>,
    /// Placed occurrences, in the order of their nodes.
    pub objects: Vec<Object>,
}

impl Model {
    /// Triangles with instancing expanded.
    pub fn placed_triangles(&self) -> u64 {
        self.objects.iter().map(|o| self.parts[o.part as usize].mesh.triangles.len() as u64).sum()
    }

    /// Triangles stored, each part once.
    pub fn unique_triangles(&self) -> u64 {
        self.parts.iter().map(|p| p.mesh.triangles.len() as u64).sum()
    }

    /// Path of a node in the tree, `/unit/system/part`. A `/` inside a name is written `\/`, a `\` as `\\`.
    pub fn path(&self, node: NodeId) -> String {
        let mut names = Vec::new();
        let mut at = Some(node);
        while let Some(id) = at {
            let node = &self.nodes[id as usize];
            names.push(path_segment(&node.name));
            at = node.parent;
        }
        names.iter().rev().fold(String::new(), |path, name| path + "/" + name)
    }
}

/// A node's name as it stands in a path: `/` is written `\/`, `\` as `\\`.
pub fn path_segment(name: &str) -> String {
    name.replace('\\', "\\\\").replace('/', "\\/")
}
