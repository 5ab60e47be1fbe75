//! A page: one level of detail of a chunk, packed.
//!
//! Vertices and indices are two streams, each stored the smaller way: raw, or by meshoptimizer's codec (Kapoulkine,
//! meshoptimizer; its index codec follows Giesen 2013 and Stokes 2014). Measured there: about 1.2 bytes of index a
//! triangle and 2.6 to 3.8 bytes a vertex.
//!
//! The index codec keeps the order of triangles and their winding but may rotate their corners. So that a page decodes
//! to the same mesh whichever encoding was smaller, [`decode`] gives every triangle in its [`canonical`] rotation:
//! `decode(encode(mesh))` is `mesh` with each triangle made canonical, and vertices unchanged.

use std::borrow::Cow;

use thiserror::Error;

use super::layout::{Encoding, LevelRecord, MAX_LEVEL_TRIANGLES};
use crate::geometry::LevelMesh;

/// A level, packed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EncodedPage {
    /// Vertex stream, then index stream.
    pub bytes: Vec<u8>,
    /// Bytes of the vertex stream.
    pub vertex_bytes: u32,
    /// Bytes of the index stream.
    pub index_bytes: u32,
    /// Vertices.
    pub vertex_count: u32,
    /// Triangles.
    pub triangle_count: u32,
    /// Of the vertices, of the indices.
    pub encodings: [Encoding; 2],
}

impl EncodedPage {
    /// The record of this page when it lies at `page_offset` of the geometry section. `error` in part units.
    pub fn record(&self, page_offset: u64, error: f32) -> LevelRecord {
        LevelRecord {
            page_offset,
            checksum: xxhash_rust::xxh3::xxh3_64(&self.bytes),
            vertex_bytes: self.vertex_bytes,
            index_bytes: self.index_bytes,
            vertex_count: self.vertex_count,
            triangle_count: self.triangle_count,
            error,
            encodings: self.encodings.map(|encoding| encoding as u8),
            reserved: [0; 2],
        }
    }
}

/// Why a level cannot be packed or a page cannot be unpacked.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PageError {
    /// A count outside what a chunk may have.
    #[error("expected 1 to {most} {what}, found {found}")]
    Count {
        /// `vertices` or `triangles`.
        what: &'static str,
        /// The most allowed.
        most: u64,
        /// The count.
        found: u64,
    },
    /// A stream cannot hold the vertices or triangles that its record counts.
    #[error("{count} {what} need {} {expected} bytes, found {found}", if *.exact { "exactly" } else { "at least" })]
    Size {
        /// `vertices` or `triangles`.
        what: &'static str,
        /// How many.
        count: u32,
        /// Whether `expected` is the only possible size or the least.
        exact: bool,
        /// Bytes.
        expected: u64,
        /// Bytes of the stream.
        found: u64,
    },
    /// The page has another length than its record says.
    #[error("expected a page of {expected} bytes, found {found}")]
    Length {
        /// By the record.
        expected: u64,
        /// Of the page.
        found: u64,
    },
    /// An encoding that this version does not know.
    #[error("expected encoding 0 or 1 for the {what}, found {found}")]
    Encoding {
        /// `vertices` or `triangles`.
        what: &'static str,
        /// The number.
        found: u8,
    },
    /// The checksum of the page differs from its record's.
    #[error("expected checksum {expected:016x}, found {found:016x}")]
    Checksum {
        /// By the record.
        expected: u64,
        /// Of the page.
        found: u64,
    },
    /// The codec refused the stream.
    #[error("the {what} do not decode: {reason}")]
    Codec {
        /// `vertices` or `triangles`.
        what: &'static str,
        /// As the codec says.
        reason: String,
    },
    /// A corner names a vertex that does not exist.
    #[error("triangle {triangle}: expected a vertex index below {vertex_count}, found {found}")]
    Index {
        /// Which triangle.
        triangle: usize,
        /// Its bad corner.
        found: u32,
        /// Vertices of the level.
        vertex_count: u32,
    },
    /// The unused fourth number of a packed vertex.
    #[error("vertex {vertex}: expected 0 as the fourth number, found {found}")]
    Padding {
        /// Which vertex.
        vertex: usize,
        /// The number.
        found: u16,
    },
    /// A coordinate that f32 cannot hold exactly.
    #[error("vertex {vertex}: expected a coordinate below 2^24, found {found}")]
    Coordinate {
        /// Which vertex.
        vertex: usize,
        /// Chunk offset + quantized coordinate.
        found: i64,
    },
}

