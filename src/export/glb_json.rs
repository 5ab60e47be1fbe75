//! The JSON chunk of a GLB: serialized straight from the document, item by item, without a tree in memory.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DAffine3, DMat4};
use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::{Map, Value, json};

use super::glb::{Document, Extent, GlbError};
use crate::model::Colour;

/// glTF's codes.
const ARRAY_BUFFER: u32 = 34_962;
const ELEMENT_ARRAY_BUFFER: u32 = 34_963;
const UNSIGNED_SHORT: u32 = 5_123;
const UNSIGNED_INT: u32 = 5_125;
const FLOAT: u32 = 5_126;

/// The document as glTF numbers it.
pub(super) struct Json<'a> {
    document: &'a Document<'a>,
    extents: &'a [Extent],
    bin_length: u64,
    /// Children of each node.
    children: Vec<Vec<u32>>,
    roots: Vec<u32>,
    /// glTF's index of each geometry's and mesh's, `None` where there is nothing to show.
    geometry_ids: Vec<Option<u32>>,
    mesh_ids: Vec<Option<u32>>,
    materials: BTreeMap<[u8; 4], u32>,
    extras: Vec<Option<Value>>,
}

/// Numbers everything and checks what text and numbers the document brings along.
pub(super) fn prepare<'a>(
    path: &Path,
    document: &'a Document<'a>,
    extents: &'a [Extent],
    bin_length: u64,
) -> Result<Json<'a>, GlbError> {
    let mut children = vec![Vec::new(); document.nodes.len()];
    let mut roots = Vec::new();
    let mut extras = Vec::with_capacity(document.nodes.len());
    for (id, node) in document.nodes.iter().enumerate() {
        match node.parent.and_then(|parent| children.get_mut(parent as usize)) {
            Some(siblings) => siblings.push(id as u32),
            None => roots.push(id as u32),
        }
        if !node.matrix.is_finite() {
            return Err(GlbError::NotFinite { path: path.to_owned(), what: format!("node {:?}", node.name) });
        }
        let parsed = node.extras.map(serde_json::from_str).transpose();
        extras.push(parsed.map_err(|source| GlbError::Extras {
            path: path.to_owned(),
            node: node.name.to_string(),
            source,
        })?);
    }
    let geometry_ids = numbered(extents.iter().map(|extent| !extent.is_empty()));
    let geometry_id = |geometry: u32| geometry_ids.get(geometry as usize).copied().flatten();
    let mesh_ids = numbered(document.meshes.iter().map(|mesh| geometry_id(mesh.geometry).is_some()));
    let mut materials: BTreeMap<[u8; 4], u32> =
        document.meshes.iter().map(|mesh| (mesh.colour.0, 0)).collect();
    for (id, material) in materials.values_mut().enumerate() {
        *material = id as u32;
    }
    Ok(Json { document, extents, bin_length, children, roots, geometry_ids, mesh_ids, materials, extras })
}

/// Consecutive numbers for those that are kept.
fn numbered(kept: impl Iterator<Item = bool>) -> Vec<Option<u32>> {
    let mut next = 0;
    kept.map(|kept| {
        kept.then(|| {
            next += 1;
            next - 1
        })
    })
    .collect()
}

/// A sequence that is made while it is written.
struct Sequence<F>(F);

impl<F, I> Serialize for Sequence<F>
where
    F: Fn() -> I,
    I: IntoIterator<Item: Serialize>,
{
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq((self.0)())
    }
}

impl Serialize for Json<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut top = serializer.serialize_map(None)?;
        top.serialize_entry("asset", &json!({ "version": "2.0", "generator": "voxsight" }))?;
        top.serialize_entry("scene", &0)?;
        top.serialize_entry("scenes", &[json!({ "nodes": self.roots })])?;
        top.serialize_entry("nodes", &Sequence(|| (0..self.document.nodes.len()).map(|id| self.node(id))))?;
        top.serialize_entry("meshes", &Sequence(|| self.meshes()))?;
        top.serialize_entry(
            "materials",
            &Sequence(|| self.materials.keys().map(|colour| material(Colour(*colour)))),
        )?;
        top.serialize_entry("buffers", &[json!({ "byteLength": self.bin_length })])?;
        top.serialize_entry("bufferViews", &Sequence(|| self.written().flat_map(buffer_views)))?;
        top.serialize_entry("accessors", &Sequence(|| self.written().zip(0..).flat_map(accessors)))?;
        top.end()
    }
}

