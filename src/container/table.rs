//! Header and section table: where each section lies, and that its bytes are those that were written.

use std::ops::Range;

use bytemuck::Zeroable;
use xxhash_rust::xxh3::xxh3_64;

use super::error::{Damage, Problem};
use super::layout::{Header, MAGIC, SECTION_ALIGNMENT, SectionEntry, SectionKind, TABLE_END, VERSION};
use super::write::header_checksum;

/// Name of the first 64 bytes in messages.
const HEADER: &str = "header";
/// Name of the section table in messages.
const TABLE: &str = "section table";

/// A checked section table.
#[derive(Debug)]
pub(super) struct Table {
    /// By [`SectionKind::index`].
    sections: [Section; SectionKind::ALL.len()],
}

#[derive(Clone, Debug, Default)]
struct Section {
    /// In the file's bytes: inside them, from a multiple of 64, a whole number of records.
    range: Range<usize>,
    checksum: u64,
}

impl Table {
    /// Reads and checks header and table, and that sections and zero bytes between them are the whole file. Looks at no
    /// section's bytes.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, Problem> {
        let entries = read_entries(bytes)?;
        let table = Table { sections: locate_sections(bytes.len(), &entries)? };
        table.check_tiling(bytes)?;
        Ok(table)
    }

    /// Where a section lies in the file's bytes.
    pub(super) fn range(&self, kind: SectionKind) -> Range<usize> {
        self.sections[kind.index()].range.clone()
    }

    /// Hashes a section. `bytes` are the file's.
    pub(super) fn check_checksum(&self, bytes: &[u8], kind: SectionKind) -> Result<(), Damage> {
        let Section { range, checksum } = self.sections[kind.index()].clone();
        let byte = Some(range.start as u64);
        let found = xxh3_64(&bytes[range]);
        if found == checksum {
            return Ok(());
        }
        let expected = format!("checksum {checksum:016x}");
        Err(Damage { byte, ..Damage::section(kind.name(), expected, format_args!("{found:016x}")) })
    }

    /// Each section starts at the first multiple of 64 after the one before it, the bytes between are 0, and the last
    /// one ends the file.
    fn check_tiling(&self, bytes: &[u8]) -> Result<(), Damage> {
        // An empty section shares its place with the next one: it comes before.
        let mut kinds = SectionKind::ALL;
        kinds.sort_by_key(|&kind| (self.range(kind).start, self.range(kind).end));
        let mut end = TABLE_END as usize;
        for kind in kinds {
            let range = self.range(kind);
            let start = end.next_multiple_of(SECTION_ALIGNMENT as usize);
            if range.start != start {
                let expected = format!("\"{}\" at byte {start}", kind.name());
                return Err(entry_damage(kind, expected, format!("byte {}", range.start)));
            }
            // In bounds: `start` is where a section starts that is.
            if let Some(at) = bytes[end..start].iter().position(|&byte| byte != 0) {
                let expected = format!("zero bytes before \"{}\"", kind.name());
                let damage = Damage::section(TABLE, expected, bytes[end + at]);
                return Err(Damage { byte: Some((end + at) as u64), ..damage });
            }
            end = range.end;
        }
        if end != bytes.len() {
            let expected = format!("a last section that ends with the file at byte {}", bytes.len());
            return Err(Damage::section(TABLE, expected, format_args!("byte {end}")));
        }
        Ok(())
    }
}

