//! Long random sessions: what is left is what the history says from the last load on, whatever was done, and memory stays
//! bounded.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui::accessibility::is_input;
use eframe::egui::{Key, Modifiers, Pos2, Rect, Vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use hairlight::editor::{
    Brush, Canvas, Document, History, Mode, Places, Reach, Step, Stroke, put_file,
};
use hairlight::paint::{Channel, Paint};
use hairlight::scene::{Scene, parse_assignment};
use hairlight::stage::Geometry;
use tempfile::tempdir;

use crate::editor::{Window, drag, editor, key, look, small, window};

/// Set in a process that runs one test alone.
const ALONE: &str = "HAIRLIGHT_TEST_ALONE";

/// Runs the test `name` again in a process of its own, where it finds [`ALONE`] set, and fails as it does. `before` is
/// what a shell does first.
pub fn alone(name: &str, before: &str) {
    let script = format!("{before} exec \"$0\" {name} --exact --include-ignored --nocapture");
    let output = std::process::Command::new("sh")
        .args(["-c", &script])
        .arg(std::env::current_exe().unwrap())
        .env(ALONE, "1")
        .output()
        .unwrap();
    let said =
        [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    println!("{}{}", said[0], said[1]);
    assert!(output.status.success() && said[0].contains("1 passed"), "{name}: {}", output.status);
}

pub fn is_alone() -> bool {
    std::env::var_os(ALONE).is_some()
}

/// Resident memory of this process, bytes.
fn resident() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<usize>().unwrap() << 10
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn below(&mut self, most: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % most as u64) as usize
    }

    fn one_of<'a, T>(&mut self, all: &'a [T]) -> &'a T {
        &all[self.below(all.len())]
    }
}

/// A scene and its paint, without what no step takes back: where the paint is kept, and where the camera is.
type State = (Scene, Option<Paint>);

fn state(document: &Document) -> State {
    let mut scene = document.scene.clone();
    (scene.hair.paint, scene.camera) = (None, Scene::default().camera);
    let mut paint = document.paint.as_deref().cloned();
    if let Some(paint) = &mut paint {
        paint.forget_bare();
    }
    (scene, paint.filter(|paint| !paint.layers().is_empty()))
}

/// Two grooms, whose paint is not each other's.
const STRANDS: [u32; 2] = [1000, 1100];

struct Session {
    random: Random,
    folder: PathBuf,
    stages: [(Geometry, Places); 2],
    document: Document,
    most_bytes: usize,
    history: History,
    /// As it was opened.
    opened: State,
    /// What each file should have.
    saved: [Option<State>; 3],
    counts: [usize; 4],
}

impl Session {
    fn new(folder: &Path, most_bytes: usize, seed: u64) -> Session {
        println!("seed {seed}");
        let stages = STRANDS.map(|strands| {
            let mut scene = small();
            scene.hair.strands = strands;
            let stage = Geometry::load(&scene).unwrap();
            let lens = stage.camera(&scene).unwrap().lens(stage.center, [96, 96]);
            let places = Places::new(&stage, &lens);
            (stage, places)
        });
        // For who opens paint of another groom.
        let mut foreign = Document::new(small(), None);
        foreign.begin_paint(Paint::bare(stages[0].0.groom().points.len()));
        foreign.save(&folder.join("foreign.toml"), Some(stages[0].0.groom())).unwrap();
        std::fs::write(folder.join("bad.toml"), "[fibre]\neta = 9\n").unwrap();
        let mut scene = small();
        // Not beside where tests run: a scene that is kept has its paths whole.
        scene.output.path = folder.join("picture.png").to_string_lossy().into_owned();
        let document = Document::new(scene, None);
        let opened = state(&document);
        Session {
            random: Random(seed),
            folder: folder.to_owned(),
            stages,
            document,
            most_bytes,
            history: History::keeping(most_bytes),
            opened,
            saved: [const { None }; 3],
            counts: [0; 4],
        }
    }

    fn shown(&self) -> usize {
        STRANDS.iter().position(|&n| n == self.document.scene.hair.strands).expect("one of them")
    }

    fn path(&self, k: usize) -> PathBuf {
        self.folder.join(format!("scene-{k}.toml"))
    }

