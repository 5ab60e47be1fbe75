//! The `voxsight` command: parse, run, print the error chain, exit code 0 (done), 1 (failed) or 2 (bad usage).

use std::process::ExitCode;

use clap::Parser;
use voxsight::cli::{Cli, Usage};

fn main() -> ExitCode {
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let mut told = error.to_string();
            eprintln!("error: {told}");
            let mut cause = error.source();
            while let Some(inner) = cause {
                // Many errors quote their cause already.
                let text = inner.to_string();
                if !told.contains(&text) {
                    eprintln!("  because {text}");
                    told = text;
                }
                cause = inner.source();
            }
            // As clap exits for what it finds itself.
            if error.is::<Usage>() { ExitCode::from(2) } else { ExitCode::FAILURE }
        }
    }
}
