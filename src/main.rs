//! The `voxsight` command: parse, run, print the error chain, exit code 0 (done), 1 (failed) or 2 (bad usage).

use std::process::ExitCode;

use clap::Parser;
use voxsight::cli::Cli;

fn main() -> ExitCode {
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            let mut cause = error.source();
            while let Some(inner) = cause {
                eprintln!("  because {inner}");
                cause = inner.source();
            }
            ExitCode::FAILURE
        }
    }
}
