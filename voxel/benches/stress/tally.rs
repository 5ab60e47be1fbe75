//! Counts by class, and the table of them.

use crate::classes::Class;
use crate::oracles::Verdict;

/// Of one class of rays.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    pub rays: u64,
    /// Voxels met by the packets.
    pub hits: u64,
    /// Rays with at least one hit.
    pub hitting: u64,
    pub packet_casts: u64,
    pub single_casts: u64,
    /// Rays cast by the reference too, and by all paths.
    pub reference: u64,
    pub exact: u64,
    pub float: u64,
    /// Rays of which two paths gave different answers.
    pub different: u64,
    /// Of the oracles.
    pub verdict: Verdict,
    pub backwards: u64,
    pub repeated: u64,
    pub endless: u64,
}

impl Tally {
    fn add(&mut self, other: &Tally) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.hitting += other.hitting;
        self.packet_casts += other.packet_casts;
        self.single_casts += other.single_casts;
        self.reference += other.reference;
        self.exact += other.exact;
        self.float += other.float;
        self.different += other.different;
        self.verdict.missed += other.verdict.missed;
        self.verdict.wrong += other.verdict.wrong;
        self.verdict.grazed += other.verdict.grazed;
        self.backwards += other.backwards;
        self.repeated += other.repeated;
        self.endless += other.endless;
    }

    fn columns(&self) -> [u64; 15] {
        [
            self.rays,
            self.hitting,
            self.hits,
            self.packet_casts,
            self.single_casts,
            self.reference,
            self.exact,
            self.float,
            self.different,
            self.verdict.missed,
            self.verdict.wrong,
            self.backwards,
            self.repeated,
            self.endless,
            self.verdict.grazed,
        ]
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
        let seen = |class: Class| {
            let tally = &self.0[class as usize];
            let judged = tally.exact > 0 && tally.float > 0;
            tally.hitting > 0 && tally.reference > 0 && (judged || !class.can_be_judged())
        };
        Class::ALL.iter().filter(|class| !seen(**class)).map(|class| class.name()).collect()
    }

    pub fn print(&self) {
        let names = [
            "rays",
            "hit",
            "hits",
            "packet",
            "single",
            "reference",
            "exact",
            "f64",
            "differ",
            "missed",
            "wrong",
            "backwards",
            "repeated",
            "endless",
            "(grazed)",
        ];
        print!("{:18}", "class");
        names.iter().for_each(|name| print!(" {name:>10}"));
        println!();
        let row = |name: &str, tally: &Tally| {
            print!("{name:18}");
            tally.columns().iter().for_each(|n| print!(" {n:>10}"));
            println!();
        };
        for class in Class::ALL {
            row(class.name(), &self.0[class as usize]);
        }
        row("total", &self.total());
    }
}
