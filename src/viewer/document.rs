//! An opened scene and what a user has done with it. Every change can be undone.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use glam::{DAffine3, DVec3};

use crate::camera::Plane;
use crate::filter::Filter;
use crate::loaded::LoadedScene;
use crate::moved::Motions;
use crate::shown::Shown;

/// Changes that can be undone, at most.
const MOST_UNDONE: usize = 200;

/// Objects, a bit each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectSet {
    words: Vec<u64>,
    count: u32,
}

impl ObjectSet {
    /// Adds or takes away an object.
    pub fn set(&mut self, object: u32, is_in: bool) {
        if self.has(object) == is_in {
            return;
        }
        let (word, bit) = (object as usize / 64, 1 << (object % 64));
        if self.words.len() <= word {
            self.words.resize(word + 1, 0);
        }
        self.words[word] ^= bit;
        if is_in { self.count += 1 } else { self.count -= 1 }
    }

    /// Is an object in it?
    pub fn has(&self, object: u32) -> bool {
        self.words.get(object as usize / 64).is_some_and(|word| word >> (object % 64) & 1 == 1)
    }

    /// How many there are.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// How many of a range are in it.
    pub fn count_of(&self, objects: Range<u32>) -> u32 {
        let (first, last) = (objects.start as usize / 64, objects.end as usize / 64);
        let within = |word: usize| {
            let below = |end: u32| if end as usize / 64 > word { u64::MAX } else { (1 << (end % 64)) - 1 };
            let from = if word == first { !((1u64 << (objects.start % 64)) - 1) } else { u64::MAX };
            self.words.get(word).copied().unwrap_or(0) & from & below(objects.end)
        };
        if objects.is_empty() { 0 } else { (first..=last).map(|word| within(word).count_ones()).sum() }
    }

    /// All of them, rising.
    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        let bits = |(index, &word): (usize, &u64)| {
            (0..64).filter(move |bit| word >> bit & 1 == 1).map(move |bit| index as u32 * 64 + bit)
        };
        self.words.iter().enumerate().flat_map(bits)
    }

    /// Empties it.
    pub fn clear(&mut self) {
        *self = ObjectSet::default();
    }
}

/// A section plane: what is on its outer side is cut away.
#[derive(Clone, Debug, PartialEq)]
pub struct Section {
    /// As a user calls it.
    pub name: String,
    /// Where it is.
    pub plane: Plane,
    /// Does it cut?
    pub is_on: bool,
}

/// What a user has made of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// Objects that are not shown.
    pub hidden: Arc<ObjectSet>,
    /// Objects that are looked through.
    pub seen_through: Arc<ObjectSet>,
    /// What each moved object has moved by, in the world.
    pub motions: Arc<Motions>,
    /// What is cut away.
    pub sections: Vec<Section>,
}

/// How much of a node is hidden, or looked through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Share {
    /// Nothing of it.
    None,
    /// Some.
    Some,
    /// All of it.
    All,
}

/// A change that was made: its name, and the state before it.
type Undo = (String, Arc<State>);

/// An opened scene and what a user has done with it.
pub struct Document {
    scene: Arc<LoadedScene>,
    state: Arc<State>,
    selected: ObjectSet,
    /// Another number for another state.
    version: u64,
    undo: Vec<Undo>,
    redo: Vec<Undo>,
    /// The last change may go on: it is one gesture.
    is_open: bool,
    /// Of this state; made when it is first asked for.
    shown: OnceLock<Arc<Shown>>,
}