    fn edit(&mut self) {
        let before = self.document.scene.clone();
        let presets = ["black", "blond", "red", "white"];
        let random = &mut self.random;
        let text = match random.below(24) {
            0..6 => format!("fibre.preset={}", random.one_of(&presets)),
            6..12 => format!("fibre.beta_r_deg={}", 1 + random.below(40)),
            12..17 => format!("environment.rotation_deg={}", random.below(360)),
            17..23 => format!("fibre.eta={}", 1.0 + 0.01 * random.below(200) as f64),
            _ => format!("hair.strands={}", random.one_of(&STRANDS)),
        };
        self.document.scene.apply(vec![parse_assignment(&text).unwrap()]).unwrap();
        self.document.follow_hair();
        if before != self.document.scene {
            let [before, after] = [before, self.document.scene.clone()].map(Box::new);
            self.history.push(Step::Scene { before, after });
            self.counts[0] += 1;
        }
    }

    fn stroke(&mut self) {
        let random = &mut self.random;
        let channel = *random.one_of(&Channel::ALL);
        let [least, most] = channel.range();
        let value = [(); 3].map(|()| least + (most - least) * 0.01 * random.below(100) as f32);
        let brush = Brush {
            channel,
            value,
            radius: 0.02 + 0.001 * random.below(60) as f32,
            strength: 0.1 * (1 + random.below(10)) as f32,
            mode: Mode::ALL[random.below(4)],
            reach: Reach::ALL[random.below(3)],
            mirror: random.below(4) == 0,
            gradient: [0.5 * random.below(3) as f32, 1.0],
            ..Brush::default()
        };
        let (stage, places) = &self.stages[self.shown()];
        let points = stage.groom().points.len();
        if self.document.paint.is_none() {
            let paint = stage.paint(&self.document.scene).unwrap();
            self.document.begin_paint(paint.unwrap_or(Paint::bare(points)));
        }
        let paint = self.document.paint.as_mut().unwrap();
        let mut stroke = Stroke::new(&brush, points);
        let canvas = Canvas { places, stage, bare: [1.0, 1.1, 1.2] };
        for _ in 0..1 + self.random.below(3) {
            let place = [(); 2].map(|()| self.random.below(96) as f32 / 96.0);
            stroke.to(place, 0.1 * self.random.below(11) as f32, &canvas, Arc::make_mut(paint));
        }
        if let Some(step) = stroke.step(paint) {
            self.history.push(step);
            self.counts[1] += 1;
        }
    }

    fn save(&mut self) {
        let k = self.random.below(3);
        let (path, hair) = (self.path(k), self.stages[self.shown()].0.groom());
        self.document.save(&path, Some(hair)).unwrap();
        assert!(!self.document.changed());
        let Document { scene, paint, .. } = &self.document;
        assert!(paint.is_some() || scene.hair.paint.is_none(), "paint that is not here");
        self.saved[k] = Some(state(&self.document));
        self.counts[2] += 1;
    }

    fn load(&mut self) {
        let k = self.random.below(3);
        let Some(saved) = self.saved[k].clone() else { return };
        self.document = Document::open(&self.path(k)).unwrap();
        let stage = &self.stages[self.shown()].0;
        if let Some(paint) = stage.paint(&self.document.scene).unwrap() {
            self.document.begin_paint(paint);
        }
        assert!(!self.document.changed());
        let opened = state(&self.document);
        assert!(opened.0 == saved.0, "the scene that was saved is opened");
        assert!(opened.1 == saved.1, "the paint that was saved is opened");
        self.history = History::keeping(self.most_bytes);
        self.opened = saved;
        self.counts[3] += 1;
    }

    /// What cannot be opened or saved says why, and changes nothing.
    fn be_refused(&mut self) {
        let before = (state(&self.document), self.document.changed());
        let other = &self.stages[1].0;
        let error = match self.random.below(5) {
            0 => Document::open(&self.folder.join("bad.toml")).err(),
            1 => Document::open(&self.folder.join("none.toml")).err(),
            2 => {
                let scene = Scene::read(&self.folder.join("foreign.toml")).unwrap();
                other.paint(&scene).err()
            }
            3 => put_file(&mut self.document.scene, &self.folder.join("none.hair")).err(),
            _ => {
                let under = self.folder.join("bad.toml/scene.toml");
                self.document.save(&under, Some(self.stages[self.shown()].0.groom())).err()
            }
        };
        let line = format!("{:#}", error.expect("refused"));
        let told = ["bad.toml", "none.toml", "foreign.paint", "none.hair"];
        assert!(told.iter().any(|name| line.contains(name)) && !line.contains('\n'), "{line}");
        assert!((state(&self.document), self.document.changed()) == before, "{line}");
    }