const VERTICES: &str = "vertices";
const TRIANGLES: &str = "triangles";

/// A triangle rotated so that the least of its three rotations (in lexicographic order) remains. Same winding.
pub fn canonical([a, b, c]: [u32; 3]) -> [u32; 3] {
    [a, b, c].min([b, c, a]).min([c, a, b])
}

/// Packs a level.
///
/// # Errors
///
/// Counts outside the limits of a chunk, or an index that is not below the number of vertices.
pub fn encode(mesh: &LevelMesh) -> Result<EncodedPage, PageError> {
    let (vertex_count, triangle_count) =
        check_counts(mesh.vertices.len() as u64, mesh.triangles.len() as u64)?;
    check_indices(&mesh.triangles, vertex_count)?;
    let triangles: Vec<[u32; 3]> = mesh.triangles.iter().copied().map(canonical).collect();

    let (vertex_encoding, mut bytes) = encode_vertices(&mesh.vertices);
    let (index_encoding, indices) = encode_triangles(&triangles, vertex_count);
    // The counts are bounded, so both streams are far below 4 GiB.
    let (vertex_bytes, index_bytes) = (bytes.len() as u32, indices.len() as u32);
    bytes.extend_from_slice(&indices);
    let encodings = [vertex_encoding, index_encoding];
    Ok(EncodedPage { bytes, vertex_bytes, index_bytes, vertex_count, triangle_count, encodings })
}

/// Unpacks a page. Any bytes are safe: sizes are checked against the counts before memory is asked for, and every
/// index before it is returned. The checksum is not looked at.
///
/// # Errors
///
/// The record is impossible, or the page is not what the record says.
pub fn decode(record: &LevelRecord, page: &[u8]) -> Result<LevelMesh, PageError> {
    let encodings = check_record(record)?;
    let (vertex_stream, index_stream) = page
        .split_at_checked(record.vertex_bytes as usize)
        .filter(|(_, indices)| indices.len() == record.index_bytes as usize)
        .ok_or(PageError::Length {
            expected: u64::from(record.vertex_bytes) + u64::from(record.index_bytes),
            found: page.len() as u64,
        })?;
    let vertices = decode_vertices(encodings[0], vertex_stream, record.vertex_count)?;
    let triangles = decode_triangles(encodings[1], index_stream, record)?;
    check_indices(&triangles, record.vertex_count)?;
    Ok(LevelMesh { vertices, triangles })
}

/// Checks that counts, encodings and sizes of a record fit together, without its page. Afterwards decoding asks for at
/// most a few megabytes ([`MAX_LEVEL_TRIANGLES`]).
pub(super) fn check_record(record: &LevelRecord) -> Result<[Encoding; 2], PageError> {
    let (vertex_count, triangle_count) =
        check_counts(u64::from(record.vertex_count), u64::from(record.triangle_count))?;
    let [vertex_byte, index_byte] = record.encodings;
    let encoding = |what, found| Encoding::from_byte(found).ok_or(PageError::Encoding { what, found });
    let encodings = [encoding(VERTICES, vertex_byte)?, encoding(TRIANGLES, index_byte)?];

    let (vertices, triangles) = (u64::from(vertex_count), u64::from(triangle_count));
    let size = |what, count, encoding, raw, least, found: u32| {
        let (exact, expected) = if encoding == Encoding::Raw { (true, raw) } else { (false, least) };
        let found = u64::from(found);
        let fits = if exact { found == expected } else { found >= expected };
        if fits { Ok(()) } else { Err(PageError::Size { what, count, exact, expected, found }) }
    };
    // The least that meshoptimizer's decoders accept: a header byte, two control bytes a block of 256 vertices, a tail
    // of 24; a header byte, a byte a triangle, a table of 16.
    let least_vertices = 1 + 2 * vertices.div_ceil(256) + 24;
    let least_triangles = 1 + triangles + 16;
    let raw_triangles = 3 * triangles * IndexWidth::of(vertex_count).bytes();
    size(VERTICES, vertex_count, encodings[0], 6 * vertices, least_vertices, record.vertex_bytes)?;
    size(TRIANGLES, triangle_count, encodings[1], raw_triangles, least_triangles, record.index_bytes)?;
    Ok(encodings)
}

