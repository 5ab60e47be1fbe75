//! The promises of the ray caster under a thousand million rays: no voxel missed that a ray crosses by more than 2^-10,
//! none made up, no wrong first hit, nothing twice, nothing out of order, no loop; one answer from every path.
//!
//! `cargo bench -p voxsight-voxel --bench stress -- [--rays 1G] [--seed 1] [--part 1/4] [--group N]`
//!
//! Rays come in groups of up to 64 of one class at one scene; all of a group follows from the seed and the group's
//! number. Every group goes through a packet and through a batch or single SIMD rays, each with one of the instruction
//! sets of this processor, which must agree to the last bit. One group in [`REFERENCE_EVERY`] goes through all paths with all
//! instruction sets and the scalar reference; one in [`ORACLE_EVERY`] is judged by an oracle besides: in exact
//! arithmetic where the grid is small and the ray has few bits, else in f64 against all occupied voxels near the ray.
//!
//! Exit code 1 where a promise is broken (the ray is printed, `--group` repeats it), where a group takes
//! longer than a minute, and where a class was not tested by everything.
#![allow(clippy::expect_used, clippy::panic, reason = "a bench stops at the first surprise")]

#[path = "../tests/common/mod.rs"]
mod common;

#[path = "stress/classes.rs"]
mod classes;
#[path = "stress/exact.rs"]
mod exact;
#[path = "stress/line.rs"]
mod line;
#[path = "stress/nearby.rs"]
mod nearby;
#[path = "stress/oracles.rs"]
mod oracles;
#[path = "stress/paths.rs"]
mod paths;
#[path = "stress/random.rs"]
mod random;
#[path = "stress/scenes.rs"]
mod scenes;
#[path = "stress/tally.rs"]
mod tally;

use std::panic::AssertUnwindSafe;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use voxsight_voxel::raycast::{GridRay, Instructions, PACKET_RAYS, RayPacket};

use classes::Class;
use line::Line;
use oracles::{Judge, Verdict};
use paths::{Met, Mode, Path, Question, ask};
use random::Random;
use scenes::{Scene, scenes};
use tally::{Count, Tallies};

/// One group in this many is cast by all paths.
const REFERENCE_EVERY: u64 = 16;
/// One of those in this many is judged by an oracle: one group in 64.
const ORACLE_EVERY: u64 = 4;
/// Failures that are printed.
const PRINTED: u64 = 10;
/// A group that takes longer than this does not end.
const PATIENCE: Duration = Duration::from_secs(60);

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

/// What all threads share.
struct Stress {
    seed: u64,
    scenes: Vec<Scene>,
    instructions: Vec<Instructions>,
    /// Rays done.
    done: AtomicU64,
    failures: AtomicU64,
    started: Instant,
    /// Of each thread, the group it is at and when it began, in ms from the start.
    at: Vec<(AtomicU64, AtomicU64)>,
}

/// What one thread keeps.
#[derive(Default)]
struct Worker {
    packet: RayPacket,
    met: Vec<Met>,
    expected: Vec<Met>,
    tallies: Tallies,
}

/// One group of rays.
struct Group<'a> {
    number: u64,
    class: Class,
    scene: &'a Scene,
    rays: Vec<GridRay>,
}

impl Stress {
    /// Prints a broken promise.
    fn report(&self, group: &Group, ray: usize, what: &str) {
        if self.failures.fetch_add(1, Ordering::Relaxed) >= PRINTED {
            return;
        }
        eprintln!(
            "FAILED --seed {} --group {}, class {}, {}, ray {ray}: {what}\n  {:?}",
            self.seed,
            group.number,
            group.class.name(),
            group.scene.name,
            group.rays[ray]
        );
    }

