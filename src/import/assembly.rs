//! Joins the drafts of all files into one [`Model`]; equal parts are stored once.

use std::collections::HashMap;

use bytemuck::cast_slice;

use super::ImportOptions;
use super::draft::{Draft, DraftNode, HashedPart, too_many_nodes};
use super::error::ImportError;
use crate::model::{Mesh, Model, Node, NodeId, Object, PartId};

/// The model so far.
#[derive(Default)]
pub(super) struct Assembly {
    model: Model,
    by_fingerprint: HashMap<u64, Vec<PartId>>,
}

impl Assembly {
    /// Adds the node of a folder or of a file. Called in depth-first order.
    pub fn node(
        &mut self,
        name: &str,
        parent: Option<NodeId>,
        options: &ImportOptions,
    ) -> Result<NodeId, ImportError> {
        if self.model.nodes.len() >= options.max_nodes {
            return Err(too_many_nodes(name, options));
        }
        self.model.nodes.push(Node { name: name.to_owned(), parent, extras: None });
        Ok(self.model.nodes.len() as NodeId - 1)
    }

    /// Adds a file's content below `parent`.
    pub fn add(
        &mut self,
        file: &str,
        draft: Draft,
        parent: Option<NodeId>,
        options: &ImportOptions,
    ) -> Result<(), ImportError> {
        if self.model.nodes.len() + draft.nodes.len() > options.max_nodes {
            return Err(too_many_nodes(file, options));
        }
        let is_used = used_parts(draft.parts.len(), &draft.nodes);
        let part_ids: Vec<Option<PartId>> =
            draft.parts.into_iter().zip(is_used).map(|(part, used)| used.then(|| self.part(part))).collect();
        let first = self.model.nodes.len() as NodeId;
        for (node, id) in draft.nodes.into_iter().zip(first..) {
            let parent = node.parent.map_or(parent, |p| Some(first + p));
            self.model.nodes.push(Node { name: node.name, parent, extras: node.extras });
            let part_of = |part: u32| part_ids.get(part as usize).copied().flatten();
            if let Some(object) = node.object
                && let Some(part) = part_of(object.part)
            {
                let (world_from_part, colour) = (object.world_from_part, object.colour);
                self.model.objects.push(Object { node: id, part, world_from_part, colour });
            }
        }
        Ok(())
    }

    /// Adds the only shape of a file to the node of that file, which then carries the object itself.
    pub fn add_to_node(&mut self, node: NodeId, draft: Draft) {
        let mut parts = draft.parts;
        for object in draft.nodes.into_iter().filter_map(|node| node.object) {
            if (object.part as usize) < parts.len() {
                let part = self.part(parts.swap_remove(object.part as usize));
                let (world_from_part, colour) = (object.world_from_part, object.colour);
                self.model.objects.push(Object { node, part, world_from_part, colour });
            }
        }
    }

    pub fn finish(self) -> Model {
        self.model
    }

    /// The part with this geometry: a known one if there is one with the same bits.
    fn part(&mut self, new: HashedPart) -> PartId {
        let same = self.by_fingerprint.entry(new.fingerprint).or_default();
        let parts = &mut self.model.parts;
        let known = same.iter().copied().find(|&id| {
            parts.get(id as usize).is_some_and(|part| is_same_geometry(&part.mesh, &new.part.mesh))
        });
        known.unwrap_or_else(|| {
            let id = parts.len() as PartId;
            same.push(id);
            parts.push(new.part);
            id
        })
    }
}

/// Equal bits, so that 0 and -0 differ and nothing is ever merged by rounding.
fn is_same_geometry(a: &Mesh, b: &Mesh) -> bool {
    a.triangles == b.triangles && cast_slice::<_, u64>(&a.positions) == cast_slice::<_, u64>(&b.positions)
}

/// For each of `parts` parts, whether an object of `nodes` uses it.
fn used_parts(parts: usize, nodes: &[DraftNode]) -> Vec<bool> {
    let mut is_used = vec![false; parts];
    for object in nodes.iter().filter_map(|node| node.object.as_ref()) {
        if let Some(used) = is_used.get_mut(object.part as usize) {
            *used = true;
        }
    }
    is_used
}
