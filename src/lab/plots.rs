//! The three charts of a report: time against error, where the time goes, and how errors are spread over views.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::chart::{Axis, Chart, Curve, Point, charts_svg};
use super::methods::{FLOOR, METHODS};
use super::page::percent;
use super::report::{MethodReport, Report};
use super::svg::{GREY, INK, SvgError, colour, drawn};

/// Width of every chart, pixels.
const WIDTH: u32 = 960;
/// Height of the row of a method in [`stages`] and [`spread`].
const ROW: i32 = 26;
/// Room for the names of methods at the left.
const NAMES: i32 = 210;

/// Time against both errors, a curve for each method and resolution: left and below is better, in both charts.
///
/// # Errors
///
/// Drawing failed.
pub fn pareto(report: &Report) -> Result<String, SvgError> {
    let chart = |title: &str, y: &str, error: &dyn Fn(&MethodReport) -> f64| Chart {
        title: title.into(),
        x: Axis { label: "milliseconds a view (median)".into(), name: plain, marks_at_points: false },
        y: Axis { label: y.into(), name: plain, marks_at_points: false },
        curves: curves(report, error),
    };
    let lost = chart("Time against lost pixels", "lost pixels, % (mean)", &|m| m.lost_pixels.mean);
    let needless = chart(
        "Time against triangles drawn for nothing",
        "triangles drawn for nothing, % of the drawn (mean)",
        &|m| m.needless_triangles.mean,
    );
    charts_svg(&[lost, needless], WIDTH, 1)
}

/// A curve for each method and resolution, its points by rising rays per pixel.
fn curves(report: &Report, error: &dyn Fn(&MethodReport) -> f64) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    let rays = |method: &MethodReport| method.variant.rays_per_pixel.map_or(1.0, |rays| rays.get());
    let mut order: Vec<usize> = (0..report.methods.len()).collect();
    for index in &order {
        let variant = &report.methods[*index].variant;
        let name = variant.curve();
        if !curves.iter().any(|curve| curve.name == name) {
            let colour = colour_of(&variant.method, curves.len());
            curves.push(Curve { colour, is_dashed: variant.method == FLOOR, name, points: Vec::new() });
        }
    }
    order.sort_by(|&a, &b| rays(&report.methods[a]).total_cmp(&rays(&report.methods[b])));
    for method in order.into_iter().map(|index| &report.methods[index]) {
        let name = method.variant.curve();
        let point = Point {
            x: 1e3 * method.time.distribution.median,
            y: 100.0 * error(method),
            label: method.variant.rays_per_pixel.map_or_else(String::new, |rays| rays.to_string()),
        };
        if let Some(curve) = curves.iter_mut().find(|curve| curve.name == name) {
            curve.points.push(point);
        }
    }
    for curve in &mut curves {
        if curve.is_dashed {
            curve.name += " (sampling floor)";
        }
    }
    curves
}

/// The floor is grey, everything else has the colour of its curve.
fn colour_of(method: &str, curve: usize) -> usize {
    if method == FLOOR { GREY } else { curve % GREY }
}

