//! Groups of rays: cast, compared and judged.

use std::ops::Range;
use std::panic::AssertUnwindSafe;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use voxsight_voxel::raycast::{GridRay, Instructions, Next, PACKET_RAYS, RayPacket};
use voxsight_voxel::voxelize::VoxelizeError;

use super::classes::Class;
use super::exact::ExactLine;
use super::line::Line;
use super::oracles::{FloatOracle, Verdict, judge};
use super::paths::{Met, Mode, Path, Question, ask};
use super::random::Random;
use super::scenes::{Scene, scenes};
use super::tally::{Count, Tallies};

/// Failures that are printed.
const PRINTED: u64 = 10;
/// A group that takes longer than this does not end.
const PATIENCE: Duration = Duration::from_secs(60);

/// How much is done with a group.
#[derive(Clone, Copy, Debug)]
pub struct Depth {
    /// One group in this many is cast by all paths with all instruction sets.
    pub reference_every: u64,
    /// One of those in this many is judged by an oracle.
    pub oracle_every: u64,
}

/// What became of a run.
pub struct Outcome {
    pub tallies: Tallies,
    /// Broken promises, panics among them.
    pub failures: u64,
    seconds: f64,
}

impl Outcome {
    pub fn print(&self) {
        self.tallies.print();
        let rays = self.tallies.total()[Count::Rays] as f64 / 1e6;
        println!("{:.1} s, {:.2} Mrays/s", self.seconds, rays / self.seconds);
    }
}

/// What all threads share.
pub struct Stress {
    pub seed: u64,
    depth: Depth,
    pub scenes: Vec<Scene>,
    pub instructions: Vec<Instructions>,
    /// Rays done.
    done: AtomicU64,
    failures: AtomicU64,
    started: Instant,
    /// Of each thread, the group it is at and when it began, in ms from the start.
    at: Vec<(AtomicU64, AtomicU64)>,
}

/// Start of a group in a thread that is at none.
const IDLE: u64 = u64::MAX;

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
    pub fn new(seed: u64, depth: Depth) -> Result<Self, VoxelizeError> {
        Ok(Stress {
            seed,
            depth,
            scenes: scenes(seed)?,
            instructions: Instructions::available(),
            done: AtomicU64::new(0),
            failures: AtomicU64::new(0),
            started: Instant::now(),
            at: (0..rayon::current_num_threads()).map(|_| (AtomicU64::new(0), IDLE.into())).collect(),
        })
    }

    /// Casts and checks groups, on all cores.
    pub fn run(&self, groups: Range<u64>) -> Outcome {
        let started = Instant::now();
        let expected_rays = (groups.end - groups.start) * PACKET_RAYS as u64 * 15 / 16;
        let is_done = AtomicBool::new(false);
        let tallies = std::thread::scope(|scope| {
            scope.spawn(|| self.watch(expected_rays, &is_done));
            let tallies = groups
                .into_par_iter()
                .fold(Worker::default, |mut worker, group| {
                    self.group_or_panic(&mut worker, group);
                    worker
                })
                .map(|worker| worker.tallies)
                .reduce(Tallies::default, Tallies::plus);
            is_done.store(true, Ordering::Relaxed);
            tallies
        });
        let failures = self.failures.load(Ordering::Relaxed);
        Outcome { tallies, failures, seconds: started.elapsed().as_secs_f64() }
    }

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

    /// [`Stress::group`], watched; a panic on the way is a broken promise too.
    fn group_or_panic(&self, worker: &mut Worker, number: u64) {
        let at = rayon::current_thread_index().and_then(|thread| self.at.get(thread));
        if let Some((group, began)) = at {
            group.store(number, Ordering::Relaxed);
            began.store(self.started.elapsed().as_millis() as u64, Ordering::Relaxed);
        }
        let group = AssertUnwindSafe(|| self.group(worker, number));
        if std::panic::catch_unwind(group).is_err() {
            eprintln!("FAILED --seed {} --group {number}: panic", self.seed);
            self.failures.fetch_add(1, Ordering::Relaxed);
        }
        if let Some((_, began)) = at {
            began.store(IDLE, Ordering::Relaxed);
        }
    }

    /// Casts and checks a group.
    fn group(&self, worker: &mut Worker, number: u64) {
        let mut random = Random::new(self.seed, number);
        let class = random.pick(&Class::ALL);
        let scene = &self.scenes[random.below(self.scenes.len() as u64) as usize];
        let by_reference = random.one_in(self.depth.reference_every);
        let judged = random.one_in(self.depth.oracle_every) && by_reference && class.can_be_judged();
        let question = Question::new(&mut random, scene.side(), by_reference);
        let group = Group { number, class, scene, rays: class.rays(&mut random, scene) };

        let paths = if by_reference {
            let of_each =
                |path: fn(Instructions) -> Path| self.instructions.iter().map(move |&set| path(set));
            let fast = of_each(Path::Packet).chain(of_each(Path::Single)).chain(of_each(Path::Batch));
            [Path::Reference].into_iter().chain(fast).collect()
        } else {
            // The slowest set less often.
            let fast = self.instructions.get(1..).filter(|fast| !fast.is_empty());
            let mut set = || match fast {
                Some(fast) if !random.one_in(6) => random.pick(fast),
                _ => random.pick(&self.instructions),
            };
            let (first, second) = (set(), set());
            let alone = if random.one_in(3) { Path::Single(first) } else { Path::Batch(first) };
            vec![alone, Path::Packet(second)]
        };
        let rays = group.rays.len() as u64;
        worker.tallies.of(class)[Count::Rays] += rays;
        self.compare(worker, &group, &paths, &question);
        let hits: u64 = worker.expected.iter().map(|met| met.hits).sum();
        worker.tallies.of(class)[Count::Hits] += hits;
        let hitting = worker.expected.iter().filter(|met| met.hits > 0).count() as u64;
        worker.tallies.of(class)[Count::Hitting] += hitting;
        if by_reference {
            worker.tallies.of(class)[Count::Reference] += rays;
            self.check_shorthands(worker, &group, &question);
        }
        if judged {
            self.compare(worker, &group, &paths, &Question::all());
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
                Next::Voxel
            });
            let Some(line) = Line::new(ray) else {
                tally[Count::Wrong] += met.len() as u64;
                continue;
            };
            nearby.clear();
            scene.nearby.for_each(&line, |voxel| nearby.push(voxel));
            let exact = ExactLine::new(ray, scene.side()).filter(|_| scene.is_small());
            let reach = line.reach(scene.side());
            let verdict = match &exact {
                Some(exact) => judge(exact, &nearby, &met, reach),
                None => judge(&FloatOracle::new(&line, scene.side()), &nearby, &met, reach),
            };
            tally[if exact.is_some() { Count::Exact } else { Count::Float }] += 1;
            tally[Count::Missed] += verdict.missed;
            tally[Count::Wrong] += verdict.wrong;
            tally[Count::Grazed] += verdict.grazed;
            if (Verdict { grazed: 0, ..verdict }) != Verdict::default() {
                self.report(group, i, &format!("exact {}: {verdict:?}", exact.is_some()));
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
