//! The GPU runtime on whatever adapter there is, a software one included. Without any, these tests say that they skip; with
//! `REQUIRE_GPU=1` they fail.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

#[path = "../common/mod.rs"]
mod common;

mod caps;
mod changes;
mod command;
#[path = "../common/command.rs"]
mod command_line;
mod decode;
mod filter;
mod layout;
mod memory;
mod picking;
mod pictures;
mod queries;
mod rays;
mod shadows;
mod walks;

use std::io::Write;
use std::sync::OnceLock;

use voxsight::gpu::{Context, ContextSettings, GpuError};

/// The adapter that all tests share: software drivers take long to start.
fn context() -> Option<&'static Context> {
    static CONTEXT: OnceLock<Result<Context, GpuError>> = OnceLock::new();
    match CONTEXT.get_or_init(|| Context::new(&ContextSettings::default())) {
        Ok(context) => Some(context),
        Err(error) if std::env::var_os("REQUIRE_GPU").is_some() => panic!("REQUIRE_GPU is set: {error}"),
        Err(error) => {
            // Not `eprintln`, of which nothing is seen when the test passes.
            let _ = writeln!(std::io::stderr(), "SKIPPED: {error}");
            None
        }
    }
}

#[test]
fn adapters_that_are_not_there_are_named_with_what_to_do() {
    let settings = ContextSettings { adapter: Some("no such adapter".to_owned()), ..Default::default() };
    let error = Context::new(&settings).unwrap_err().to_string();
    assert!(error.contains("no such adapter") && error.contains("mesa-vulkan-drivers"), "{error}");
}