    fn run(&mut self, steps: usize) {
        for _ in 0..steps {
            match self.random.below(100) {
                0..38 => self.edit(),
                38..66 => self.stroke(),
                66..84 => _ = self.document.step(&mut self.history, false),
                84..94 => _ = self.document.step(&mut self.history, true),
                94..97 => self.save(),
                97 => self.load(),
                _ => self.be_refused(),
            }
            let alone = self.history.steps().0.len() == 1;
            assert!(
                self.history.bytes() <= self.most_bytes || alone,
                "{} bytes",
                self.history.bytes()
            );
        }
    }

    /// Back to what was opened, where nothing was forgotten, and on again to what there is now.
    fn replay(&mut self) {
        let [edits, strokes, saves, loads] = self.counts;
        let (steps, done) = self.history.steps();
        let (all, bytes) = (steps.len(), self.history.bytes());
        println!("{edits} edits, {strokes} strokes, {saves} saves, {loads} loads");
        println!("since the last load {done} of {all} steps hold, {bytes} bytes");
        let now = state(&self.document);
        let back = (0..).take_while(|_| self.document.step(&mut self.history, false)).count();
        assert_eq!(back, done);
        if self.history.forgotten == 0 {
            assert!(state(&self.document) == self.opened, "back to what was opened");
        }
        (0..back).for_each(|_| assert!(self.document.step(&mut self.history, true)));
        assert!(state(&self.document) == now, "and on again");
    }
}

/// Ten thousand edits, strokes, undos, redos, saves, loads and refusals, in a process alone, whose memory they do not
/// let grow.
#[test]
fn a_long_random_session_is_what_its_history_replays() {
    /// Beside what the history keeps: copies under way, and what the allocator does not give back.
    const SPARE: usize = 48 << 20;
    if !is_alone() {
        return alone("editor_sessions::a_long_random_session_is_what_its_history_replays", "");
    }
    let folder = tempdir().unwrap();
    let mut session = Session::new(folder.path(), 256 << 20, 20_261_122);
    session.run(200);
    let before = resident();
    session.run(9800);
    let grown = resident().saturating_sub(before);
    println!("resident {} MiB, then {} more", before >> 20, grown >> 20);
    let bound = session.history.bytes() + SPARE;
    assert!(grown < bound, "{grown} bytes");
    session.replay();
    // The control: what is kept is seen.
    let kept = std::hint::black_box(vec![1u8; 2 * SPARE]);
    assert!(resident() - before > SPARE + kept.len() / 4);
    drop(kept);

    let folder = tempdir().unwrap();
    let mut session = Session::new(folder.path(), 1 << 20, 7);
    session.run(1000);
    session.replay();
    (0..40).for_each(|_| session.stroke());
    assert!(session.history.forgotten > 0, "what is bounded lets go");
    session.replay();
}