/// A number without needless digits.
pub(super) fn plain(value: f64) -> String {
    // Decades of f64 powers may be 0.30000000000000004.
    let text = format!("{value:.6}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

/// Rows with the names of the methods at the left.
fn rows(
    report: &Report,
    title: &str,
    subtitle: &str,
    draw: impl Fn(&MethodReport, &Area, i32) -> Result<(), SvgError>,
    legend: impl Fn(&Area, i32) -> Result<(), SvgError>,
) -> Result<String, SvgError> {
    const TOP: i32 = 56;
    const BOTTOM: i32 = 44;
    let below = TOP + ROW * report.methods.len() as i32;
    drawn((WIDTH, (below + BOTTOM) as u32), |area| {
        area.draw(&Text::new(title, (12, 10), ("sans-serif", 17)))?;
        area.draw(&Text::new(subtitle, (12, 33), ("sans-serif", 12).into_font().color(&INK.mix(0.7))))?;
        let right = ("sans-serif", 13).into_font().color(&INK).pos(Pos::new(HPos::Right, VPos::Center));
        for (y, method) in (0..).map(|row| TOP + ROW * row + ROW / 2).zip(&report.methods) {
            area.draw(&Text::new(method.variant.to_string(), (NAMES - 10, y), right.clone()))?;
            draw(method, area, y)?;
        }
        legend(area, below + 4)
    })
}

/// Where the time of a view goes: mean of every stage.
///
/// # Errors
///
/// Drawing failed.
pub fn stages(report: &Report) -> Result<String, SvgError> {
    let mut names: Vec<&str> = Vec::new();
    for stage in report.methods.iter().flat_map(|method| &method.time.stages) {
        if !names.contains(&stage.stage) {
            names.push(stage.stage);
        }
    }
    let longest = report.methods.iter().map(|method| method.time.distribution.mean).fold(1e-9, f64::max);
    // Room for the figure at the end of the longest bar.
    let width = f64::from(WIDTH as i32 - NAMES - 90);
    let index = |name: &str| names.iter().position(|&other| other == name).unwrap_or(0);
    rows(
        report,
        "Where the time goes",
        "mean milliseconds a view, by stage",
        |method, area, y| {
            let mut start = 0.0;
            for stage in &method.time.stages {
                let at = |seconds: f64| NAMES + (seconds / longest * width).round() as i32;
                let corners = [(at(start), y - 8), (at(start + stage.seconds), y + 8)];
                area.draw(&Rectangle::new(corners, colour(index(stage.stage)).filled()))?;
                start += stage.seconds;
            }
            let end = NAMES + (start / longest * width).round() as i32 + 6;
            let style = ("sans-serif", 12).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Center));
            Ok(area.draw(&Text::new(milliseconds(start), (end, y), style))?)
        },
        |area, y| {
            let mut x = NAMES;
            for (i, name) in names.iter().enumerate() {
                area.draw(&Rectangle::new([(x, y + 8), (x + 12, y + 20)], colour(i).filled()))?;
                area.draw(&Text::new(*name, (x + 18, y + 8), ("sans-serif", 12)))?;
                x += 44 + 8 * name.len() as i32;
            }
            Ok(())
        },
    )
}

/// Milliseconds with three digits or so.
pub(super) fn milliseconds(seconds: f64) -> String {
    let ms = 1e3 * seconds;
    let digits = if ms < 1.0 {
        3
    } else if ms < 10.0 {
        2
    } else if ms < 100.0 {
        1
    } else {
        0
    };
    format!("{ms:.digits$} ms")
}

/// How lost pixels are spread over views: a dot a view, a bar at the median, a tick at the 95th percentile.
///
/// # Errors
///
/// Drawing failed.
pub fn spread(report: &Report) -> Result<String, SvgError> {
    let all = report.methods.iter().flat_map(|method| &method.frames).map(|frame| frame.accuracy.lost_pixels);
    let least = all.clone().filter(|&lost| lost > 0.0).fold(1.0, f64::min).log10().floor().min(-1.0);
    let most = all.fold(0.0, f64::max).max(1e-9).log10().ceil().clamp(least + 1.0, 0.0);
    // Zero stands apart at the left.
    let first = NAMES + 60;
    let width = f64::from(WIDTH as i32 - 24 - first);
    let at = |lost: f64| {
        if lost > 0.0 {
            first + ((lost.log10() - least) / (most - least) * width).round() as i32
        } else {
            NAMES + 14
        }
    };
    let decades = (least as i32..=most as i32).map(|decade| 10f64.powi(decade));
    let marks: Vec<f64> = std::iter::once(0.0).chain(decades).collect();
    let colours = curve_colours(report);
    let below = ROW * report.methods.len() as i32;
    rows(
        report,
        "Lost pixels, view by view",
        "a dot for each view; long bar: median, short tick: 95th percentile",
        |method, area, y| {
            let style =
                colour(colours.iter().find(|(name, _)| *name == method.variant.curve()).map_or(0, |c| c.1));
            area.draw(&PathElement::new([(NAMES, y), (WIDTH as i32 - 24, y)], INK.mix(0.12)))?;
            for (view, frame) in method.frames.iter().enumerate() {
                // Dots of equal value would hide each other: a fixed pattern moves them up and down a little.
                let offset = (view as i32 * 5) % 11 - 5;
                let place = (at(frame.accuracy.lost_pixels), y + offset);
                area.draw(&Circle::new(place, 3, style.mix(0.55).filled()))?;
            }
            let bar = |lost: f64, half: i32, width: u32| {
                let x = at(lost);
                PathElement::new([(x, y - half), (x, y + half)], INK.stroke_width(width))
            };
            area.draw(&bar(method.lost_pixels.median, 11, 2))?;
            Ok(area.draw(&bar(method.lost_pixels.p95, 6, 2))?)
        },
        |area, y| {
            let centred = ("sans-serif", 12).into_font().color(&INK).pos(Pos::new(HPos::Center, VPos::Top));
            for &mark in &marks {
                let x = at(mark);
                area.draw(&PathElement::new([(x, y - 4), (x, y - 4 - below)], INK.mix(0.12)))?;
                let text = if mark == 0.0 { "none".into() } else { format!("{} %", plain(100.0 * mark)) };
                area.draw(&Text::new(text, (x, y + 2), centred.clone()))?;
            }
            Ok(())
        },
    )
}

