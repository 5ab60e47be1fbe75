//! The whole preparation: a model becomes a container. [`build`] reads as the list of its stages.

use std::path::Path;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use serde_json::json;
use voxsight_voxel::dag::{DagError, DagRef, DagStatistics};
use voxsight_voxel::grid::{Grid, GridError};
use voxsight_voxel::voxelize::{Settings as VoxelSettings, Streamed, VoxelizeError, voxelize_into};

use super::localise::localise;
use super::memory::{MemoryError, MemoryGuard};
use super::part::{PartSettings, PrepareError, prepare_part};
use super::resources::{StageCost, Stopwatch};
use super::voxels::{ChunkGeometry, OwnerSection, SceneDrawables};
use crate::container::layout::{ObjectRecord, SectionKind};
use crate::container::{
    Axis, BuildReport, ContainerError, ContainerWriter, DagMeta, Damage, EncodedPart, Generator,
    GeometryRecords, GeometryWriter, GridMeta, Meta, PartError, SceneRecords, Settings, Source, encode_part,
};
use crate::import::{Imported, UpAxis};
use crate::model::{Model, Part};
use crate::progress::Progress;
use crate::report::Findings;

/// Parts prepared between two writes, so that few wait in memory.
const PARTS_PER_ROUND: usize = 256;

/// Finding: the voxels hardly tell these objects apart.
pub const OBJECTS_BELOW_A_VOXEL: &str =
    "objects smaller than a voxel: raise the resolution, or look for an object far from the rest";

/// How fine the voxels are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Resolution {
    /// 2^log2 voxels along the side of the grid, 6 to 17.
    Log2(u32),
    /// Side of a voxel in model units.
    VoxelSize(f64),
}

/// How a container is built.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildSettings {
    /// How fine the voxels are.
    pub resolution: Resolution,
    /// Make coarser levels of detail.
    pub lod: bool,
    /// Largest distance between an input coordinate and its decoded one, model units.
    pub max_position_error: Option<f64>,
    /// Name of the model's unit.
    pub unit: String,
    /// Its length in metres.
    pub metres_per_unit: f64,
    /// The model's up axis, recorded.
    pub up: Axis,
    /// Plan to hold no more resident memory than this, bytes, and stop with an error rather than hold more.
    pub memory: Option<u64>,
}

impl Default for BuildSettings {
    fn default() -> Self {
        BuildSettings {
            resolution: Resolution::Log2(12),
            lod: true,
            max_position_error: None,
            unit: "m".to_owned(),
            metres_per_unit: 1.0,
            up: Axis::Y,
            memory: None,
        }
    }
}

impl BuildSettings {
    /// For a model as its files say; where they do not, metres and z up are taken.
    pub fn of(imported: &Imported) -> Self {
        let up = match imported.up_axis {
            Some(UpAxis::X) => Axis::X,
            Some(UpAxis::Y) => Axis::Y,
            Some(UpAxis::Z) | None => Axis::Z,
        };
        // glTF is in metres; no other format says.
        BuildSettings { metres_per_unit: imported.metres_per_unit.unwrap_or(1.0), up, ..Self::default() }
    }
}

/// What a build gives beside the file.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildOutcome {
    /// As in the file.
    pub meta: Meta,
    /// As in the file.
    pub report: BuildReport,
    /// Not in the file, which depends on the input and the settings alone.
    pub stages: Vec<StageCost>,
}