    /// [`Stress::group`]; a panic on the way is a broken promise too.
    fn group_or_panic(&self, worker: &mut Worker, number: u64) {
        let group = AssertUnwindSafe(|| self.group(worker, number));
        if std::panic::catch_unwind(group).is_err() {
            eprintln!("FAILED --seed {} --group {number}: panic", self.seed);
            self.failures.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Casts and checks a group.
    fn group(&self, worker: &mut Worker, number: u64) {
        if let Some(at) = rayon::current_thread_index().and_then(|thread| self.at.get(thread)) {
            at.1.store(self.started.elapsed().as_millis() as u64, Ordering::Relaxed);
            at.0.store(number, Ordering::Relaxed);
        }
        let mut random = Random::new(self.seed, number);
        let class = random.pick(&Class::ALL);
        let scene = &self.scenes[random.below(self.scenes.len() as u64) as usize];
        let by_reference = random.one_in(REFERENCE_EVERY);
        let judged = by_reference && random.one_in(ORACLE_EVERY) && class.can_be_judged();
        let question =
            if judged { Question::all() } else { Question::new(&mut random, scene.side(), by_reference) };
        let group = Group { number, class, scene, rays: class.rays(&mut random, scene) };

        let paths = if by_reference {
            let of_each =
                |path: fn(Instructions) -> Path| self.instructions.iter().map(move |&set| path(set));
            let fast = of_each(Path::Packet).chain(of_each(Path::Single)).chain(of_each(Path::Batch));
            [Path::Reference].into_iter().chain(fast).collect()
        } else {
            let mut set = || random.pick(&self.instructions);
            let (first, second) = (set(), set());
            let alone = if random.one_in(3) { Path::Single(first) } else { Path::Batch(first) };
            vec![alone, Path::Packet(second)]
        };
        self.compare(worker, &group, &paths, &question);
        let tally = worker.tallies.of(class);
        let rays = group.rays.len() as u64;
        tally[Count::Rays] += rays;
        if by_reference {
            tally[Count::Reference] += rays;
            self.check_shorthands(worker, &group, &question);
        }
        if judged {
            self.judge(worker, &group);
        }
        self.done.fetch_add(rays, Ordering::Relaxed);
    }

    /// All paths against the first of them, and each for itself: order, repetition and length.
    fn compare(&self, worker: &mut Worker, group: &Group, paths: &[Path], question: &Question) {
        let Worker { packet, met, expected, tallies } = worker;
        let tally = tallies.of(group.class);
        let dag = group.scene.dag.view();
        let most = 3 * group.scene.side() as u64;
        for (i, &path) in paths.iter().enumerate() {
            ask(path, dag, &group.rays, question, packet, met);
            match path {
                Path::Reference => {}
                Path::Single(_) => tally[Count::Single] += met.len() as u64,
                Path::Batch(_) => tally[Count::Batch] += met.len() as u64,
                Path::Packet(_) => tally[Count::Packet] += met.len() as u64,
            }
            for (ray, met) in met.iter().enumerate() {
                if met.backwards + met.repeated > 0 || met.hits > most {
                    self.report(group, ray, &format!("{path:?} {question:?} loops: {met:?}"));
                    tally[Count::Backwards] += met.backwards;
                    tally[Count::Repeated] += met.repeated;
                    tally[Count::Endless] += u64::from(met.hits > most);
                }
            }
            if i == 0 {
                tally[Count::Hits] += met.iter().map(|met| met.hits).sum::<u64>();
                tally[Count::Hitting] += met.iter().filter(|met| met.hits > 0).count() as u64;
                std::mem::swap(met, expected);
                continue;
            }
            for (ray, (met, expected)) in met.iter().zip(expected.iter()).enumerate() {
                if met != expected {
                    tally[Count::Differing] += 1;
                    self.report(
                        group,
                        ray,
                        &format!("{path:?} {question:?} met {met:?}, {:?} {expected:?}", paths[0]),
                    );
                }
            }
        }
    }

    /// `first_hit` and `any_hit` of the reference, against what it met.
    fn check_shorthands(&self, worker: &mut Worker, group: &Group, question: &Question) {
        if question.mode != Mode::First || question.footprint != Default::default() {
            return;
        }
        let dag = group.scene.dag.view();
        for (i, (ray, expected)) in group.rays.iter().zip(&worker.expected).enumerate() {
            if dag.first_hit(ray) != expected.first || dag.any_hit(ray) != expected.first.is_some() {
                worker.tallies.of(group.class)[Count::Differing] += 1;
                self.report(group, i, "first_hit or any_hit differs from cast");
            }
        }
    }

    /// What the reference meets, and so all paths, against an oracle.
    fn judge(&self, worker: &mut Worker, group: &Group) {
        let tally = worker.tallies.of(group.class);
        let scene = group.scene;
        let (mut nearby, mut met) = (Vec::new(), Vec::new());
        for (i, ray) in group.rays.iter().enumerate() {
            met.clear();
            scene.dag.view().cast(ray, |hit| {
                met.push((hit.voxel, hit.t()));
                voxsight_voxel::raycast::Next::Voxel
            });
            let line = Line::new(ray);
            nearby.clear();
            scene.nearby.for_each(&line, |voxel| nearby.push(voxel));
            let judge = Judge::new(ray, scene.side(), scene.is_small());
            let verdict = judge.judge(&line, scene.side(), &nearby, &met);
            if judge.is_exact() {
                tally[Count::Exact] += 1;
            } else {
                tally[Count::Float] += 1;
            }
            tally[Count::Missed] += verdict.missed;
            tally[Count::Wrong] += verdict.wrong;
            tally[Count::Grazed] += verdict.grazed;
            if (Verdict { grazed: 0, ..verdict }) != Verdict::default() {
                self.report(group, i, &format!("exact {}: {verdict:?}", judge.is_exact()));
            }
        }
    }

    /// Prints progress every few seconds until all is done; ends the process where a group does not.
    fn watch(&self, rays: u64, is_done: &AtomicBool) {
        let mut next = Duration::from_secs(5);
        while !is_done.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20));
            let elapsed = self.started.elapsed();
            if elapsed < next {
                continue;
            }
            next += Duration::from_secs(5);
            let done = self.done.load(Ordering::Relaxed);
            eprintln!(
                "{:5.0} s {:8.2} of {:.2} Mrays, {:.2} Mrays/s, {} failures",
                elapsed.as_secs_f64(),
                done as f64 / 1e6,
                rays as f64 / 1e6,
                done as f64 / 1e6 / elapsed.as_secs_f64(),
                self.failures.load(Ordering::Relaxed)
            );
            for (group, began) in &self.at {
                let began = Duration::from_millis(began.load(Ordering::Relaxed));
                if elapsed.saturating_sub(began) > PATIENCE {
                    eprintln!(
                        "FAILED --seed {} --group {}: no end",
                        self.seed,
                        group.load(Ordering::Relaxed)
                    );
                    std::process::exit(1);
                }
            }
        }
    }
}

