//! The two JSON sections: what the container was made from, and what the build found.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use voxsight_voxel::dag::DagShape;
use voxsight_voxel::grid::Grid;
use xxhash_rust::xxh3::Xxh3;

use super::error::Damage;
use super::layout::SectionKind;
use crate::report::Findings;

/// Sources, settings, units and bounds. Nothing in it depends on when or where it was built.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// The program that wrote the container.
    pub generator: Generator,
    /// Input files, in the order in which they were read.
    pub sources: Vec<Source>,
    /// Settings of the build.
    pub settings: Settings,
    /// Box of all objects, world.
    pub bounds: Bounds,
    /// The voxel grid in world.
    pub grid: GridMeta,
    /// What the DAG sections hold.
    pub dag: DagMeta,
    /// How much of everything.
    pub counts: Counts,
}

/// A program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Generator {
    /// `voxsight`.
    pub name: String,
    /// Its version, such as `0.1.0`.
    pub version: String,
}

impl Generator {
    /// This program.
    pub fn this() -> Self {
        Generator { name: env!("CARGO_PKG_NAME").to_owned(), version: env!("CARGO_PKG_VERSION").to_owned() }
    }
}

/// An input file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// File name or path below the input folder, `/` between folders: the same on every machine.
    pub name: String,
    /// Length of the file, with those it refers to.
    pub bytes: u64,
    /// XXH3-64 of the file, 16 hexadecimal digits.
    pub xxh3: String,
    /// The files that it refers to, also those that were not read.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub referred: Vec<ReferredFile>,
}

/// A file that an input file refers to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReferredFile {
    /// Relative to the folder of the file that refers to it, `/` between folders.
    pub name: String,
    /// Its length; none where it was not there, or was not read.
    pub bytes: Option<u64>,
}

impl Source {
    /// Describes a file by its content.
    pub fn of(name: impl Into<String>, content: &[u8]) -> Self {
        let mut hash = Xxh3::new();
        hash.update(content);
        Source {
            name: name.into(),
            bytes: content.len() as u64,
            xxh3: format!("{:016x}", hash.digest()),
            referred: Vec::new(),
        }
    }
}

/// Settings of a build.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Voxels along the grid's side.
    pub resolution: u32,
    /// Whether coarser levels were made.
    pub lod: bool,
    /// Largest allowed distance between an input coordinate and its decoded one, model units; `None` for no limit.
    pub max_position_error: Option<f64>,
    /// Name of the model's unit, such as `mm`.
    pub unit: String,
    /// Its length, metres.
    pub metres_per_unit: f64,
    /// The model's up axis.
    pub up: Axis,
}

/// An axis of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Axis {
    /// +x
    X,
    /// +y
    Y,
    /// +z
    Z,
}

impl Axis {
    /// The axis' direction, length 1.
    pub fn unit(self) -> DVec3 {
        match self {
            Axis::X => DVec3::X,
            Axis::Y => DVec3::Y,
            Axis::Z => DVec3::Z,
        }
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Low corner.
    pub min: [f64; 3],
    /// High corner.
    pub max: [f64; 3],
}

/// The voxel grid: a cube of `2^log2` voxels a side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridMeta {
    /// Low corner, world.
    pub origin: [f64; 3],
    /// Side of a voxel, model units.
    pub voxel_size: f64,
    /// 6 to 17.
    pub log2: u32,
}

/// What cannot be seen from the DAG's words alone: see [`voxsight_voxel::dag::DagShape`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DagMeta {
    /// Word offset of the root; none for an empty grid.
    pub root: Option<u32>,
    /// End, in words, of the nodes of each height.
    pub height_ends: Vec<u32>,
    /// Occupied bricks, each counted as often as it occurs.
    pub brick_count: u64,
    /// Occupied voxels, likewise.
    pub voxel_count: u64,
}

/// How much of everything a container holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Nodes of the assembly tree.
    pub nodes: u64,
    /// Distinct geometries.
    pub parts: u64,
    /// Placed occurrences.
    pub objects: u64,
    /// (object, chunk) pairs.
    pub drawables: u64,
    /// Spatial pieces of parts.
    pub chunks: u64,
    /// Levels of detail of all chunks.
    pub levels: u64,
    /// Triangles of level 0, each part once.
    pub unique_triangles: u64,
    /// Triangles of level 0 with instancing expanded.
    pub placed_triangles: u64,
}

/// What the build repaired and counted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BuildReport {
    /// Repairs, drops and skips.
    pub findings: Findings,
    /// Named numbers of the stages. No times: the same input and settings give the same bytes.
    pub statistics: serde_json::Map<String, serde_json::Value>,
}

impl GridMeta {
    /// The grid that it describes.
    pub fn grid(&self) -> Grid {
        Grid { origin: self.origin.into(), voxel_size: self.voxel_size, log2: self.log2 }
    }
}

impl Meta {
    /// How to read the sections of the DAG.
    pub fn dag_shape(&self) -> DagShape {
        DagShape { log2: self.grid.log2, height_ends: self.dag.height_ends.clone(), root: self.dag.root }
    }

    /// Checks that lengths are positive, that `counts` and `bounds` (of all objects) are what the sections hold, and
    /// that the grid is around them.
    pub(super) fn check(&self, counts: &Counts, bounds: Option<Bounds>) -> Result<(), Damage> {
        let wrong =
            |expected: &str, found: String| Err(Damage::section(SectionKind::Meta.name(), expected, found));
        let Bounds { min, max } = self.bounds;
        if !(min.iter().chain(&max).all(|c| c.is_finite())
            && min.iter().zip(&max).all(|(low, high)| low <= high))
        {
            return wrong("finite bounds, min not above max", format!("{:?}", self.bounds));
        }
        let positive = |length: f64| length.is_finite() && length > 0.0;
        let GridMeta { origin, voxel_size, log2 } = self.grid;
        if !(origin.iter().all(|c| c.is_finite()) && positive(voxel_size) && (6..=17).contains(&log2)) {
            return wrong(
                "a grid with finite origin, positive voxel size, log2 of 6 to 17",
                format!("{:?}", self.grid),
            );
        }
        if self.settings.resolution != 1 << log2 {
            let expected = format!("a resolution of {}, the grid's side", 1 << log2);
            return wrong(&expected, self.settings.resolution.to_string());
        }
        if let Some(bounds) = bounds {
            if self.bounds != bounds {
                return wrong(&format!("{bounds:?}, as the objects have"), format!("{:?}", self.bounds));
            }
            // A voxel of tolerance: the builder leaves one free, and rounding takes far less.
            let side = voxel_size * f64::from(1u32 << log2);
            let holds = |axis: usize| {
                let (low, high) = (origin[axis] - voxel_size, origin[axis] + side + voxel_size);
                high.is_finite() && low <= min[axis] && max[axis] <= high
            };
            if !(0..3).all(holds) {
                return wrong(&format!("a grid around {bounds:?}"), format!("{:?}", self.grid));
            }
        }
        if !positive(self.settings.metres_per_unit) {
            return wrong("a positive number of metres a unit", self.settings.metres_per_unit.to_string());
        }
        if self.counts != *counts {
            return wrong(&format!("{counts:?}, as the sections have"), format!("{:?}", self.counts));
        }
        Ok(())
    }
}
