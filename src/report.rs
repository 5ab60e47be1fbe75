//! What was repaired, dropped or skipped on the way, counted, so that nothing happens silently.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// One kind of repair, how often it was made, and where it was first seen.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// How often.
    pub count: u64,
    /// Where it was met first: file, node, place.
    pub first: String,
}

/// Counted findings, by a short sentence such as `triangles dropped: vertex is not a finite number`.
///
/// Sorted by that sentence, so that the report reads the same whatever order the work was done in.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Findings(pub BTreeMap<String, Finding>);

impl Findings {
    /// Counts `count` cases of `what`; `place` is kept for the first one. Nothing is recorded for a count of 0.
    pub fn add(&mut self, what: &str, count: u64, place: impl FnOnce() -> String) {
        if count == 0 {
            return;
        }
        match self.0.get_mut(what) {
            Some(finding) => finding.count += count,
            None => {
                self.0.insert(what.to_owned(), Finding { count, first: place() });
            }
        }
    }

    /// Adds everything of `later`, which was met after all of `self`.
    pub fn merge(&mut self, later: Findings) {
        for (what, finding) in later.0 {
            self.add(&what, finding.count, || finding.first);
        }
    }
}
