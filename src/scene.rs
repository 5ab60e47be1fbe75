//! A container as the runtime sees it: the assembly tree with names, objects, drawables, and geometry on demand.
//!
//! Indices that are passed in (node, object, drawable ...) come from this scene; one that is out of range is a bug of
//! the caller and panics like a slice does. Levels are the exception: they are read from the file, so
//! [`Scene::level_mesh`] returns errors.

use std::iter;
use std::ops::Range;
use std::path::Path;

use glam::{DAffine3, Vec3};
use serde_json::Value;
use voxsight_voxel::dag::{DagRef, OwnersRef};
use voxsight_voxel::grid::Grid;

use crate::container::error::{ContainerError, Problem};
use crate::container::layout::{ChunkRecord, LevelRecord, NodeRecord, ObjectRecord, PartRecord, StringRef};
use crate::container::{BuildReport, Container, Meta};
use crate::geometry::{self, LevelMesh};
use crate::model::path_segment;

/// The unit of visibility, level of detail and streaming: a chunk of an object's part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drawable {
    /// Index into [`Scene::objects`].
    pub object: u32,
    /// Index into [`Scene::chunks`].
    pub chunk: u32,
}

/// An opened container.
#[derive(Debug)]
pub struct Scene {
    container: Container,
    drawables: Vec<Drawable>,
}

impl AsRef<Scene> for Scene {
    fn as_ref(&self) -> &Scene {
        self
    }
}

