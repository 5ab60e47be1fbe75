//! Checks every cross reference of a container's records, one pass over each section.
//!
//! The reader runs this on bytes that it does not trust, the writer on what it is about to write, so that no file is
//! written that would not open. After it passed, every index, range and string of the records is in bounds.

use glam::{DAffine3, Vec3};

use super::error::Damage;
use super::layout::{
    ChunkRecord, LevelRecord, MAX_COORDINATE, MAX_DEPTH, MAX_DRAWABLES, MAX_EXTRAS_BYTES, MAX_NAME_BYTES,
    MAX_STEP, MIN_STEP, NONE, NodeRecord, ObjectRecord, PartRecord, SectionKind, StringRef,
};
use super::meta::{Bounds, Counts};
use super::page;
use super::tree::world_box;

/// The sections that refer to each other.
#[derive(Clone, Copy)]
pub(super) struct Tables<'a> {
    pub strings: &'a str,
    pub nodes: &'a [NodeRecord],
    pub parts: &'a [PartRecord],
    pub objects: &'a [ObjectRecord],
    pub chunks: &'a [ChunkRecord],
    pub levels: &'a [LevelRecord],
    pub geometry_length: u64,
}

impl Tables<'_> {
    /// Checks everything; returns how much there is.
    pub(super) fn check(&self) -> Result<Counts, Damage> {
        self.check_sizes()?;
        self.check_nodes()?;
        self.check_tree()?;
        self.check_levels()?;
        self.check_chunks()?;
        let unique_triangles = self.check_parts()?;
        let (drawables, placed_triangles) = self.check_objects()?;
        Ok(Counts {
            nodes: self.nodes.len() as u64,
            parts: self.parts.len() as u64,
            objects: self.objects.len() as u64,
            drawables,
            chunks: self.chunks.len() as u64,
            levels: self.levels.len() as u64,
            unique_triangles,
            placed_triangles,
        })
    }

    /// Indices are u32, and the largest one means "none".
    fn check_sizes(&self) -> Result<(), Damage> {
        let lengths = [
            (SectionKind::Nodes, self.nodes.len()),
            (SectionKind::Parts, self.parts.len()),
            (SectionKind::Objects, self.objects.len()),
            (SectionKind::Chunks, self.chunks.len()),
            (SectionKind::Levels, self.levels.len()),
        ];
        for (kind, length) in lengths {
            if length as u64 >= u64::from(NONE) {
                return Err(Damage::section(kind.name(), format!("fewer than {NONE} records"), length));
            }
        }
        Ok(())
    }

    /// The fields of each node, and that nodes and objects name each other.
    fn check_nodes(&self) -> Result<(), Damage> {
        for (i, node) in self.nodes.iter().enumerate() {
            let wrong =
                |expected: &str, found: String| Err(Damage::record(SectionKind::Nodes, i, expected, found));
            if self.string(node.name).is_none_or(str::is_empty) {
                return wrong("a name inside the strings, not empty", format!("{:?}", node.name));
            }
            if node.name.length > MAX_NAME_BYTES {
                return wrong(
                    &format!("a name of at most {MAX_NAME_BYTES} bytes"),
                    node.name.length.to_string(),
                );
            }
            if self.string(node.extras).is_none() {
                return wrong("extras inside the strings", format!("{:?}", node.extras));
            }
            if node.extras.length > MAX_EXTRAS_BYTES {
                let expected = format!("extras of at most {MAX_EXTRAS_BYTES} bytes");
                return wrong(&expected, node.extras.length.to_string());
            }
            if node.reserved != 0 {
                return wrong("a reserved field of 0", node.reserved.to_string());
            }
            if node.object != NONE
                && self.objects.get(node.object as usize).is_none_or(|object| object.node as usize != i)
            {
                return wrong("no object, or one that names this node", node.object.to_string());
            }
        }
        Ok(())
    }

    /// The nodes are a forest in pre-order: the parent of each is the innermost subtree that it stands in.
    ///
    /// Linear: a subtree that ended is climbed out of once.
    fn check_tree(&self) -> Result<(), Damage> {
        let count = self.nodes.len() as u32;
        let mut innermost = NONE;
        // Of `innermost`.
        let mut depth = 0;
        for (i, node) in self.nodes.iter().enumerate() {
            // `innermost` is NONE or an earlier, checked node; its parent is earlier still.
            let enclosing_end = loop {
                match self.nodes.get(innermost as usize) {
                    None => break count,
                    Some(open) if open.subtree_end as usize > i => break open.subtree_end,
                    Some(ended) => (innermost, depth) = (ended.parent, depth - 1),
                }
            };
            if node.parent != innermost {
                let expected = format!("parent {}, whose subtree this is in", OrNone(innermost));
                return Err(Damage::record(SectionKind::Nodes, i, expected, OrNone(node.parent)));
            }
            if node.subtree_end as usize <= i || node.subtree_end > enclosing_end {
                let expected = format!("a subtree that ends at {} to {enclosing_end}", i + 1);
                return Err(Damage::record(SectionKind::Nodes, i, expected, node.subtree_end));
            }
            (innermost, depth) = (i as u32, depth + 1);
            if depth > MAX_DEPTH {
                let expected = format!("a tree of at most {MAX_DEPTH} levels");
                return Err(Damage::record(SectionKind::Nodes, i, expected, depth));
            }
        }
        Ok(())
    }

    /// Each level by itself, and that the pages tile the geometry.
    fn check_levels(&self) -> Result<(), Damage> {
        let mut page_start = 0_u64;
        for (i, level) in self.levels.iter().enumerate() {
            let wrong = |expected: String, found: String| {
                Err(Damage::record(SectionKind::Levels, i, expected, found))
            };
            if let Err(error) = page::check_record(level) {
                return wrong("a page that can be decoded".to_owned(), error.to_string());
            }
            if level.page_offset != page_start {
                return wrong(
                    format!("a page at byte {page_start} of the geometry"),
                    level.page_offset.to_string(),
                );
            }
            page_start += u64::from(level.vertex_bytes) + u64::from(level.index_bytes);
            if page_start > self.geometry_length {
                let expected =
                    format!("a page that ends within the {} bytes of geometry", self.geometry_length);
                return wrong(expected, page_start.to_string());
            }
            if !(level.error.is_finite() && level.error >= 0.0) {
                return wrong("a finite error, not negative".to_owned(), level.error.to_string());
            }
            if level.reserved != [0; 2] {
                return wrong("a reserved field of 0".to_owned(), format!("{:?}", level.reserved));
            }
        }
        if page_start != self.geometry_length {
            let expected = format!("{page_start} bytes, as the pages have");
            return Err(Damage::section(SectionKind::Geometry.name(), expected, self.geometry_length));
        }
        Ok(())
    }

    /// Each chunk, and that the chunks' levels tile the levels and get coarser.
    fn check_chunks(&self) -> Result<(), Damage> {
        let mut next = 0;
        for (i, chunk) in self.chunks.iter().enumerate() {
            let levels = tile(
                SectionKind::Chunks,
                i,
                "level",
                self.levels,
                next,
                chunk.first_level,
                chunk.level_count,
            )?;
            next += levels.len();
            let wrong =
                |expected: &str, found: String| Err(Damage::record(SectionKind::Chunks, i, expected, found));
            if !chunk.offset.iter().all(|offset| (0..MAX_COORDINATE).contains(offset)) {
                return wrong("offsets of 0 to 2^24 - 1", format!("{:?}", chunk.offset));
            }
            if chunk.reserved != 0 {
                return wrong("a reserved field of 0", chunk.reserved.to_string());
            }
            if let Some(finest) = levels.first()
                && finest.error != 0.0
            {
                return wrong("an error of 0 for its level 0", finest.error.to_string());
            }
            for (finer, coarser) in levels.iter().zip(levels.iter().skip(1)) {
                if coarser.error < finer.error {
                    return wrong(
                        "errors that do not shrink",
                        format!("{} after {}", coarser.error, finer.error),
                    );
                }
                if coarser.triangle_count > finer.triangle_count {
                    let found = format!("{} after {}", coarser.triangle_count, finer.triangle_count);
                    return wrong("levels that do not grow", found);
                }
            }
        }
        all_used(SectionKind::Levels, self.levels.len(), next)
    }

    /// Each part, and that the parts' chunks tile the chunks. Returns the triangles of all parts.
    fn check_parts(&self) -> Result<u64, Damage> {
        let mut next = 0;
        let mut unique_triangles = 0;
        for (i, part) in self.parts.iter().enumerate() {
            let chunks =
                tile(SectionKind::Parts, i, "chunk", self.chunks, next, part.first_chunk, part.chunk_count)?;
            next += chunks.len();
            let wrong =
                |expected: &str, found: String| Err(Damage::record(SectionKind::Parts, i, expected, found));
            if self.string(part.name).is_none() {
                return wrong("a name inside the strings", format!("{:?}", part.name));
            }
            if part.name.length > MAX_NAME_BYTES {
                return wrong(
                    &format!("a name of at most {MAX_NAME_BYTES} bytes"),
                    part.name.length.to_string(),
                );
            }
            if !part.step.iter().all(|&step| is_step(step)) {
                return wrong("steps that are powers of two, 2^-126 to 2^45", format!("{:?}", part.step));
            }
            let boxed = |((&low, &high), &step): ((&f32, &f32), &f32)| {
                0.0 <= low && low <= high && high <= step * (MAX_COORDINATE - 1) as f32
            };
            if !part.min.iter().zip(&part.max).zip(&part.step).all(boxed) {
                return wrong("0 <= min <= max < 2^24 steps", format!("{:?} to {:?}", part.min, part.max));
            }
            let levels = chunks.iter().filter_map(|chunk| self.levels.get(chunk.first_level as usize));
            let triangles: u64 = levels.map(|level| u64::from(level.triangle_count)).sum();
            if u64::from(part.triangle_count) != triangles {
                return wrong(
                    &format!("{triangles} triangles, as its chunks have"),
                    part.triangle_count.to_string(),
                );
            }
            unique_triangles += triangles;
        }
        all_used(SectionKind::Chunks, self.chunks.len(), next)?;
        Ok(unique_triangles)
    }

    /// Each object. Returns the number of drawables and of placed triangles.
    fn check_objects(&self) -> Result<(u64, u64), Damage> {
        let (mut drawables, mut placed_triangles) = (0_u64, 0_u64);
        let mut last_node = None;
        for (i, object) in self.objects.iter().enumerate() {
            let wrong = |expected: String, found: String| {
                Err(Damage::record(SectionKind::Objects, i, expected, found))
            };
            if self.nodes.get(object.node as usize).is_none_or(|node| node.object as usize != i) {
                return wrong("a node that names this object".to_owned(), object.node.to_string());
            }
            if last_node.is_some_and(|last| last >= object.node) {
                return wrong("a node after the last object's".to_owned(), object.node.to_string());
            }
            last_node = Some(object.node);
            let Some(part) = self.parts.get(object.part as usize) else {
                return wrong(format!("a part below {}", self.parts.len()), object.part.to_string());
            };
            if !object.world_from_part.iter().all(|c| c.is_finite()) {
                return wrong("a finite transform".to_owned(), format!("{:?}", object.world_from_part));
            }
            let world_from_part = DAffine3::from_cols_array(&object.world_from_part);
            let determinant = world_from_part.matrix3.determinant();
            if !determinant.is_finite() || determinant == 0.0 || !world_from_part.inverse().is_finite() {
                return wrong(
                    "a finite transform with an inverse".to_owned(),
                    format!("{:?}", object.world_from_part),
                );
            }
            let boxed = |(low, high): (&f64, &f64)| low.is_finite() && high.is_finite() && low <= high;
            if !object.min.iter().zip(&object.max).all(boxed) {
                return wrong("a finite box".to_owned(), format!("{:?} to {:?}", object.min, object.max));
            }
            let (min, max) = world_box(&world_from_part, Vec3::from(part.min), Vec3::from(part.max));
            if (object.min, object.max) != (min.to_array(), max.to_array()) {
                let expected = format!("its part's box in world, {min} to {max}");
                return wrong(expected, format!("{:?} to {:?}", object.min, object.max));
            }
            if u64::from(object.first_drawable) != drawables {
                return wrong(format!("first drawable {drawables}"), object.first_drawable.to_string());
            }
            drawables += u64::from(part.chunk_count);
            if drawables > u64::from(MAX_DRAWABLES) {
                return wrong(format!("at most {MAX_DRAWABLES} drawables in all"), drawables.to_string());
            }
            placed_triangles += u64::from(part.triangle_count);
        }
        Ok((drawables, placed_triangles))
    }

    fn string(&self, at: StringRef) -> Option<&str> {
        string(self.strings, at)
    }
}

