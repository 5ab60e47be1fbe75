//! An opened scene and what a user has done with it. Every change can be undone.

use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

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
            let rest = |word: &u64| Some(word & (word - 1)).filter(|&rest| rest != 0);
            let words = std::iter::successors(Some(word).filter(|&word| word != 0), rest);
            words.map(move |word| index as u32 * 64 + word.trailing_zeros())
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
    /// Another number for another selection.
    selection: u64,
    /// Of this state and selection; likewise.
    middle: OnceLock<Option<DVec3>>,
    /// The box of the node that was last asked about, in this state: of an assembly it takes long.
    node_box: Mutex<Option<(u32, Bounds)>>,
}

/// Corners of a box; `None` of nothing.
type Bounds = Option<(DVec3, DVec3)>;

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
            selection: 0,
            middle: OnceLock::new(),
            node_box: Mutex::new(None),
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
        // Where planes alone are others, the rest is taken over: one is dragged.
        let alike = Arc::ptr_eq(&state.hidden, &self.state.hidden)
            && Arc::ptr_eq(&state.seen_through, &self.state.seen_through)
            && Arc::ptr_eq(&state.motions, &self.state.motions);
        let shown = self.shown.take().filter(|_| alike);
        self.shown = shown.map_or_else(OnceLock::new, |shown| {
            OnceLock::from(Arc::new(shown.with_planes(planes(&state).collect())))
        });
        self.middle = OnceLock::new();
        self.node_box = Mutex::new(None);
        std::mem::replace(&mut self.state, state)
    }

    /// As [`Document::change`], but one with the last change if that was made so by the same name and nothing came between: what a drag
    /// does bit by bit is undone at once. [`Document::end_gesture`] ends it.
    pub fn change_on(&mut self, name: &str, change: impl FnOnce(&mut State)) {
        let goes_on = self.is_open && self.undo.last().is_some_and(|(last, _)| last == name);
        if !goes_on {
            let before = self.version;
            self.change(name, change);
            self.is_open = self.version != before;
            return;
        }
        let mut state = State::clone(&self.state);
        change(&mut state);
        if state == *self.state {
            return;
        }
        self.replace(Arc::new(state));
        // Back where it began, it has changed nothing.
        if self.undo.last().is_some_and(|(_, before)| *before == self.state) {
            self.undo.pop();
            self.is_open = false;
        }
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

    /// Another number for another selection.
    pub fn selection_version(&self) -> u64 {
        self.selection
    }

    fn selection_changes(&mut self) {
        self.selection += 1;
        self.middle = OnceLock::new();
    }

    /// Selects these objects alone.
    pub fn select(&mut self, objects: impl IntoIterator<Item = u32>) {
        self.selected.clear();
        self.add(objects);
    }

    /// Adds objects to the selection.
    pub fn add(&mut self, objects: impl IntoIterator<Item = u32>) {
        self.selection_changes();
        objects.into_iter().for_each(|object| self.selected.set(object, true));
    }

    /// Adds objects to the selection, or where all of them are selected, takes them away.
    pub fn toggle(&mut self, objects: impl IntoIterator<Item = u32> + Clone) {
        self.selection_changes();
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
        planes(&self.state)
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
        Shown::new(Arc::clone(&self.scene), filter, Arc::clone(&self.state.motions))
    }

    /// The mean of the selected parts' own middles, where they are now; `None` where nothing is selected. It turns with them: back and
    /// forth ends where it began.
    pub fn middle_of_selection(&self) -> Option<DVec3> {
        *self.middle.get_or_init(|| {
            let middles = self.selected.iter().filter_map(|object| self.bounds([object]));
            let sum: DVec3 = middles.map(|(min, max)| 0.5 * (min + max)).sum();
            (self.selected.count() > 0).then(|| sum / f64::from(self.selected.count()))
        })
    }

    /// World-space box of all below a node, where it is now; `None` of nothing.
    pub fn node_bounds(&self, node: u32) -> Bounds {
        let mut known = self.node_box.lock().unwrap_or_else(PoisonError::into_inner);
        match *known {
            Some((of, bounds)) if of == node => bounds,
            _ => known.insert((node, self.bounds(self.objects_of(node)))).1,
        }
    }

    /// World-space box of objects, where they are now; `None` of none.
    pub fn bounds(&self, objects: impl IntoIterator<Item = u32>) -> Bounds {
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

/// The planes of a state that cut.
fn planes(state: &State) -> impl Iterator<Item = Plane> + '_ {
    state.sections.iter().filter(|section| section.is_on).map(|section| section.plane)
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
        (sections, if sections == 1 { "section" } else { "sections" }),
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

    /// A plant, as small as can be.
    fn document() -> Document {
        use crate::prepare::{BuildSettings, Resolution, build};
        use crate::progress::Silent;
        let settings = crate::sample::PlantSettings { objects: 30, triangles: 3000, seed: 1 };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plant.vxs");
        let build_settings = BuildSettings { resolution: Resolution::Log2(6), ..BuildSettings::default() };
        let model = crate::sample::plant(&settings);
        build(model, Vec::new(), Default::default(), &build_settings, &path, &Silent).unwrap();
        let scene = crate::scene::Scene::open(&path).unwrap();
        Document::new(Arc::new(LoadedScene::new(scene, &Silent).unwrap()))
    }

    fn drag(document: &mut Document, x: f64) {
        let mut objects = ObjectSet::default();
        objects.set(3, true);
        let motion = DAffine3::from_translation(DVec3::X * x);
        document.drag_by("Move", &objects, &Motions::new(), motion);
    }

    fn x(document: &Document) -> f64 {
        document.state().motions.get(&3).map_or(0.0, |motion| motion.translation.x)
    }

    #[test]
    fn gestures_are_undone_one_by_one() {
        let mut document = document();
        [1.0, 2.0].iter().for_each(|&at| drag(&mut document, at));
        document.end_gesture();
        // One that begins with nothing, and one that comes back on its way.
        [2.0, 3.0, 4.0].iter().for_each(|&at| drag(&mut document, at));
        document.end_gesture();
        [5.0, 4.0, 6.0].iter().for_each(|&at| drag(&mut document, at));
        document.end_gesture();
        for expected in [4.0, 2.0, 0.0] {
            assert!(document.undo().is_some());
            assert_eq!(x(&document), expected);
        }
        assert!(document.undo().is_none());
        // As many as are kept: a long drag is still one.
        for at in 0..MOST_UNDONE {
            document.set_hidden([at as u32 % 7], at % 14 < 7);
        }
        let count = document.undo.len();
        assert_eq!(count, MOST_UNDONE);
        (1..100).for_each(|at| drag(&mut document, f64::from(at)));
        assert_eq!(document.undo.len(), MOST_UNDONE);
        document.undo();
        assert_eq!((x(&document), document.undo.len()), (0.0, MOST_UNDONE - 1));
        assert_eq!(document.undoable().0, Some("Hide"), "what was done before it is still there");
    }

    #[test]
    fn a_plane_that_moves_leaves_the_rest_as_it_is() {
        let mut document = document();
        document.set_hidden([1, 2], true);
        drag(&mut document, 1.0);
        let before = document.shown();
        let plane = Plane { normal: DVec3::X, point: DVec3::ONE };
        document.change("Add section", |state| {
            state.sections.push(Section { name: "a".into(), plane, is_on: true });
        });
        let after = document.shown();
        assert_eq!(after.filter().clip_planes(), [plane]);
        assert_eq!(after.unmoved().filter.clip_planes(), [plane]);
        assert!(after.filter().is_same_but_for_planes(before.filter()));
        assert_eq!(after.motions(), before.motions());
        // Made anew it is the same.
        let anew = Shown::new(Arc::clone(document.scene()), after.filter().clone(), after.motions().clone());
        let mut random = oorandom::Rand64::new(3);
        let (min, max) = document.bounds(0..30).unwrap();
        for _ in 0..500 {
            let mut point = || {
                min + (max - min) * DVec3::new(random.rand_float(), random.rand_float(), random.rand_float())
            };
            let ray = crate::ray::Ray::new(point(), (point() - point()).normalize_or(DVec3::X));
            assert_eq!(after.closest(&ray), anew.closest(&ray));
        }
    }
}
