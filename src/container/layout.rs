//! Layout of a `.vxs` container: little endian, memory-mapped, read zero-copy.
//!
//! ```text
//! byte 0    Header           64 bytes: magic, version, section count, file length, checksum of header + table
//! byte 64   SectionEntry[n]  32 bytes each: kind, offset, length, checksum (XXH3-64 of the section's bytes)
//!           section          each starts at a multiple of 64, zero bytes fill the gaps, the last one ends the file
//! ```
//!
//! The table names every [`SectionKind`] exactly once, in the order of [`SectionKind::ALL`]. The sections themselves
//! may lie in any order (the writer streams the geometry first, while it is made), but they tile the file: each
//! starts at the first multiple of 64 after the one before it. So no byte of a file is without meaning, and `verify`
//! finds any single one that changed.
//!
//! Records are plain old data; their sizes are asserted below; reserved fields are 0. Spaces: *world* is model space
//! in f64; *part* is a part's own space, whose origin is the low corner of the part's box.
//!
//! A vertex is stored as three u16 `q` and decoded as `(chunk.offset + q) * part.step`. Steps are powers of two and
//! `offset + q` stays below 2^24, so that the decoded f32 is exact: the same bits on every CPU and GPU, with or
//! without fused multiply-add, and borders shared by chunks have no cracks.

use bytemuck::{Pod, Zeroable};

#[cfg(target_endian = "big")]
compile_error!("a container is mapped into memory as it is, little endian; this platform is big endian");

/// First eight bytes of every container.
pub const MAGIC: [u8; 8] = *b"VOXSIGHT";
/// Version written and read by this code. Any other is refused.
pub const VERSION: u32 = 2;
/// Sections start at multiples of this many bytes from the start of the file. Geometry pages are not aligned: they
/// are decoded, never read in place, and half a cache line lost per page would be a byte a triangle for small parts.
pub const SECTION_ALIGNMENT: u64 = 64;
/// Most triangles of one level of a chunk.
pub const MAX_LEVEL_TRIANGLES: u32 = 65_536;
/// Quantized coordinates `offset + q` stay below this, so that every one is an exact f32.
pub const MAX_COORDINATE: i32 = 1 << 24;
/// Smallest quantization step: a normal f32, so that no decoded coordinate is ever flushed to zero.
pub const MIN_STEP: f32 = f32::MIN_POSITIVE;
/// Largest quantization step, 2^45: 2^60 units, the largest extent that is built, need a little more than 16 bits of
/// 2^44. The largest coordinate, 2^69, is far from where f32 ends.
pub const MAX_STEP: f32 = 3.518_437_2e13;
/// Deepest node of the assembly tree; a root's depth is 1. Paths grow with it.
pub const MAX_DEPTH: u32 = 1_024;
/// Longest name of a node or part, bytes.
pub const MAX_NAME_BYTES: u32 = 1 << 16;
/// Longest extras of a node, bytes.
pub const MAX_EXTRAS_BYTES: u32 = 1 << 24;
/// Most drawables of a scene. The runtime keeps 8 bytes for each, and a small damaged file must not ask for more
/// memory than a big model needs: 2^27 drawables are a gigabyte.
pub const MAX_DRAWABLES: u32 = 1 << 27;
/// "No such thing" in an index field.
pub const NONE: u32 = u32::MAX;

/// What a section holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum SectionKind {
    /// JSON: source files, settings, units, bounds ([`super::Meta`]).
    Meta = 1,
    /// UTF-8 text that [`StringRef`]s point into.
    Strings = 2,
    /// [`NodeRecord`]s: the assembly tree.
    Nodes = 3,
    /// [`PartRecord`]s.
    Parts = 4,
    /// [`ObjectRecord`]s.
    Objects = 5,
    /// [`ChunkRecord`]s.
    Chunks = 6,
    /// [`LevelRecord`]s.
    Levels = 7,
    /// Encoded vertices and indices, one page a level, without gaps, in the order of the levels.
    Geometry = 8,
    /// u32 words of the DAG's nodes (`voxsight_voxel::dag`).
    DagNodes = 9,
    /// u64 masks of the DAG's leaf bricks.
    DagLeaves = 10,
    /// u32 leaf-brick counts beside the words of the DAG's nodes above height 1.
    DagCounts = 11,
    /// First brick ordinal and first word of each owner page, u64 each (`voxsight_voxel::dag::owners`).
    OwnerDirectory = 12,
    /// u64 words of the owner pages.
    OwnerPages = 13,
    /// JSON: what the build repaired and counted ([`crate::report::Findings`] and statistics). No times: the same
    /// input and settings give the same bytes.
    Report = 14,
}

