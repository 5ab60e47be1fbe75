//! Meshes: primitives of one colour are merged into one geometry, and a geometry that several meshes share is
//! decoded once.

use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use super::accessor::{Component, Contents, Elements};
use super::extensions::{DRACO, unsupported};
use super::json::{Mesh as JsonMesh, Primitive};
use super::material::{Paint, paint_of};
use crate::import::draft::{Draft, HashedPart, Piece};
use crate::import::error::ImportError;
use crate::import::repair::{self, Dropped, MAX_PART_TRIANGLES, Remap};
use crate::model::Mesh;
use crate::report::Findings;

/// Everything about a primitive that decides its triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Shape {
    position: usize,
    indices: Option<usize>,
    mode: Mode,
    /// For messages.
    mesh: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Mode {
    Triangles,
    Strip,
    Fan,
}

/// Shapes of one mesh that have one colour.
struct Group {
    paint: Paint,
    shapes: Vec<Shape>,
}

/// Decodes the meshes in `used` (sorted) into parts of `draft`; the result has the pieces of each, in the
/// same order.
pub(super) fn decode(
    contents: Contents,
    used: &[usize],
    paints: &[Paint],
    draft: &mut Draft,
) -> Result<Vec<Vec<Piece>>, ImportError> {
    let mut groups_of_mesh = Vec::with_capacity(used.len());
    for &mesh in used {
        groups_of_mesh.push(groups(contents, mesh, paints, &mut draft.findings)?);
    }
    // The same shapes in two meshes (a bolt in steel, a bolt in brass) are one geometry.
    let mut geometries: Vec<(usize, &[Shape])> = Vec::new();
    let mut known: HashMap<Vec<Shape>, usize> = HashMap::new();
    let mut geometry_of_group = Vec::new();
    for (group, &mesh) in groups_of_mesh.iter().zip(used).flat_map(|(g, m)| g.iter().map(move |g| (g, m))) {
        let key = group.shapes.iter().map(|&shape| Shape { mesh: 0, ..shape }).collect();
        geometry_of_group.push(*known.entry(key).or_insert_with(|| {
            geometries.push((mesh, &group.shapes));
            geometries.len() - 1
        }));
    }
    limit_triangles(contents, &geometries)?;
    let decoded: Vec<Result<(HashedPart, Findings), ImportError>> =
        geometries.par_iter().map(|&(mesh, shapes)| geometry(contents, mesh, shapes)).collect();
    let mut part_of_geometry = Vec::with_capacity(decoded.len());
    for (outcome, &(mesh, _)) in decoded.into_iter().zip(&geometries) {
        let (part, findings) = outcome?;
        draft.findings.merge(findings);
        part_of_geometry.push(draft.part(part, || place(contents, mesh)));
    }
    let mut geometry_of_group = geometry_of_group.into_iter();
    let pieces_of = |groups: Vec<Group>| {
        let pieces = groups.into_iter().zip(&mut geometry_of_group).filter_map(|(group, geometry)| {
            let part = part_of_geometry.get(geometry).copied().flatten()?;
            Some(Piece { label: group.paint.label, colour: group.paint.colour, part })
        });
        pieces.collect()
    };
    Ok(groups_of_mesh.into_iter().map(pieces_of).collect())
}

fn place(contents: Contents, mesh: usize) -> String {
    let name = contents.document.meshes.get(mesh).and_then(|m| m.name.as_deref()).unwrap_or_default();
    format!("{}: mesh {mesh} \"{name}\"", contents.source.name)
}

/// The triangle primitives of a mesh by colour, in the order in which the colours come first.
fn groups(
    contents: Contents,
    mesh: usize,
    paints: &[Paint],
    findings: &mut Findings,
) -> Result<Vec<Group>, ImportError> {
    let source = contents.source;
    let meshes = &contents.document.meshes;
    let Some(JsonMesh { primitives, .. }) = meshes.get(mesh) else {
        return Err(source.invalid(
            "nodes",
            format!("meshes below {}", meshes.len()),
            format!("mesh {mesh}"),
        ));
    };
    let here = || place(contents, mesh);
    let mut groups: Vec<Group> = Vec::new();
    let mut by_colour = HashMap::new();
    for (i, primitive) in primitives.iter().enumerate() {
        let place = || format!("mesh {mesh}, primitive {i}");
        let mode = match primitive.mode {
            None | Some(4) => Mode::Triangles,
            Some(5) => Mode::Strip,
            Some(6) => Mode::Fan,
            Some(0..4) => {
                findings.add("primitives skipped: points or lines", 1, here);
                continue;
            }
            Some(other) => return Err(source.invalid(place(), "a mode from 0 to 6", other.to_string())),
        };
        let Some(position) = primitive.attributes.position else {
            findings.add("primitives skipped: no POSITION", 1, here);
            continue;
        };
        refuse_compressed(contents, primitive, position)?;
        findings.add("morph targets ignored: rest pose used", primitive.targets.0.len() as u64, here);
        let coloured = u64::from(primitive.attributes.colour.is_some());
        findings.add("primitives whose vertex colours are ignored: the material's is used", coloured, here);
        let paint = paint_of(source, paints, primitive.material, place)?;
        let group = *by_colour.entry(paint.colour).or_insert_with(|| {
            groups.push(Group { paint, shapes: Vec::new() });
            groups.len() - 1
        });
        if let Some(group) = groups.get_mut(group) {
            group.shapes.push(Shape { position, indices: primitive.indices, mode, mesh });
        }
    }
    if groups.is_empty() {
        findings.add("meshes dropped: no triangle in them", 1, here);
    }
    Ok(groups)
}

