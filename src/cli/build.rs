//! `voxsight build`: models become a scene.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;

use super::Failure;
use super::numbers::{Length, metres_of_unit, parse_bytes, parse_length, parse_resolution, parse_unit};
use super::output::{check_output, human_bytes, print_json, print_out, write_json};
use super::progress::TerminalProgress;
use crate::container::{Axis, Source};
use crate::human::grouped;
use crate::import::{ImportOptions, Imported, import};
use crate::prepare::memory::MemoryGuard;
use crate::prepare::{BuildOutcome, BuildSettings, Resolution, build};

/// Flags of `build`.
#[derive(Args)]
pub struct Build {
    /// Models (glTF, GLB, OBJ, PLY, STL) and folders of them
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// The scene to write
    #[arg(long, short, value_name = "SCENE.vxs")]
    output: PathBuf,
    /// Voxels along the side of the grid, a power of two from 64 to 131072
    #[arg(long, default_value = "4096", value_parser = parse_resolution, value_name = "N")]
    resolution: u32,
    /// Side of a voxel instead, such as 2mm, or 0.5 in model units
    #[arg(long, value_parser = parse_length, conflicts_with = "resolution", value_name = "LENGTH")]
    voxel_size: Option<Length>,
    /// The model's unit, whatever the file says: um, mm, cm, dm, m, km, in, ft [default: the file's, or m]
    #[arg(long, value_parser = parse_unit)]
    unit: Option<String>,
    /// The model's up axis, whatever the file says [default: the file's (glTF: y), or z]
    #[arg(long)]
    up: Option<Up>,
    /// Largest distance between a coordinate and its stored value, such as 0.1mm
    #[arg(long, value_parser = parse_length, value_name = "LENGTH")]
    max_position_error: Option<Length>,
    /// Make no coarser levels of detail
    #[arg(long)]
    no_lod: bool,
    /// Hold no more memory than this, such as 4G; when the result itself is larger, stop with an error
    #[arg(long, value_parser = parse_bytes, value_name = "BYTES")]
    memory: Option<u64>,
    /// Write the build report (repairs, sizes, time and memory of each stage) to a JSON file
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print the build report as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Up {
    X,
    Y,
    Z,
}

impl Build {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        check_output(&self.output, &["vxs"])?;
        if let Some(report) = &self.report {
            check_output(report, &["json"])?;
        }
        let started = std::time::Instant::now();
        let guard = MemoryGuard::new(self.memory, progress)?;
        let imported = import(&self.inputs, &ImportOptions::default(), &guard);
        guard.check()?;
        let mut imported = imported?;
        imported.note_guesses(self.unit.is_some(), self.up.is_some());
        let import_seconds = started.elapsed().as_secs_f64();
        let settings = self.settings(&imported);
        let sources = imported.sources.iter().map(Source::from).collect();
        let outcome = build(imported.model, sources, imported.findings, &settings, &self.output, progress)?;
        progress.finish();
        let report = report(&outcome, import_seconds, &self.output)?;
        if let Some(path) = &self.report {
            write_json(path, &report)?;
        }
        if self.json {
            return print_json(&report);
        }
        print_summary(&outcome, started.elapsed().as_secs_f64(), &self.output)
    }

    fn settings(&self, imported: &Imported) -> BuildSettings {
        let of_files = BuildSettings::of(imported);
        let (unit, metres_per_unit) = match &self.unit {
            Some(unit) => (unit.clone(), metres_of_unit(unit).unwrap_or(1.0)),
            None => (of_files.unit, of_files.metres_per_unit),
        };
        let up = match self.up {
            Some(Up::X) => Axis::X,
            Some(Up::Y) => Axis::Y,
            Some(Up::Z) => Axis::Z,
            None => of_files.up,
        };
        let resolution = match self.voxel_size {
            Some(length) => Resolution::VoxelSize(length.in_units(metres_per_unit)),
            None => Resolution::Log2(self.resolution),
        };
        BuildSettings {
            resolution,
            lod: !self.no_lod,
            max_position_error: self.max_position_error.map(|length| length.in_units(metres_per_unit)),
            unit,
            metres_per_unit,
            up,
            memory: self.memory,
        }
    }
}

fn report(outcome: &BuildOutcome, import_seconds: f64, output: &Path) -> Result<serde_json::Value, Failure> {
    let file_bytes = std::fs::metadata(output)?.len();
    let seconds: f64 = import_seconds + outcome.stages.iter().map(|stage| stage.seconds).sum::<f64>();
    Ok(json!({
        "file_bytes": file_bytes,
        "seconds": seconds,
        "import_seconds": import_seconds,
        "triangles_per_second": outcome.meta.counts.placed_triangles as f64 / seconds,
        "stages": outcome.stages,
        "meta": outcome.meta,
        "report": outcome.report,
    }))
}

fn print_summary(outcome: &BuildOutcome, seconds: f64, output: &Path) -> Result<(), Failure> {
    let counts = &outcome.meta.counts;
    for (what, finding) in &outcome.report.findings.0 {
        print_out!("{} {what} (first: {})", grouped(finding.count), finding.first)?;
    }
    print_out!(
        "{}: {} objects, {} triangles placed ({} stored), {} voxels at {}^3",
        output.display(),
        grouped(counts.objects),
        grouped(counts.placed_triangles),
        grouped(counts.unique_triangles),
        grouped(outcome.meta.dag.voxel_count),
        outcome.meta.settings.resolution
    )?;
    let peak = outcome.stages.iter().filter_map(|stage| stage.peak_bytes).max();
    print_out!(
        "{:.2} s, {:.2} M triangles/s{}",
        seconds,
        counts.placed_triangles as f64 / seconds / 1e6,
        peak.map(|bytes| format!(", peak memory {}", human_bytes(bytes))).unwrap_or_default()
    )
}
