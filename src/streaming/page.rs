//! A page in memory: one level of a chunk as a vertex shader reads it.
//!
//! ```text
//! vertices   three u16 each, packed; then up to 2 bytes, so that what follows starts at a multiple of 4
//! indices    three a triangle, of 1, 2 or 4 bytes, as narrow as the number of vertices allows; then up to 3 bytes
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
    /// Bytes of an index: 1, 2 or 4.
    pub index_bytes: u32,
    /// Where the indices begin, bytes.
    pub indices_at: u32,
    /// All of it, bytes: a multiple of 4.
    pub bytes: u32,
}

const VERTEX_BYTES: u32 = 6;

impl PageLayout {
    /// Of so many vertices and triangles: as many as a level may have ([`crate::container::layout::MAX_LEVEL_TRIANGLES`]).
    pub fn new(vertices: u32, triangles: u32) -> Self {
        let index_bytes = match vertices {
            0..=0x100 => 1,
            0x101..=0x1_0000 => 2,
            _ => 4,
        };
        let indices_at = (VERTEX_BYTES * vertices).next_multiple_of(4);
        let bytes = (indices_at + 3 * triangles * index_bytes).next_multiple_of(4);
        PageLayout { vertices, triangles, index_bytes, indices_at, bytes }
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
    let width = layout.index_bytes as usize;
    for index in mesh.triangles.iter().flatten() {
        bytes.extend_from_slice(&index.to_le_bytes()[..width]);
    }
    bytes.resize(layout.bytes as usize, 0);
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
    let width = layout.index_bytes as usize;
    let triangle = |i: usize| -> Option<[u32; 3]> {
        let at = |corner: usize| number(layout.indices_at as usize + (3 * i + corner) * width, width);
        Some([at(0)?, at(1)?, at(2)?])
    };
    Some(LevelMesh {
        vertices: (0..layout.vertices as usize).map(vertex).collect::<Option<_>>()?,
        triangles: (0..layout.triangles as usize).map(triangle).collect::<Option<_>>()?,
    })
}

/// The pages of an opened container: its levels, read from the memory map and decoded by whoever asks.
pub struct ContainerPages(pub Arc<Scene>);

impl ContainerPages {
    /// Bytes of a page in memory.
    pub fn bytes_of(&self, page: u32) -> u64 {
        u64::from(PageLayout::of(&self.0.levels()[page as usize]).bytes)
    }
}

impl PageSource for ContainerPages {
    fn load(&self, page: u32) -> Result<Vec<u8>, LoadError> {
        let mesh = self.0.level_mesh(page).map_err(|error| LoadError::Source(error.into()))?;
        Ok(encode(&mesh))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_hold_the_mesh_and_no_more() {
        for (vertices, triangles) in
            [(3u32, 1u32), (256, 5), (257, 5), (1000, 2001), (65_536, 3), (65_537, 2), (70_000, 65_536)]
        {
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
            let needed = 6 * vertices + 3 * triangles * layout.index_bytes;
            assert!(layout.bytes < needed + 8 && layout.bytes.is_multiple_of(4));
            assert_eq!(decode(&layout, &bytes[..bytes.len() - 4]), None);
        }
    }
}
