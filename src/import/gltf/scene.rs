//! The node tree of the default scene, walked without recursion; nodes become [`Draft`] nodes, instances
//! child nodes.

use std::collections::BTreeSet;

use glam::DAffine3;

use super::accessor::{Component, Contents, Elements};
use super::json::{Document, Instancing, Node};
use super::transform;
use crate::import::draft::{Draft, Piece, Source, too_many_nodes, too_many_placed};
use crate::import::error::ImportError;

/// A node to visit.
struct Visit {
    node: usize,
    /// In the draft.
    parent: Option<u32>,
    world_from_parent: DAffine3,
}

/// The nodes of the default scene without parent in it, in order.
fn roots(source: &Source, document: &Document) -> Result<Vec<usize>, ImportError> {
    let scenes = &document.scenes;
    match document.scene {
        Some(scene) => scenes.get(scene).map(|scene| scene.nodes.clone()).ok_or_else(|| {
            source.invalid("scene", format!("one of {} scenes", scenes.len()), scene.to_string())
        }),
        None => Ok(scenes.first().map_or_else(|| orphans(document), |scene| scene.nodes.clone())),
    }
}

/// Nodes that are nobody's child.
fn orphans(document: &Document) -> Vec<usize> {
    let mut is_child = vec![false; document.nodes.len()];
    for &child in document.nodes.iter().flat_map(|node| &node.children) {
        if let Some(entry) = is_child.get_mut(child) {
            *entry = true;
        }
    }
    (0..is_child.len()).filter(|&i| is_child.get(i) == Some(&false)).collect()
}

/// Checks that the scene is a forest, and returns the meshes that it uses, sorted.
pub(super) fn check(source: &Source, document: &Document) -> Result<Vec<usize>, ImportError> {
    let mut is_seen = vec![false; document.nodes.len()];
    let mut meshes = BTreeSet::new();
    let mut waiting = roots(source, document)?;
    while let Some(id) = waiting.pop() {
        let expected = || format!("one of {} nodes", document.nodes.len());
        let (Some(node), Some(seen)) = (document.nodes.get(id), is_seen.get_mut(id)) else {
            return Err(source.invalid(format!("node {id}"), expected(), "no such one"));
        };
        if std::mem::replace(seen, true) {
            let expected = "one parent, and no circle";
            return Err(source.invalid(format!("node {id}"), expected, "a second way to it"));
        }
        meshes.extend(node.mesh);
        waiting.extend(&node.children);
    }
    Ok(meshes.into_iter().collect())
}

/// Adds the scene, which [`check`] has passed. `pieces_of_mesh` says what mesh `used[i]` consists of.
pub(super) fn build(
    contents: Contents,
    used: &[usize],
    pieces_of_mesh: &[Vec<Piece>],
    draft: &mut Draft,
) -> Result<(), ImportError> {
    let Contents { source, document, .. } = contents;
    draft.nodes.reserve(limit_growth(contents, used, pieces_of_mesh, draft)?);
    let visit = |node, parent, world_from_parent| Visit { node, parent, world_from_parent };
    let roots = roots(source, document)?;
    let mut waiting: Vec<Visit> =
        roots.iter().rev().map(|&root| visit(root, None, DAffine3::IDENTITY)).collect();
    let mut visited = 0_u64;
    while let Some(Visit { node: id, parent, world_from_parent }) = waiting.pop() {
        visited += 1;
        if visited.is_multiple_of(65_536) {
            source.check_cancelled()?;
        }
        let Some(node) = document.nodes.get(id) else { continue };
        let place = || format!("{}: node {id}", source.name);
        draft.findings.add("cameras ignored", u64::from(node.camera.is_some()), place);
        draft.findings.add("skins ignored: rest pose used", u64::from(node.skin.is_some()), place);
        let (parent_from_node, is_projective) = transform::of_node(node);
        draft.findings.add("projective rows of node matrices ignored", u64::from(is_projective), place);
        let world_from_node = world_from_parent * parent_from_node;

        let name = node.name.clone().filter(|name| !name.trim().is_empty());
        let name = name.unwrap_or_else(|| format!("node {id}"));
        let extras = node.extras.as_ref().map(ToString::to_string);
        let at = draft.node(source, name, parent, extras)?;
        if let Some(pieces) = pieces_of(node, used, pieces_of_mesh) {
            match &node.extensions.instancing {
                None => draft.place(source, at, world_from_node, pieces)?,
                Some(instancing) => {
                    let instances = instances(contents, id, instancing)?;
                    for (i, node_from_instance) in instances.enumerate() {
                        let instance = draft.node(source, format!("#{i}"), Some(at), None)?;
                        draft.place(source, instance, world_from_node * node_from_instance, pieces)?;
                    }
                }
            }
        }
        waiting.extend(node.children.iter().rev().map(|&child| visit(child, Some(at), world_from_node)));
    }
    let outside = (document.nodes.len() as u64).saturating_sub(visited);
    draft.findings.add("nodes ignored: not in the default scene", outside, || source.name.to_owned());
    Ok(())
}

