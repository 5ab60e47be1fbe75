//! Copies of a model that share nothing, for scale tests as the papers made them: every vertex is baked, every copy is
//! turned and scaled, so that neither instancing nor deduplication can shrink the load.

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::ops::Range;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};

use super::write::{SampleError, WriteSummary, empty_folder};
use crate::export::glb::{self, Document, Geometry, GlbMesh, GlbNode};
use crate::import::UpAxis;
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
    /// The axis that copies are turned about and stand upright on.
    pub up: UpAxis,
    /// A copy is split into several files so that none holds more bytes of geometry, unless a single object does.
    pub max_file_bytes: u64,
}

impl Default for CopiesSettings {
    fn default() -> Self {
        CopiesSettings { copies: 6, overlap: None, up: UpAxis::Y, max_file_bytes: 3 << 29 }
    }
}

/// Each copy's placement, `world_from_model`.
///
/// Copy k is turned by 60 degrees x k about the up axis through the middle of the model's box, odd copies are tilted by
/// 3 degrees besides, the scale is 1 + 0.01 k; the copies stand on a near-square grid on the ground. Copy 0 stays in
/// place.
pub fn copy_placements(model: &Model, settings: &CopiesSettings) -> Vec<DAffine3> {
    let (low, high) = world_bounds(model);
    if low.x > high.x {
        return Vec::new();
    }
    let (centre, size) = ((low + high) / 2.0, high - low);
    let model_from_y_up = model_from_y_up(settings.up);
    let ground = model_from_y_up.transpose() * size;
    let pitch = settings.overlap.unwrap_or(1.1) * ground.x.max(ground.z);
    let count = u64::from(settings.copies);
    let columns = (1..=settings.copies).find(|&columns| u64::from(columns).pow(2) >= count).unwrap_or(1);
    (0..settings.copies)
        .map(|copy| {
            let cell = DVec3::new(f64::from(copy % columns), 0.0, f64::from(copy / columns)) * pitch;
            let tilt = if copy % 2 == 1 { TAU / 120.0 } else { 0.0 };
            let turned = about_y(TAU * f64::from(copy % 6) / 6.0) * about_x(tilt);
            let scaled = turned * (1.0 + 0.01 * f64::from(copy));
            let matrix3 = model_from_y_up * scaled * model_from_y_up.transpose();
            DAffine3 { matrix3, translation: model_from_y_up * cell + (centre - matrix3 * centre) }
        })
        .collect()
}

/// The axes exchanged in a circle, so that no number changes but its place.
fn model_from_y_up(up: UpAxis) -> DMat3 {
    match up {
        UpAxis::X => DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y),
        UpAxis::Y => DMat3::IDENTITY,
        UpAxis::Z => DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X),
    }
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
/// Every vertex is (copy x placement) x position in f64, then rounded to f32: relative to a point near the object, to
/// which its node moves it, so that f32 is as fine at map coordinates as at the origin. That point lies differently in
/// every object, so that no two have the same vertices. Streamed object by object: besides the model itself, memory
/// holds one object's vertices.
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
            let origins: Vec<DVec3> = range
                .clone()
                .zip(objects)
                .map(|(index, object)| origin(model, object, &world_from_model, index))
                .collect();
            let document = document(model, objects, &origins, format!("copy{copy}"));
            let bytes = glb::write(&file, &document, progress, |index, geometry| {
                if let (Some(object), Some(origin)) =
                    (objects.get(index as usize), origins.get(index as usize))
                {
                    bake(model, object, &world_from_model, *origin, geometry);
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
///
/// `origins` are the objects' in the world. Objects may stand in the subtree of another one, whose node moves them too.
fn document<'a>(model: &'a Model, objects: &[Object], origins: &[DVec3], root: String) -> Document<'a> {
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
    let origin_of_node: HashMap<NodeId, DVec3> =
        objects.iter().zip(origins).map(|(object, origin)| (object.node, *origin)).collect();
    // Of the nodes in the document: where they are in the world.
    let mut placed_at = vec![DVec3::ZERO];
    for (id, node) in model.nodes.iter().enumerate().filter(|(id, _)| needed[*id]) {
        // Parents stand first, so theirs is known.
        let parent =
            node.parent.and_then(|parent| new_id.get(parent as usize).copied().flatten()).unwrap_or(0);
        new_id[id] = Some(document.nodes.len() as NodeId);
        let (name, extras) = (node.name.as_str().into(), node.extras.as_deref());
        let parent_at = placed_at.get(parent as usize).copied().unwrap_or_default();
        let at = origin_of_node.get(&(id as NodeId)).copied().unwrap_or(parent_at);
        placed_at.push(at);
        let matrix = DAffine3::from_translation(at - parent_at);
        document.nodes.push(GlbNode { name, parent: Some(parent), matrix, extras, ..GlbNode::default() });
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

/// The point that the vertices of object `index` are written relative to.
///
/// The middle of its box, moved by up to half its size: as far as no other object is, so that two placements of one
/// part do not become equal again once their translation is in the node.
fn origin(model: &Model, object: &Object, world_from_model: &DAffine3, index: usize) -> DVec3 {
    let Some(part) = model.parts.get(object.part as usize) else { return DVec3::ZERO };
    let world_from_part = *world_from_model * object.world_from_part;
    let world = || part.mesh.positions.iter().map(|position| world_from_part.transform_point3(*position));
    let (low, high) =
        world().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
    if part.mesh.positions.is_empty() {
        return DVec3::ZERO;
    }
    // M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences" (2018), R3: powers of 1 / 1.2207440846.
    let r3 = DVec3::new(0.819_172_513_396_164, 0.671_043_606_703_789, 0.549_700_477_901_970);
    let shift = (r3 * (index as f64 + 1.0)).fract() - 0.5;
    (low + high) / 2.0 + shift * (high - low).max_element()
}

fn bake(model: &Model, object: &Object, world_from_model: &DAffine3, origin: DVec3, geometry: &mut Geometry) {
    let Some(part) = model.parts.get(object.part as usize) else { return };
    let world_from_part = *world_from_model * object.world_from_part;
    let baked =
        |position: &DVec3| (world_from_part.transform_point3(*position) - origin).as_vec3().to_array();
    geometry.positions.extend(part.mesh.positions.iter().map(baked));
    // A mirrored placement turns triangles inside out: turn them back.
    let mirrored = world_from_part.matrix3.determinant() < 0.0;
    let corner = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
    geometry.triangles.extend(part.mesh.triangles.iter().map(corner));
}
