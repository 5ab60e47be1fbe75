//! Opening a container: everything is checked once, then sections are read in place.

use std::fs::File;
use std::path::{Path, PathBuf};

use bytemuck::Pod;
use memmap2::Mmap;
use serde::de::DeserializeOwned;
use voxsight_voxel::dag::owners::OwnersIndex;
use voxsight_voxel::dag::{DagRef, OwnersRef};
use xxhash_rust::xxh3::xxh3_64;

use super::check::{Tables, bounds_of};
use super::error::{ContainerError, Damage, Problem};
use super::layout::{
    ChunkRecord, LevelRecord, NodeRecord, ObjectRecord, PartRecord, SectionKind, StringRef, TABLE_END,
};
use super::map;
use super::meta::{BuildReport, Meta};
use super::page::{self, PageError};
use super::table::Table;
use super::voxels::VoxelSections;
use crate::geometry::LevelMesh;

/// An opened container.
///
/// Opening has checked the header, the table, the checksums of all sections but the geometry, every cross reference
/// between records, and every word of the voxel sections; [`Container::decode_level`] checks a page when it is read.
/// What nothing relies on for safety is left to [`super::verify()`]: all pages, and whether owners and voxels agree.
#[derive(Debug)]
pub struct Container {
    path: PathBuf,
    map: Mmap,
    table: Table,
    meta: Meta,
    report: BuildReport,
    owners_index: OwnersIndex,
}

