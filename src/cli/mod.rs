//! The command line: one file for each command, with its flags, help and work together.

mod build;
mod compare;
mod demo;
mod find;
mod generate;
mod info;
mod light;
mod numbers;
mod output;
mod path;
mod progress;
mod render;
mod shadow_report;
mod verify;
mod view;
mod visible;
mod walk;
mod walk_summary;

use std::error::Error;

use clap::{Args, Parser, Subcommand};

use progress::TerminalProgress;

/// What a command fails with: any error, printed with its causes.
type Failure = Box<dyn Error + Send + Sync>;

/// What was asked for cannot be done with any files: the command itself is wrong.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(String);

/// A [`Usage`] error.
fn usage(text: impl Into<String>) -> Failure {
    Usage(text.into()).into()
}

/// Voxel-assisted visibility and level of detail for CAD models too big to render.
#[derive(Parser)]
#[command(name = "voxsight", version, about, max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: Global,
}

/// Options of every command.
#[derive(Args)]
struct Global {
    /// Threads to use; all cores if left out
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
    /// Print results only: no progress, no remarks
    #[arg(long, short, global = true)]
    quiet: bool,
}

#[derive(Subcommand)]
enum Command {
    /// Builds a sample plant and shows what voxsight does with it
    Demo(demo::Demo),
    /// Makes models for tests
    #[command(subcommand)]
    Generate(generate::Generate),
    /// Turns models into a scene (.vxs)
    Build(build::Build),
    /// Tells what a scene holds
    Info(info::Info),
    /// Checks a scene to the last byte
    Verify(verify::Verify),
    /// Finds objects by name, by a value of their extras such as a part number, or by path
    Find(find::Find),
    /// Asks what a camera sees
    Visible(visible::Visible),
    /// Compares methods of culling over many views: run time against error, as a report
    Compare(compare::Compare),
    /// Renders a picture
    Render(render::Render),
    /// Draws a camera path on the GPU, off screen: what every frame took, and how right it is
    Walk(walk::Walk),
    /// Walks through a scene in a window
    View(view::View),
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    ///
    /// Whatever stopped it, to be printed with its causes.
    pub fn run(self) -> Result<(), Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.global.threads.unwrap_or(0));
        pool.build_global().map_err(|error| format!("cannot start threads: {error}"))?;
        let command = match self.command {
            // Over in no time: Ctrl-C may do what it always does.
            Command::Info(command) => return command.run(),
            Command::Find(command) => return command.run(),
            // Its window shows progress, and is closed when it is to end.
            Command::View(command) => return command.run(),
            longer => longer,
        };
        let progress = TerminalProgress::new(self.global.quiet)?;
        let result = match command {
            Command::Demo(command) => command.run(&progress),
            Command::Generate(command) => command.run(&progress),
            Command::Build(command) => command.run(&progress),
            Command::Verify(command) => command.run(&progress),
            Command::Info(_) | Command::Find(_) | Command::View(_) => Ok(()),
            Command::Visible(command) => command.run(&progress),
            Command::Compare(command) => command.run(&progress),
            Command::Render(command) => command.run(&progress),
            Command::Walk(command) => command.run(&progress),
        };
        progress.finish();
        result
    }
}
