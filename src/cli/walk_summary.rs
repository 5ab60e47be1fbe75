//! Figures over all frames of a walk.

use serde::Serialize;

use crate::gpu::Context;
use crate::gpu::check::Difference;
use crate::gpu::frame::PASSES;
use crate::lab::statistics::nearest_rank;
use crate::walkthrough::FrameRecord;

/// Frames after a cut in which something may still be missing.
pub const SETTLING: u64 = 3;
/// Frames after a cut from which on motion is smooth.
const SMOOTH: u64 = 30;

/// A frame compared with `exact`.
pub struct Checked {
    pub difference: Difference,
}

/// Milliseconds of a stage over all frames.
#[derive(Clone, Debug, Serialize)]
pub struct Stage {
    pub name: &'static str,
    pub median: f64,
    pub p95: f64,
    pub p99: f64,
    pub worst: f64,
}

/// How frames compare with `exact`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct CheckSummary {
    /// Shares of the pixels of a frame, of those later than [`SETTLING`] frames after a cut.
    pub settled: Option<SettledCheck>,
    /// Share of the pixels of a cut or of a frame that soon after one, when pages are still to come.
    pub differ_after_cuts: Option<f64>,
    /// Drawables of at least 16 pixels, frame by frame.
    pub lost: u64,
}

/// How settled frames compare with `exact`: shares of the pixels of a frame.
#[derive(Clone, Debug, Serialize)]
pub struct SettledCheck {
    pub differ_mean: f64,
    pub differ_worst: f64,
    pub off_silhouettes_mean: f64,
}

/// Figures over all frames.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    pub adapter: String,
    pub adapter_kind: String,
    pub budget: u64,
    pub triangle_budget: u64,
    pub stages: Vec<Stage>,
    pub frames_per_second: f64,
    /// Frames a second over the slowest hundredth of the frames.
    pub one_percent_low: f64,
    pub resident_mean: u64,
    pub resident_most: u64,
    pub written: u64,
    pub written_most: u64,
    pub copies: u64,
    pub written_share_in_motion: Option<f64>,
    pub triangles_mean: u64,
    pub triangles_most: u64,
    pub missing: u64,
    pub missing_late: u64,
    pub failed_pages: u32,
    pub check: Option<CheckSummary>,
    #[serde(skip)]
    records: Vec<FrameRecord>,
    #[serde(skip)]
    checks: Vec<Difference>,
}

impl Summary {
    pub fn new(context: &Context, budget: u64, triangle_budget: u64) -> Self {
        Summary {
            adapter: context.name.clone(),
            adapter_kind: format!("{:?}", context.kind),
            budget,
            triangle_budget,
            stages: Vec::new(),
            frames_per_second: 0.0,
            one_percent_low: 0.0,
            resident_mean: 0,
            resident_most: 0,
            written: 0,
            written_most: 0,
            copies: 0,
            written_share_in_motion: None,
            triangles_mean: 0,
            triangles_most: 0,
            missing: 0,
            missing_late: 0,
            failed_pages: 0,
            check: None,
            records: Vec::new(),
            checks: Vec::new(),
        }
    }

    pub fn add(&mut self, record: &FrameRecord, checked: Option<Checked>) {
        self.records.push(record.clone());
        self.checks.extend(checked.map(|checked| checked.difference));
    }

    pub fn frames(&self) -> usize {
        self.records.len()
    }

    /// Works out all figures.
    pub fn finish(&mut self) {
        let records = &self.records;
        let count = records.len().max(1) as u64;
        let stage = |name: &'static str, of: &dyn Fn(&FrameRecord) -> f64| {
            let mut times: Vec<f64> = records.iter().map(of).collect();
            times.sort_by(f64::total_cmp);
            Stage {
                name,
                median: nearest_rank(&times, 50),
                p95: nearest_rank(&times, 95),
                p99: nearest_rank(&times, 99),
                worst: nearest_rank(&times, 100),
            }
        };
        let mut stages = vec![
            stage("frame", &|r| r.frame_ms),
            stage("query", &|r| r.query_ms),
            stage("select", &|r| r.select_ms),
            stage("stream", &|r| r.stream_ms),
            stage("upload", &|r| r.upload_ms),
            stage("draw", &|r| r.draw_ms),
        ];
        for name in PASSES {
            let of = |record: &FrameRecord| record.passes.iter().find(|(pass, _)| *pass == name).map(|p| p.1);
            if records.iter().any(|record| of(record).is_some()) {
                stages.push(stage(name, &|record| of(record).unwrap_or(0.0)));
            }
        }
        self.stages = stages;
        let mut slowest: Vec<f64> = records.iter().map(|r| r.frame_ms).collect();
        slowest.sort_by(|a, b| b.total_cmp(a));
        let per_second = |times: &[f64]| 1e3 * times.len() as f64 / times.iter().sum::<f64>().max(1e-9);
        self.frames_per_second = per_second(&slowest);
        self.one_percent_low = per_second(&slowest[..slowest.len().div_ceil(100)]);
        self.resident_mean = records.iter().map(|r| r.resident).sum::<u64>() / count;
        self.resident_most = records.iter().map(|r| r.resident).max().unwrap_or(0);
        self.written = records.iter().map(|r| r.written).sum();
        self.written_most = records.iter().map(|r| r.written).max().unwrap_or(0);
        self.copies = records.iter().map(|r| u64::from(r.copies)).sum();
        self.triangles_mean = records.iter().map(|r| r.triangles).sum::<u64>() / count;
        self.triangles_most = records.iter().map(|r| r.triangles).max().unwrap_or(0);
        self.failed_pages = records.last().map_or(0, |record| record.failed);
        self.missing = records.iter().map(|r| u64::from(r.missing)).sum();
        let mut since_cut = 0;
        let (mut shares, mut smooth_frames) = (0.0, 0u64);
        for record in records {
            since_cut = if record.is_cut { 0 } else { since_cut + 1 };
            if since_cut > SETTLING {
                self.missing_late += u64::from(record.missing);
            }
            if since_cut > SMOOTH && record.resident > 0 {
                shares += record.written as f64 / record.resident as f64;
                smooth_frames += 1;
            }
        }
        self.written_share_in_motion = (smooth_frames > 0).then(|| shares / smooth_frames as f64);
        self.check = self.checked();
    }

    /// How the frames compare that were compared.
    fn checked(&self) -> Option<CheckSummary> {
        let mut since_cut = 0;
        let (mut settled, mut settling) = (Vec::new(), Vec::new());
        for (record, check) in self.records.iter().zip(&self.checks) {
            since_cut = if record.is_cut { 0 } else { since_cut + 1 };
            if since_cut > SETTLING { settled.push(check) } else { settling.push(check) }
        }
        let share = |part: u64, check: &Difference| part as f64 / check.pixels.max(1) as f64;
        let mean = |checks: &[&Difference], of: fn(&Difference) -> u64| {
            checks.iter().map(|check| share(of(check), check)).sum::<f64>() / checks.len().max(1) as f64
        };
        (!self.checks.is_empty()).then(|| CheckSummary {
            settled: (!settled.is_empty()).then(|| SettledCheck {
                differ_mean: mean(&settled, |check| check.differ),
                differ_worst: settled.iter().map(|check| share(check.differ, check)).fold(0.0, f64::max),
                off_silhouettes_mean: mean(&settled, |check| check.off_silhouettes),
            }),
            differ_after_cuts: (!settling.is_empty()).then(|| mean(&settling, |check| check.differ)),
            lost: self.checks.iter().map(|check| check.lost).sum(),
        })
    }
}