/// What is clicked, dragged, pressed and opened at random over the real window leaves what its history says.
#[test]
fn a_random_session_over_the_window_is_what_its_history_replays() {
    const SEED: u64 = 20_261_128;
    /// What would take long, or leave the folder or the window.
    const NOT_CLICKED: [&str; 9] = [
        "Browse…",
        "New",
        "Quit",
        "Measure causes",
        "strands",
        "lights",
        "samples",
        "Turntable",
        "Save picture…",
    ];
    println!("seed {SEED}");
    let mut random = Random(SEED);
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut scene = small();
    scene.output.path = path("picture.png").to_string_lossy().into_owned();
    let mut document = Document::new(scene.clone(), None);
    document.save(&path("scene.toml"), None).unwrap();
    std::fs::write(path("bad.toml"), "[fibre]\neta = 9\n").unwrap();
    scene.fibre.eta = 1.7;
    Document::new(scene, None).save(&path("other.toml"), None).unwrap();
    let mut window = window(document);
    let mut opened = state(&editor(&window).document);
    let mut counts = [0; 4];
    for _ in 0..300 {
        let kind = random.below(40);
        let what = match kind {
            0..12 => {
                let places = places_of(&window, &NOT_CLICKED);
                let at = random.one_of(&places);
                // Buttons are clicked, sliders dragged.
                let to = *at + sideways(&mut random, if kind < 6 { 0 } else { 40 });
                drag(&mut window, &[*at, to]);
                0
            }
            12..22 => {
                let rect = window.get_by_label("Picture").rect();
                let places = [(); 3].map(|()| {
                    let share = [(); 2].map(|()| 0.01 * random.below(100) as f32);
                    rect.min + rect.size() * Vec2::from(share)
                });
                drag(&mut window, &places);
                1
            }
            22..39 => {
                let command = Modifiers::COMMAND;
                let (modifiers, pressed) = *random.one_of(&[
                    (command, Key::Z),
                    (command, Key::Z),
                    (command | Modifiers::SHIFT, Key::Z),
                    (command, Key::S),
                    (Modifiers::NONE, Key::B),
                    (Modifiers::NONE, Key::V),
                    (Modifiers::NONE, Key::F),
                    (Modifiers::NONE, Key::X),
                    (Modifiers::NONE, Key::I),
                    (Modifiers::NONE, Key::R),
                    (Modifiers::NONE, Key::Escape),
                    (Modifiers::NONE, Key::CloseBracket),
                    (Modifiers::NONE, Key::Tab),
                    (Modifiers::NONE, Key::Space),
                    (Modifiers::NONE, Key::ArrowRight),
                ]);
                key(&mut window, modifiers, pressed);
                2
            }
            _ => {
                let name = *random.one_of(&["scene.toml", "other.toml", "bad.toml", "none.hair"]);
                let before = state(&editor(&window).document);
                window.state_mut().as_mut().unwrap().open(&path(name));
                let refused = ["bad.toml", "none.hair"].contains(&name);
                if refused && window.query_by_label("Throw away").is_none() {
                    assert!(state(&editor(&window).document) == before, "{name} changed something");
                }
                window.step();
                3
            }
        };
        counts[what] += 1;
        window.step();
        // What asks something stays for a few steps.
        if random.below(4) == 0 && window.query_by_label("Cancel").is_some() {
            key(&mut window, Modifiers::NONE, Key::Escape);
        }
        let editor = editor(&window);
        assert!(editor.history.bytes() <= 256 << 20);
        if editor.history.steps().0.is_empty() {
            opened = state(&editor.document);
        }
    }
    // Whatever is asked is given up.
    for _ in 0..4 {
        key(&mut window, Modifiers::NONE, Key::Escape);
    }
    window.run_steps(4);
    let (steps, done) = editor(&window).history.steps();
    let all = steps.len();
    println!("{counts:?}; {done} of {all} steps hold");
    assert!(all > 0);
    let now = state(&editor(&window).document);
    for _ in 0..done {
        key(&mut window, Modifiers::COMMAND, Key::Z);
    }
    assert_eq!(editor(&window).history.steps().1, 0);
    assert!(state(&editor(&window).document) == opened, "back to what was opened");
    for _ in 0..done {
        key(&mut window, Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
    }
    assert!(state(&editor(&window).document) == now, "and on again");
    look(&mut window, "random.png");
}

fn sideways(random: &mut Random, most: usize) -> Vec2 {
    Vec2::new(random.below(2 * most + 1) as f32 - most as f32, 0.0)
}

/// Where what can be clicked is, but for some by name.
fn places_of(window: &Window, but: &[&str]) -> Vec<Pos2> {
    let room = Rect::from_min_size(Pos2::ZERO, Vec2::new(860.0, 420.0));
    let nodes = window.root().children_recursive();
    let places = nodes.filter(|node| node.accesskit_node().has_bounds()).filter_map(|node| {
        let (own, at) = (node.accesskit_node(), node.rect().center());
        let name = own.label().unwrap_or_default();
        let clicked = is_input(own.role()) && !but.contains(&name.as_str()) && room.contains(at);
        clicked.then_some(at)
    });
    places.collect()
}