impl Document {
    /// As the file has it.
    pub fn new(scene: Arc<LoadedScene>) -> Self {
        Document {
            scene,
            state: Arc::default(),
            selected: ObjectSet::default(),
            version: 0,
            undo: Vec::new(),
            redo: Vec::new(),
            is_open: false,
            shown: OnceLock::new(),
        }
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<LoadedScene> {
        &self.scene
    }

    /// What a user has made of it.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Selected objects.
    pub fn selected(&self) -> &ObjectSet {
        &self.selected
    }

    /// Another number for another state; the selection does not count.
    pub fn version(&self) -> u64 {
        self.version
    }

    // --- Changes ---

    /// Changes the state; the change is called `name` where it can be undone. One that changes nothing leaves nothing behind.
    pub fn change(&mut self, name: &str, change: impl FnOnce(&mut State)) {
        let mut state = State::clone(&self.state);
        change(&mut state);
        if state == *self.state {
            return;
        }
        let before = self.replace(Arc::new(state));
        self.undo.push((name.to_owned(), before));
        if self.undo.len() > MOST_UNDONE {
            self.undo.remove(0);
        }
        self.redo.clear();
        self.is_open = false;
    }

    /// Takes over another state; the one before.
    fn replace(&mut self, state: Arc<State>) -> Arc<State> {
        self.version += 1;
        self.shown = OnceLock::new();
        std::mem::replace(&mut self.state, state)
    }

    /// As [`Document::change`], but one with the last change if that was made so by the same name and nothing came between: what a drag
    /// does bit by bit is undone at once. [`Document::end_gesture`] ends it.
    pub fn change_on(&mut self, name: &str, change: impl FnOnce(&mut State)) {
        let count = self.undo.len();
        let goes_on = self.is_open && self.undo.last().is_some_and(|(last, _)| last == name);
        self.change(name, change);
        if goes_on && self.undo.len() > count {
            self.undo.pop();
            // Back where it began, it has changed nothing.
            if self.undo.last().is_some_and(|(_, before)| *before == self.state) {
                self.undo.pop();
            }
        }
        self.is_open = true;
    }

    /// What comes now is another change, whatever its name.
    pub fn end_gesture(&mut self) {
        self.is_open = false;
    }

    /// Takes the last change back. Tells its name.
    pub fn undo(&mut self) -> Option<String> {
        let (name, before) = self.undo.pop()?;
        self.is_open = false;
        let after = self.replace(before);
        self.redo.push((name.clone(), after));
        Some(name)
    }

    /// Makes a change again that was taken back. Tells its name.
    pub fn redo(&mut self) -> Option<String> {
        let (name, after) = self.redo.pop()?;
        self.is_open = false;
        let before = self.replace(after);
        self.undo.push((name.clone(), before));
        Some(name)
    }

    /// What [`Document::undo`] would take back, and [`Document::redo`] make again.
    pub fn undoable(&self) -> (Option<&str>, Option<&str>) {
        fn last(list: &[Undo]) -> Option<&str> {
            list.last().map(|(name, _)| name.as_str())
        }
        (last(&self.undo), last(&self.redo))
    }

    /// Objects of a node and of all below it.
    pub fn objects_of(&self, node: u32) -> Range<u32> {
        self.scene.scene().subtree_objects(node)
    }

    /// Hides objects, or shows them.
    pub fn set_hidden(&mut self, objects: impl IntoIterator<Item = u32>, is_hidden: bool) {
        self.change(if is_hidden { "Hide" } else { "Show" }, |state| {
            let hidden = Arc::make_mut(&mut state.hidden);
            objects.into_iter().for_each(|object| hidden.set(object, is_hidden));
        });
    }

    /// Looks through objects (x-ray), or does not any more.
    pub fn set_seen_through(&mut self, objects: impl IntoIterator<Item = u32>, is_seen_through: bool) {
        self.change(if is_seen_through { "X-ray" } else { "Opaque" }, |state| {
            let seen_through = Arc::make_mut(&mut state.seen_through);
            objects.into_iter().for_each(|object| seen_through.set(object, is_seen_through));
        });
    }

    /// Shows these objects and hides all others.
    pub fn isolate(&mut self, objects: impl IntoIterator<Item = u32>) {
        let count = self.scene.scene().objects().len() as u32;
        self.change("Isolate", |state| {
            let mut hidden = ObjectSet::default();
            (0..count).for_each(|object| hidden.set(object, true));
            objects.into_iter().for_each(|object| hidden.set(object, false));
            state.hidden = Arc::new(hidden);
        });
    }

    /// Shows everything, and looks through nothing.
    pub fn show_all(&mut self) {
        self.change("Show all", |state| {
            state.hidden = Arc::default();
            state.seen_through = Arc::default();
        });
    }

    /// Moves objects in the world, after what they have moved by before.
    pub fn move_by(&mut self, name: &str, objects: &ObjectSet, motion: DAffine3) {
        self.change(name, |state| {
            let motions = Arc::make_mut(&mut state.motions);
            for object in objects.iter() {
                let before = motions.get(&object).copied().unwrap_or(DAffine3::IDENTITY);
                motions.insert(object, motion * before);
            }
        });
    }

    /// As [`Document::move_by`], from where `before` has them, and one with the last change where that is of the same name: for what
    /// is dragged.
    pub fn drag_by(&mut self, name: &str, objects: &ObjectSet, before: &Motions, motion: DAffine3) {
        self.change_on(name, |state| {
            let motions = Arc::make_mut(&mut state.motions);
            for object in objects.iter() {
                let before = before.get(&object).copied();
                if before.is_none() && motion == DAffine3::IDENTITY {
                    motions.remove(&object);
                } else {
                    motions.insert(object, motion * before.unwrap_or(DAffine3::IDENTITY));
                }
            }
        });
    }

    /// Moves objects back to where the file has them.
    pub fn move_back(&mut self, objects: &ObjectSet) {
        self.change("Move back", |state| {
            Arc::make_mut(&mut state.motions).retain(|object, _| !objects.has(*object));
        });
    }

    // --- Selection ---

    /// Selects these objects alone.
    pub fn select(&mut self, objects: impl IntoIterator<Item = u32>) {
        self.selected.clear();
        self.add(objects);
    }

    /// Adds objects to the selection.
    pub fn add(&mut self, objects: impl IntoIterator<Item = u32>) {
        objects.into_iter().for_each(|object| self.selected.set(object, true));
    }

    /// Adds objects to the selection, or where all of them are selected, takes them away.
    pub fn toggle(&mut self, objects: impl IntoIterator<Item = u32> + Clone) {
        let are_in = objects.clone().into_iter().all(|object| self.selected.has(object));
        objects.into_iter().for_each(|object| self.selected.set(object, !are_in));
    }

    // --- What follows ---

    /// How much of a node is hidden.
    pub fn hidden_share(&self, node: u32) -> Share {
        share(&self.state.hidden, self.objects_of(node))
    }

    /// How much of a node is looked through.
    pub fn seen_through_share(&self, node: u32) -> Share {
        share(&self.state.seen_through, self.objects_of(node))
    }

    /// The planes that cut.
    pub fn planes(&self) -> impl Iterator<Item = Plane> + '_ {
        self.state.sections.iter().filter(|section| section.is_on).map(|section| section.plane)
    }