/// Lost pixels frame by frame, a line for each method and resolution: of each the one that stands for it.
///
/// # Errors
///
/// Drawing failed.
pub fn frames(report: &Report) -> Result<String, SvgError> {
    const HEIGHT: i32 = 340;
    const PLOT: (i32, i32, i32, i32) = (70, 44, WIDTH as i32 - 190, HEIGHT - 44);
    let (left, top, right, bottom) = PLOT;
    let shown: Vec<&MethodReport> =
        report.representatives().iter().map(|&index| &report.methods[index]).collect();
    let most = shown.iter().map(|method| method.lost_pixels.worst).fold(1e-6, f64::max);
    let colours = curve_colours(report);
    let last = report.views.len().saturating_sub(1).max(1) as f64;
    let x = |frame: usize| left + (frame as f64 / last * f64::from(right - left)).round() as i32;
    let y = |lost: f64| bottom - (lost / most * f64::from(bottom - top)).round() as i32;
    drawn((WIDTH, HEIGHT as u32), |area| {
        let small = ("sans-serif", 12).into_font().color(&INK);
        area.draw(&Text::new("Lost pixels along the way", (12, 10), ("sans-serif", 17)))?;
        for mark in [0.0, 0.5 * most, most] {
            area.draw(&PathElement::new([(left, y(mark)), (right, y(mark))], INK.mix(0.12)))?;
            let style = small.clone().pos(Pos::new(HPos::Right, VPos::Center));
            area.draw(&Text::new(percent(mark), (left - 8, y(mark)), style))?;
        }
        let style = small.clone().pos(Pos::new(HPos::Center, VPos::Top));
        area.draw(&Text::new("frame", ((left + right) / 2, bottom + 24), style.clone()))?;
        for frame in [0, report.views.len().saturating_sub(1)] {
            area.draw(&Text::new(frame.to_string(), (x(frame), bottom + 6), style.clone()))?;
        }
        for (row, method) in (0..).zip(&shown) {
            let name = method.variant.curve();
            let index = colours.iter().find(|(other, _)| *other == name).map_or(0, |found| found.1);
            let points =
                method.frames.iter().enumerate().map(|(i, frame)| (x(i), y(frame.accuracy.lost_pixels)));
            area.draw(&PathElement::new(points.collect::<Vec<_>>(), colour(index).stroke_width(2)))?;
            let height = top + 18 * row;
            let sample = [(right + 14, height + 6), (right + 34, height + 6)];
            area.draw(&PathElement::new(sample, colour(index).stroke_width(2)))?;
            area.draw(&Text::new(method.variant.to_string(), (right + 40, height), small.clone()))?;
        }
        Ok(())
    })
}

/// The colours of [`pareto`], by curve.
fn curve_colours(report: &Report) -> Vec<(String, usize)> {
    let mut colours: Vec<(String, usize)> = Vec::new();
    for method in &report.methods {
        let name = method.variant.curve();
        if !colours.iter().any(|(other, _)| *other == name) {
            colours.push((name, colour_of(&method.variant.method, colours.len())));
        }
    }
    colours
}

/// What a method does, for the page.
pub(super) fn about(method: &str) -> &'static str {
    METHODS.iter().find(|kind| kind.name == method).map_or("", |kind| kind.about)
}
