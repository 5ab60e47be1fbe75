//! Counts by class, and the table of them.

use std::ops::{Index, IndexMut};

use super::classes::Class;

/// What is counted, in the order of the table's columns.
#[derive(Clone, Copy, Debug)]
pub enum Count {
    Rays,
    /// Rays with at least one hit.
    Hitting,
    /// Hits on one path.
    Hits,
    /// Casts: a ray on a path with an instruction set.
    Packet,
    Single,
    Batch,
    /// Rays that went through the reference and every path.
    Reference,
    /// Rays judged by the exact oracle, and by the one in f64.
    Exact,
    Float,
    /// Rays of which a path gave an answer of its own.
    Differing,
    /// See [`super::oracles::Verdict`].
    Missed,
    Wrong,
    /// Hits with a smaller t than the one before.
    Backwards,
    /// Hits that were no step onwards.
    Repeated,
    /// Rays with more hits than a line can have.
    Endless,
    /// No failure, see [`super::oracles::Verdict`].
    Grazed,
}

const NAMES: [&str; 16] = [
    "rays",
    "hitting",
    "hits",
    "packet",
    "single",
    "batch",
    "reference",
    "exact",
    "f64",
    "differing",
    "missed",
    "wrong",
    "backwards",
    "repeated",
    "endless",
    "(grazed)",
];

/// Of one class of rays.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally([u64; NAMES.len()]);

impl Index<Count> for Tally {
    type Output = u64;
    fn index(&self, count: Count) -> &u64 {
        &self.0[count as usize]
    }
}

impl IndexMut<Count> for Tally {
    fn index_mut(&mut self, count: Count) -> &mut u64 {
        &mut self.0[count as usize]
    }
}

impl Tally {
    fn add(&mut self, other: &Tally) {
        self.0.iter_mut().zip(other.0).for_each(|(n, other)| *n += other);
    }

    fn print(&self, name: &str) {
        println!("{name:18}{}", self.0.map(|n| format!(" {n:>10}")).concat());
    }
}

/// One tally a class.
#[derive(Clone, Debug, Default)]
pub struct Tallies([Tally; Class::ALL.len()]);

impl Tallies {
    pub fn of(&mut self, class: Class) -> &mut Tally {
        &mut self.0[class as usize]
    }

    pub fn plus(mut self, other: Tallies) -> Tallies {
        for (tally, other) in self.0.iter_mut().zip(&other.0) {
            tally.add(other);
        }
        self
    }

    pub fn total(&self) -> Tally {
        let mut total = Tally::default();
        self.0.iter().for_each(|tally| total.add(tally));
        total
    }

    /// Classes of which a check saw nothing: their zeros mean nothing.
    pub fn untested(&self) -> Vec<&'static str> {
        let is_seen = |class: Class| {
            let seen = |count| self.0[class as usize][count] > 0;
            let judged = seen(Count::Exact) && seen(Count::Float);
            seen(Count::Hitting) && seen(Count::Reference) && (judged || !class.can_be_judged())
        };
        Class::ALL.iter().filter(|class| !is_seen(**class)).map(|class| class.name()).collect()
    }

    pub fn print(&self) {
        println!("{:18}{}", "class", NAMES.map(|name| format!(" {name:>10}")).concat());
        Class::ALL.iter().for_each(|class| self.0[*class as usize].print(class.name()));
        self.total().print("total");
    }
}