/// A primitive whose only data are in an extension that the file forgot to require.
fn refuse_compressed(contents: Contents, primitive: &Primitive, position: usize) -> Result<(), ImportError> {
    let accessor = contents.document.accessors.get(position);
    let has_data = accessor.is_some_and(|a| a.buffer_view.is_some() || a.sparse.is_some());
    if primitive.extensions.contains_key(DRACO) && !has_data {
        return Err(unsupported(contents.source, DRACO));
    }
    Ok(())
}

/// A small file can name one long accessor a million times. No exporter writes less than a byte for four
/// triangles.
fn limit_triangles(contents: Contents, geometries: &[(usize, &[Shape])]) -> Result<(), ImportError> {
    let source = contents.source;
    let accessors = &contents.document.accessors;
    let sparse = |accessor: usize| {
        accessors.get(accessor).and_then(|a| a.sparse.as_ref()).map_or(0, |sparse| sparse.count as u64)
    };
    // Sparse values count too: each shape decodes them again.
    let work = |shape: &Shape| {
        let accessor = accessors.get(shape.indices.unwrap_or(shape.position));
        let count = accessor.map_or(0, |a| a.count as u64);
        let triangles = if shape.mode == Mode::Triangles { count / 3 } else { count.saturating_sub(2) };
        triangles.saturating_add(sparse(shape.position)).saturating_add(shape.indices.map_or(0, sparse))
    };
    let mut total = 0_u64;
    for (_, shapes) in geometries {
        let own = shapes.iter().map(work).fold(0_u64, u64::saturating_add);
        if own > MAX_PART_TRIANGLES {
            return Err(source.too_many("triangles in one part", MAX_PART_TRIANGLES, "split the mesh"));
        }
        total = total.saturating_add(own);
    }
    let limit = contents.total_bytes.saturating_mul(4).min(source.options.max_triangles);
    if total > limit {
        return Err(source.too_many(
            "triangles",
            limit,
            "its accessors share data beyond reason; export it again",
        ));
    }
    Ok(())
}

/// One geometry of some shapes.
fn geometry(
    contents: Contents,
    mesh: usize,
    shapes: &[Shape],
) -> Result<(HashedPart, Findings), ImportError> {
    contents.source.check_cancelled()?;
    let mut merged = Mesh::default();
    let mut dropped = Dropped::default();
    let mut findings = Findings::default();
    // Primitives often share one vertex buffer; what they share of it stays shared.
    let mut sources: HashMap<usize, (Elements, Remap)> = HashMap::new();
    for shape in shapes {
        let indices = shape.indices.map(|accessor| index_list(contents, accessor)).transpose()?;
        let (positions, remap) = match sources.entry(shape.position) {
            std::collections::hash_map::Entry::Occupied(known) => known.into_mut(),
            std::collections::hash_map::Entry::Vacant(new) => {
                let positions = position_list(contents, shape.position)?;
                let corners = indices.as_ref().map_or(positions.count(), Vec::len);
                let remap = Remap::new(positions.count(), corners);
                new.insert((positions, remap))
            }
        };
        let count = indices.as_ref().map_or(positions.count(), Vec::len);
        if shape.mode == Mode::Triangles {
            let odd = u64::from(!count.is_multiple_of(3));
            findings.add("primitives with a corner or two left over", odd, || place(contents, mesh));
        }
        let corner = |i: usize| match &indices {
            Some(indices) => indices.get(i).copied().unwrap_or(u32::MAX),
            None => i as u32,
        };
        let triangles = (0..triangle_count(shape.mode, count)).map(|i| corners(shape.mode, i).map(corner));
        merged.triangles.reserve(triangles.len());
        let position = |i: u32| {
            let [x, y, z, _] = positions.get(i as usize);
            DVec3::new(x, y, z)
        };
        repair::append(&mut merged, positions.count(), position, triangles, remap, &mut dropped);
    }
    dropped.report(&mut findings, || place(contents, mesh));
    let name = contents.document.meshes.get(mesh).and_then(|m| m.name.clone()).unwrap_or_default();
    Ok((HashedPart::new(name, merged), findings))
}

fn index_list(contents: Contents, accessor: usize) -> Result<Vec<u32>, ImportError> {
    let components = [Component::U8, Component::U16, Component::U32];
    Ok(Elements::new(contents, accessor, "SCALAR", &components)?.to_indices())
}

/// Floats, or the small integers of KHR_mesh_quantization.
fn position_list(contents: Contents<'_>, accessor: usize) -> Result<Elements<'_>, ImportError> {
    let components = [Component::F32, Component::I8, Component::U8, Component::I16, Component::U16];
    Elements::new(contents, accessor, "VEC3", &components)
}

fn triangle_count(mode: Mode, corners: usize) -> usize {
    match mode {
        Mode::Triangles => corners / 3,
        Mode::Strip | Mode::Fan => corners.saturating_sub(2),
    }
}

/// Places in the index list of triangle `i`, glTF 2.0 section 3.7.2.1.
fn corners(mode: Mode, i: usize) -> [usize; 3] {
    match mode {
        Mode::Triangles => [3 * i, 3 * i + 1, 3 * i + 2],
        Mode::Strip => [i, i + 1 + i % 2, i + 2 - i % 2],
        Mode::Fan => [i + 1, i + 2, 0],
    }
}