impl Container {
    /// Opens and checks a container.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is not a container, is of another version, was cut short, or is damaged: says where.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ContainerError> {
        let path = path.as_ref();
        Self::open_checked(path).map_err(|problem| ContainerError::new(path, problem))
    }

    fn open_checked(path: &Path) -> Result<Self, Problem> {
        let map = map_file(path)?;
        let table = Table::read(&map)?;
        for kind in SectionKind::ALL {
            if kind != SectionKind::Geometry {
                table.check_checksum(&map, kind)?;
            }
        }
        let meta: Meta = read_json(&map, &table, SectionKind::Meta)?;
        let report = read_json(&map, &table, SectionKind::Report)?;
        let owners_index = OwnersIndex::default();
        let mut container = Container { path: path.to_owned(), map, table, meta, report, owners_index };
        container.check_records()?;
        container.owners_index = container.check_voxels()?;
        Ok(container)
    }

    /// Strings are text, and all records fit together.
    fn check_records(&self) -> Result<(), Problem> {
        let strings = std::str::from_utf8(self.bytes(SectionKind::Strings)).map_err(|error| {
            let at = error.valid_up_to();
            self.place(Damage::record(SectionKind::Strings, at, "UTF-8 text", "bytes that are not"))
        })?;
        let tables = Tables {
            strings,
            nodes: self.nodes(),
            parts: self.parts(),
            objects: self.objects(),
            chunks: self.chunks(),
            levels: self.levels(),
            geometry_length: self.geometry().len() as u64,
        };
        let counts = tables.check().map_err(|damage| self.place(damage))?;
        self.meta.check(&counts, bounds_of(self.objects())).map_err(|damage| self.place(damage))?;
        Ok(())
    }

    fn check_voxels(&self) -> Result<OwnersIndex, Problem> {
        let sections = VoxelSections {
            nodes: self.dag_nodes(),
            counts: self.dag_counts(),
            leaves: self.dag_leaves(),
            owner_directory: self.owner_directory(),
            owner_pages: self.owner_pages(),
        };
        sections.check(&self.meta).map_err(|damage| self.place(damage).into())
    }

    /// Adds to `damage` where its record stands in the file.
    fn place(&self, damage: Damage) -> Damage {
        let kind = SectionKind::ALL.into_iter().find(|kind| kind.name() == damage.section);
        let byte = kind
            .zip(damage.record)
            .map(|(kind, record)| self.table.range(kind).start as u64 + record * kind.record_size() as u64);
        Damage { byte, ..damage }
    }

    /// The path it was opened by.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A number that only this file's contents give: a hash of the header and the table with the checksums of all sections.
    pub fn fingerprint(&self) -> u128 {
        xxhash_rust::xxh3::xxh3_128(&self.map[..TABLE_END as usize])
    }

    /// Length of the file, bytes.
    pub fn file_length(&self) -> u64 {
        self.map.len() as u64
    }

    /// Length of a section, bytes.
    pub fn section_length(&self, kind: SectionKind) -> u64 {
        self.table.range(kind).len() as u64
    }

    /// Sources, settings, bounds and counts.
    pub fn meta(&self) -> &Meta {
        &self.meta
    }

    /// What the build repaired and counted.
    pub fn report(&self) -> &BuildReport {
        &self.report
    }

    /// The assembly tree, in pre-order.
    pub fn nodes(&self) -> &[NodeRecord] {
        self.records(SectionKind::Nodes)
    }

    /// Distinct geometries.
    pub fn parts(&self) -> &[PartRecord] {
        self.records(SectionKind::Parts)
    }

    /// Placed occurrences, in the order of their nodes.
    pub fn objects(&self) -> &[ObjectRecord] {
        self.records(SectionKind::Objects)
    }

    /// Spatial pieces of parts.
    pub fn chunks(&self) -> &[ChunkRecord] {
        self.records(SectionKind::Chunks)
    }

    /// Levels of detail of chunks.
    pub fn levels(&self) -> &[LevelRecord] {
        self.records(SectionKind::Levels)
    }

    /// All pages.
    pub fn geometry(&self) -> &[u8] {
        self.bytes(SectionKind::Geometry)
    }

    /// The occupied voxels.
    pub fn dag(&self) -> DagRef<'_> {
        DagRef::assume_valid(&self.meta.dag_shape(), self.dag_nodes(), self.dag_counts(), self.dag_leaves())
    }

    /// Who occupies them: drawables.
    pub fn owners(&self) -> OwnersRef<'_> {
        OwnersRef::new(self.owner_directory(), self.owner_pages(), &self.owners_index)
    }

    /// Words of the DAG's nodes.
    pub fn dag_nodes(&self) -> &[u32] {
        self.records(SectionKind::DagNodes)
    }

    /// Masks of the DAG's leaf bricks.
    pub fn dag_leaves(&self) -> &[u64] {
        self.records(SectionKind::DagLeaves)
    }

    /// Leaf-brick counts beside the words of the DAG's nodes above height 1.
    pub fn dag_counts(&self) -> &[u32] {
        self.records(SectionKind::DagCounts)
    }

    /// First brick ordinal and first word of each owner page.
    pub fn owner_directory(&self) -> &[[u64; 2]] {
        self.records(SectionKind::OwnerDirectory)
    }

    /// Words of the owner pages.
    pub fn owner_pages(&self) -> &[u64] {
        self.records(SectionKind::OwnerPages)
    }

    /// The text that a record of this container refers to.
    pub fn string(&self, at: StringRef) -> &str {
        // Both were checked at opening, so this is empty only for a reference from somewhere else.
        let start = at.offset as usize;
        let end = start.saturating_add(at.length as usize);
        let bytes = self.bytes(SectionKind::Strings).get(start..end).unwrap_or_default();
        std::str::from_utf8(bytes).unwrap_or_default()
    }

    /// The packed page of a level, as [`page::decode`] takes it.
    ///
    /// # Errors
    ///
    /// There is no such level.
    pub fn page(&self, level: u32) -> Result<(&LevelRecord, &[u8]), ContainerError> {
        let levels = self.levels();
        let record = levels.get(level as usize).ok_or_else(|| {
            let problem =
                Problem::NoSuch { what: "level", index: u64::from(level), count: levels.len() as u64 };
            ContainerError::new(&self.path, problem)
        })?;
        // Opening has checked that the pages tile the geometry section.
        let start = record.page_offset as usize;
        let end = start + record.vertex_bytes as usize + record.index_bytes as usize;
        Ok((record, &self.geometry()[start..end]))
    }

    /// Checks and unpacks the page of a level.
    ///
    /// # Errors
    ///
    /// There is no such level, or its page is damaged.
    pub fn decode_level(&self, level: u32) -> Result<LevelMesh, ContainerError> {
        let (record, bytes) = self.page(level)?;
        let found = xxh3_64(bytes);
        let mesh = if found == record.checksum {
            page::decode(record, bytes)
        } else {
            Err(PageError::Checksum { expected: record.checksum, found })
        };
        mesh.map_err(|source| self.page_error(level, record, source))
    }

    /// `source` as an error of this container.
    pub(super) fn page_error(&self, level: u32, record: &LevelRecord, source: PageError) -> ContainerError {
        let byte = self.table.range(SectionKind::Geometry).start as u64 + record.page_offset;
        ContainerError::new(&self.path, Problem::Page { level, byte, source })
    }

    /// Checks the checksum that opening leaves out, as it reads the whole geometry.
    pub(super) fn check_geometry_checksum(&self) -> Result<(), ContainerError> {
        let result = self.table.check_checksum(&self.map, SectionKind::Geometry);
        result.map_err(|damage| ContainerError::new(&self.path, damage))
    }

    fn bytes(&self, kind: SectionKind) -> &[u8] {
        // Inside the map: the table is checked.
        &self.map[self.table.range(kind)]
    }

    fn records<T: Pod>(&self, kind: SectionKind) -> &[T] {
        debug_assert_eq!(size_of::<T>(), kind.record_size());
        // Cannot fail: the map starts at a page border, the table is checked: the section starts at a
        // multiple of 64 and is a whole number of records long.
        bytemuck::cast_slice(self.bytes(kind))
    }
}

fn map_file(path: &Path) -> Result<Mmap, Problem> {
    let io = |doing| move |source| Problem::Io { doing, source };
    // Asked before opening: opening a named pipe would wait for its writer.
    if !std::fs::metadata(path).map_err(io("be read"))?.is_file() {
        return Err(Problem::NotAFile);
    }
    let file = File::open(path).map_err(io("be read"))?;
    map::map(&file).map_err(io("map into memory"))
}

fn read_json<T: DeserializeOwned>(bytes: &[u8], table: &Table, kind: SectionKind) -> Result<T, Damage> {
    let section = table.range(kind);
    let byte = Some(section.start as u64);
    serde_json::from_slice(&bytes[section]).map_err(|error| Damage {
        byte,
        ..Damage::section(kind.name(), "JSON as this version writes it", error)
    })
}