/// Limits of a chunk. Every vertex is some triangle's corner, so there are at most three a triangle.
fn check_counts(vertices: u64, triangles: u64) -> Result<(u32, u32), PageError> {
    let within = |what, most: u64, found: u64| match u32::try_from(found) {
        Ok(count) if found >= 1 && found <= most => Ok(count),
        _ => Err(PageError::Count { what, most, found }),
    };
    let triangle_count = within(TRIANGLES, u64::from(MAX_LEVEL_TRIANGLES), triangles)?;
    Ok((within(VERTICES, 3 * triangles, vertices)?, triangle_count))
}

fn check_indices(triangles: &[[u32; 3]], vertex_count: u32) -> Result<(), PageError> {
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&found) = corners.iter().find(|&&index| index >= vertex_count) {
            return Err(PageError::Index { triangle, found, vertex_count });
        }
    }
    Ok(())
}

/// How wide a raw index is.
#[derive(Clone, Copy)]
enum IndexWidth {
    U8,
    U16,
    U32,
}

impl IndexWidth {
    fn of(vertex_count: u32) -> Self {
        match vertex_count {
            0..=0x100 => IndexWidth::U8,
            0x101..=0x1_0000 => IndexWidth::U16,
            _ => IndexWidth::U32,
        }
    }

    fn bytes(self) -> u64 {
        match self {
            IndexWidth::U8 => 1,
            IndexWidth::U16 => 2,
            IndexWidth::U32 => 4,
        }
    }
}

fn encode_vertices(vertices: &[[u16; 3]]) -> (Encoding, Vec<u8>) {
    let raw: Vec<u8> = vertices.iter().flatten().flat_map(|q| q.to_le_bytes()).collect();
    // The codec works on vertices of a multiple of four bytes.
    let padded: Vec<[u16; 4]> = vertices.iter().map(|&[x, y, z]| [x, y, z, 0]).collect();
    // Level and version given, as the library's defaults are process-wide settings; 2 and 1 are those defaults.
    smaller(raw, meshopt::encode_vertex_buffer_level(&padded, 2, Some(1)))
}

fn encode_triangles(triangles: &[[u32; 3]], vertex_count: u32) -> (Encoding, Vec<u8>) {
    let indices = triangles.as_flattened();
    let raw: Vec<u8> = match IndexWidth::of(vertex_count) {
        IndexWidth::U8 => indices.iter().map(|&i| i as u8).collect(),
        IndexWidth::U16 => indices.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect(),
        IndexWidth::U32 => indices.iter().flat_map(|&i| i.to_le_bytes()).collect(),
    };
    smaller(raw, meshopt::encode_index_buffer(indices, vertex_count as usize))
}

/// The shorter stream; raw when equal, as it costs nothing to decode. The encoders report failure by an empty stream:
/// then, too, it is raw.
fn smaller(raw: Vec<u8>, packed: meshopt::Result<Vec<u8>>) -> (Encoding, Vec<u8>) {
    match packed {
        Ok(packed) if !packed.is_empty() && packed.len() < raw.len() => (Encoding::Meshopt, packed),
        _ => (Encoding::Raw, raw),
    }
}

