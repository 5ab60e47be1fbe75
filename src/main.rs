//! The `voxsight` command.
fn main() {}