fn pieces_of<'a>(node: &Node, used: &[usize], pieces_of_mesh: &'a [Vec<Piece>]) -> Option<&'a [Piece]> {
    let at = used.binary_search(&node.mesh?).ok()?;
    pieces_of_mesh.get(at).map(Vec::as_slice)
}

/// Nodes that [`build`] will add, counted before the first is made. A small file can ask for millions of them, by
/// naming one accessor of instances or one mesh of many colours in many nodes. An honest instance has 12 bytes at
/// least, an honest colour dozens.
fn limit_growth(
    contents: Contents,
    used: &[usize],
    pieces_of_mesh: &[Vec<Piece>],
    draft: &Draft,
) -> Result<usize, ImportError> {
    let Contents { source, document, .. } = contents;
    let (mut nodes, mut triangles) = (0_u64, 0_u64);
    let mut waiting = roots(source, document)?;
    while let Some(id) = waiting.pop() {
        let Some(node) = document.nodes.get(id) else { continue };
        waiting.extend(&node.children);
        nodes = nodes.saturating_add(1);
        let Some(pieces) = pieces_of(node, used, pieces_of_mesh) else { continue };
        // A single piece needs no node of its own.
        let below = if pieces.len() == 1 { 0 } else { pieces.len() as u64 };
        let (copies, added) = match &node.extensions.instancing {
            None => (1, below),
            Some(instancing) => {
                let instances = instances(contents, id, instancing)?.len() as u64;
                (instances, instances.saturating_mul(1 + below))
            }
        };
        nodes = nodes.saturating_add(added);
        let placed = copies.saturating_mul(draft.triangles_of(pieces));
        triangles = triangles.saturating_add(placed);
    }
    let limit = contents.total_bytes.saturating_mul(4);
    if nodes > limit {
        let advice = "its nodes share data beyond reason; export it again";
        return Err(source.too_many("nodes, instances and pieces of meshes", limit, advice));
    }
    if nodes > source.options.max_nodes as u64 {
        return Err(too_many_nodes(source.name, source.options));
    }
    if triangles > source.options.max_placed_triangles {
        return Err(too_many_placed(source.name, source.options));
    }
    Ok(nodes as usize)
}

/// Placements of EXT_mesh_gpu_instancing.
fn instances<'a>(
    contents: Contents<'a>,
    node: usize,
    instancing: &Instancing,
) -> Result<impl ExactSizeIterator<Item = DAffine3> + use<'a>, ImportError> {
    let attributes = &instancing.attributes;
    let read = |accessor: Option<usize>, kind, components: &[Component]| {
        accessor.map(|accessor| Elements::new(contents, accessor, kind, components)).transpose()
    };
    let translations = read(attributes.translation, "VEC3", &[Component::F32])?;
    let rotations = read(attributes.rotation, "VEC4", &[Component::F32, Component::I8, Component::I16])?;
    let scales = read(attributes.scale, "VEC3", &[Component::F32])?;
    let counts: Vec<usize> =
        [&translations, &rotations, &scales].into_iter().flatten().map(Elements::count).collect();
    let count = counts.first().copied().unwrap_or(0);
    if let Some(other) = counts.into_iter().find(|&other| other != count) {
        let place = format!("node {node}, EXT_mesh_gpu_instancing");
        return Err(contents.source.invalid(place, format!("{count} of each attribute"), other.to_string()));
    }
    Ok((0..count).map(move |i| {
        let three = |elements: &Option<Elements>, otherwise| {
            elements.as_ref().map_or(otherwise, |elements| {
                let [x, y, z, _] = elements.get(i);
                [x, y, z]
            })
        };
        let rotation = rotations.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |elements| elements.get(i));
        transform::from_parts(three(&translations, [0.0; 3]), rotation, three(&scales, [1.0; 3]))
    }))
}