impl Scene {
    /// Opens and checks a container, see [`Container::open`].
    ///
    /// # Errors
    ///
    /// As [`Container::open`]; not enough memory for the drawables.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ContainerError> {
        Self::new(Container::open(path)?)
    }

    /// Takes over an opened container.
    ///
    /// # Errors
    ///
    /// Not enough memory for the drawables (8 bytes each, at most 1 GiB).
    pub fn new(container: Container) -> Result<Self, ContainerError> {
        let drawables = list_drawables(&container)?;
        Ok(Scene { container, drawables })
    }

    /// The file behind the scene: voxel sections, lengths of sections.
    pub fn container(&self) -> &Container {
        &self.container
    }

    /// The voxel grid.
    pub fn grid(&self) -> Grid {
        self.meta().grid.grid()
    }

    /// The occupied voxels.
    pub fn dag(&self) -> DagRef<'_> {
        self.container.dag()
    }

    /// Who occupies them: drawables.
    pub fn owners(&self) -> OwnersRef<'_> {
        self.container.owners()
    }

    /// Sources, settings, bounds and counts.
    pub fn meta(&self) -> &Meta {
        self.container.meta()
    }

    /// What the build repaired and counted.
    pub fn report(&self) -> &BuildReport {
        self.container.report()
    }

    /// The assembly tree, in pre-order.
    pub fn nodes(&self) -> &[NodeRecord] {
        self.container.nodes()
    }

    /// Distinct geometries.
    pub fn parts(&self) -> &[PartRecord] {
        self.container.parts()
    }

    /// Placed occurrences, in the order of their nodes.
    pub fn objects(&self) -> &[ObjectRecord] {
        self.container.objects()
    }

    /// Spatial pieces of parts.
    pub fn chunks(&self) -> &[ChunkRecord] {
        self.container.chunks()
    }

    /// Levels of detail of chunks.
    pub fn levels(&self) -> &[LevelRecord] {
        self.container.levels()
    }

    /// All (object, chunk) pairs, object by object. A drawable's number is its place here.
    pub fn drawables(&self) -> &[Drawable] {
        &self.drawables
    }

    // --- Assembly tree ---

    /// The text of a name or of extras.
    pub fn name(&self, at: StringRef) -> &str {
        self.container.string(at)
    }

    /// Path of a node, `/unit/system/part`, written as [`crate::model::Model::path`] does.
    pub fn node_path(&self, node: u32) -> String {
        let nodes = self.nodes();
        let ancestors = iter::successors(Some(&nodes[node as usize]), |node| nodes.get(node.parent as usize));
        let names: Vec<String> = ancestors.map(|node| path_segment(self.name(node.name))).collect();
        names.iter().rev().fold(String::new(), |path, name| path + "/" + name)
    }

    /// Nodes without parent.
    pub fn roots(&self) -> impl Iterator<Item = u32> + '_ {
        self.siblings(0..self.nodes().len() as u32)
    }

    /// Direct children of a node, in order.
    pub fn children(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        self.siblings(node + 1..self.nodes()[node as usize].subtree_end)
    }

    /// The nodes of `range` whose parents are outside it: the subtrees that it is made of.
    fn siblings(&self, range: Range<u32>) -> impl Iterator<Item = u32> + '_ {
        let within = move |node: u32| (node < range.end).then_some(node);
        let first = within(range.start);
        iter::successors(first, move |&node| within(self.nodes()[node as usize].subtree_end))
    }

    /// Objects in the subtree of a node, itself included.
    pub fn subtree_objects(&self, node: u32) -> Range<u32> {
        let end = self.nodes()[node as usize].subtree_end;
        let before = |limit: u32| self.objects().partition_point(|object| object.node < limit) as u32;
        before(node)..before(end)
    }

    /// Nodes whose name contains `text`, or a value in their extras (a part number), or whose path does if `text` contains a `/`.
    /// Case does not matter, nor does it whether a `/` inside a name is written as such or escaped as in [`Scene::node_path`]. In
    /// order.
    pub fn find(&self, text: &str) -> impl Iterator<Item = u32> + '_ {
        let mut is_found = self.finder(text);
        (0..self.nodes().len() as u32).filter(move |&node| is_found(node))
    }

    /// Tells whether [`Scene::find`] finds a node; to be asked about one after the other, in order.
    pub fn finder(&self, text: &str) -> impl FnMut(u32) -> bool + '_ {
        let wanted: String = folded(&text.replace("\\/", "/").replace("\\\\", "\\")).collect();
        let in_paths = wanted.contains('/');
        let mut search = PathSearch::default();
        move |index| {
            let node = &self.nodes()[index as usize];
            let name = self.name(node.name);
            if in_paths {
                search.visit(index, node.subtree_end, name, &wanted)
            } else {
                folded(name).collect::<String>().contains(&wanted)
                    || in_values(self.name(node.extras), &wanted)
            }
        }
    }

    // --- Objects and drawables ---

    /// The object of a drawable.
    pub fn drawable_object(&self, drawable: u32) -> u32 {
        self.drawables[drawable as usize].object
    }

    /// The drawables of an object, one for each chunk of its part.
    pub fn object_drawables(&self, object: u32) -> Range<u32> {
        let object = &self.objects()[object as usize];
        object.first_drawable..object.first_drawable + self.parts()[object.part as usize].chunk_count
    }

    /// Placement of an object: part space to world.
    pub fn world_from_part(&self, object: u32) -> DAffine3 {
        DAffine3::from_cols_array(&self.objects()[object as usize].world_from_part)
    }

    /// The page of a drawable at a level: its index into [`Scene::levels`].
    pub fn page_of(&self, drawable: u32, level: u32) -> u32 {
        self.chunks()[self.drawables[drawable as usize].chunk as usize].first_level + level
    }

    /// The part that a chunk belongs to.
    pub fn chunk_part(&self, chunk: u32) -> u32 {
        // Parts tile the chunks: the last one that starts at or before it.
        self.parts().partition_point(|part| part.first_chunk <= chunk) as u32 - 1
    }

    /// The chunk that a level belongs to.
    pub fn level_chunk(&self, level: u32) -> u32 {
        self.chunks().partition_point(|chunk| chunk.first_level <= level) as u32 - 1
    }

    // --- Geometry ---

    /// Reads, checks and unpacks the page of a level.
    ///
    /// # Errors
    ///
    /// There is no such level, or its page is damaged.
    pub fn level_mesh(&self, level: u32) -> Result<LevelMesh, ContainerError> {
        self.container.decode_level(level)
    }

    /// Positions in part space of `mesh`, which is [`Scene::level_mesh`] of `level`. Exact.
    pub fn level_positions(&self, level: u32, mesh: &LevelMesh) -> Vec<Vec3> {
        let chunk = self.level_chunk(level);
        let step = Vec3::from(self.parts()[self.chunk_part(chunk) as usize].step);
        let offset = self.chunks()[chunk as usize].offset;
        mesh.vertices.iter().map(|&q| geometry::decode(offset, q, step)).collect()
    }
}

