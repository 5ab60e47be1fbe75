//! An opened scene and what a user has done with it. Every change can be undone.

mod objects;
mod showing;

use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::{DAffine3, DVec3};

pub use objects::ObjectSet;
use showing::Showing;

use crate::camera::Plane;
use crate::human::grouped;
use crate::loaded::LoadedScene;
use crate::moved::Motions;
use crate::shown::Shown;

/// Changes that can be undone, at most.
const MOST_UNDONE: usize = 200;

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
    /// Of this state, or of one before while it is being made.
    showing: Showing,
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
            showing: Showing::new(&scene),
            scene,
            state: Arc::default(),
            selected: ObjectSet::default(),
            version: 0,
            undo: Vec::new(),
            redo: Vec::new(),
            is_open: false,
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
        self.showing.replace(&self.state, &state);
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
        let dragged = objects.iter().filter_map(|object| {
            let before = before.get(&object).copied();
            let is_back = before.is_none() && motion == DAffine3::IDENTITY;
            (!is_back).then(|| (object, motion * before.unwrap_or(DAffine3::IDENTITY)))
        });
        let others = before.iter().filter(|(object, _)| !objects.has(**object));
        // Many are quicker made into a new map than looked up in one by one.
        let motions: Motions = others.map(|(object, motion)| (*object, *motion)).chain(dragged).collect();
        self.change_on(name, |state| state.motions = Arc::new(motions));
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

    /// The scene as it is shown in this state; made now if it was not yet, which takes a second for a million moved parts.
    pub fn shown(&self) -> Arc<Shown> {
        self.showing.now(&self.scene, &self.state)
    }

    /// The same without waiting: where making it takes long a thread does, and the one before is told until it has. Is it of this
    /// state?
    pub fn shown_soon(&mut self) -> (Arc<Shown>, bool) {
        self.showing.soon(&self.scene, &self.state)
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
    let told = counts
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{} {what}", grouped(*count as u64)));
    told.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plant, as small as can be.
    fn document() -> Document {
        document_of(crate::sample::plant(&crate::sample::PlantSettings {
            objects: 30,
            triangles: 3000,
            seed: 1,
        }))
    }

    fn document_of(model: crate::model::Model) -> Document {
        use crate::prepare::{BuildSettings, Resolution, build};
        use crate::progress::Silent;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plant.vxs");
        let build_settings = BuildSettings { resolution: Resolution::Log2(6), ..BuildSettings::default() };
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

    #[test]
    fn what_takes_long_is_made_by_a_thread_and_seen_on_its_way() {
        use crate::sample::{PlantSettings, plant};
        let mut document = document_of(plant(&PlantSettings { objects: 6000, triangles: 100_000, seed: 1 }));
        document.select(0..6000);
        let objects = document.selected().clone();
        let (first, _) = document.shown_soon();
        let move_all = |document: &mut Document, x: f64| {
            document.drag_by("Move", &objects, &Motions::new(), DAffine3::from_translation(DVec3::X * x));
        };
        let x_of = |shown: &Shown| shown.motions().get(&3).map_or(0.0, |motion| motion.translation.x);
        move_all(&mut document, 1.0);
        let (shown, is_newest) = document.shown_soon();
        assert!(!is_newest && Arc::ptr_eq(&shown, &first), "it is not waited for");
        // Dragged on meanwhile: what was begun is seen first, then what is there now.
        move_all(&mut document, 2.0);
        let mut seen = vec![0.0];
        let deadline = std::time::Instant::now() + std::time::Duration::from_secs(60);
        loop {
            assert!(std::time::Instant::now() < deadline, "{seen:?}");
            let (shown, is_newest) = document.shown_soon();
            if seen.last() != Some(&x_of(&shown)) {
                seen.push(x_of(&shown));
            }
            assert_eq!(is_newest, x_of(&shown) == 2.0);
            if is_newest {
                break;
            }
            std::thread::yield_now();
        }
        assert_eq!(seen, [0.0, 1.0, 2.0]);
        assert!(Arc::ptr_eq(&document.shown(), &document.shown_soon().0));
        // A plane, and little that is moved, are there at once.
        let plane = Plane { normal: DVec3::X, point: DVec3::ONE };
        document.change("Add section", |state| {
            state.sections.push(Section { name: "a".into(), plane, is_on: true });
        });
        let (shown, is_newest) = document.shown_soon();
        assert!(is_newest && shown.filter().clip_planes() == [plane] && x_of(&shown) == 2.0);
        document.undo();
        // A plane that is added while parts are made ready cuts what has become of them.
        move_all(&mut document, 3.0);
        assert!(!document.shown_soon().1);
        document.change("Add section", |state| {
            state.sections.push(Section { name: "a".into(), plane, is_on: true });
        });
        while !document.shown_soon().1 {
            std::thread::yield_now();
        }
        let (shown, _) = document.shown_soon();
        assert!(shown.filter().clip_planes() == [plane] && x_of(&shown) == 3.0);
        document.undo();
        document.end_gesture();
        // What is taken back while it is made ready is not seen.
        move_all(&mut document, 4.0);
        assert!(!document.shown_soon().1);
        while document.undo().is_some() {}
        let (none, is_newest) = document.shown_soon();
        assert!(is_newest && none.moved().is_none());
        move_all(&mut document, 5.0);
        while !document.shown_soon().1 {
            assert!([0.0, 5.0].contains(&x_of(&document.shown_soon().0)));
        }
        // Nor is it where it goes back to another that takes long: that one is still there.
        document.end_gesture();
        move_all(&mut document, 6.0);
        assert!(!document.shown_soon().1);
        document.undo();
        let (shown, is_newest) = document.shown_soon();
        assert!(is_newest && x_of(&shown) == 5.0);
        while document.showing.is_making() {
            assert_eq!(x_of(&document.shown_soon().0), 5.0);
        }
    }
}
