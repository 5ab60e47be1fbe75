//! The promises of the ray caster under a thousand million rays: no voxel missed that a ray crosses by more than 2^-10,
//! none made up, no wrong first hit, nothing twice, nothing out of order, no loop; one answer from every path.
//!
//! `cargo bench -p voxsight-voxel --bench stress -- [--rays 1G] [--seed 1] [--part 1/4] [--group N]`
//!
//! Rays come in groups of up to 64 of one class at one scene; all of a group follows from the seed and the group's
//! number. Every group goes through a packet and through a batch or single SIMD rays, each with one of the instruction
//! sets of this processor, which must agree to the last bit. One group in 32 goes through all paths with all
//! instruction sets and the scalar reference; one in 128 is judged by an oracle besides: in exact arithmetic
//! where the grid is small and the ray has few bits, else in f64 against all occupied voxels near the ray.
//!
//! Exit code 1 where a promise is broken (the ray is printed, `--group` repeats it), where a group takes
//! longer than a minute, and where a class was not tested by everything.
#![allow(clippy::expect_used, clippy::panic, reason = "a bench stops at the first surprise")]

#[path = "stress/mod.rs"]
mod stress;

use std::process::ExitCode;

use voxsight_voxel::raycast::PACKET_RAYS;

use stress::{Depth, Stress};

/// One group in this many is cast by all paths with all instruction sets.
const REFERENCE_EVERY: u64 = 32;
/// One of those in this many is judged by an oracle: one group in 128.
const ORACLE_EVERY: u64 = 4;

struct Options {
    rays: u64,
    seed: u64,
    /// Which part of how many.
    part: (u64, u64),
    group: Option<u64>,
}

/// 1000, 10k, 5M, 1G.
fn count(text: &str) -> Option<u64> {
    let (digits, unit) = match text.chars().last()? {
        'k' => (&text[..text.len() - 1], 1_000),
        'M' => (&text[..text.len() - 1], 1_000_000),
        'G' => (&text[..text.len() - 1], 1_000_000_000),
        _ => (text, 1),
    };
    digits.parse::<u64>().ok()?.checked_mul(unit)
}

fn options() -> Options {
    let args: Vec<String> = std::env::args().skip(1).collect();
    // `cargo test --benches` runs this too, without --bench.
    let rays = if args.iter().any(|arg| arg == "--bench") { 1_000_000_000 } else { 100_000 };
    let mut options = Options { rays, seed: 1, part: (1, 1), group: None };
    let mut args = args.into_iter();
    while let Some(arg) = args.next() {
        let mut number = || args.next().as_deref().and_then(count).expect("a number, such as 1M");
        match arg.as_str() {
            "--bench" => {}
            "--rays" => options.rays = number(),
            "--seed" => options.seed = number(),
            "--group" => options.group = Some(number()),
            "--part" => {
                let part = args.next().expect("a part, such as 1/4");
                let (part, of) = part.split_once('/').expect("a part, such as 1/4");
                options.part = (count(part).expect("a number"), count(of).expect("a number"));
                assert!((1..=options.part.1).contains(&options.part.0), "a part, such as 1/4");
            }
            _ => panic!("unknown option {arg}; there are --rays, --seed, --part and --group"),
        }
    }
    options
}

fn main() -> ExitCode {
    let options = options();
    // One group in 8 has half of its rays, on average.
    let groups = options.rays.div_ceil(PACKET_RAYS as u64) * 16 / 15 + 1;
    let (part, parts) = options.part;
    let (range, depth) = match options.group {
        Some(group) => (group..group + 1, Depth { reference_every: 1, oracle_every: 1 }),
        None => (
            groups * (part - 1) / parts..groups * part / parts,
            Depth { reference_every: REFERENCE_EVERY, oracle_every: ORACLE_EVERY },
        ),
    };
    let stress = Stress::new(options.seed, depth).expect("scenes that fit");
    for scene in &stress.scenes {
        println!("{:20} {:>8} voxels", scene.name, scene.voxels.len());
    }
    println!("instruction sets: {:?}, {} threads", stress.instructions, rayon::current_num_threads());
    println!("seed {}, groups {range:?}", stress.seed);
    let outcome = stress.run(range);
    outcome.print();
    let untested = if options.group.is_none() { outcome.tallies.untested() } else { Vec::new() };
    if !untested.is_empty() {
        println!("FAILED: not tested by everything: {untested:?}; cast more rays");
    }
    if outcome.failures > 0 {
        println!("FAILED: {} broken promises", outcome.failures);
    }
    if outcome.failures > 0 || !untested.is_empty() { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