/// Opening has checked that there are at most `MAX_DRAWABLES`.
fn list_drawables(container: &Container) -> Result<Vec<Drawable>, ContainerError> {
    let count = container.meta().counts.drawables;
    let mut drawables = Vec::new();
    drawables
        .try_reserve_exact(count as usize)
        .map_err(|_| ContainerError::new(container.path(), Problem::OutOfMemory { count }))?;
    for (object, record) in (0..).zip(container.objects()) {
        let part = &container.parts()[record.part as usize];
        let chunks = part.first_chunk..part.first_chunk + part.chunk_count;
        drawables.extend(chunks.map(|chunk| Drawable { object, chunk }));
    }
    Ok(drawables)
}

/// Is a folded text in a value of extras, which are JSON? Names of fields do not count.
fn in_values(extras: &str, wanted: &str) -> bool {
    // Next to none has it anywhere: that is quick to see, where nothing is written otherwise in JSON.
    let is_plain = !extras.contains('\\') && !wanted.contains(['"', '\\']);
    if extras.is_empty() || (is_plain && !folded(extras).collect::<String>().contains(wanted)) {
        return false;
    }
    fn is_in(value: &Value, wanted: &str) -> bool {
        match value {
            Value::String(text) => folded(text).collect::<String>().contains(wanted),
            Value::Number(number) => number.to_string().contains(wanted),
            Value::Array(list) => list.iter().any(|value| is_in(value, wanted)),
            Value::Object(fields) => fields.values().any(|value| is_in(value, wanted)),
            Value::Null | Value::Bool(_) => false,
        }
    }
    serde_json::from_str(extras).is_ok_and(|value: Value| is_in(&value, wanted))
}

/// Text without case. Character by character (unlike `str::to_lowercase`, which writes a sigma at a word's end
/// differently), so that a piece of a text folds to a piece of the folded text.
fn folded(text: &str) -> impl Iterator<Item = char> + '_ {
    text.chars().flat_map(char::to_lowercase)
}

/// Searches the paths of all nodes in pre-order.
///
/// A path is its parent's path and one more name, so it contains what its parent's contains, and anything new ends in
/// that name: every character is looked at a bounded number of times, however deep the tree.
#[derive(Default)]
struct PathSearch {
    /// Path of the last visited node, folded.
    path: String,
    /// That node and its ancestors, outermost first.
    open: Vec<OpenNode>,
}

struct OpenNode {
    subtree_end: u32,
    /// Length of the path before this node's own `/name`.
    start: usize,
    found: bool,
}

impl PathSearch {
    /// Whether the path of `node` contains `wanted`.
    fn visit(&mut self, node: u32, subtree_end: u32, segment: &str, wanted: &str) -> bool {
        while let Some(last) = self.open.pop_if(|last| last.subtree_end <= node) {
            self.path.truncate(last.start);
        }
        let start = self.path.len();
        self.path.push('/');
        self.path.extend(folded(segment));
        let inherited = self.open.last().is_some_and(|parent| parent.found);
        let tail = self.path.floor_char_boundary(start.saturating_sub(wanted.len()));
        let found = inherited || self.path[tail..].contains(wanted);
        self.open.push(OpenNode { subtree_end, start, found });
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_extras_are_found_and_their_names_are_not() {
        let extras = r#"{"Part number":"A-7","size":"3\" pipe","list":[{"deep":4711}],"path":"C:\\plant"}"#;
        for found in ["a-7", "3\" pipe", "471", "c:\\pl"] {
            assert!(in_values(extras, found), "{found}");
        }
        for not in ["number", "deep", "a-8", "{"] {
            assert!(!in_values(extras, not), "{not}");
        }
        assert!(!in_values("", "a") && !in_values("not json a", "a"));
    }
}
