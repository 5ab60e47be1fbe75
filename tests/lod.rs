//! Selection of levels: against brute force on small cases, monotone in the budget, never over it, stable.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

mod common;

use common::Random;
use voxsight::lod::density::{self, DensitySettings};
use voxsight::lod::vertex_budget::{self, VertexBudgetSettings};
use voxsight::lod::{Candidate, Level, Selection, System};

/// Levels out of a hat.
struct Table(Vec<Vec<Level>>);

impl System for Table {
    fn drawable_count(&self) -> u32 {
        self.0.len() as u32
    }
    fn page_count(&self) -> u32 {
        self.0.iter().map(|levels| levels.len() as u32).max().unwrap_or(0)
    }
    fn level_count(&self, drawable: u32) -> u32 {
        self.0[drawable as usize].len() as u32
    }
    fn level(&self, drawable: u32, level: u32) -> Level {
        self.0[drawable as usize][level as usize]
    }
}

fn table(random: &mut Random, drawables: u32, most_levels: u32) -> Table {
    let drawable = |random: &mut Random| {
        let levels = 1 + random.below(most_levels);
        let mut triangles = 1 + random.below(400);
        let mut error = 0.0;
        let mut list = Vec::new();
        for page in 0..levels {
            list.push(Level { triangles, vertices: triangles / 2 + 2, error, page });
            // Now and then a level has as many triangles as the finer one.
            triangles = (triangles - random.below(triangles)).max(1);
            error += random.unit() * 0.2;
        }
        list
    };
    Table((0..drawables).map(|_| drawable(random)).collect())
}

fn views(random: &mut Random, table: &Table) -> Vec<Candidate> {
    let view = |drawable: u32, random: &mut Random| Candidate {
        drawable,
        // Some cover the same number, some none.
        pixels: [0.0, 1.0, 16.0, 1000.0 * random.unit()][random.below(4) as usize],
        pixels_per_unit: 20.0 * random.unit(),
        area: 500.0 * random.unit(),
        depth: 10.0 * random.unit(),
    };
    (0..table.drawable_count()).filter(|d| d % 5 != 3).map(|drawable| view(drawable, random)).collect()
}

/// Triangles if everything is as coarse as it can be.
fn coarsest(table: &Table, views: &[Candidate]) -> u64 {
    let last = |view: &Candidate| table.level(view.drawable, table.level_count(view.drawable) - 1);
    views.iter().map(|view| u64::from(last(view).triangles)).sum()
}

fn density_of(table: &Table, view: &Candidate, level: u32) -> f64 {
    f64::from(table.level(view.drawable, level).triangles) / view.pixels.max(0.1)
}

/// Is a level finer than this one wanted at all?
fn is_wanted(table: &Table, view: &Candidate, level: u32, settings: &DensitySettings) -> bool {
    let finer = density_of(table, view, level - 1);
    let too_coarse = table.level(view.drawable, level).error * view.pixels_per_unit > settings.pixel_error;
    finer <= settings.greatest_density && (too_coarse || finer <= settings.least_density)
}

fn settings(random: &mut Random, budget: u64) -> DensitySettings {
    DensitySettings {
        budget,
        least_density: [0.0, 0.5][random.below(2) as usize],
        greatest_density: [f64::INFINITY, 20.0][random.below(2) as usize],
        pixel_error: [0.0, 0.5, 3.0][random.below(3) as usize],
        ..DensitySettings::default()
    }
}

/// All ways to choose levels that are wanted and fit: the one whose densest refused step is densest. No drawable is finer than
/// what another one was refused.
fn brute_force(table: &Table, views: &[Candidate], settings: &DensitySettings) -> Option<f64> {
    let mut levels = vec![0u32; views.len()];
    let mut best: Option<f64> = None;
    loop {
        let reaches = |view: &Candidate, level: u32| {
            (level + 1..table.level_count(view.drawable))
                .all(|coarser| is_wanted(table, view, coarser, settings))
        };
        let sum: u64 =
            views.iter().zip(&levels).map(|(v, &l)| u64::from(table.level(v.drawable, l).triangles)).sum();
        if sum <= settings.budget && views.iter().zip(&levels).all(|(view, &level)| reaches(view, level)) {
            let mut refused = f64::INFINITY;
            let mut got = 0.0f64;
            for (view, &level) in views.iter().zip(&levels) {
                if level > 0 && is_wanted(table, view, level, settings) {
                    refused = refused.min(density_of(table, view, level - 1));
                }
                if level + 1 < table.level_count(view.drawable) {
                    got = got.max(density_of(table, view, level));
                }
            }
            if got <= refused {
                best = Some(best.map_or(refused, |best| best.max(refused)));
            }
        }
        // The next way.
        let Some(i) = (0..views.len()).find(|&i| levels[i] + 1 < table.level_count(views[i].drawable)) else {
            return best;
        };
        levels[i] += 1;
        levels[..i].fill(0);
    }
}

