//! Checking a container to the last byte.

use std::collections::HashSet;
use std::path::Path;

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use serde::de::IgnoredAny;

use super::error::{ContainerError, Damage, Problem};
use super::layout::{ChunkRecord, MAX_COORDINATE, SectionKind};
use super::page::PageError;
use super::read::Container;
use super::voxels;
use crate::geometry::{LevelMesh, decode};
use crate::progress::Progress;

/// What a sound container holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct VerifyReport {
    /// Length of the file.
    pub file_bytes: u64,
    /// Pages decoded.
    pub pages: u64,
    /// Vertices in them, all levels.
    pub vertices: u64,
    /// Triangles in them, all levels.
    pub triangles: u64,
}

/// Checks everything: what [`Container::open`] does, the checksum of the geometry and of each page, that each page
/// decodes, that the boxes of the parts are those of their vertices, that every occupied voxel has an owner and no other
/// has one, and that extra properties are JSON.
///
/// Any single changed byte of the file is found. Pages are decoded in parallel; the error reported is the first in the
/// order of the file's chunks, whatever the number of threads.
///
/// # Errors
///
/// The first damage found, or [`Problem::Cancelled`].
pub fn verify(path: impl AsRef<Path>, progress: &dyn Progress) -> Result<VerifyReport, ContainerError> {
    let path = path.as_ref();
    let container = Container::open(path)?;
    container.check_geometry_checksum()?;
    check_extras(&container)?;
    voxels::check_owner_masks(&container)?;
    let boxes = decode_chunks(&container, progress)?;
    check_part_boxes(&container, &boxes)?;
    let levels = container.levels();
    Ok(VerifyReport {
        file_bytes: container.file_length(),
        pages: levels.len() as u64,
        vertices: levels.iter().map(|level| u64::from(level.vertex_count)).sum(),
        triangles: levels.iter().map(|level| u64::from(level.triangle_count)).sum(),
    })
}

/// Distinct extras are parsed once. They must not overlap, so that little text cannot make much work.
fn check_extras(container: &Container) -> Result<(), ContainerError> {
    let mut known = HashSet::new();
    let mut left = container.section_length(SectionKind::Strings);
    for (i, node) in container.nodes().iter().enumerate() {
        let extras = container.string(node.extras);
        if extras.is_empty() || !known.insert((node.extras.offset, node.extras.length)) {
            continue;
        }
        let Some(rest) = left.checked_sub(extras.len() as u64) else {
            let found = format!("{:?}", node.extras);
            let damage = Damage::record(SectionKind::Nodes, i, "extras that do not overlap", found);
            return Err(ContainerError::new(container.path(), damage));
        };
        left = rest;
        if let Err(error) = serde_json::from_str::<IgnoredAny>(extras) {
            let damage = Damage::record(SectionKind::Nodes, i, "extras that are JSON", error);
            return Err(ContainerError::new(container.path(), damage));
        }
    }
    Ok(())
}

/// Decodes all levels of all chunks; returns the box of each chunk's level 0, in steps.
fn decode_chunks(container: &Container, progress: &dyn Progress) -> Result<Vec<StepBox>, ContainerError> {
    let total = container.section_length(SectionKind::Geometry);
    progress.stage("verify", total, "bytes");
    let results: Vec<Result<StepBox, ContainerError>> = container
        .chunks()
        .par_iter()
        .map(|chunk| {
            if progress.is_cancelled() {
                return Err(ContainerError::new(container.path(), Problem::Cancelled));
            }
            decode_chunk(container, chunk, progress)
        })
        .collect();
    // In the order of the chunks: the first error, whichever thread met one first.
    results.into_iter().collect()
}

fn decode_chunk(
    container: &Container,
    chunk: &ChunkRecord,
    progress: &dyn Progress,
) -> Result<StepBox, ContainerError> {
    let mut finest = StepBox::EMPTY;
    for level in chunk.first_level..chunk.first_level + chunk.level_count {
        let mesh = container.decode_level(level)?;
        let (record, page) = container.page(level)?;
        let level_box =
            StepBox::of(chunk.offset, &mesh).map_err(|source| container.page_error(level, record, source))?;
        if level == chunk.first_level {
            finest = level_box;
        }
        progress.advance(page.len() as u64);
    }
    Ok(finest)
}

fn check_part_boxes(container: &Container, chunks: &[StepBox]) -> Result<(), ContainerError> {
    for (i, part) in container.parts().iter().enumerate() {
        // In bounds: opening has checked that the parts tile the chunks.
        let own = &chunks[part.first_chunk as usize..][..part.chunk_count as usize];
        let (min, max) = StepBox::union(own).in_part(Vec3::from(part.step));
        if (min.to_array(), max.to_array()) != (part.min, part.max) {
            let expected = format!("a box of {min} to {max}, as its vertices have");
            let found = format!("{:?} to {:?}", part.min, part.max);
            let damage = Damage::record(SectionKind::Parts, i, expected, found);
            return Err(ContainerError::new(container.path(), damage));
        }
    }
    Ok(())
}

/// Box of vertices in quantization steps, `offset + q`.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepBox {
    min: [i32; 3],
    max: [i32; 3],
}

impl StepBox {
    const EMPTY: Self = StepBox { min: [i32::MAX; 3], max: [i32::MIN; 3] };

    /// Of a level of a chunk at `offset`, which must not be negative.
    ///
    /// # Errors
    ///
    /// A coordinate that is not below 2^24.
    pub(super) fn of(offset: [i32; 3], mesh: &LevelMesh) -> Result<Self, PageError> {
        let mut bounds = Self::EMPTY;
        for (vertex, q) in mesh.vertices.iter().enumerate() {
            for axis in 0..3 {
                let found = i64::from(offset[axis]) + i64::from(q[axis]);
                if !(0..i64::from(MAX_COORDINATE)).contains(&found) {
                    return Err(PageError::Coordinate { vertex, found });
                }
                bounds.min[axis] = bounds.min[axis].min(found as i32);
                bounds.max[axis] = bounds.max[axis].max(found as i32);
            }
        }
        Ok(bounds)
    }

    pub(super) fn union(boxes: &[Self]) -> Self {
        boxes.iter().fold(Self::EMPTY, |union, one| StepBox {
            min: [0, 1, 2].map(|axis| union.min[axis].min(one.min[axis])),
            max: [0, 1, 2].map(|axis| union.max[axis].max(one.max[axis])),
        })
    }

    /// Low and high corner in part space, exact like every decoded vertex.
    pub(super) fn in_part(&self, step: Vec3) -> (Vec3, Vec3) {
        (decode(self.min, [0; 3], step), decode(self.max, [0; 3], step))
    }
}
