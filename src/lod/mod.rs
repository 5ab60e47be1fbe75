//! Selection of levels of detail: how fine each visible drawable shall be drawn.
//!
//! Two policies share one interface. [`density`] (Xue et al. 2016, section 4.2) draws every drawable with about as many triangles a
//! pixel as every other, and as many as the budget allows; it needs the sample counts of a visibility query. [`vertex_budget`]
//! (Peng and Cao 2013, eq. 1) shares out vertices by a closed formula over boxes; it needs no samples.
//!
//! Selection and [streaming](crate::streaming) talk about pairs of drawable and level, and learn what these are from a
//! [`System`]: other systems of levels than the chunks of the container can stand behind it.

pub mod density;
pub mod levels;
pub mod vertex_budget;
mod view;

pub use levels::ChunkLevels;
pub use view::{Candidate, candidates};

/// One level of a drawable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Triangles, at least 1; a finer level never has fewer.
    pub triangles: u32,
    /// Vertices, at least 1.
    pub vertices: u32,
    /// How far it may be from level 0, world units: 0 for level 0; a coarser level's is never less.
    pub error: f64,
    /// What holds its geometry: drawables that place the same chunk share pages.
    pub page: u32,
}

/// A system of levels of detail, as selection and streaming see it.
pub trait System: Sync {
    /// Drawables.
    fn drawable_count(&self) -> u32;

    /// Pages: numbers of pages are below this.
    fn page_count(&self) -> u32;

    /// Levels of a drawable, at least 1; level 0 is the finest.
    fn level_count(&self, drawable: u32) -> u32;

    /// One of them.
    fn level(&self, drawable: u32, level: u32) -> Level;
}

/// A drawable and the level at which it shall be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Choice {
    /// Which drawable.
    pub drawable: u32,
    /// At which level.
    pub level: u32,
}

/// What a policy has chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Rising by drawable.
    pub choices: Vec<Choice>,
    /// Of all choices together.
    pub triangles: u64,
    /// Of all choices together.
    pub vertices: u64,
    /// Visible drawables that are too small to be drawn: below the threshold of pixels.
    pub below_threshold: u32,
    /// Visible drawables that do not fit into the budget even at their coarsest levels.
    pub beyond_budget: u32,
}

impl Selection {
    /// Adds a choice.
    fn push(&mut self, system: &dyn System, choice: Choice) {
        let level = system.level(choice.drawable, choice.level);
        self.choices.push(choice);
        self.triangles += u64::from(level.triangles);
        self.vertices += u64::from(level.vertices);
    }

    /// The level of a drawable, if it is drawn.
    pub fn level_of(&self, drawable: u32) -> Option<u32> {
        let at = self.choices.binary_search_by_key(&drawable, |choice| choice.drawable).ok()?;
        Some(self.choices[at].level)
    }
}
