//! A page in memory: one level of a chunk as a vertex shader reads it.
//!
//! ```text
//! vertices   three u16 each, packed; then up to 2 bytes, so that what follows starts at a multiple of 4
//! indices    three a triangle, as many bits each as the number of vertices needs, lowest first, in u32 words
//! ```
//!
//! Little endian. Positions are decoded as [`crate::geometry::decode`] does; normals are those of the triangles. Nothing else is
//! stored.

use std::sync::Arc;

use super::{LoadError, PageSource};
use crate::container::layout::LevelRecord;
use crate::geometry::LevelMesh;
use crate::scene::Scene;

/// Where things are in a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageLayout {
    /// Vertices.
    pub vertices: u32,
    /// Triangles.
    pub triangles: u32,
    /// Bits of an index, at least 1.
    pub index_bits: u32,
    /// Where the indices begin, bytes.
    pub indices_at: u32,
    /// All of it, bytes: a multiple of 4.
    pub bytes: u32,
}

const VERTEX_BYTES: u32 = 6;

impl PageLayout {
    /// Of so many vertices and triangles: as many as a level may have ([`crate::container::layout::MAX_LEVEL_TRIANGLES`]).
    pub fn new(vertices: u32, triangles: u32) -> Self {
        let index_bits = u32::BITS - vertices.saturating_sub(1).max(1).leading_zeros();
        let indices_at = (VERTEX_BYTES * vertices).next_multiple_of(4);
        // At most 2^16 triangles of three 18-bit indices.
        let bytes = indices_at + 4 * (3 * triangles * index_bits).div_ceil(32);
        PageLayout { vertices, triangles, index_bits, indices_at, bytes }
    }

    /// Of a level.
    pub fn of(record: &LevelRecord) -> Self {
        PageLayout::new(record.vertex_count, record.triangle_count)
    }
}

/// A level as it goes into memory.
pub fn encode(mesh: &LevelMesh) -> Vec<u8> {
    let layout = PageLayout::new(mesh.vertices.len() as u32, mesh.triangles.len() as u32);
    let mut bytes = Vec::with_capacity(layout.bytes as usize);
    bytes.extend(mesh.vertices.iter().flatten().flat_map(|q| q.to_le_bytes()));
    bytes.resize(layout.indices_at as usize, 0);
    // Bits that are not yet a whole word.
    let (mut word, mut used) = (0u64, 0);
    for &index in mesh.triangles.iter().flatten() {
        word |= u64::from(index) << used;
        used += layout.index_bits;
        if used >= 32 {
            bytes.extend_from_slice(&(word as u32).to_le_bytes());
            word >>= 32;
            used -= 32;
        }
    }
    if used > 0 {
        bytes.extend_from_slice(&(word as u32).to_le_bytes());
    }
    bytes
}

/// What [`encode`] made: the CPU twin of the vertex shader's fetch. `None` where the bytes are too few.
pub fn decode(layout: &PageLayout, bytes: &[u8]) -> Option<LevelMesh> {
    let number = |at: usize, width: usize| -> Option<u32> {
        let mut whole = [0; 4];
        whole[..width].copy_from_slice(bytes.get(at..at + width)?);
        Some(u32::from_le_bytes(whole))
    };
    let vertex = |i: usize| -> Option<[u16; 3]> {
        let at = |axis: usize| number(6 * i + 2 * axis, 2).map(|q| q as u16);
        Some([at(0)?, at(1)?, at(2)?])
    };
    let bits = layout.index_bits as usize;
    let index = |i: usize| -> Option<u32> {
        let (word, shift) = (layout.indices_at as usize + i * bits / 32 * 4, i * bits % 32);
        let low = u64::from(number(word, 4)?);
        let high = if shift + bits > 32 { u64::from(number(word + 4, 4)?) } else { 0 };
        Some((((low | high << 32) >> shift) & ((1 << bits) - 1)) as u32)
    };
    let triangle =
        |i: usize| -> Option<[u32; 3]> { Some([index(3 * i)?, index(3 * i + 1)?, index(3 * i + 2)?]) };
    Some(LevelMesh {
        vertices: (0..layout.vertices as usize).map(vertex).collect::<Option<_>>()?,
        triangles: (0..layout.triangles as usize).map(triangle).collect::<Option<_>>()?,
    })
}

/// The pages of an opened container: its levels, read from the memory map and decoded by whoever asks. `S` has the scene.
pub struct ContainerPages<S>(pub Arc<S>);

impl<S: AsRef<Scene>> ContainerPages<S> {
    /// Bytes of a page in memory.
    pub fn bytes_of(&self, page: u32) -> u64 {
        PageLayout::of(&(*self.0).as_ref().levels()[page as usize]).bytes.into()
    }
}

impl<S: AsRef<Scene> + Send + Sync + 'static> PageSource for ContainerPages<S> {
    fn load(&self, page: u32) -> Result<Vec<u8>, LoadError> {
        let mesh = (*self.0).as_ref().level_mesh(page).map_err(|error| LoadError::Source(error.into()))?;
        Ok(encode(&mesh))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_the_mesh_and_no_more() {
        for (vertices, triangles) in [
            (1u32, 1u32),
            (2, 3),
            (3, 1),
            (256, 5),
            (257, 5),
            (1000, 2001),
            (65_536, 3),
            (65_537, 2),
            (70_000, 65_536),
            // As large as pages get.
            (196_608, 65_536),
        ] {
            let mut random = oorandom::Rand64::new(u128::from(vertices));
            let mesh = LevelMesh {
                vertices: (0..vertices).map(|_| [0; 3].map(|_: i32| random.rand_u64() as u16)).collect(),
                triangles: (0..triangles)
                    .map(|_| [0; 3].map(|_: i32| (random.rand_u64() % u64::from(vertices)) as u32))
                    .collect(),
            };
            let layout = PageLayout::new(vertices, triangles);
            let bytes = encode(&mesh);
            assert_eq!(bytes.len() as u32, layout.bytes);
            assert_eq!(decode(&layout, &bytes), Some(mesh));
            let needed = 6 * vertices + (3 * triangles * layout.index_bits).div_ceil(8);
            assert!(layout.bytes < needed + 8 && layout.bytes.is_multiple_of(4));
            assert!(1 << layout.index_bits >= vertices && (1 << layout.index_bits) / 2 < vertices.max(2));
            assert_eq!(decode(&layout, &bytes[..bytes.len() - 4]), None);
        }
    }
}