/// The sizes were checked by [`check_record`].
fn decode_vertices(encoding: Encoding, stream: &[u8], count: u32) -> Result<Vec<[u16; 3]>, PageError> {
    match encoding {
        Encoding::Raw => {
            let (vertices, _) = stream.as_chunks::<6>();
            Ok(vertices
                .iter()
                .map(|&[a, b, c, d, e, f]| [[a, b], [c, d], [e, f]].map(u16::from_le_bytes))
                .collect())
        }
        Encoding::Meshopt => {
            let padded: Vec<[u16; 4]> = meshopt::decode_vertex_buffer(stream, count as usize)
                .map_err(|error| PageError::Codec { what: VERTICES, reason: codec_reason(&error).into() })?;
            let unpad = |(vertex, &[x, y, z, w]): (usize, &[u16; 4])| {
                if w == 0 { Ok([x, y, z]) } else { Err(PageError::Padding { vertex, found: w }) }
            };
            padded.iter().enumerate().map(unpad).collect()
        }
    }
}

fn decode_triangles(
    encoding: Encoding,
    stream: &[u8],
    record: &LevelRecord,
) -> Result<Vec<[u32; 3]>, PageError> {
    let indices: Vec<u32> = match encoding {
        Encoding::Raw => match IndexWidth::of(record.vertex_count) {
            IndexWidth::U8 => stream.iter().map(|&i| u32::from(i)).collect(),
            IndexWidth::U16 => {
                stream.as_chunks().0.iter().map(|&i| u32::from(u16::from_le_bytes(i))).collect()
            }
            IndexWidth::U32 => stream.as_chunks().0.iter().map(|&i| u32::from_le_bytes(i)).collect(),
        },
        Encoding::Meshopt => meshopt::decode_index_buffer(stream, 3 * record.triangle_count as usize)
            .map_err(|error| PageError::Codec { what: TRIANGLES, reason: codec_reason(&error).into() })?,
    };
    let (triangles, _) = indices.as_chunks::<3>();
    Ok(triangles.iter().copied().map(canonical).collect())
}