impl SectionKind {
    /// All kinds, in file order.
    pub const ALL: [SectionKind; 14] = [
        SectionKind::Meta,
        SectionKind::Strings,
        SectionKind::Nodes,
        SectionKind::Parts,
        SectionKind::Objects,
        SectionKind::Chunks,
        SectionKind::Levels,
        SectionKind::Geometry,
        SectionKind::DagNodes,
        SectionKind::DagLeaves,
        SectionKind::DagCounts,
        SectionKind::OwnerDirectory,
        SectionKind::OwnerPages,
        SectionKind::Report,
    ];

    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            SectionKind::Meta => "meta",
            SectionKind::Strings => "strings",
            SectionKind::Nodes => "nodes",
            SectionKind::Parts => "parts",
            SectionKind::Objects => "objects",
            SectionKind::Chunks => "chunks",
            SectionKind::Levels => "levels",
            SectionKind::Geometry => "geometry",
            SectionKind::DagNodes => "dag nodes",
            SectionKind::DagLeaves => "dag leaves",
            SectionKind::DagCounts => "dag counts",
            SectionKind::OwnerDirectory => "owner directory",
            SectionKind::OwnerPages => "owner pages",
            SectionKind::Report => "report",
        }
    }

    /// Bytes of one record; 1 for sections that are text or pages.
    pub fn record_size(self) -> usize {
        match self {
            SectionKind::Meta | SectionKind::Strings | SectionKind::Geometry | SectionKind::Report => 1,
            SectionKind::Nodes => size_of::<NodeRecord>(),
            SectionKind::Parts => size_of::<PartRecord>(),
            SectionKind::Objects => size_of::<ObjectRecord>(),
            SectionKind::Chunks => size_of::<ChunkRecord>(),
            SectionKind::Levels => size_of::<LevelRecord>(),
            SectionKind::DagNodes | SectionKind::DagCounts => size_of::<u32>(),
            SectionKind::OwnerDirectory => size_of::<[u64; 2]>(),
            SectionKind::DagLeaves | SectionKind::OwnerPages => size_of::<u64>(),
        }
    }

    /// Place in [`SectionKind::ALL`] and in the section table.
    pub fn index(self) -> usize {
        self as usize - 1
    }
}

/// Bytes of the header and the section table; the first section starts here. A multiple of [`SECTION_ALIGNMENT`].
pub const TABLE_END: u64 = (size_of::<Header>() + SectionKind::ALL.len() * size_of::<SectionEntry>()) as u64;

/// Start of the file.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: [u8; 8],
    /// [`VERSION`].
    pub version: u32,
    /// Number of [`SectionEntry`]s that follow.
    pub section_count: u32,
    /// Bytes of the whole file.
    pub file_length: u64,
    /// XXH3-64 of this header with this field 0, followed by the section table.
    pub checksum: u64,
    /// Zero.
    pub reserved: [u64; 4],
}

/// Where a section lies.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SectionEntry {
    /// A [`SectionKind`] as a number.
    pub kind: u32,
    /// Zero.
    pub reserved: u32,
    /// From the start of the file, a multiple of [`SECTION_ALIGNMENT`].
    pub offset: u64,
    /// Bytes, without padding.
    pub length: u64,
    /// XXH3-64 of those bytes.
    pub checksum: u64,
}

/// A piece of the strings section, in bytes, on character borders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct StringRef {
    /// From the start of the section.
    pub offset: u32,
    /// Bytes.
    pub length: u32,
}

/// A node of the assembly tree, in depth-first pre-order: a subtree is a range of nodes.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct NodeRecord {
    /// Never empty.
    pub name: StringRef,
    /// JSON text, empty when there is none.
    pub extras: StringRef,
    /// [`NONE`] for a root; else below this node's own index.
    pub parent: u32,
    /// Index after the last node of this node's subtree.
    pub subtree_end: u32,
    /// The object that this node carries, or [`NONE`].
    pub object: u32,
    /// Zero.
    pub reserved: u32,
}

