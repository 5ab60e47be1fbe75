//! The assembly tree, objects and strings as records.

use std::collections::HashMap;

use glam::{DAffine3, DVec3, Vec3};

use super::check::{Tables, bounds_of};
use super::error::{ContainerError, Damage};
use super::layout::{
    ChunkRecord, LevelRecord, NONE, NodeRecord, ObjectRecord, PartRecord, SectionKind, StringRef,
};
use super::meta::{Bounds, Counts};
use super::part::GeometryRecords;
use super::write::ContainerWriter;
use crate::model::{Node, Object};

/// The records of a scene, checked as a reader would.
#[derive(Clone, Debug)]
pub struct SceneRecords {
    strings: String,
    nodes: Vec<NodeRecord>,
    parts: Vec<PartRecord>,
    objects: Vec<ObjectRecord>,
    chunks: Vec<ChunkRecord>,
    levels: Vec<LevelRecord>,
    counts: Counts,
}

impl SceneRecords {
    /// Makes records of a [`crate::model::Model`]'s nodes and objects, and of the geometry written for its parts.
    ///
    /// `objects` place parts as imported; the origin that each part was made local to is added here
    /// ([`world_from_part`]). `part_names` are in the order of the parts. Equal strings are stored once, in the order
    /// in which they are first met (nodes, then parts), so the same model gives the same bytes.
    ///
    /// # Errors
    ///
    /// The model breaks one of its promises (order of nodes, indices, finite transforms), or a limit of the container
    /// is exceeded (4 GiB of strings, [`super::layout::MAX_DRAWABLES`]): says which record.
    pub fn new(
        nodes: &[Node],
        objects: &[Object],
        part_names: &[impl AsRef<str>],
        geometry: GeometryRecords,
    ) -> Result<Self, Damage> {
        let GeometryRecords { origins, mut parts, chunks, levels, length } = geometry;
        if part_names.len() != parts.len() {
            let expected = format!("{} names of parts, as parts were written", parts.len());
            return Err(Damage::section(SectionKind::Parts.name(), expected, part_names.len()));
        }
        let mut strings = Strings::default();
        let nodes = node_records(nodes, objects, &mut strings)?;
        for (part, name) in parts.iter_mut().zip(part_names) {
            part.name = strings.add(name.as_ref())?;
        }
        let objects = object_records(objects, &parts, &origins)?;
        let strings = strings.text;
        let tables = Tables {
            strings: &strings,
            nodes: &nodes,
            parts: &parts,
            objects: &objects,
            chunks: &chunks,
            levels: &levels,
            geometry_length: length,
        };
        let counts = tables.check()?;
        Ok(SceneRecords { strings, nodes, parts, objects, chunks, levels, counts })
    }

    /// For [`super::Meta::counts`].
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Box of all objects in world, for [`super::Meta::bounds`]; `None` without objects.
    pub fn bounds(&self) -> Option<Bounds> {
        bounds_of(&self.objects)
    }

    /// Objects, with their placements from part space and their first drawables.
    pub fn objects(&self) -> &[ObjectRecord] {
        &self.objects
    }

    /// Parts, with their chunks and boxes.
    pub fn parts(&self) -> &[PartRecord] {
        &self.parts
    }

    /// Writes the sections from strings to levels.
    ///
    /// # Errors
    ///
    /// As [`ContainerWriter::write_section`].
    pub fn write(&self, writer: &mut ContainerWriter) -> Result<(), ContainerError> {
        writer.write_section(SectionKind::Strings, self.strings.as_bytes())?;
        writer.write_section(SectionKind::Nodes, &self.nodes)?;
        writer.write_section(SectionKind::Parts, &self.parts)?;
        writer.write_section(SectionKind::Objects, &self.objects)?;
        writer.write_section(SectionKind::Chunks, &self.chunks)?;
        writer.write_section(SectionKind::Levels, &self.levels)
    }
}

/// Placement of a part whose imported mesh was moved to `origin`: part space to world.
pub fn world_from_part(world_from_imported: DAffine3, origin: DVec3) -> DAffine3 {
    world_from_imported * DAffine3::from_translation(origin)
}