/// Box of all objects in world; `None` without objects.
pub(super) fn bounds_of(objects: &[ObjectRecord]) -> Option<Bounds> {
    let boxes = objects.iter().map(|object| Bounds { min: object.min, max: object.max });
    boxes.reduce(|a, b| Bounds {
        min: [0, 1, 2].map(|axis| a.min[axis].min(b.min[axis])),
        max: [0, 1, 2].map(|axis| a.max[axis].max(b.max[axis])),
    })
}

/// The text at `at`, if it lies inside `strings` and on character borders.
pub(super) fn string(strings: &str, at: StringRef) -> Option<&str> {
    let start = usize::try_from(at.offset).ok()?;
    strings.get(start..start.checked_add(usize::try_from(at.length).ok()?)?)
}

/// The `count >= 1` items from `first`, which must be `next`: the first that no earlier record has.
fn tile<'a, T>(
    kind: SectionKind,
    record: usize,
    what: &str,
    items: &'a [T],
    next: usize,
    first: u32,
    count: u32,
) -> Result<&'a [T], Damage> {
    let rest = items.get(next..).unwrap_or_default();
    match rest.get(..count as usize) {
        Some(own) if first as usize == next && count > 0 => Ok(own),
        _ => {
            let expected = format!("first {what} {next}, and 1 to {} of them", rest.len());
            Err(Damage::record(kind, record, expected, format!("first {first}, {count} of them")))
        }
    }
}

/// Nothing may be left that belongs to nobody.
fn all_used(kind: SectionKind, length: usize, used: usize) -> Result<(), Damage> {
    if length == used {
        return Ok(());
    }
    Err(Damage::section(kind.name(), format!("{used} records, all in use"), length))
}

fn is_step(step: f32) -> bool {
    const MANTISSA: u32 = (1 << 23) - 1;
    (MIN_STEP..=MAX_STEP).contains(&step) && step.to_bits() & MANTISSA == 0
}

/// An index, or `none`.
struct OrNone(u32);

impl std::fmt::Display for OrNone {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            NONE => write!(f, "none"),
            index => write!(f, "{index}"),
        }
    }
}