/// A part: one geometry.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct PartRecord {
    /// Name of the geometry; may be empty.
    pub name: StringRef,
    /// Its chunks are `first_chunk .. first_chunk + chunk_count`, at least one.
    pub first_chunk: u32,
    /// See `first_chunk`.
    pub chunk_count: u32,
    /// Quantization step per axis in part space, a power of two.
    pub step: [f32; 3],
    /// Low corner of the decoded level 0, part space: exactly the least coordinates of its vertices, not negative.
    pub min: [f32; 3],
    /// High corner of the decoded level 0, part space.
    pub max: [f32; 3],
    /// Triangles of level 0, all chunks.
    pub triangle_count: u32,
}

/// An object: one placed occurrence of a part. Objects stand in the order of their nodes, so a subtree is a range of
/// objects, too.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ObjectRecord {
    /// Columns x, y, z, translation of the affine map from part space to world.
    pub world_from_part: [f64; 12],
    /// Low corner in world of its decoded level 0 (conservative: box of the transformed part box).
    pub min: [f64; 3],
    /// High corner, likewise.
    pub max: [f64; 3],
    /// The node that carries it.
    pub node: u32,
    /// The part that it places.
    pub part: u32,
    /// Its drawables are `first_drawable .. first_drawable + chunk_count of the part`, in the order of the objects.
    pub first_drawable: u32,
    /// sRGB red, green, blue and linear alpha.
    pub colour: [u8; 4],
}

/// A spatial piece of a part. The parts' chunks follow each other without gaps.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ChunkRecord {
    /// Added to the quantized coordinates; not negative.
    pub offset: [i32; 3],
    /// Its levels are `first_level .. first_level + level_count`, finest first, at least one.
    pub first_level: u32,
    /// See `first_level`.
    pub level_count: u32,
    /// Zero.
    pub reserved: u32,
}

/// One level of detail of a chunk, and where its page lies. The chunks' levels follow each other without gaps.
///
/// A page is `vertex_bytes` of encoded vertices, then `index_bytes` of encoded indices. What it decodes to is told in
/// [`super::page`].
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct LevelRecord {
    /// From the start of the geometry section: the end of the page before.
    pub page_offset: u64,
    /// XXH3-64 of the page.
    pub checksum: u64,
    /// Bytes of the encoded vertices.
    pub vertex_bytes: u32,
    /// Bytes of the encoded indices.
    pub index_bytes: u32,
    /// Vertices, at least 1, at most 3 a triangle.
    pub vertex_count: u32,
    /// Triangles, at least 1, at most [`MAX_LEVEL_TRIANGLES`] and never more than the finer level has.
    pub triangle_count: u32,
    /// Geometric error in part units: how far this level may be from level 0. 0 for level 0, finite, never below the
    /// finer level's.
    pub error: f32,
    /// [`Encoding`] of the vertices, [`Encoding`] of the indices.
    pub encodings: [u8; 2],
    /// Zero.
    pub reserved: [u8; 2],
}

/// How the bytes of a page are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Encoding {
    /// Vertices: three little-endian u16 each. Indices: three u8, u16 or u32 a triangle, as narrow as the vertex
    /// count allows (at most 256, at most 65,536 vertices, more).
    Raw = 0,
    /// meshoptimizer's vertex codec over four u16 a vertex (the last 0), or its index codec.
    Meshopt = 1,
}

impl Encoding {
    /// The encoding that this number stands for.
    pub fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            0 => Some(Encoding::Raw),
            1 => Some(Encoding::Meshopt),
            _ => None,
        }
    }
}

const _: () = {
    assert!(size_of::<Header>() == 64);
    assert!(size_of::<SectionEntry>() == 32);
    assert!(size_of::<NodeRecord>() == 32);
    assert!(size_of::<PartRecord>() == 56);
    assert!(size_of::<ObjectRecord>() == 160);
    assert!(size_of::<ChunkRecord>() == 24);
    assert!(size_of::<LevelRecord>() == 40);
    assert!(TABLE_END.is_multiple_of(SECTION_ALIGNMENT));
    assert!(MAX_STEP.to_bits() == (127 + 45) << 23);
};
