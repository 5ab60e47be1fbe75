//! Streaming, simulated: random walks, teleports, budgets down to absurd. The same code as before a GPU, over plain memory.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use std::collections::HashMap;

use common::Random;
use voxsight::lod::{Choice, Level, System};
use voxsight::streaming::{
    Frame, FrameReport, LoadError, Loaded, Memory, Priority, StreamSettings, Streamer,
};

/// Drawables along a line, some of which share pages.
struct Row {
    levels: Vec<Vec<Level>>,
    bytes: Vec<u64>,
}

impl System for Row {
    fn drawable_count(&self) -> u32 {
        self.levels.len() as u32
    }
    fn page_count(&self) -> u32 {
        self.bytes.len() as u32
    }
    fn level_count(&self, drawable: u32) -> u32 {
        self.levels[drawable as usize].len() as u32
    }
    fn level(&self, drawable: u32, level: u32) -> Level {
        self.levels[drawable as usize][level as usize]
    }
}

impl Row {
    fn new(random: &mut Random, drawables: u32) -> Self {
        let mut row = Row { levels: Vec::new(), bytes: Vec::new() };
        for drawable in 0..drawables {
            if drawable > 0 && random.below(4) == 0 {
                // Another occurrence of a part.
                let same = random.below(drawable) as usize;
                row.levels.push(row.levels[same].clone());
                continue;
            }
            let count = 1 + random.below(5);
            let mut triangles = 20 + random.below(3000);
            let mut levels = Vec::new();
            for _ in 0..count {
                let page = row.bytes.len() as u32;
                row.bytes.push(u64::from(triangles * 8 + random.below(30)));
                levels.push(Level { triangles, vertices: triangles, error: 0.0, page });
                triangles = triangles / 2 + 1;
            }
            row.levels.push(levels);
        }
        row
    }

    /// What a camera at a place wants: what is near, the finer the nearer.
    fn wanted(&self, at: f64) -> Vec<Priority> {
        let near = |drawable: u32| {
            let distance = (f64::from(drawable) - at).abs();
            let level = (distance / 4.0) as u32;
            let level = level.min(self.level_count(drawable) - 1);
            let samples = (1000.0 / (1.0 + distance)) as u32;
            (distance < 30.0).then_some(Priority { choice: Choice { drawable, level }, samples })
        };
        (0..self.drawable_count()).filter_map(near).collect()
    }

    fn bytes_of(&self, page: u32) -> u64 {
        self.bytes[page as usize]
    }

    fn contents(&self, page: u32) -> Vec<u8> {
        (0..self.bytes_of(page)).map(|i| (u64::from(page) * 31 + i * 7) as u8).collect()
    }
}

/// Memory that counts what is done to it.
struct Plain {
    bytes: Vec<u8>,
    written: u64,
}

impl Memory for Plain {
    fn write(&mut self, offset: u64, bytes: &[u8]) {
        self.bytes.write(offset, bytes);
        self.written += bytes.len() as u64;
    }
    fn shift(&mut self, from: u64, to: u64, bytes: u64) {
        assert!(to < from);
        self.bytes.shift(from, to, bytes);
    }
}

/// A streamer, its memory, and a loader that is late by some frames and mixes things up.
struct Stage {
    row: Row,
    streamer: Streamer,
    settings: StreamSettings,
    memory: Plain,
    /// Pages on their way, and the frame in which they come.
    coming: Vec<(u32, u32)>,
    frame: u32,
    latency: u32,
    /// Pages that are damaged.
    damaged: Vec<u32>,
    before: Vec<Choice>,
}

impl Stage {
    fn new(row: Row, settings: StreamSettings, latency: u32) -> Self {
        let memory = Plain { bytes: vec![0; settings.budget as usize], written: 0 };
        let (streamer, damaged) = (Streamer::new(settings), Vec::new());
        Stage {
            row,
            streamer,
            settings,
            memory,
            coming: Vec::new(),
            frame: 0,
            latency,
            damaged,
            before: Vec::new(),
        }
    }

