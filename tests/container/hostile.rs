//! Bytes that were made to hurt.

use super::*;

/// A container as bytes, to be changed and made to look sound again.
struct Forgery(Vec<u8>);

impl Forgery {
    fn get<T: Pod>(&self, at: usize) -> Option<T> {
        self.0.get(at..at.checked_add(size_of::<T>())?).map(bytemuck::pod_read_unaligned)
    }

    fn put<T: Pod>(&mut self, at: usize, value: T) {
        self.0[at..at + size_of::<T>()].copy_from_slice(bytemuck::bytes_of(&value));
    }

    fn entry_at(kind: SectionKind) -> usize {
        size_of::<Header>() + kind.index() * size_of::<SectionEntry>()
    }

    fn entry(&self, kind: SectionKind) -> SectionEntry {
        self.get(Self::entry_at(kind)).unwrap()
    }

    fn section(&self, kind: SectionKind) -> Option<&[u8]> {
        let SectionEntry { offset, length, .. } = self.entry(kind);
        self.0.get(offset as usize..offset.checked_add(length)? as usize)
    }

    /// Makes the checksums of pages right.
    fn seal_pages(&mut self) {
        let (levels, geometry) = (self.entry(SectionKind::Levels), self.entry(SectionKind::Geometry));
        for i in 0..levels.length as usize / size_of::<LevelRecord>() {
            let at = levels.offset as usize + i * size_of::<LevelRecord>();
            let Some(mut record) = self.get::<LevelRecord>(at) else { return };
            let start = geometry.offset.wrapping_add(record.page_offset) as usize;
            let end = start.wrapping_add(record.vertex_bytes as usize + record.index_bytes as usize);
            if let Some(page) = self.0.get(start..end) {
                record.checksum = xxh3_64(page);
                self.put(at, record);
            }
        }
    }

    /// Makes the checksums of sections and header right, so that the checks behind them are reached.
    fn seal(&mut self) {
        for kind in SectionKind::ALL {
            if let Some(section) = self.section(kind) {
                let entry = SectionEntry { checksum: xxh3_64(section), ..self.entry(kind) };
                self.put(Self::entry_at(kind), entry);
            }
        }
        let header: Header = self.get(0).unwrap();
        self.put(0, Header { checksum: 0, ..header });
        let checksum = xxh3_64(&self.0[..TABLE_END as usize]);
        self.put(0, Header { checksum, ..header });
    }
}

/// Uses everything that a reader can ask a scene for.
fn use_all(path: &Path) -> Result<u64, ContainerError> {
    let scene = Scene::open(path)?;
    let mut sum = 0;
    for (i, node) in (0..).zip(scene.nodes()) {
        sum += (scene.node_path(i).len() + scene.name(node.extras).len()) as u64;
        sum += scene.children(i).count() as u64 + scene.subtree_objects(i).len() as u64;
    }
    sum += (scene.find("bolt").count() + scene.find("t/b").count() + scene.roots().count()) as u64;
    for (i, drawable) in (0..).zip(scene.drawables()) {
        assert_eq!(scene.drawable_object(i), drawable.object);
        assert!(scene.object_drawables(drawable.object).contains(&i));
        let (chunk, object) = (drawable.chunk, &scene.objects()[drawable.object as usize]);
        assert_eq!(scene.chunk_part(chunk), object.part);
        assert!(scene.world_from_part(drawable.object).is_finite());
        let chunk = &scene.chunks()[chunk as usize];
        for level in chunk.first_level..chunk.first_level + chunk.level_count {
            if let Ok(mesh) = scene.level_mesh(level) {
                assert!(scene.level_positions(level, &mesh).iter().all(|p| p.is_finite()));
                assert!(mesh.triangles.as_flattened().iter().all(|&v| (v as usize) < mesh.vertices.len()));
            }
        }
    }
    let bounds = scene.meta().bounds;
    let loaded = LoadedScene::new(scene, &Silent)?;
    for from in [DVec3::new(1.0, 0.3, 0.2), DVec3::new(-0.1, 0.2, 1.0)] {
        let camera = Camera::around(bounds.min.into(), bounds.max.into(), from, DVec3::Y, 8, 8);
        // The box may be a point too small for a camera.
        let Ok(rays) = camera.rays() else { continue };
        for method in [Method::Voxel, Method::Hybrid, Method::Exact, Method::Frustum] {
            sum += query(&loaded.query(), &rays, method, &QuerySettings::default()).hits;
        }
    }
    Ok(sum)
}