fn main() -> ExitCode {
    let options = options();
    let scenes = scenes(options.seed).expect("scenes that fit");
    for scene in &scenes {
        println!("{:20} {:>8} voxels", scene.name, scene.voxels.len());
    }
    let stress = Stress {
        seed: options.seed,
        scenes,
        instructions: Instructions::available(),
        done: AtomicU64::new(0),
        failures: AtomicU64::new(0),
        started: Instant::now(),
        at: (0..rayon::current_num_threads()).map(|_| (AtomicU64::new(0), AtomicU64::new(0))).collect(),
    };
    println!("instruction sets: {:?}, {} threads", stress.instructions, rayon::current_num_threads());
    // One group in 8 has half of its rays, on average.
    let groups = options.rays.div_ceil(PACKET_RAYS as u64) * 16 / 15 + 1;
    let (part, parts) = options.part;
    let range = match options.group {
        Some(group) => group..group + 1,
        None => groups * (part - 1) / parts..groups * part / parts,
    };
    println!("seed {}, groups {range:?}", options.seed);
    let expected_rays = (range.end - range.start) * PACKET_RAYS as u64 * 15 / 16;
    let is_done = AtomicBool::new(false);
    let tallies = std::thread::scope(|scope| {
        scope.spawn(|| stress.watch(expected_rays, &is_done));
        let tallies = range
            .into_par_iter()
            .fold(Worker::default, |mut worker, group| {
                stress.group_or_panic(&mut worker, group);
                worker
            })
            .map(|worker| worker.tallies)
            .reduce(Tallies::default, Tallies::plus);
        is_done.store(true, Ordering::Relaxed);
        tallies
    });
    let seconds = stress.started.elapsed().as_secs_f64();
    tallies.print();
    let total = tallies.total();
    println!("{:.1} s, {:.2} Mrays/s", seconds, total[Count::Rays] as f64 / 1e6 / seconds);
    let untested = if options.group.is_none() { tallies.untested() } else { Vec::new() };
    if !untested.is_empty() {
        println!("FAILED: not tested by everything: {untested:?}; cast more rays");
    }
    // Panics among them, which no class counts.
    let failures = stress.failures.load(Ordering::Relaxed);
    if failures > 0 {
        println!("FAILED: {failures} broken promises");
    }
    if failures > 0 || !untested.is_empty() { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