    fn step(&mut self, wanted: &[Priority], expected: &[Priority], random: &mut Random) -> FrameReport {
        self.frame += 1;
        let mut loaded = Vec::new();
        for (page, when) in std::mem::take(&mut self.coming) {
            if when > self.frame {
                self.coming.push((page, when));
            } else {
                let is_damaged = self.damaged.contains(&page);
                let bytes = if is_damaged {
                    Err(LoadError::Source("damaged".into()))
                } else {
                    Ok(self.row.contents(page))
                };
                loaded.push(Loaded { page, bytes });
            }
        }
        let in_frustum: Vec<u32> = (0..self.row.drawable_count()).step_by(3).collect();
        let frame = Frame { wanted, in_frustum: &in_frustum, expected };
        let before = self.memory.written;
        let bytes_of = |page: u32| self.row.bytes_of(page);
        let (report, requests) = self.streamer.frame(&self.row, &frame, &bytes_of, loaded, &mut self.memory);
        let pages: HashMap<u32, ()> = self.coming.iter().map(|&(page, _)| (page, ())).collect();
        for page in requests {
            if !pages.contains_key(&page) {
                let late = 1 + random.below(self.latency);
                self.coming.push((page, self.frame + late));
            }
        }
        assert_eq!(self.memory.written - before, report.written);
        self.check(wanted, &report);
        report
    }

    /// What must hold after every frame.
    fn check(&mut self, wanted: &[Priority], report: &FrameReport) {
        assert!(report.resident <= self.settings.budget);
        assert!(report.written <= self.settings.upload, "{} written", report.written);
        assert_eq!(report.drawn.len() as u32 + report.missing, wanted.len() as u32);
        // Whole pages hold what they should, and none lies in another.
        let whole: Vec<(u64, u32)> = (0..self.row.bytes.len() as u32)
            .filter_map(|page| Some((self.streamer.offset_of(page)?, page)))
            .collect();
        let mut ends: Vec<(u64, u64)> =
            whole.iter().map(|&(offset, page)| (offset, offset + self.row.bytes_of(page))).collect();
        ends.sort_unstable();
        assert!(ends.windows(2).all(|pair| pair[0].1 <= pair[1].0), "pages overlap");
        for (offset, page) in whole {
            let held = &self.memory.bytes[offset as usize..][..self.row.bytes_of(page) as usize];
            assert!(held == self.row.contents(page), "page {page} is not itself");
        }
        for choice in &report.drawn {
            let page = self.row.level(choice.drawable, choice.level).page;
            assert!(self.streamer.offset_of(page).is_some(), "drawn and not resident: {choice:?}");
        }
        // The difference to the frame before, by brute force.
        let level =
            |list: &[Choice], drawable: u32| list.iter().find(|c| c.drawable == drawable).map(|c| c.level);
        let added = report.drawn.iter().filter(|c| level(&self.before, c.drawable).is_none()).count();
        let removed = self.before.iter().filter(|c| level(&report.drawn, c.drawable).is_none()).count();
        let changed =
            report.drawn.iter().filter(|c| level(&self.before, c.drawable).is_some_and(|l| l != c.level));
        let counted = [report.added, report.removed, report.changed].map(|n| n as usize);
        assert_eq!(counted, [added, removed, changed.count()]);
        self.before.clone_from(&report.drawn);
    }
}

#[test]
fn walks_and_teleports_stay_in_budget_and_converge_when_the_camera_stops() {
    let (mut moved, mut evicted) = (0, 0);
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let row = Row::new(&mut random, 300);
        let settings = StreamSettings {
            budget: u64::from(60_000 + random.below(500_000)),
            upload: u64::from(3_000 + random.below(60_000)),
            reserve: 0.05,
            in_flight: u64::from(5_000 + random.below(100_000)),
        };
        let latency = 1 + random.below(4);
        let mut stage = Stage::new(row, settings, latency);
        let mut at = 150.0;
        for step in 0..60 {
            at = match random.below(20) {
                0 => 300.0 * random.unit(),
                _ => (at + 3.0 * random.unit() - 1.0).clamp(0.0, 299.0),
            };
            let expected = stage.row.wanted((at + 5.0).min(299.0));
            let wanted = stage.row.wanted(at);
            let report = stage.step(&wanted, &expected, &mut random);
            moved += report.moved;
            evicted += report.evicted;
            assert!(report.failed.is_empty(), "seed {seed}, step {step}");
        }
        let wanted = stage.row.wanted(at);
        let frames = (0..2000).find(|_| stage.step(&wanted, &[], &mut random).is_complete);
        assert!(frames.is_some(), "seed {seed}: it does not converge");
        let last = stage.step(&wanted, &[], &mut random);
        assert_eq!(
            (last.written, last.moved, last.added, last.changed),
            (0, 0, 0, 0),
            "seed {seed}: it goes on"
        );
        let page = |want: &Priority| stage.row.level(want.choice.drawable, want.choice.level).page;
        let mut pages: Vec<u32> = wanted.iter().map(page).collect();
        let coarsest = |want: &Priority| {
            stage.row.level(want.choice.drawable, stage.row.level_count(want.choice.drawable) - 1).page
        };
        pages.extend(wanted.iter().map(coarsest));
        pages.sort_unstable();
        pages.dedup();
        let needed: u64 = pages.iter().map(|&page| stage.row.bytes_of(page).next_multiple_of(16)).sum();
        if needed as f64 <= 0.95 * settings.budget as f64 - 16.0 {
            let mut choices: Vec<Choice> = wanted.iter().map(|want| want.choice).collect();
            choices.sort_unstable();
            assert_eq!((last.drawn, last.missing), (choices, 0), "seed {seed}: all that fits is there");
        }
    }
    assert!(moved > 0 && evicted > 0, "{moved} {evicted}");
}