#[test]
fn sealed_forgeries_never_panic() {
    const INTERESTING: [u32; 12] =
        [0, 1, 2, 3, 7, 255, 65_536, 1 << 24, i32::MAX as u32, 1 << 31, u32::MAX - 1, u32::MAX];
    let (folder, path) = sample();
    let original = fs::read(&path).unwrap();
    let forged = folder.path().join("forged.vxs");
    let (mut opened, mut sound, trials) = (0, 0, 6_000);
    for seed in 0..trials {
        let mut random = oorandom::Rand32::new(seed);
        let mut forgery = Forgery(original.clone());
        for _ in 0..random.rand_range(1..4) {
            // Mostly the records and pages; now and then the table, or anything.
            let range = match random.rand_range(0..10) {
                0 => 64..TABLE_END as usize,
                1 => 0..original.len(),
                _ => {
                    let kind = SectionKind::ALL[random.rand_range(0..13) as usize];
                    let SectionEntry { offset, length, .. } = Forgery(original.clone()).entry(kind);
                    offset as usize..(offset + length) as usize
                }
            };
            let at = random.rand_range(range.start as u32..range.end as u32) as usize;
            let word = at & !3;
            match (random.rand_range(0..4), forgery.get::<u32>(word)) {
                (0, Some(_)) => forgery.put(word, INTERESTING[random.rand_range(0..12) as usize]),
                (1, Some(old)) => {
                    forgery.put(word, old.wrapping_add(random.rand_range(0..5)).wrapping_sub(2))
                }
                (2, Some(old)) => forgery.put(word, old ^ 1 << random.rand_range(0..32)),
                _ => forgery.0[at] = random.rand_u32() as u8,
            }
        }
        forgery.seal_pages();
        forgery.seal();
        fs::write(&forged, &forgery.0).unwrap();
        let outcome = std::panic::catch_unwind(|| (use_all(&forged).is_ok(), check(&forged).is_ok()));
        let (used, verified) = outcome.unwrap_or_else(|_| panic!("panicked on seed {seed}"));
        assert!(used || !verified, "seed {seed}: verify passed what does not open");
        opened += u32::from(used);
        sound += u32::from(verified);
    }
    // The trials reach all three outcomes, else they test little.
    assert!(
        sound > 100 && opened > sound + 100 && opened < trials as u32 - 1_000,
        "{opened} {sound} of {trials}"
    );
}

#[test]
fn forged_records_are_named_with_place_expected_and_found() {
    let (folder, path) = sample();
    let original = fs::read(&path).unwrap();
    let forged = folder.path().join("forged.vxs");
    let nan = f32::NAN.to_bits();
    // Section, record, byte in the record, forged word, part of the message.
    let cases = [
        (
            SectionKind::Nodes,
            3,
            16,
            5,
            "record 3 (byte ",
            "expected parent 2, whose subtree this is in, found 5",
        ),
        (SectionKind::Nodes, 2, 20, 9, "record 2", "expected a subtree that ends at 3 to 5, found 9"),
        (SectionKind::Nodes, 0, 20, 5, "record 5", "expected parent none, whose subtree this is in, found 0"),
        (
            SectionKind::Nodes,
            3,
            24,
            0,
            "record 3",
            "expected no object, or one that names this node, found 0",
        ),
        (SectionKind::Nodes, 0, 0, u32::MAX, "record 0", "expected a name inside the strings"),
        (SectionKind::Nodes, 6, 4, 0, "record 6", "not empty"),
        (SectionKind::Parts, 1, 12, u32::MAX, "record 1", "expected first chunk 1, and 1 to 3 of them"),
        (SectionKind::Parts, 0, 16, nan, "record 0", "powers of two"),
        (SectionKind::Parts, 0, 16, 0.75_f32.to_bits(), "record 0", "powers of two"),
        (SectionKind::Parts, 2, 40, nan, "record 2", "0 <= min <= max"),
        (SectionKind::Parts, 2, 52, 2, "record 2", "expected 1 triangles, as its chunks have, found 2"),
        (SectionKind::Objects, 1, 4, 0x7ff0_0000, "record 1", "expected a finite transform"),
        (
            SectionKind::Objects,
            0,
            144,
            3,
            "record 2",
            "expected no object, or one that names this node, found 0",
        ),
        (SectionKind::Objects, 0, 148, 3, "record 0", "expected a part below 3, found 3"),
        (SectionKind::Objects, 4, 152, 4, "record 4", "expected first drawable 5, found 4"),
        (SectionKind::Chunks, 1, 0, u32::MAX, "record 1", "expected offsets of 0 to 2^24 - 1"),
        (SectionKind::Chunks, 0, 16, 2, "record 1", "expected first level 2"),
        (SectionKind::Levels, 1, 0, 1, "record 1", "expected a page at byte"),
        (SectionKind::Levels, 0, 24, u32::MAX, "record 0", "expected 1 to 120 vertices, found 4294967295"),
        (SectionKind::Levels, 0, 28, u32::MAX, "record 0", "expected 1 to 65536 triangles, found 4294967295"),
        (SectionKind::Levels, 1, 32, nan, "record 1", "expected a finite error"),
        (SectionKind::Levels, 2, 32, 0, "record 0", "expected errors that do not shrink, found 0 after 0.5"),
        (SectionKind::Levels, 0, 36, 7, "record 0", "expected encoding 0 or 1 for the vertices, found 7"),
    ];
    for (kind, record, field, word, place, text) in cases {
        let mut forgery = Forgery(original.clone());
        let at = forgery.entry(kind).offset as usize + record * kind.record_size() + field;
        forgery.put(at, word);
        forgery.seal();
        fs::write(&forged, &forgery.0).unwrap();
        let message = Container::open(&forged).expect_err("forged").to_string();
        for part in ["forged.vxs: section \"", place, text, "build it again with `voxsight build`"] {
            assert!(message.contains(part), "{kind:?} {record} {field}: {part:?} is not in: {message}");
        }
    }
}

