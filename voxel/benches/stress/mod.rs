//! The stress run of the ray caster, for the bench and, shortly, for a test.

mod classes;
#[path = "../../tests/common/mod.rs"]
mod common;
mod exact;
mod line;
mod nearby;
mod oracles;
mod paths;
mod random;
mod run;
mod scenes;
mod tally;

pub use run::{Depth, Stress};