impl Json<'_> {
    /// Geometries that have triangles. Geometry n of these has views and accessors 2n and 2n + 1.
    fn written(&self) -> impl Iterator<Item = &Extent> {
        self.extents.iter().filter(|extent| !extent.is_empty())
    }

    fn node(&self, id: usize) -> Value {
        // `id` is below the number of nodes, and every list here has one entry a node.
        let (node, children, extras) = (&self.document.nodes[id], &self.children[id], &self.extras[id]);
        let mut json = Map::new();
        json.insert("name".into(), json!(node.name));
        if !children.is_empty() {
            json.insert("children".into(), json!(children));
        }
        if node.matrix != DAffine3::IDENTITY {
            json.insert("matrix".into(), json!(DMat4::from(node.matrix).to_cols_array()));
        }
        if let Some(mesh) = node.mesh.and_then(|mesh| self.mesh_ids.get(mesh as usize).copied().flatten()) {
            json.insert("mesh".into(), json!(mesh));
        }
        if let Some(extras) = extras {
            json.insert("extras".into(), extras.clone());
        }
        Value::Object(json)
    }

    fn meshes(&self) -> impl Iterator<Item = Value> {
        self.document.meshes.iter().filter_map(|mesh| {
            let geometry = self.geometry_ids.get(mesh.geometry as usize).copied().flatten()?;
            let material = self.materials.get(&mesh.colour.0);
            let primitive = json!({
                "attributes": { "POSITION": 2 * geometry },
                "indices": 2 * geometry + 1,
                "material": material,
            });
            Some(json!({ "name": mesh.name, "primitives": [primitive] }))
        })
    }
}

/// A matt material. Double-sided, because surfaces of CAD models are often open.
fn material(colour: Colour) -> Value {
    let mut json = json!({
        "pbrMetallicRoughness": {
            "baseColorFactor": linear(colour),
            "metallicFactor": 0.0,
            "roughnessFactor": 0.7,
        },
        "doubleSided": true,
    });
    if colour.0[3] < 255 {
        json["alphaMode"] = json!("BLEND");
    }
    json
}

/// The inverse of [`Colour::from_linear`], exact for each of the 256 values of a channel.
fn linear(colour: Colour) -> [f64; 4] {
    let [r, g, b, a] = colour.0.map(|c| f64::from(c) / 255.0);
    // IEC 61966-2-1.
    let decode = |c: f64| if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) };
    [decode(r), decode(g), decode(b), a]
}

fn buffer_views(extent: &Extent) -> [Value; 2] {
    let corners = extent.offset + extent.position_bytes();
    [
        (extent.offset, extent.position_bytes(), ARRAY_BUFFER),
        (corners, extent.index_bytes(), ELEMENT_ARRAY_BUFFER),
    ]
    .map(|(offset, length, target)| {
        json!({ "buffer": 0, "byteOffset": offset, "byteLength": length, "target": target })
    })
}

fn accessors((extent, id): (&Extent, u64)) -> [Value; 2] {
    // As f64, so that the decimals are the exact value of the f32.
    let exact = |bound: [f32; 3]| bound.map(f64::from);
    [
        json!({
            "bufferView": 2 * id,
            "componentType": FLOAT,
            "count": extent.vertices,
            "type": "VEC3",
            "min": exact(extent.min),
            "max": exact(extent.max),
        }),
        json!({
            "bufferView": 2 * id + 1,
            "componentType": if extent.has_short_indices() { UNSIGNED_SHORT } else { UNSIGNED_INT },
            "count": 3 * extent.triangles,
            "type": "SCALAR",
        }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_colour_survives_the_way_to_linear_and_back() {
        for level in 0..=255 {
            let colour = Colour([level, 255 - level, level, level]);
            assert_eq!(Colour::from_linear(linear(colour)), colour);
        }
    }
}
