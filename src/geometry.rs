//! Prepared geometry: what a part becomes before it is written, and what a page of the container decodes to.

use glam::{DVec3, Vec3};

/// One level of detail of a chunk, quantized. Position = `(chunk offset + q) * part step`, part space.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LevelMesh {
    /// Quantized coordinates, relative to the chunk's offset.
    pub vertices: Vec<[u16; 3]>,
    /// Corners; every index is below `vertices.len()`.
    pub triangles: Vec<[u32; 3]>,
}

/// A level and how far it may be from level 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PreparedLevel {
    /// The geometry.
    pub mesh: LevelMesh,
    /// Geometric error in part units, 0 for level 0, never below the finer level's.
    pub error: f32,
}

/// A spatial piece of a part, at most 65,536 triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PreparedChunk {
    /// Added to the quantized coordinates; not negative; `offset + q` stays below 2^24.
    pub offset: [i32; 3],
    /// Finest first; at least one.
    pub levels: Vec<PreparedLevel>,
}

/// A part, ready to be written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PreparedPart {
    /// Origin of part space in the space of the imported mesh: the low corner of its box.
    /// An object's placement becomes `world_from_imported * translation(origin)`.
    pub origin: DVec3,
    /// Quantization step per axis, a power of two. Every decoded coordinate of level 0 is within half a step of
    /// the input's.
    pub step: Vec3,
    /// At least one.
    pub chunks: Vec<PreparedChunk>,
}

/// Decodes one vertex, Xue et al. 2016 eq. 2 on a grid of power-of-two steps. Exact in f32.
#[inline]
pub fn decode(offset: [i32; 3], q: [u16; 3], step: Vec3) -> Vec3 {
    let at = |axis: usize| (offset[axis] + i32::from(q[axis])) as f32;
    Vec3::new(at(0), at(1), at(2)) * step
}