fn refused(table: &Table, views: &[Candidate], settings: &DensitySettings, found: &Selection) -> f64 {
    let step = |view: &Candidate| {
        let level = found.level_of(view.drawable)?;
        (level > 0 && is_wanted(table, view, level, settings)).then(|| density_of(table, view, level - 1))
    };
    views.iter().filter_map(step).fold(f64::INFINITY, f64::min)
}

#[test]
fn the_finest_even_selection_that_fits_is_found() {
    let mut binding = 0;
    for seed in 0..400 {
        let mut random = Random::new(seed);
        let table = table(&mut random, 6, 4);
        let views = views(&mut random, &table);
        let settings = {
            let more = u64::from(random.below(900));
            settings(&mut random, coarsest(&table, &views) + more)
        };
        let found = density::select(&table, &views, &settings, None);
        assert_eq!((found.choices.len(), found.beyond_budget), (views.len(), 0), "seed {seed}");
        assert!(found.triangles <= settings.budget, "seed {seed}");
        let best = brute_force(&table, &views, &settings);
        let reached = refused(&table, &views, &settings, &found);
        assert_eq!(Some(reached), best, "seed {seed}");
        binding += u32::from(reached.is_finite());
    }
    assert!(binding > 100, "{binding}");
}

#[test]
fn a_larger_budget_makes_nothing_coarser_and_no_budget_is_exceeded() {
    let mut left_out = 0;
    for seed in 0..60 {
        let mut random = Random::new(seed);
        let table = table(&mut random, 200, 9);
        let views = views(&mut random, &table);
        let settings = settings(&mut random, 0);
        let mut before: Option<Selection> = None;
        for budget in [0, 1, 10, 300, 1000, 3000, 10_000, 20_000, 40_000, u64::MAX] {
            let found = density::select(&table, &views, &DensitySettings { budget, ..settings }, None);
            assert!(found.triangles <= budget, "seed {seed}, {budget}: {}", found.triangles);
            let sum: u64 =
                found.choices.iter().map(|c| u64::from(table.level(c.drawable, c.level).triangles)).sum();
            assert_eq!(found.triangles, sum);
            assert_eq!(found.choices.len() as u32 + found.beyond_budget, views.len() as u32);
            left_out += found.beyond_budget;
            for choice in before.iter().flat_map(|before| &before.choices) {
                let level = found.level_of(choice.drawable);
                assert!(
                    level.is_some_and(|level| level <= choice.level),
                    "seed {seed}, {budget}: {choice:?}"
                );
            }
            before = Some(found);
        }
        // With all the budget in the world each is as fine as it needs to be, and no finer.
        let found = before.unwrap();
        for view in &views {
            let level = found.level_of(view.drawable).unwrap();
            assert!(level == 0 || !is_wanted(&table, view, level, &settings), "seed {seed}");
            let last = table.level_count(view.drawable) - 1;
            assert!(level == last || is_wanted(&table, view, level + 1, &settings), "seed {seed}");
        }
    }
    assert!(left_out > 1000, "{left_out}");
}

#[test]
fn small_changes_of_the_view_change_few_levels_and_never_break_the_budget() {
    let (mut with, mut without) = (0, 0);
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let table = table(&mut random, 400, 9);
        let mut views = views(&mut random, &table);
        let budget = coarsest(&table, &views) + u64::from(random.below(20_000));
        let settings = DensitySettings { budget, ..DensitySettings::default() };
        let mut kept = density::select(&table, &views, &settings, None);
        let mut fresh = kept.clone();
        for frame in 0..10 {
            for view in &mut views {
                view.pixels *= 1.0 + 0.1 * (random.unit() - 0.5);
                view.pixels_per_unit *= 1.0 + 0.02 * (random.unit() - 0.5);
            }
            let changes = |a: &Selection, b: &Selection| {
                a.choices.iter().zip(&b.choices).filter(|(a, b)| a != b).count()
            };
            let next = density::select(&table, &views, &settings, Some(&kept));
            assert!(next.triangles <= budget, "seed {seed}, frame {frame}");
            with += changes(&kept, &next);
            kept = next;
            let next = density::select(&table, &views, &settings, None);
            without += changes(&fresh, &next);
            fresh = next;
            // What is kept is about what is fresh.
            let error = kept.triangles.abs_diff(fresh.triangles) as f64 / fresh.triangles as f64;
            assert!(error < 0.3, "seed {seed}, frame {frame}: {} {}", kept.triangles, fresh.triangles);
        }
    }
    assert!(
        without > 1000 && with * 4 < without,
        "levels changed: {with} with hysteresis, {without} without"
    );
}