/// The entries of the table, after the header's own fields and the checksum of both were found right.
fn read_entries(bytes: &[u8]) -> Result<Vec<SectionEntry>, Problem> {
    let found = bytes.len() as u64;
    if bytes.is_empty() || !bytes.starts_with(&MAGIC[..bytes.len().min(MAGIC.len())]) {
        return Err(Problem::NotAContainer(guess_format(bytes)));
    }
    let Some(header) = bytes.first_chunk::<{ size_of::<Header>() }>() else {
        return Err(Problem::Length { expected: TABLE_END, found });
    };
    let header: Header = bytemuck::pod_read_unaligned(header);
    if header.version != VERSION {
        return Err(Problem::Version { found: header.version });
    }
    if header.section_count as usize != SectionKind::ALL.len() {
        let expected = format!("{} sections", SectionKind::ALL.len());
        return Err(Damage::section(HEADER, expected, header.section_count).into());
    }
    let Some(table) = bytes.get(size_of::<Header>()..TABLE_END as usize) else {
        return Err(Problem::Length { expected: header.file_length.max(TABLE_END), found });
    };
    let checksum = header_checksum(&header, table);
    if header.checksum != checksum {
        let expected = format!("checksum {:016x} of header and table", header.checksum);
        return Err(Damage::section(HEADER, expected, format_args!("{checksum:016x}")).into());
    }
    if header.file_length != found {
        return Err(Problem::Length { expected: header.file_length, found });
    }
    if header.reserved != <[u64; 4]>::zeroed() {
        return Err(
            Damage::section(HEADER, "reserved fields of 0", format_args!("{:?}", header.reserved)).into()
        );
    }
    let (entries, _) = table.as_chunks::<{ size_of::<SectionEntry>() }>();
    Ok(entries.iter().map(|entry| bytemuck::pod_read_unaligned(entry)).collect())
}

/// Every kind stands at its place in the table and its section is inside the file.
fn locate_sections(
    file_length: usize,
    entries: &[SectionEntry],
) -> Result<[Section; SectionKind::ALL.len()], Damage> {
    let mut sections = SectionKind::ALL.map(|_| Section::default());
    for ((kind, entry), section) in SectionKind::ALL.into_iter().zip(entries).zip(&mut sections) {
        if entry.kind != kind as u32 || entry.reserved != 0 {
            let expected = format!("kind {} (\"{}\"), reserved 0", kind as u32, kind.name());
            return Err(entry_damage(
                kind,
                expected,
                format!("kind {}, reserved {}", entry.kind, entry.reserved),
            ));
        }
        let size = kind.record_size();
        if !entry.length.is_multiple_of(size as u64) {
            let expected = format!("\"{}\" as records of {size} bytes each", kind.name());
            return Err(entry_damage(kind, expected, format!("{} bytes", entry.length)));
        }
        let range = usize::try_from(entry.offset)
            .ok()
            .zip(usize::try_from(entry.length).ok())
            .and_then(|(start, length)| Some(start..start.checked_add(length)?))
            .filter(|range| range.end <= file_length);
        let Some(range) = range else {
            let expected = format!("\"{}\" within the file's {file_length} bytes", kind.name());
            let found = format!("{} bytes from byte {}", entry.length, entry.offset);
            return Err(entry_damage(kind, expected, found));
        };
        *section = Section { range, checksum: entry.checksum };
    }
    Ok(sections)
}

fn entry_damage(kind: SectionKind, expected: String, found: String) -> Damage {
    Damage { record: Some(kind.index() as u64), ..Damage::section(TABLE, expected, found) }
}

/// What a file that is no container seems to be, and what to do about it.
fn guess_format(bytes: &[u8]) -> &'static str {
    const MODELS: [(&[u8], &str); 8] = [
        (b"glTF", "it looks like a GLB model: build a scene from it first with `voxsight build`"),
        (b"ply", "it looks like a PLY model: build a scene from it first with `voxsight build`"),
        (b"solid", "it looks like an STL model: build a scene from it first with `voxsight build`"),
        (b"#", "it may be an OBJ model: build a scene from it first with `voxsight build`"),
        (b"v ", "it looks like an OBJ model: build a scene from it first with `voxsight build`"),
        (b"mtllib", "it looks like an OBJ model: build a scene from it first with `voxsight build`"),
        (
            b"{",
            "it looks like JSON: if it is a glTF model, build a scene from it first with `voxsight build`",
        ),
        (b"PK\x03\x04", "it looks like a ZIP archive: unpack it, and build a scene from the model inside"),
    ];
    if bytes.is_empty() {
        return "it is empty: build it again with `voxsight build`";
    }
    let known = MODELS.iter().find(|(start, _)| bytes.starts_with(start));
    known
        .map_or("its first bytes are not VOXSIGHT: give a .vxs file made by `voxsight build`", |(_, text)| {
            text
        })
}
