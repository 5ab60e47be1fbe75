//! Parts on their way into the file: packed in parallel, written one after the other.

use std::io::Write;

use glam::{DVec3, Vec3};
use thiserror::Error;

use super::error::{ContainerError, Damage, Problem};
use super::layout::{ChunkRecord, LevelRecord, PartRecord, SectionKind, StringRef};
use super::page::{self, EncodedPage, PageError};
use super::verify::StepBox;
use super::write::{ContainerWriter, SectionWriter};
use crate::geometry::PreparedPart;

/// A part, packed. A tenth or so of the memory of what it was packed from.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedPart {
    /// As [`PreparedPart::origin`].
    pub origin: DVec3,
    /// As [`PreparedPart::step`].
    pub step: Vec3,
    /// Low corner of the decoded level 0, part space.
    pub min: Vec3,
    /// High corner, likewise.
    pub max: Vec3,
    /// Chunks, at least one.
    pub chunks: Vec<EncodedChunk>,
}

/// A chunk, packed.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedChunk {
    /// As [`crate::geometry::PreparedChunk::offset`].
    pub offset: [i32; 3],
    /// Page and geometric error (part units) of each level, finest first, at least one.
    pub levels: Vec<(EncodedPage, f32)>,
}

/// A part that cannot be packed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PartError {
    /// Nothing to write.
    #[error("the part has no chunk")]
    NoChunk,
    /// Nothing to write.
    #[error("chunk {chunk} has no level")]
    NoLevel {
        /// Index in the part.
        chunk: usize,
    },
    /// One of its levels breaks a limit of the container.
    #[error("chunk {chunk}, level {level}: {source}")]
    Level {
        /// Index in the part.
        chunk: usize,
        /// Index in the chunk.
        level: usize,
        /// Which limit.
        source: PageError,
    },
}

/// Packs a part. Call it from as many threads as there are.
///
/// # Errors
///
/// The part breaks a promise of [`PreparedPart`] or a limit of the container: too many triangles, an index or
/// coordinate out of range.
pub fn encode_part(part: &PreparedPart) -> Result<EncodedPart, PartError> {
    let mut boxes = Vec::with_capacity(part.chunks.len());
    let mut chunks = Vec::with_capacity(part.chunks.len());
    for (c, chunk) in part.chunks.iter().enumerate() {
        let mut levels = Vec::with_capacity(chunk.levels.len());
        for (l, level) in chunk.levels.iter().enumerate() {
            let wrong = |source| PartError::Level { chunk: c, level: l, source };
            let bounds = StepBox::of(chunk.offset, &level.mesh).map_err(wrong)?;
            if l == 0 {
                boxes.push(bounds);
            }
            levels.push((page::encode(&level.mesh).map_err(wrong)?, level.error));
        }
        if levels.is_empty() {
            return Err(PartError::NoLevel { chunk: c });
        }
        chunks.push(EncodedChunk { offset: chunk.offset, levels });
    }
    if chunks.is_empty() {
        return Err(PartError::NoChunk);
    }
    let (min, max) = StepBox::union(&boxes).in_part(part.step);
    Ok(EncodedPart { origin: part.origin, step: part.step, min, max, chunks })
}

/// Records of the geometry that was written.
#[derive(Clone, Debug, Default)]
pub struct GeometryRecords {
    /// [`EncodedPart::origin`] of each part.
    pub(super) origins: Vec<DVec3>,
    /// Without names: those are added with the tree.
    pub(super) parts: Vec<PartRecord>,
    pub(super) chunks: Vec<ChunkRecord>,
    pub(super) levels: Vec<LevelRecord>,
    /// Bytes of the geometry section.
    pub(super) length: u64,
}

impl GeometryRecords {
    /// The parts as written, in order, without names.
    pub fn parts(&self) -> &[PartRecord] {
        &self.parts
    }

    /// Their chunks.
    pub fn chunks(&self) -> &[ChunkRecord] {
        &self.chunks
    }

    /// The chunks' levels.
    pub fn levels(&self) -> &[LevelRecord] {
        &self.levels
    }
}

/// Streams packed parts into the geometry section; only records stay in memory.
pub struct GeometryWriter<'a> {
    section: SectionWriter<'a>,
    records: GeometryRecords,
}

impl<'a> GeometryWriter<'a> {
    /// Begins the geometry section.
    ///
    /// # Errors
    ///
    /// As [`ContainerWriter::begin_section`].
    pub fn begin(writer: &'a mut ContainerWriter) -> Result<Self, ContainerError> {
        let section = writer.begin_section(SectionKind::Geometry)?;
        Ok(GeometryWriter { section, records: GeometryRecords::default() })
    }

    /// Writes the next part. Parts must come in the order of [`crate::model::Model::parts`], whatever order they were
    /// packed in: the file depends on it.
    ///
    /// # Errors
    ///
    /// The disk is full, or there are more than 2^32 - 2 chunks, levels or triangles in one part.
    pub fn push(&mut self, part: &EncodedPart) -> Result<(), ContainerError> {
        self.push_part(part).map_err(|problem| ContainerError::new(self.section.path(), problem))
    }

    fn push_part(&mut self, part: &EncodedPart) -> Result<(), Problem> {
        let first_chunk = index(SectionKind::Chunks, self.records.chunks.len())?;
        let mut triangles = 0;
        for chunk in &part.chunks {
            let first_level = index(SectionKind::Levels, self.records.levels.len())?;
            for (page, error) in &chunk.levels {
                self.records.levels.push(page.record(self.section.length(), *error));
                self.section
                    .write_all(&page.bytes)
                    .map_err(|source| Problem::Io { doing: "write (is the disk full?)", source })?;
            }
            triangles += chunk.levels.first().map_or(0, |(page, _)| page.triangle_count as usize);
            self.records.chunks.push(ChunkRecord {
                offset: chunk.offset,
                first_level,
                level_count: index(SectionKind::Levels, chunk.levels.len())?,
                reserved: 0,
            });
        }
        self.records.origins.push(part.origin);
        self.records.parts.push(PartRecord {
            name: StringRef::default(),
            first_chunk,
            chunk_count: index(SectionKind::Chunks, part.chunks.len())?,
            step: part.step.to_array(),
            min: part.min.to_array(),
            max: part.max.to_array(),
            triangle_count: index(SectionKind::Parts, triangles)?,
        });
        Ok(())
    }

    /// Ends the section.
    ///
    /// # Errors
    ///
    /// As [`SectionWriter::end`].
    pub fn end(self) -> Result<GeometryRecords, ContainerError> {
        let length = self.section.length();
        self.section.end()?;
        Ok(GeometryRecords { length, ..self.records })
    }
}

fn index(kind: SectionKind, number: usize) -> Result<u32, Problem> {
    u32::try_from(number)
        .ok()
        .filter(|&index| index != super::layout::NONE)
        .ok_or_else(|| Problem::Unwritable(Damage::section(kind.name(), "numbers below 2^32 - 1", number)))
}
