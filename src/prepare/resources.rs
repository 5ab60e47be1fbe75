//! Time and memory of a build, stage by stage.

use std::time::Instant;

use serde::Serialize;

/// One stage of a build: what it took.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageCost {
    /// Name of the stage.
    pub name: &'static str,
    /// Wall time, seconds.
    pub seconds: f64,
    /// Highest resident memory of the process up to the end of the stage, bytes; `None` where the system does not say.
    pub peak_bytes: Option<u64>,
}

/// Collects stages.
pub(super) struct Stopwatch {
    started: Instant,
    stages: Vec<StageCost>,
}

impl Stopwatch {
    pub fn start() -> Self {
        Stopwatch { started: Instant::now(), stages: Vec::new() }
    }

    /// The stage that began with the last call (or the start) ends here.
    pub fn lap(&mut self, name: &'static str) {
        let now = Instant::now();
        let seconds = (now - self.started).as_secs_f64();
        self.stages.push(StageCost { name, seconds, peak_bytes: peak_resident_bytes() });
        self.started = now;
    }

    pub fn finish(self) -> Vec<StageCost> {
        self.stages
    }
}

/// Highest resident memory of this process so far; Linux only.
pub fn peak_resident_bytes() -> Option<u64> {
    status_field("VmHWM:")
}

/// Resident memory of this process now; Linux only.
pub fn resident_bytes() -> Option<u64> {
    status_field("VmRSS:")
}

/// A field of /proc/self/status, given there in KiB.
fn status_field(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
