//! `voxsight generate`: models for tests.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::numbers::parse_count;
use super::output::{human_bytes, print_out};
use super::progress::TerminalProgress;
use super::{Failure, usage};
use crate::human::grouped;
use crate::import::{ImportOptions, UpAxis, import};
use crate::sample::{CopiesSettings, PlantSettings, WriteSummary, write_copies, write_plant};

/// What to generate.
#[derive(Subcommand)]
pub enum Generate {
    /// A process plant of any size: pipe racks, vessels, valves, steel, stairs, buildings
    Plant(Plant),
    /// Copies of a model, rotated and slightly scaled, that share nothing: for scale tests
    Copies(Copies),
}

/// Flags of `generate plant`.
#[derive(Args)]
pub struct Plant {
    /// Objects to place, such as 45k
    #[arg(long, default_value = "2000", value_parser = parse_count, value_name = "N")]
    objects: u64,
    /// Triangles to place, instancing expanded, such as 12M
    #[arg(long, default_value = "500k", value_parser = parse_count, value_name = "N")]
    triangles: u64,
    /// Another seed is another plant
    #[arg(long, default_value = "1", value_name = "N")]
    seed: u64,
    /// A .glb file, or a folder for a file an area (large plants)
    #[arg(long, short, value_name = "FILE.glb|DIR")]
    output: PathBuf,
}

/// Flags of `generate copies`.
#[derive(Args)]
pub struct Copies {
    /// The model to copy
    model: PathBuf,
    /// How many copies
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    copies: u32,
    /// Distance of neighbouring copies as a fraction of the model's size: below 1 they interpenetrate [default: 1.1]
    #[arg(long, value_name = "FRACTION")]
    overlap: Option<f64>,
    /// The folder to write, a file or more for each copy
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
}

impl Generate {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        let summary = match self {
            Generate::Plant(Plant { objects, triangles, seed, output }) => {
                if output.extension().is_some_and(|extension| !extension.eq_ignore_ascii_case("glb")) {
                    return Err(usage(format!("{}: name a .glb file, or a folder", output.display())));
                }
                write_plant(&PlantSettings { objects, triangles, seed }, &output, progress)?
            }
            Generate::Copies(Copies { model, copies, overlap, output }) => {
                let imported = import(&[model], &ImportOptions::default(), progress)?;
                let up = imported.up_axis.unwrap_or(UpAxis::Z);
                let settings = CopiesSettings { copies, overlap, up, ..CopiesSettings::default() };
                write_copies(&imported.model, &settings, &output, progress)?
            }
        };
        progress.finish();
        print_summary(&summary)
    }
}

fn print_summary(summary: &WriteSummary) -> Result<(), Failure> {
    let files = summary.files.len() as u64;
    print_out!(
        "{} {}, {}: {} objects, {} triangles",
        grouped(files),
        if files == 1 { "file" } else { "files" },
        human_bytes(summary.bytes),
        grouped(summary.objects),
        grouped(summary.triangles)
    )
}