/// Box in world of a box in part space: each corner's rounding included, so that no vertex in it is outside.
///
/// Arvo, "Transforming Axis-Aligned Bounding Boxes", Graphics Gems, 1990. Each bound is a sum of four terms; it is moved
/// outward by more than that sum, or the same sum in any other order, can be rounded by.
pub fn world_box(world_from_part: &DAffine3, min: Vec3, max: Vec3) -> (DVec3, DVec3) {
    let (min, max) = (min.as_dvec3(), max.as_dvec3());
    let origin = world_from_part.translation;
    let (mut low, mut high, mut size) = (origin, origin, origin.abs());
    for axis in 0..3 {
        let column = world_from_part.matrix3.col(axis);
        let (a, b) = (column * min[axis], column * max[axis]);
        low += a.min(b);
        high += a.max(b);
        size += a.abs().max(b.abs());
    }
    let rounding = size * (8.0 * f64::EPSILON);
    (low - rounding, high + rounding)
}

fn node_records<'a>(
    nodes: &'a [Node],
    objects: &[Object],
    strings: &mut Strings<'a>,
) -> Result<Vec<NodeRecord>, Damage> {
    let mut records = Vec::with_capacity(nodes.len());
    for (i, node) in nodes.iter().enumerate() {
        records.push(NodeRecord {
            name: strings.add(&node.name)?,
            extras: strings.add(node.extras.as_deref().unwrap_or_default())?,
            parent: node.parent.unwrap_or(NONE),
            // `as`: the number of nodes is checked with everything else in `Tables::check`.
            subtree_end: i as u32 + 1,
            object: NONE,
            reserved: 0,
        });
    }
    // Children come after their parents, so backwards each subtree is complete before it is added to its parent's.
    for i in (0..records.len()).rev() {
        let NodeRecord { parent, subtree_end, .. } = records[i];
        if let Some(parent) = records[..i].get_mut(parent as usize) {
            parent.subtree_end = parent.subtree_end.max(subtree_end);
        }
    }
    for (i, object) in objects.iter().enumerate() {
        match records.get_mut(object.node as usize) {
            Some(node) if node.object == NONE => node.object = i as u32,
            Some(node) => {
                let expected = format!("a node without object, as node {} carries one already", object.node);
                return Err(Damage::record(SectionKind::Objects, i, expected, node.object));
            }
            None => {
                let expected = format!("a node below {}", nodes.len());
                return Err(Damage::record(SectionKind::Objects, i, expected, object.node));
            }
        }
    }
    Ok(records)
}

fn object_records(
    objects: &[Object],
    parts: &[PartRecord],
    origins: &[DVec3],
) -> Result<Vec<ObjectRecord>, Damage> {
    let mut first_drawable = 0_u32;
    let mut records = Vec::with_capacity(objects.len());
    for (i, object) in objects.iter().enumerate() {
        let (Some(part), Some(&origin)) =
            (parts.get(object.part as usize), origins.get(object.part as usize))
        else {
            let expected = format!("a part below {}", parts.len());
            return Err(Damage::record(SectionKind::Objects, i, expected, object.part));
        };
        let world_from_part = world_from_part(object.world_from_part, origin);
        let (min, max) = world_box(&world_from_part, Vec3::from(part.min), Vec3::from(part.max));
        records.push(ObjectRecord {
            world_from_part: world_from_part.to_cols_array(),
            min: min.to_array(),
            max: max.to_array(),
            node: object.node,
            part: object.part,
            first_drawable,
            colour: object.colour.0,
        });
        // Saturated, it is far above the limit, which `Tables::check` reports.
        first_drawable = first_drawable.saturating_add(part.chunk_count);
    }
    Ok(records)
}

/// Text in which equal strings are stored once.
#[derive(Default)]
struct Strings<'a> {
    text: String,
    known: HashMap<&'a str, StringRef>,
}

impl<'a> Strings<'a> {
    fn add(&mut self, string: &'a str) -> Result<StringRef, Damage> {
        if string.is_empty() {
            return Ok(StringRef::default());
        }
        if let Some(&known) = self.known.get(string) {
            return Ok(known);
        }
        let end = self.text.len() + string.len();
        // Both numbers are at most `end`.
        if u32::try_from(end).is_err() {
            return Err(Damage::section(
                SectionKind::Strings.name(),
                "less than 4 GiB of names and extras",
                end,
            ));
        }
        let at = StringRef { offset: self.text.len() as u32, length: string.len() as u32 };
        self.text.push_str(string);
        self.known.insert(string, at);
        Ok(at)
    }
}
