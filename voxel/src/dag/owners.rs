//! Which drawables touch each brick, and which of its voxels: every voxel knows all its owners exactly.
//!
//! Bricks are numbered in depth-first order. Neighbouring ordinals mostly share one owner, so that ordinals are
//! stored as runs: the first ordinal of each run, and a value that is a drawable, or (top bit set) the start of a list
//! for a brick with several owners. A list is pairs of u64 words: drawable (top bit set on the last pair), and the mask
//! of the brick's voxels that this drawable touches. Drawables of a list rise.

use super::{DagError, DagRef};

/// Top bit of a run's value: the rest is the index of a pair.
const LIST_FLAG: u32 = 1 << 31;
/// Top bit of a pair's first word: the list ends here.
const LAST_FLAG: u64 = 1 << 63;
/// One entry of the lookup index for this many ordinals.
const INDEX_SPAN_LOG2: u32 = 6;

/// Owner runs and lists in memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OwnerTable {
    /// First ordinals of all runs, then their values.
    pub runs: Vec<u32>,
    /// Pairs, see the module.
    pub lists: Vec<u64>,
}

/// Collects owners brick by brick, in the order of the ordinals.
#[derive(Default)]
pub(crate) struct OwnerBuilder {
    starts: Vec<u32>,
    values: Vec<u32>,
    lists: Vec<u64>,
    bricks: u32,
}

impl OwnerBuilder {
    /// The next brick, touched by `owners`, (drawable, voxels), drawables rising, at least one.
    pub fn push(&mut self, owners: &[(u32, u64)]) -> Result<(), DagError> {
        let value = match owners {
            [(drawable, _)] => *drawable,
            _ => {
                let pair = self.lists.len() / 2;
                let last = owners.len() - 1;
                for (i, &(drawable, mask)) in owners.iter().enumerate() {
                    let flag = if i == last { LAST_FLAG } else { 0 };
                    self.lists.extend([u64::from(drawable) | flag, mask]);
                }
                list_value(pair)?
            }
        };
        if self.values.last() != Some(&value) {
            self.starts.push(self.bricks);
            self.values.push(value);
        }
        self.bricks = self.bricks.checked_add(1).ok_or(DagError::TooManyBricks)?;
        Ok(())
    }

    /// Appends what a later block collected.
    pub fn append(&mut self, block: &OwnerBuilder) -> Result<(), DagError> {
        let pairs = self.lists.len() / 2;
        for (&start, &value) in block.starts.iter().zip(&block.values) {
            let value = match value & LIST_FLAG {
                0 => value,
                _ => list_value(pairs + (value & !LIST_FLAG) as usize)?,
            };
            if self.values.last() != Some(&value) {
                self.starts.push(self.bricks.checked_add(start).ok_or(DagError::TooManyBricks)?);
                self.values.push(value);
            }
        }
        self.lists.extend_from_slice(&block.lists);
        self.bricks = self.bricks.checked_add(block.bricks).ok_or(DagError::TooManyBricks)?;
        Ok(())
    }

    pub fn finish(mut self) -> OwnerTable {
        self.starts.append(&mut self.values);
        OwnerTable { runs: self.starts, lists: self.lists }
    }
}

fn list_value(pair: usize) -> Result<u32, DagError> {
    match u32::try_from(pair) {
        Ok(pair) if pair & LIST_FLAG == 0 => Ok(pair | LIST_FLAG),
        _ => Err(DagError::TooManyOwners { what: "entries of owner lists" }),
    }
}

/// Lookup index over an owner table, made once when it is validated: about 1/16 byte a brick.
#[derive(Clone, Debug, Default)]
pub struct OwnersIndex {
    /// For each span of 2^6 ordinals, the run that holds its first ordinal.
    run_of_span: Vec<u32>,
}

/// Owners over borrowed arrays, which [`OwnersIndex::validate`] has checked.
#[derive(Clone, Copy, Debug)]
pub struct OwnersRef<'a> {
    starts: &'a [u32],
    values: &'a [u32],
    lists: &'a [u64],
    index: &'a OwnersIndex,
}

/// The owners of one brick.
#[derive(Clone, Copy, Debug)]
pub enum Owners<'a> {
    /// One drawable owns all voxels of the brick.
    One(u32),
    /// Pairs of a list.
    Several(&'a [u64]),
}

impl Owners<'_> {
    /// All owners of the brick, rising.
    #[inline]
    pub fn all(self) -> impl Iterator<Item = u32> {
        let (one, pairs) = match self {
            Owners::One(drawable) => (Some(drawable), [].as_slice()),
            Owners::Several(pairs) => (None, pairs),
        };
        one.into_iter().chain(pairs.chunks_exact(2).map(|pair| pair[0] as u32))
    }

    /// The drawables that own voxel `bit` of the brick, rising.
    #[inline]
    pub fn of_voxel(self, bit: u32) -> impl Iterator<Item = u32> {
        let (one, pairs) = match self {
            Owners::One(drawable) => (Some(drawable), [].as_slice()),
            Owners::Several(pairs) => (None, pairs),
        };
        let several =
            pairs.chunks_exact(2).filter(move |pair| pair[1] >> bit & 1 == 1).map(|pair| pair[0] as u32);
        one.into_iter().chain(several)
    }
}

