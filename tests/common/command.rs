//! The command as a script calls it. Apart from the rest, which needs no command.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::process::{Command, Output};

/// Runs it to its end.
fn voxsight(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_voxsight")).args(args).output().unwrap()
}

/// What it prints; it must succeed.
pub fn ok(args: &[&str]) -> String {
    let output = voxsight(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Its message; it must end with this code.
pub fn fails(args: &[&str], code: i32) -> String {
    let output = voxsight(args);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stderr).unwrap()
}
