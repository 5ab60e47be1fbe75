//! Copies of a model that share nothing, for scale tests as the papers made them: every vertex is baked, every copy is
//! turned and scaled, so that neither instancing nor deduplication can shrink the load.

use std::f64::consts::TAU;
use std::ops::Range;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};

use super::write::{SampleError, WriteSummary, empty_folder};
use crate::export::glb::{self, Document, Geometry, GlbMesh, GlbNode};
use crate::model::{Model, NodeId, Object, Part};
use crate::progress::Progress;

/// How the copies are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CopiesSettings {
    /// How many.
    pub copies: u32,
    /// Distance of neighbouring copies, as a fraction of the model's larger horizontal size. Below 1 the copies
    /// interpenetrate, for deep occlusion; `None` keeps them apart, at 1.1 (a turned copy's corners may still touch
    /// its neighbours).
    pub overlap: Option<f64>,
    /// A copy is split into several files so that none holds more bytes of geometry, unless a single object does.
    pub max_file_bytes: u64,
}

impl Default for CopiesSettings {
    fn default() -> Self {
        CopiesSettings { copies: 6, overlap: None, max_file_bytes: 3 << 29 }
    }
}

/// Each copy's placement, `world_from_model`.
///
/// Copy k is turned by 60 degrees x k about +Y through the middle of the model's box, odd copies are tilted by
/// 3 degrees besides, the scale is 1 + 0.01 k; the copies stand on a near-square grid in XZ. Copy 0 stays in place.
pub fn copy_placements(model: &Model, settings: &CopiesSettings) -> Vec<DAffine3> {
    let (low, high) = world_bounds(model);
    if low.x > high.x {
        return Vec::new();
    }
    let (centre, size) = ((low + high) / 2.0, high - low);
    let pitch = settings.overlap.unwrap_or(1.1) * size.x.max(size.z);
    let count = u64::from(settings.copies);
    let columns = (1..=settings.copies).find(|&columns| u64::from(columns).pow(2) >= count).unwrap_or(1);
    (0..settings.copies)
        .map(|copy| {
            let cell = DVec3::new(f64::from(copy % columns), 0.0, f64::from(copy / columns)) * pitch;
            let tilt = if copy % 2 == 1 { TAU / 120.0 } else { 0.0 };
            let turned = about_y(TAU * f64::from(copy % 6) / 6.0) * about_x(tilt);
            let matrix3 = turned * (1.0 + 0.01 * f64::from(copy));
            DAffine3 { matrix3, translation: cell + (centre - matrix3 * centre) }
        })
        .collect()
}

fn about_y(angle: f64) -> DMat3 {
    let (cos, sin) = (libm::cos(angle), libm::sin(angle));
    DMat3::from_cols(DVec3::new(cos, 0.0, -sin), DVec3::Y, DVec3::new(sin, 0.0, cos))
}

fn about_x(angle: f64) -> DMat3 {
    let (cos, sin) = (libm::cos(angle), libm::sin(angle));
    DMat3::from_cols(DVec3::X, DVec3::new(0.0, cos, sin), DVec3::new(0.0, -sin, cos))
}

/// Low and high corner; low above high for a model without vertices.
fn world_bounds(model: &Model) -> (DVec3, DVec3) {
    let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (object, part) in placed(model) {
        for position in &part.mesh.positions {
            let at = object.world_from_part.transform_point3(*position);
            bounds = (bounds.0.min(at), bounds.1.max(at));
        }
    }
    bounds
}

fn placed(model: &Model) -> impl Iterator<Item = (&Object, &Part)> {
    model.objects.iter().filter_map(|object| Some((object, model.parts.get(object.part as usize)?)))
}