#[test]
fn verify_names_the_first_bad_page_whatever_the_threads() {
    let (_folder, path) = sample();
    let mut forgery = Forgery(fs::read(&path).unwrap());
    let geometry = forgery.entry(SectionKind::Geometry);
    let levels = forgery.entry(SectionKind::Levels).offset as usize;
    for level in [6, 3, 2] {
        let record: LevelRecord = forgery.get(levels + level * size_of::<LevelRecord>()).unwrap();
        forgery.0[(geometry.offset + record.page_offset) as usize + 1] ^= 4;
    }
    forgery.seal();
    fs::write(&path, &forgery.0).unwrap();
    Container::open(&path).expect("opening does not read pages");
    for threads in [1, 4] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let error = pool.install(|| check(&path)).unwrap_err();
        assert!(matches!(*error.problem, Problem::Page { level: 2, .. }), "{threads} threads: {error}");
    }
}

#[test]
fn verify_sees_a_box_that_is_not_its_parts() {
    let (_folder, path) = sample();
    // The part is nowhere placed: opening compares the boxes of objects with those of their parts.
    let mut model = sample_model();
    model.objects.retain(|object| object.part != 0);
    write_scene(&path, &model, &sample_parts()).unwrap();
    let mut forgery = Forgery(fs::read(&path).unwrap());
    let max_x = forgery.entry(SectionKind::Parts).offset as usize + 40;
    let old: f32 = forgery.get(max_x).unwrap();
    forgery.put(max_x, old + 0.5);
    forgery.seal();
    fs::write(&path, &forgery.0).unwrap();
    Container::open(&path).expect("opening does not decode");
    let message = check(&path).unwrap_err().to_string();
    assert!(
        message.contains("section \"parts\", record 0") && message.contains("as its vertices have"),
        "{message}"
    );
}

/// Changes the sample by `change`, makes its checksums right again, and returns what `verify` says.
fn verify_forged(change: impl FnOnce(&mut Forgery)) -> String {
    let (_folder, path) = sample();
    let mut forgery = Forgery(fs::read(&path).unwrap());
    change(&mut forgery);
    forgery.seal();
    fs::write(&path, &forgery.0).unwrap();
    check(&path).unwrap_err().to_string()
}

#[test]
fn placements_that_mean_nothing_are_not_sound() {
    for (value, text) in
        [(0.0, "expected a finite transform with an inverse"), (1e308, "expected a finite transform")]
    {
        let message = verify_forged(|forgery| {
            let objects = forgery.entry(SectionKind::Objects).offset as usize;
            for number in 0..12 {
                forgery.put(objects + 160 + 8 * number, value);
            }
        });
        assert!(message.contains("\"objects\", record 1") && message.contains(text), "{message}");
    }
    // Moved a little: the box does not follow.
    let message = verify_forged(|forgery| {
        let x = forgery.entry(SectionKind::Objects).offset as usize + 72;
        forgery.put(x, forgery.get::<f64>(x).unwrap() + 0.5);
    });
    assert!(
        message.contains("record 0") && message.contains("expected its part's box in world"),
        "{message}"
    );
    let message = verify_forged(|forgery| {
        let step = forgery.entry(SectionKind::Parts).offset as usize + 16;
        forgery.put(step, 2_f32.powi(46));
    });
    assert!(message.contains("powers of two, 2^-126 to 2^45"), "{message}");
}