#[test]
fn hysteresis_without_width_changes_nothing() {
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let table = table(&mut random, 100, 9);
        let (views, other) = (views(&mut random, &table), views(&mut random, &table));
        let budget = u64::from(random.below(20_000));
        let settings = DensitySettings { hysteresis: 1.0, ..settings(&mut random, budget) };
        let last = density::select(&table, &other, &DensitySettings { budget: u64::MAX, ..settings }, None);
        let found = density::select(&table, &views, &settings, Some(&last));
        // Steps of the very density that decides may be taken or not.
        let fresh = density::select(&table, &views, &settings, None);
        let deciding = refused(&table, &views, &settings, &fresh);
        for (a, b) in found.choices.iter().zip(&fresh.choices) {
            let view = views.iter().find(|view| view.drawable == a.drawable).unwrap();
            let (low, high) = (a.level.min(b.level), a.level.max(b.level));
            let at_the_border = (low..high).all(|level| density_of(&table, view, level) == deciding);
            assert!(at_the_border, "seed {seed}: {a:?} {b:?}");
        }
    }
}

#[test]
fn drawables_below_the_threshold_are_counted_and_left_out() {
    let mut random = Random::new(1);
    let table = table(&mut random, 100, 5);
    let views = views(&mut random, &table);
    let settings = DensitySettings { least_pixels: 5.0, ..DensitySettings::default() };
    let found = density::select(&table, &views, &settings, None);
    let large: Vec<u32> = views.iter().filter(|v| v.pixels >= 5.0).map(|v| v.drawable).collect();
    assert_eq!(found.choices.iter().map(|choice| choice.drawable).collect::<Vec<_>>(), large);
    assert_eq!(found.below_threshold as usize, views.len() - large.len());
}

#[test]
fn vertices_are_shared_out_as_the_formula_says() {
    for seed in 0..100 {
        let mut random = Random::new(seed);
        let table = table(&mut random, 60, 9);
        let views = views(&mut random, &table);
        let settings = VertexBudgetSettings {
            budget: u64::from(2 + random.below(9000)),
            ..VertexBudgetSettings::default()
        };
        // The formula as printed, alpha 3 and beta 2, with its factor beta.
        let weight = |view: &Candidate| match view.area < settings.least_area {
            true => 0.0,
            false => {
                let vertices = f64::from(table.level(view.drawable, 0).vertices);
                (2.0 * (view.area / view.depth.max(1e-3)) * vertices * vertices).cbrt()
            }
        };
        let all: f64 = views.iter().map(weight).sum();
        let shares = vertex_budget::shares(&table, &views, &settings);
        for (view, share) in views.iter().zip(&shares) {
            let expected = settings.budget as f64 * weight(view) / all;
            assert!((share - expected).abs() <= 1e-9 * expected, "seed {seed}: {share} {expected}");
        }
        let found = vertex_budget::select(&table, &views, &settings);
        assert!(found.vertices <= settings.budget, "seed {seed}");
        for choice in &found.choices {
            let place = views.iter().position(|view| view.drawable == choice.drawable).unwrap();
            let vertices = |level: u32| f64::from(table.level(choice.drawable, level).vertices);
            let is_coarsest = choice.level + 1 == table.level_count(choice.drawable);
            assert!(is_coarsest || vertices(choice.level) <= shares[place], "seed {seed}: {choice:?}");
            assert!(
                choice.level == 0 || vertices(choice.level - 1) > shares[place],
                "seed {seed}: {choice:?}"
            );
        }
        assert_eq!(
            found.choices.len() as u32 + found.below_threshold + found.beyond_budget,
            views.len() as u32
        );
    }
}