/// Writes `copy0.glb`, `copy1.glb` and so on to an empty or new folder. A copy that is too large for one file becomes
/// `copy0-1.glb`, `copy0-2.glb` and so on; each has the root node `copy0`.
///
/// Every vertex is (copy x placement) x position in f64, then rounded to f32. Streamed object by object: besides the
/// model itself, memory holds one object's vertices.
pub fn write_copies(
    model: &Model,
    settings: &CopiesSettings,
    output: &Path,
    progress: &dyn Progress,
) -> Result<WriteSummary, SampleError> {
    if let Some(value) = settings.overlap.filter(|overlap| !(overlap.is_finite() && *overlap > 0.0)) {
        return Err(SampleError::Setting {
            what: "overlap",
            value,
            expected: "a number above 0, such as 0.8",
        });
    }
    empty_folder(output)?;
    let mut summary = WriteSummary::default();
    for (copy, world_from_model) in copy_placements(model, settings).into_iter().enumerate() {
        progress.stage(&format!("writing copy {copy}"), model.placed_triangles(), "triangles");
        let ranges = split(model, settings.max_file_bytes);
        for (piece, range) in ranges.iter().enumerate() {
            let name = if ranges.len() == 1 {
                format!("copy{copy}.glb")
            } else {
                format!("copy{copy}-{}.glb", piece + 1)
            };
            let objects = model.objects.get(range.clone()).unwrap_or_default();
            let file = output.join(name);
            let document = document(model, objects, format!("copy{copy}"));
            let bytes = glb::write(&file, &document, progress, |index, geometry| {
                if let Some(object) = objects.get(index as usize) {
                    bake(model, object, &world_from_model, geometry);
                }
            })?;
            let triangles = |object: &Object| {
                model.parts.get(object.part as usize).map_or(0, |p| p.mesh.triangles.len() as u64)
            };
            summary.add(file, objects.len() as u64, objects.iter().map(triangles).sum(), bytes);
        }
    }
    Ok(summary)
}

/// Runs of objects of at most `max_bytes` of geometry each, at least one object.
fn split(model: &Model, max_bytes: u64) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    let mut bytes = 0;
    for (at, (_, part)) in placed(model).enumerate() {
        let own = 12 * (part.mesh.positions.len() + part.mesh.triangles.len()) as u64;
        bytes += own;
        match ranges.last_mut() {
            Some(range) if bytes <= max_bytes => range.end = at + 1,
            _ => {
                ranges.push(at..at + 1);
                bytes = own;
            }
        }
    }
    ranges
}

/// A root for the copy, the nodes that lead to `objects`, and a geometry for each object.
fn document<'a>(model: &'a Model, objects: &[Object], root: String) -> Document<'a> {
    let mut needed = vec![false; model.nodes.len()];
    for object in objects {
        let mut at = Some(object.node);
        while let Some(id) = at {
            let Some(seen) = needed.get_mut(id as usize) else { break };
            if std::mem::replace(seen, true) {
                break;
            }
            at = model.nodes.get(id as usize).and_then(|node| node.parent);
        }
    }
    let mut document = Document { geometries: objects.len() as u32, ..Document::default() };
    document.nodes.push(GlbNode { name: root.into(), ..GlbNode::default() });
    let mut new_id: Vec<Option<NodeId>> = vec![None; model.nodes.len()];
    for (id, node) in model.nodes.iter().enumerate().filter(|(id, _)| needed[*id]) {
        // Parents stand first, so theirs is known.
        let parent =
            node.parent.and_then(|parent| new_id.get(parent as usize).copied().flatten()).unwrap_or(0);
        new_id[id] = Some(document.nodes.len() as NodeId);
        let (name, extras) = (node.name.as_str().into(), node.extras.as_deref());
        document.nodes.push(GlbNode { name, parent: Some(parent), extras, ..GlbNode::default() });
    }
    for (geometry, object) in (0..).zip(objects) {
        let name = model.parts.get(object.part as usize).map_or("", |part| &part.name);
        document.meshes.push(GlbMesh { name: name.into(), geometry, colour: object.colour });
        let id = new_id.get(object.node as usize).copied().flatten();
        if let Some(node) = id.and_then(|id| document.nodes.get_mut(id as usize)) {
            node.mesh = Some(geometry);
        }
    }
    document
}

fn bake(model: &Model, object: &Object, world_from_model: &DAffine3, geometry: &mut Geometry) {
    let Some(part) = model.parts.get(object.part as usize) else { return };
    let world_from_part = *world_from_model * object.world_from_part;
    let baked = |position: &DVec3| world_from_part.transform_point3(*position).as_vec3().to_array();
    geometry.positions.extend(part.mesh.positions.iter().map(baked));
    // A mirrored placement turns triangles inside out: turn them back.
    let mirrored = world_from_part.matrix3.determinant() < 0.0;
    let corner = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
    geometry.triangles.extend(part.mesh.triangles.iter().map(corner));
}