#[test]
fn metadata_that_belongs_to_another_scene_is_not_sound() {
    // Written over the old text (and digits after it), so that the sections stay where they are.
    for (old, new, text) in [
        ("\"resolution\": 64", "\"resolution\": 65", "expected a resolution of 64"),
        ("\"max\": [\n      1", "\"max\": [\n      2", "as the objects have"),
        ("\"voxel_size\": 1", "\"voxel_size\": 10", "expected a grid around"),
    ] {
        let message = verify_forged(|forgery| {
            let meta = forgery.section(SectionKind::Meta).unwrap();
            let at = meta.windows(old.len()).position(|window| window == old.as_bytes()).expect(old);
            let at = forgery.entry(SectionKind::Meta).offset as usize + at;
            forgery.0[at..at + new.len()].copy_from_slice(new.as_bytes());
        });
        assert!(message.contains("section \"meta\"") && message.contains(text), "{old}: {message}");
    }
}

#[test]
fn forged_owners_are_refused_or_own_the_voxels_of_their_brick_and_no_others() {
    let (folder, path) = sample();
    let original = Forgery(fs::read(&path).unwrap());
    let (pages, directory) =
        (original.entry(SectionKind::OwnerPages), original.entry(SectionKind::OwnerDirectory));
    let mut refused: BTreeMap<String, u32> = BTreeMap::new();
    let mut accepted = 0;
    for byte in (directory.offset..directory.offset + directory.length)
        .chain(pages.offset..pages.offset + pages.length)
    {
        for bit in 0..8 {
            let mut forgery = Forgery(original.0.clone());
            forgery.0[byte as usize] ^= 1 << bit;
            forgery.seal();
            let forged = folder.path().join("forged.vxs");
            fs::write(&forged, &forgery.0).unwrap();
            match check(&forged) {
                Err(error) => {
                    let message = error.to_string();
                    let rule = message.split("expected ").nth(1).unwrap_or(&message);
                    *refused.entry(rule.split(", found").next().unwrap_or(rule).to_owned()).or_default() += 1;
                }
                Ok(_) => {
                    accepted += 1;
                    let container = Container::open(&forged).unwrap();
                    let (dag, owners) = (container.dag(), container.owners());
                    dag.for_each_brick(|_, ordinal, mask| {
                        let masks = owners.of_brick(ordinal, mask).masks();
                        let union = masks.iter().fold(0, |union, (_, mask)| union | mask);
                        assert!(masks.iter().all(|&(drawable, mask)| drawable < 6 && mask != 0));
                        assert!(masks.is_sorted_by_key(|(drawable, _)| *drawable) && union == mask);
                    });
                }
            }
        }
    }
    for rule in [
        "owner pages cover every brick",
        "the parts of an owner page lie in it",
        "an owner page has a start for each run",
        "an owner is a drawable, and owners of a set rise",
        "an owner run names an entry of its page's palette",
        "owner codes rise and lie in their page",
        "a masked owner run is one brick with several owners",
        "an owner code is as long as its brick's voxels ask for",
    ] {
        assert!(refused.keys().any(|message| message.contains(rule)), "never refused: {rule}; {refused:#?}");
    }
    // Another owner, or another share between two: as good as the true one without the triangles.
    assert!(accepted > 0 && accepted < refused.values().sum::<u32>(), "{accepted} accepted, {refused:#?}");
}

#[test]
fn verify_sees_extras_that_overlap() {
    let (_folder, path) = sample();
    let (strings, extras) = {
        let scene = Scene::open(&path).unwrap();
        (scene.container().section_length(SectionKind::Strings), scene.nodes()[2].extras)
    };
    let message = verify_forged(|forgery| {
        let at = forgery.entry(SectionKind::Strings).offset as usize + extras.offset as usize;
        forgery.0[at..at + extras.length as usize].fill(b'7');
        let nodes = forgery.entry(SectionKind::Nodes).offset as usize;
        // Numbers of 24, 23, ... digits, all of the same digits.
        for node in 0..8 {
            forgery.put(nodes + 32 * node + 8, [extras.offset, extras.length - node as u32]);
        }
    });
    assert!(strings < 8 * u64::from(extras.length - 7));
    assert!(message.contains("expected extras that do not overlap"), "{message}");
}

#[test]
fn verify_stops_when_asked() {
    let (_folder, path) = sample();
    let error = verify(&path, &CancelFlag(&AtomicBool::new(true))).unwrap_err();
    assert!(matches!(*error.problem, Problem::Cancelled), "{error}");
}