/// Why a build failed. The target file is as it was before.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// A part cannot be prepared.
    #[error(transparent)]
    Part(#[from] PrepareError),
    /// A part cannot be packed; a fault of this program.
    #[error("part {part}: {source}")]
    Encode {
        /// Index of the part.
        part: usize,
        /// What is wrong with it.
        source: PartError,
    },
    /// The tree cannot be written.
    #[error("the model cannot be written: {0}")]
    Records(Damage),
    /// No grid for this model.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// No DAG for this grid.
    #[error(transparent)]
    Dag(#[from] DagError),
    /// The voxels do not fit, or cannot be stored.
    #[error(transparent)]
    Voxels(VoxelizeError),
    /// The file cannot be written.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// The model has no object.
    #[error("the model has no object: there is nothing to build")]
    Empty,
    /// The caller asked to stop.
    #[error("cancelled; nothing was written")]
    Cancelled,
    /// The memory limit was reached, or cannot be watched.
    #[error(transparent)]
    Memory(#[from] MemoryError),
}

/// Builds a container from a model. The file appears under its name only when it is complete.
///
/// The same model and settings give the same bytes, whatever the number of threads.
pub fn build(
    model: Model,
    sources: Vec<Source>,
    mut findings: Findings,
    settings: &BuildSettings,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildOutcome, BuildError> {
    let guard = MemoryGuard::new(settings.memory, progress)?;
    let mut stopwatch = Stopwatch::start();
    let mut writer = ContainerWriter::create(output)?;

    progress.stage("find equal parts", 0, "");
    let model = localise(model, &mut findings);
    stopwatch.lap("localise");

    let (geometry, chunks) = prepare_parts(&model, settings, &mut findings, &mut writer, &guard)?;
    stopwatch.lap("levels of detail");

    let names: Vec<&str> = model.parts.iter().map(|part| part.name.as_str()).collect();
    let records =
        SceneRecords::new(&model.nodes, &model.objects, &names, geometry).map_err(BuildError::Records)?;
    drop(model);
    records.write(&mut writer)?;
    stopwatch.lap("tree");

    let (grid, voxels, statistics) = voxelize_scene(&records, &chunks, settings, &mut writer, &guard)?;
    drop(chunks);
    stopwatch.lap("voxels");

    let is_tiny = |o: &&ObjectRecord| (0..3).all(|k| o.max[k] - o.min[k] < grid.voxel_size);
    let tiny = records.objects().iter().filter(is_tiny).count() as u64;
    findings.add(OBJECTS_BELOW_A_VOXEL, tiny, || format!("a voxel is {} units", grid.voxel_size));

    let meta = meta(&records, sources, settings, &grid, &voxels, &statistics)?;
    let report = BuildReport { findings, statistics: report_statistics(&records, &voxels, &statistics) };
    progress.stage("write", 0, "");
    write_voxels(&mut writer, &voxels)?;
    writer.write_json(SectionKind::Meta, &meta)?;
    writer.write_json(SectionKind::Report, &report)?;
    still_wanted(&guard)?;
    writer.finish()?;
    stopwatch.lap("write");
    Ok(BuildOutcome { meta, report, stages: stopwatch.finish() })
}

/// Levels of detail of all parts, streamed to the file; level 0 stays for the voxels.
fn prepare_parts(
    model: &Model,
    settings: &BuildSettings,
    findings: &mut Findings,
    writer: &mut ContainerWriter,
    guard: &MemoryGuard,
) -> Result<(GeometryRecords, Vec<ChunkGeometry>), BuildError> {
    guard.stage("levels of detail", model.unique_triangles(), "triangles");
    let gains = part_gains(model);
    let part_settings = |part: usize| PartSettings {
        // The setting counts in the model's units, a part is quantized in its own.
        max_position_error: settings.max_position_error.map(|error| error / gains[part]),
        lod: settings.lod,
        ..PartSettings::default()
    };
    let mut geometry = GeometryWriter::begin(writer)?;
    let mut chunks = Vec::new();
    for (round, parts) in model.parts.chunks(PARTS_PER_ROUND).enumerate() {
        let prepared: Vec<Result<Prepared, BuildError>> = parts
            .par_iter()
            .enumerate()
            .map(|(i, part)| {
                let index = round * PARTS_PER_ROUND + i;
                Prepared::new(index, part, &part_settings(index), guard)
            })
            .collect();
        for part in prepared {
            let Prepared { encoded, level_0, findings: found } = part?;
            findings.merge(found);
            geometry.push(&encoded)?;
            chunks.extend(level_0);
        }
    }
    Ok((geometry.end()?, chunks))
}

/// One part, packed, with what the voxelizer needs of it.
struct Prepared {
    encoded: EncodedPart,
    level_0: Vec<ChunkGeometry>,
    findings: Findings,
}

impl Prepared {
    fn new(
        index: usize,
        part: &Part,
        settings: &PartSettings,
        guard: &MemoryGuard,
    ) -> Result<Self, BuildError> {
        still_wanted(guard)?;
        let mut findings = Findings::default();
        let place = || match part.name.as_str() {
            "" => format!("part {index}"),
            name => format!("part {index} \"{name}\""),
        };
        let prepared = prepare_part(&part.mesh, settings, &mut findings, &place)?;
        let encoded = encode_part(&prepared).map_err(|source| BuildError::Encode { part: index, source })?;
        let step = prepared.step;
        let level_0 = prepared.chunks.into_iter().filter_map(|chunk| {
            let mesh = chunk.levels.into_iter().next()?.mesh;
            Some(ChunkGeometry { offset: chunk.offset, step, mesh })
        });
        guard.advance(part.mesh.triangles.len() as u64);
        Ok(Prepared { encoded, level_0: level_0.collect(), findings })
    }
}

fn voxelize_scene(
    records: &SceneRecords,
    chunks: &[ChunkGeometry],
    settings: &BuildSettings,
    writer: &mut ContainerWriter,
    guard: &MemoryGuard,
) -> Result<(Grid, Streamed, DagStatistics), BuildError> {
    let bounds = records.bounds().ok_or(BuildError::Empty)?;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let grid = match settings.resolution {
        Resolution::Log2(log2) => Grid::around(min, max, log2)?,
        Resolution::VoxelSize(size) => Grid::with_voxel_size(min, max, size)?,
    };
    let placed = records.objects().iter().flat_map(|object| {
        let part = &records.parts()[object.part as usize];
        let world_from_part = DAffine3::from_cols_array(&object.world_from_part);
        (part.first_chunk..part.first_chunk + part.chunk_count).map(move |chunk| (world_from_part, chunk))
    });
    guard.stage("voxels", records.counts().placed_triangles, "triangles");
    let drawables = SceneDrawables { grid, placed: placed.collect(), chunks, progress: guard };
    let settings = VoxelSettings { memory: guard.left_for_voxels(), ..VoxelSettings::default() };
    // Owners go to the file as they come: they may be more than memory holds.
    let mut section = OwnerSection(writer.begin_section(SectionKind::OwnerPages)?);
    let voxels = voxelize_into(&grid, &drawables, &settings, &mut section).map_err(|error| match error {
        VoxelizeError::Cancelled => still_wanted(guard).err().unwrap_or(BuildError::Cancelled),
        other => BuildError::Voxels(other),
    })?;
    section.0.end()?;
    still_wanted(guard)?;
    // Our own output goes through the same checks as a stranger's file.
    let dag = &voxels.dag;
    let (_, statistics) = DagRef::validate(&dag.shape, &dag.words, &dag.counts, &dag.leaves)?;
    Ok((grid, voxels, statistics))
}

/// All voxel sections but the owner pages, which were written as they came.
fn write_voxels(writer: &mut ContainerWriter, voxels: &Streamed) -> Result<(), ContainerError> {
    writer.write_section(SectionKind::DagNodes, &voxels.dag.words)?;
    writer.write_section(SectionKind::DagLeaves, &voxels.dag.leaves)?;
    writer.write_section(SectionKind::DagCounts, &voxels.dag.counts)?;
    writer.write_section(SectionKind::OwnerDirectory, &voxels.owner_directory)
}

fn meta(
    records: &SceneRecords,
    sources: Vec<Source>,
    settings: &BuildSettings,
    grid: &Grid,
    voxels: &Streamed,
    statistics: &DagStatistics,
) -> Result<Meta, BuildError> {
    Ok(Meta {
        generator: Generator::this(),
        sources,
        settings: Settings {
            resolution: grid.side(),
            lod: settings.lod,
            max_position_error: settings.max_position_error,
            unit: settings.unit.clone(),
            metres_per_unit: settings.metres_per_unit,
            up: settings.up,
        },
        bounds: records.bounds().ok_or(BuildError::Empty)?,
        grid: GridMeta { origin: grid.origin.into(), voxel_size: grid.voxel_size, log2: grid.log2 },
        dag: DagMeta {
            root: voxels.dag.shape.root,
            height_ends: voxels.dag.shape.height_ends.clone(),
            brick_count: statistics.bricks,
            voxel_count: statistics.voxels,
        },
        counts: records.counts(),
    })
}

fn report_statistics(
    records: &SceneRecords,
    voxels: &Streamed,
    statistics: &DagStatistics,
) -> serde_json::Map<String, serde_json::Value> {
    let owner_bytes = 16 * voxels.owner_directory.len() as u64 + 8 * voxels.owner_words;
    let per_brick = owner_bytes as f64 / statistics.bricks.max(1) as f64;
    let steps = records.objects().iter().map(|object| {
        let step = records.parts()[object.part as usize].step.into_iter().fold(0.0, f32::max);
        f64::from(step) * coordinate_gain(&DAffine3::from_cols_array(&object.world_from_part))
    });
    let largest_position_error = 0.5 * steps.fold(0.0, f64::max);
    [
        ("dag_nodes", json!(statistics.nodes)),
        ("dag_distinct_leaves", json!(statistics.distinct_leaves)),
        ("dag_traversal_bytes", json!(statistics.traversal_bytes)),
        ("dag_count_bytes", json!(statistics.count_bytes)),
        (
            "dag_bits_per_voxel",
            json!(8.0 * statistics.traversal_bytes as f64 / statistics.voxels.max(1) as f64),
        ),
        ("owner_bytes", json!(owner_bytes)),
        ("owner_bytes_per_brick", json!(per_brick)),
        ("largest_position_error", json!(largest_position_error)),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into_iter()
    .collect()
}

/// An error when the work should stop: over the memory limit, or cancelled.
fn still_wanted(guard: &MemoryGuard) -> Result<(), BuildError> {
    guard.check()?;
    if guard.is_cancelled() { Err(BuildError::Cancelled) } else { Ok(()) }
}

/// The most that a coordinate of the world can differ when every coordinate of the part differs by at most 1: the
/// largest sum of a row's absolute values. 1 for a pure translation or scale 1 along the axes.
fn coordinate_gain(world_from_part: &DAffine3) -> f64 {
    let m = world_from_part.matrix3;
    (m.x_axis.abs() + m.y_axis.abs() + m.z_axis.abs()).max_element()
}

/// [`coordinate_gain`] of each part's most enlarged object.
fn part_gains(model: &Model) -> Vec<f64> {
    let mut gains = vec![0.0f64; model.parts.len()];
    for object in &model.objects {
        let gain = &mut gains[object.part as usize];
        *gain = gain.max(coordinate_gain(&object.world_from_part));
    }
    gains
}