/// What the codec's return codes mean (`meshoptimizer.h`).
fn codec_reason(error: &meshopt::Error) -> Cow<'static, str> {
    match error {
        meshopt::Error::Native(-1) => "not a stream of this codec".into(),
        meshopt::Error::Native(-2) => "the stream ends too early".into(),
        meshopt::Error::Native(-3) => "the stream goes on after its end".into(),
        other => other.to_string().into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bumpy sheet of `side * side` quads, corners in rotations that vary.
    fn sheet(side: u32) -> LevelMesh {
        let row = side + 1;
        let vertices = (0..row * row)
            .map(|i| {
                [(i % row) as u16 * 3, (i / row) as u16 * 5, (i.wrapping_mul(2_654_435_761) >> 28) as u16]
            })
            .collect();
        let triangles = (0..side * side)
            .flat_map(|i| {
                let a = i / side * row + i % side;
                [[a, a + 1, a + row], [a + row + 1, a + row, a + 1]]
            })
            .enumerate()
            .map(|(i, [a, b, c])| [[a, b, c], [b, c, a], [c, a, b]][i % 3])
            .collect();
        LevelMesh { vertices, triangles }
    }

    fn canonical_mesh(mesh: &LevelMesh) -> LevelMesh {
        let triangles = mesh.triangles.iter().copied().map(canonical).collect();
        LevelMesh { vertices: mesh.vertices.clone(), triangles }
    }

    #[test]
    fn pages_decode_to_the_canonical_mesh_at_every_index_width_and_encoding() {
        let mut seen = Vec::new();
        for side in [1, 2, 15, 16, 181] {
            let mesh = sheet(side);
            let page = encode(&mesh).unwrap();
            let decoded = decode(&page.record(0, 0.0), &page.bytes).unwrap();
            assert_eq!(decoded, canonical_mesh(&mesh), "side {side}");
            assert_eq!(encode(&decoded).unwrap(), page, "a decoded page encodes to itself, side {side}");
            seen.push(page.encodings);
        }
        assert_eq!(seen[0], [Encoding::Raw; 2]);
        assert_eq!(seen[4], [Encoding::Meshopt; 2]);
    }

    #[test]
    fn raw_indices_are_as_narrow_as_the_vertex_count_allows() {
        for (vertex_count, width) in [(1, 1), (256, 1), (257, 2), (65_536, 2), (65_537, 4)] {
            assert_eq!(IndexWidth::of(vertex_count).bytes(), width, "{vertex_count}");
        }
        // All corners apart and far from each other: nothing for the codec to find.
        let mut random = oorandom::Rand32::new(7);
        for vertex_count in [200_u32, 30_000, 90_000] {
            let vertices = (0..vertex_count).map(|_| [0; 3].map(|_: u16| random.rand_u32() as u16)).collect();
            let triangles =
                (0..30_000).map(|_| [0; 3].map(|_: u32| random.rand_range(0..vertex_count))).collect();
            let mesh = LevelMesh { vertices, triangles };
            let page = encode(&mesh).unwrap();
            assert_eq!(decode(&page.record(0, 0.0), &page.bytes).unwrap(), canonical_mesh(&mesh));
        }
    }

    #[test]
    fn degenerate_triangles_survive() {
        let triangles = vec![[2, 2, 2], [1, 0, 1], [0, 0, 1], [2, 1, 0], [0, 1, 2], [0, 1, 2]];
        let mesh = LevelMesh { vertices: vec![[0; 3], [u16::MAX; 3], [1, 2, 3]], triangles };
        let page = encode(&mesh).unwrap();
        assert_eq!(decode(&page.record(0, 0.0), &page.bytes).unwrap(), canonical_mesh(&mesh));
    }

    #[test]
    fn encode_refuses_what_a_chunk_may_not_have() {
        let triangle = |index| LevelMesh { vertices: vec![[0; 3]; 3], triangles: vec![[0, 1, index]] };
        assert_eq!(encode(&triangle(3)), Err(PageError::Index { triangle: 0, found: 3, vertex_count: 3 }));
        assert!(encode(&triangle(2)).is_ok());
        assert!(matches!(encode(&LevelMesh::default()), Err(PageError::Count { what: TRIANGLES, .. })));
        let many = LevelMesh { vertices: vec![[0; 3]; 4], ..triangle(2) };
        assert!(matches!(encode(&many), Err(PageError::Count { what: VERTICES, most: 3, found: 4 })));
        let big = LevelMesh { vertices: vec![[0; 3]], triangles: vec![[0; 3]; 65_537] };
        assert!(matches!(encode(&big), Err(PageError::Count { what: TRIANGLES, .. })));
    }

    #[test]
    fn a_tiny_page_cannot_ask_for_much_memory() {
        let page = encode(&sheet(40)).unwrap();
        let honest = page.record(0, 0.0);
        for (vertex_count, triangle_count) in
            [(u32::MAX, u32::MAX), (196_608, 65_536), (honest.vertex_count, 65_536)]
        {
            let record = LevelRecord { vertex_count, triangle_count, ..honest };
            assert!(check_record(&record).is_err(), "{vertex_count} vertices, {triangle_count} triangles");
        }
    }

    #[test]
    fn cut_and_random_streams_are_errors_not_panics() {
        let page = encode(&sheet(20)).unwrap();
        let honest = page.record(0, 0.0);
        for length in 0..page.bytes.len() {
            assert!(decode(&honest, &page.bytes[..length]).is_err(), "cut to {length}");
        }
        for seed in 0..3_000 {
            let mut random = oorandom::Rand32::new(seed);
            let mut bytes = page.bytes.clone();
            for _ in 0..random.rand_range(1..9) {
                let at = random.rand_range(0..bytes.len() as u32) as usize;
                bytes[at] = random.rand_u32() as u8;
            }
            if let Ok(mesh) = decode(&honest, &bytes) {
                assert_eq!(mesh.vertices.len(), honest.vertex_count as usize, "seed {seed}");
                assert!(
                    mesh.triangles.as_flattened().iter().all(|&i| i < honest.vertex_count),
                    "seed {seed}"
                );
            }
        }
    }
}