    /// The scene as it is shown.
    pub fn shown(&self) -> Arc<Shown> {
        Arc::clone(self.shown.get_or_init(|| Arc::new(self.show())))
    }

    fn show(&self) -> Shown {
        let scene = self.scene.scene();
        let mut filter = Filter::default();
        self.planes().for_each(|plane| filter.clip_by(plane));
        for object in self.state.hidden.iter() {
            scene.object_drawables(object).for_each(|drawable| filter.set_hidden(drawable, true));
        }
        for object in self.state.seen_through.iter() {
            scene.object_drawables(object).for_each(|drawable| filter.set_seen_through(drawable, true));
        }
        Shown::new(Arc::clone(&self.scene), filter, &self.state.motions)
    }

    /// World-space box of objects, where they are now; `None` of none.
    pub fn bounds(&self, objects: impl IntoIterator<Item = u32>) -> Option<(DVec3, DVec3)> {
        let all = self.scene.scene().objects();
        let bounds = objects.into_iter().map(|object| {
            let record = &all[object as usize];
            let (min, max) = (DVec3::from(record.min), DVec3::from(record.max));
            match self.state.motions.get(&object) {
                Some(motion) => crate::exact::transformed_box(motion, min, max),
                None => (min, max),
            }
        });
        bounds.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }
}

fn share(set: &ObjectSet, objects: Range<u32>) -> Share {
    match set.count_of(objects.clone()) {
        0 => Share::None,
        count if count == objects.len() as u32 => Share::All,
        _ => Share::Some,
    }
}

/// Triangles of an object at each level, finest first: those of chunks with fewer levels count with their coarsest.
pub fn triangles_by_level(scene: &LoadedScene, object: u32) -> Vec<u64> {
    let all = scene.scene();
    let part = &all.parts()[all.objects()[object as usize].part as usize];
    let chunks = &all.chunks()[part.first_chunk as usize..][..part.chunk_count as usize];
    let deepest = chunks.iter().map(|chunk| chunk.level_count).max().unwrap_or(0);
    let of_level = |level: u32| {
        let of_chunk = |chunk: &crate::container::layout::ChunkRecord| {
            let page = chunk.first_level + level.min(chunk.level_count - 1);
            u64::from(all.levels()[page as usize].triangle_count)
        };
        chunks.iter().map(of_chunk).sum()
    };
    (0..deepest).map(of_level).collect()
}

/// What was changed, for people: `12 hidden, 3 moved`; nothing where nothing was.
pub fn describe(state: &State) -> String {
    let sections = state.sections.iter().filter(|section| section.is_on).count();
    let counts = [
        (state.hidden.count() as usize, "hidden"),
        (state.seen_through.count() as usize, "x-rayed"),
        (state.motions.len(), "moved"),
        (sections, "sections"),
    ];
    let told = counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    told.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_count_what_they_hold() {
        let mut random = oorandom::Rand32::new(7);
        let (mut set, mut list) = (ObjectSet::default(), vec![false; 300]);
        for round in 0..4000 {
            let (object, is_in) = (random.rand_range(0..300), random.rand_u32() & 1 == 1);
            set.set(object, is_in);
            list[object as usize] = is_in;
            let (a, b) = (random.rand_range(0..301), random.rand_range(0..301));
            let range = a.min(b)..a.max(b);
            let expected = range.clone().filter(|&object| list[object as usize]).count();
            assert_eq!(set.count_of(range.clone()) as usize, expected, "seed 7, round {round}: {range:?}");
            assert_eq!(set.count() as usize, list.iter().filter(|is_in| **is_in).count());
        }
        let expected: Vec<u32> = (0..300).filter(|&object| list[object as usize]).collect();
        assert_eq!(set.iter().collect::<Vec<_>>(), expected);
        set.clear();
        assert_eq!(set.count_of(0..300), 0);
    }
}