#[test]
fn nothing_visible_is_absent_once_its_coarsest_level_could_arrive() {
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let row = Row::new(&mut random, 300);
        // Enough for all coarsest levels, not for much more; a page comes in the frame after it was asked for.
        let coarsest: u64 =
            (0..300).map(|d| row.bytes_of(row.level(d, row.level_count(d) - 1).page) + 16).sum();
        let settings = StreamSettings {
            budget: coarsest + 20_000,
            upload: coarsest,
            reserve: 0.5,
            in_flight: 2 * coarsest,
        };
        let mut stage = Stage::new(row, settings, 1);
        let mut at = 0.0;
        // For how many frames each drawable has been wanted.
        let mut since: HashMap<u32, u32> = HashMap::new();
        for step in 0..60 {
            // A cut every tenth frame.
            at = if step % 10 == 0 { 299.0 * random.unit() } else { (at + 0.5f64).min(299.0) };
            let wanted = stage.row.wanted(at);
            let frames = |drawable: u32| since.get(&drawable).map_or(1, |frames| frames + 1);
            since = wanted.iter().map(|w| (w.choice.drawable, frames(w.choice.drawable))).collect();
            let report = stage.step(&wanted, &[], &mut random);
            for (drawable, frames) in &since {
                let is_drawn = report.drawn.iter().any(|choice| choice.drawable == *drawable);
                assert!(
                    is_drawn || *frames < 3,
                    "seed {seed}, step {step}: {drawable} is absent after {frames} frames"
                );
            }
        }
    }
}

#[test]
fn absurd_budgets_draw_what_they_can() {
    for (budget, upload, in_flight) in
        [(0, 0, 0), (15, 100, 100), (16, 1, 1), (400, 7, 1), (3000, 100, 0), (100_000, 0, 1000)]
    {
        let mut random = Random::new(budget);
        let row = Row::new(&mut random, 100);
        let settings = StreamSettings { budget, upload, reserve: 1.0, in_flight };
        let mut stage = Stage::new(row, settings, 2);
        for step in 0..300 {
            let wanted = stage.row.wanted(f64::from(step / 50 * 17));
            stage.step(&wanted, &wanted, &mut random);
        }
    }
}

#[test]
fn damaged_pages_are_told_once_and_something_else_is_drawn() {
    let mut random = Random::new(4);
    let row = Row::new(&mut random, 40);
    let mut stage = Stage::new(row, StreamSettings { upload: 1 << 20, ..StreamSettings::default() }, 1);
    let wanted: Vec<Priority> = (0..40)
        .map(|drawable| Priority { choice: Choice { drawable, level: 0 }, samples: 1 + drawable })
        .collect();
    stage.damaged = wanted.iter().map(|w| stage.row.level(w.choice.drawable, 0).page).collect();
    stage.damaged.sort_unstable();
    stage.damaged.dedup();
    let mut failed = Vec::new();
    let mut last = FrameReport::default();
    for _ in 0..20 {
        last = stage.step(&wanted, &[], &mut random);
        failed.extend(last.failed.iter().map(|(page, _)| *page));
    }
    failed.sort_unstable();
    assert_eq!(failed, stage.damaged);
    assert!(last.is_complete);
    let only = (0..40).filter(|&drawable| stage.row.level_count(drawable) == 1).count() as u32;
    assert_eq!(last.missing, only, "what has no other level is missing");
    assert_eq!(last.substituted, 40 - only);
}