impl OwnersIndex {
    /// Checks an owner table of unknown origin in one linear pass: runs rise and lie within the bricks, drawables are
    /// below `drawables`, lists end, rise, and have non-empty masks.
    pub fn validate(runs: &[u32], lists: &[u64], bricks: u32, drawables: u32) -> Result<Self, DagError> {
        let broken = |rule, place: String| Err(DagError::Broken { rule, place });
        if !runs.len().is_multiple_of(2) || !lists.len().is_multiple_of(2) {
            return broken(
                "runs and lists are pairs",
                format!("{} runs, {} list words", runs.len(), lists.len()),
            );
        }
        let (starts, values) = runs.split_at(runs.len() / 2);
        if (bricks == 0) != starts.is_empty() || starts.first().is_some_and(|&start| start != 0) {
            return broken("runs cover every brick", "the first run".to_owned());
        }
        if let Some(at) = (1..starts.len()).find(|&i| starts[i] <= starts[i - 1]) {
            return broken("starts of runs rise", format!("run {at}"));
        }
        if starts.last().is_some_and(|&start| start >= bricks) {
            return broken("runs lie within the bricks", "the last run".to_owned());
        }
        for (pair, words) in lists.chunks_exact(2).enumerate() {
            let drawable = words[0] & !LAST_FLAG;
            if drawable >= u64::from(drawables) || words[1] == 0 {
                return broken("an owner is a drawable and owns a voxel", format!("owner list pair {pair}"));
            }
            let continues = words[0] & LAST_FLAG == 0;
            match lists.get(2 * pair + 2) {
                None if continues => return broken("owner lists end", format!("owner list pair {pair}")),
                Some(next) if continues && next & !LAST_FLAG <= drawable => {
                    return broken("drawables of an owner list rise", format!("owner list pair {pair}"));
                }
                _ => {}
            }
        }
        for (run, &value) in values.iter().enumerate() {
            let (index, count) = match value & LIST_FLAG {
                0 => (value as usize, drawables as usize),
                _ => ((value & !LIST_FLAG) as usize, lists.len() / 2),
            };
            if index >= count {
                return broken("a run names a drawable or a list", format!("run {run}"));
            }
        }
        Ok(Self::new(starts, bricks))
    }

    fn new(starts: &[u32], bricks: u32) -> Self {
        let spans = (u64::from(bricks) >> INDEX_SPAN_LOG2) + 1;
        let mut run = 0usize;
        let run_of_span = (0..spans).map(|span| {
            while starts.get(run + 1).is_some_and(|&start| u64::from(start) <= span << INDEX_SPAN_LOG2) {
                run += 1;
            }
            run as u32
        });
        OwnersIndex { run_of_span: run_of_span.collect() }
    }
}

impl OwnerTable {
    /// The lookup index of a table that this library built over `bricks` bricks.
    pub fn index(&self, bricks: u32) -> OwnersIndex {
        OwnersIndex::new(&self.runs[..self.runs.len() / 2], bricks)
    }
}

impl<'a> OwnersRef<'a> {
    /// A view over the arrays from which `index` was made.
    pub fn new(runs: &'a [u32], lists: &'a [u64], index: &'a OwnersIndex) -> Self {
        let (starts, values) = runs.split_at(runs.len() / 2);
        OwnersRef { starts, values, lists, index }
    }

    /// Checks that the lists are those of the bricks, in order, one each, and that the owners of each brick own its
    /// voxels and no others. One walk over all bricks and lists.
    ///
    /// # Errors
    ///
    /// Names the first brick of which that is not true.
    pub fn check_masks(&self, dag: &DagRef) -> Result<(), DagError> {
        let (mut run, mut next_pair) = (0, 0);
        let mut broken = None;
        dag.for_each_brick(|_, ordinal, mask| {
            if broken.is_some() {
                return;
            }
            if self.starts.get(run + 1) == Some(&ordinal) {
                run += 1;
            }
            let value = self.values[run];
            if value & LIST_FLAG == 0 {
                return;
            }
            // Also what keeps this linear: each list is read once.
            if (value & !LIST_FLAG) as usize != next_pair {
                broken = Some(("each owner list belongs to one brick, in order", ordinal));
                return;
            }
            let pairs = self.list(value);
            next_pair += pairs.len() / 2;
            if pairs.chunks_exact(2).fold(0, |union, pair| union | pair[1]) != mask {
                broken = Some(("owners own the voxels of their brick and no others", ordinal));
            }
        });
        if let Some((rule, ordinal)) = broken {
            return Err(DagError::Broken { rule, place: format!("brick {ordinal}") });
        }
        if next_pair != self.lists.len() / 2 {
            let place = format!("owner list pair {next_pair}");
            return Err(DagError::Broken { rule: "each owner list belongs to one brick, in order", place });
        }
        Ok(())
    }

    /// Owners of the brick with this ordinal, which must be below the brick count.
    #[inline]
    pub fn of_brick(&self, ordinal: u32) -> Owners<'a> {
        let span = (ordinal >> INDEX_SPAN_LOG2) as usize;
        let first = self.index.run_of_span[span] as usize;
        let end = self.index.run_of_span.get(span + 1).map_or(self.starts.len(), |&run| run as usize + 1);
        let run = first + self.starts[first..end].partition_point(|&start| start <= ordinal) - 1;
        let value = self.values[run];
        if value & LIST_FLAG == 0 {
            return Owners::One(value);
        }
        Owners::Several(self.list(value))
    }

    /// The pairs of the list that a run's value names.
    #[inline]
    fn list(&self, value: u32) -> &'a [u64] {
        let list = &self.lists[2 * (value & !LIST_FLAG) as usize..];
        let length = list.chunks_exact(2).take_while(|pair| pair[0] & LAST_FLAG == 0).count() + 1;
        &list[..2 * length]
    }
}
