//! Files of the editor, and what must not be lost: leaving, recovery after a crash, recent files, what is dropped.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use eframe::egui::accesskit::Role;
use eframe::egui::{self, Key, Modifiers, Pos2, Vec2};
use egui_kittest::kittest::Queryable;
use hairlight::editor::{Document, Editor};
use hairlight::file::typed_path;
use hairlight::paint::Paint;
use hairlight::stage::Geometry;
use tempfile::tempdir;

use crate::editor::{
    Window, apart, drag, editor, key, look, middle, picture, seen, small, window, window_on,
};

/// A stroke across the hair, until it is seen.
pub fn stroke(window: &mut Window) {
    key(window, Modifiers::NONE, Key::B);
    seen(window);
    let brush = &mut window.state_mut().as_mut().unwrap().brush;
    (brush.value, brush.radius) = ([0.0; 3], 0.15);
    let at = middle(window);
    let places: Vec<Pos2> = (0..4).map(|k| at + Vec2::new(14.0 * k as f32 - 28.0, -20.0)).collect();
    drag(window, &places);
    seen(window);
}

/// Answers what asks for a path.
pub fn type_path(window: &mut Window, path: &Path) {
    window.get_by_label("Path").focus();
    window.step();
    key(window, Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text(path.to_string_lossy().into_owned()));
    window.step();
    key(window, Modifiers::NONE, Key::Enter);
    window.step();
}

/// Asks the window to close; whether it does.
fn closes(window: &mut Window) -> bool {
    let root = window.input_mut().viewports.entry(egui::ViewportId::ROOT).or_default();
    root.events.push(egui::ViewportEvent::Close);
    window.step();
    let closes = !commanded(window, &egui::ViewportCommand::CancelClose);
    // A dialog takes some frames to be there.
    window.run_steps(3);
    closes
}

fn commanded(window: &Window, command: &egui::ViewportCommand) -> bool {
    window.output().viewport_output[&egui::ViewportId::ROOT].commands.contains(command)
}

pub fn click(window: &mut Window, label: &str) {
    window.get_by_label(label).click();
    window.run_steps(3);
}

pub fn message(window: &Window) -> String {
    editor(window).message().unwrap_or_default().to_owned()
}

pub fn exposed(window: &mut Window, stops: f64) {
    window.state_mut().as_mut().unwrap().document.scene.environment.exposure = stops;
    window.step();
}

#[test]
fn what_is_undone_is_no_change() {
    let mut window = window(Document::new(small(), None));
    stroke(&mut window);
    assert!(editor(&window).document.changed());
    key(&mut window, Modifiers::COMMAND, Key::Z);
    assert!(!editor(&window).document.changed(), "a stroke undone");
    assert!(closes(&mut window));
}

#[test]
fn save_before_closing_asks_where_and_then_closes() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("kept.toml");
    let mut window = window(Document::new(small(), None));
    exposed(&mut window, 1.0);
    assert!(!closes(&mut window), "unsaved work");
    look(&mut window, "leaving.png");
    // Given up, nothing of it comes back with a later save.
    click(&mut window, "Save");
    assert!(window.get_by_label("Path").is_focused(), "what is typed is the path");
    key(&mut window, Modifiers::NONE, Key::Escape);
    window.run_steps(2);
    assert!(window.query_by_label("Path").is_none());
    key(&mut window, Modifiers::COMMAND, Key::S);
    type_path(&mut window, &path);
    assert!(path.is_file() && !editor(&window).document.changed(), "{}", message(&window));
    assert!(!commanded(&window, &egui::ViewportCommand::Close), "nobody asked to close");

    let editor_ = window.state_mut().as_mut().unwrap();
    editor_.document.path = None;
    exposed(&mut window, 2.0);
    assert!(!closes(&mut window));
    click(&mut window, "Save");
    // What cannot be written is asked again.
    type_path(&mut window, &path.join("under-a-file.toml"));
    let said = message(&window);
    assert!(said.contains("under-a-file.toml") && said.contains("cannot be written"), "{said}");
    assert!(editor(&window).document.changed());
    type_path(&mut window, &path);
    assert!(commanded(&window, &egui::ViewportCommand::Close), "{}", message(&window));
    assert!(closes(&mut window));
    assert_eq!(Document::open(&path).unwrap().scene.environment.exposure, 2.0);
}

/// An editor that keeps its unsaved work in a folder.
pub fn keeping(document: Document, state: &Path) -> Window {
    let state = state.to_owned();
    window_on([860.0, 420.0], move |ctx| {
        Editor::new(document.clone(), ctx).keeping(&state, Duration::ZERO, ctx)
    })
}

/// The folders of unsaved work.
pub fn sets(state: &Path) -> Vec<PathBuf> {
    let Ok(folders) = std::fs::read_dir(state.join("unsaved")) else { return Vec::new() };
    folders.flatten().map(|entry| entry.path()).collect()
}

pub fn until(window: &mut Window, what: &str, mut done: impl FnMut(&Window) -> bool) {
    let begun = Instant::now();
    while !done(window) {
        assert!(begun.elapsed() < Duration::from_secs(60), "{what}: {}", message(window));
        std::thread::sleep(Duration::from_millis(5));
        window.step();
    }
}

#[test]
fn what_a_dead_process_left_is_recovered() {
    let folder = tempdir().unwrap();
    let (state, path) = (folder.path().join("state"), folder.path().join("scene.toml"));
    let mut document = Document::new(small(), None);
    document.save(&path, None).unwrap();
    let mut first = keeping(Document::open(&path).unwrap(), &state);
    assert!(sets(&state).is_empty(), "nothing is unsaved yet");
    stroke(&mut first);
    exposed(&mut first, 0.5);
    stroke(&mut first);
    let (scene, paint) = {
        let document = &editor(&first).document;
        (document.scene.clone(), document.paint.clone().expect("paint"))
    };
    // Another process at the same time is offered nothing, and keeps its own.
    let mut beside = keeping(Document::new(small(), None), &state);
    assert!(beside.query_by_label("Recover scene.toml").is_none(), "the first still lives");
    exposed(&mut beside, 3.0);
    until(&mut beside, "a set for each", |_| sets(&state).len() == 2);
    let work = |set: &PathBuf| set.join("work.json").is_file();
    until(&mut beside, "both are whole", |_| sets(&state).iter().all(work));
    beside.step();
    click_close_throwing_away(&mut beside);
    drop(beside);
    assert_eq!(sets(&state).len(), 1, "a clean close leaves nothing");

    // The end of a process that was killed: what it kept is all there is.
    drop(first);
    let mut second = keeping(Document::new(small(), None), &state);
    look(&mut second, "recover.png");
    click(&mut second, "Later");
    assert!(second.query_by_label("Recover scene.toml").is_none());
    drop(second);
    let mut third = keeping(Document::new(small(), None), &state);
    click(&mut third, "Recover scene.toml");
    until(&mut third, "recovered", |window| editor(window).document.path.is_some());
    seen(&mut third);
    let document = &editor(&third).document;
    assert!(document.scene == scene);
    assert!(document.paint.as_deref() == Some(&*paint), "the same paint");
    assert_eq!(document.path.as_deref(), Some(path.as_path()));
    assert!(document.changed());

    // It dies once more before anything was done.
    drop(third);
    let mut fourth = keeping(Document::new(small(), None), &state);
    click(&mut fourth, "Recover scene.toml");
    until(&mut fourth, "recovered", |window| editor(window).document.path.is_some());
    seen(&mut fourth);
    key(&mut fourth, Modifiers::COMMAND, Key::S);
    fourth.step();
    assert!(!editor(&fourth).document.changed(), "{}", message(&fourth));
    assert_eq!(Document::open(&path).unwrap().scene.environment.exposure, 0.5);
    assert!(path.with_extension("paint").is_file());
    drop(fourth);
    // The control: what is saved is not offered.
    assert!(sets(&state).is_empty());
    let fifth = keeping(Document::open(&path).unwrap(), &state);
    assert!(fifth.query_by_label("Recover scene.toml").is_none());
    assert!(fifth.query_by_label("Later").is_none());
}

fn click_close_throwing_away(window: &mut Window) {
    assert!(!closes(window));
    click(window, "Throw away");
    assert!(closes(window));
}

#[test]
fn work_that_cannot_be_kept_or_recovered_is_said() {
    let folder = tempdir().unwrap();
    let state = folder.path().join("state");
    std::fs::write(&state, "a file where the folder should be").unwrap();
    let mut window = keeping(Document::new(small(), None), &state);
    exposed(&mut window, 1.0);
    until(&mut window, "said", |window| message(window).contains("is not kept"));
    assert!(message(&window).contains("state/unsaved"), "{}", message(&window));
    std::fs::remove_file(&state).unwrap();
    exposed(&mut window, 2.0);
    until(&mut window, "kept", |_| sets(&state).iter().any(|set| set.join("work.json").is_file()));
    drop(window);
    std::fs::write(sets(&state)[0].join("work.json"), "{ cut short").unwrap();
    let mut window = keeping(Document::new(small(), None), &state);
    click(&mut window, "Recover untitled");
    until(&mut window, "said", |window| message(window).contains("work.json"));
    // It is asked again.
    window.run_steps(3);
    click(&mut window, "Throw away untitled");
    assert!(sets(&state).is_empty());
}

#[test]
fn recent_files_are_offered_newest_first() {
    let folder = tempdir().unwrap();
    let state = folder.path().join("state");
    let path = |k: usize| folder.path().join(format!("scene-{k}.toml"));
    for k in 0..13 {
        let mut scene = small();
        scene.fibre.eta = 1.5 + 0.01 * k as f64;
        std::fs::write(path(k), scene.to_toml()).unwrap();
    }
    let mut first = keeping(Document::open(&path(0)).unwrap(), &state);
    for k in (1..13).chain([5]) {
        first.state_mut().as_mut().unwrap().open(&path(k));
    }
    first.step();
    drop(first);
    std::fs::remove_file(path(9)).unwrap();
    let mut second = keeping(Document::new(small(), None), &state);
    let name = |k: usize| path(k).to_string_lossy().into_owned();
    click(&mut second, "File");
    click(&mut second, "Open recent");
    let y = |k: usize| second.query_by_label(&name(k)).map(|node| node.rect().min.y);
    let shown: Vec<f32> = [5, 12, 11, 10, 8, 7, 6, 4, 3].map(|k| y(k).expect("offered")).into();
    assert!(shown.is_sorted(), "{shown:?}");
    assert!(y(9).is_none() && y(2).is_none(), "gone, and too long ago");
    look(&mut second, "recent.png");
    click(&mut second, &name(11));
    assert_eq!(editor(&second).document.path, Some(path(11)));
    drop(second);
    // What is damaged is ignored, and whole again after the next file.
    let list = state.join("recent.json");
    assert!(std::fs::read_to_string(&list).unwrap().starts_with(&format!("[\"{}\"", name(11))));
    std::fs::write(&list, "[\"cut sh").unwrap();
    let third = keeping(Document::open(&path(3)).unwrap(), &state);
    assert_eq!(message(&third), "");
    assert_eq!(std::fs::read_to_string(&list).unwrap(), format!("[\"{}\"]", name(3)));
}

/// A scene's paint does not follow it to other hair, and is there again with its own; paint of other hair can be let go.
#[test]
fn paint_in_a_file_stays_with_its_hair() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("painted.toml");
    let mut first = window(Document::new(small(), None));
    stroke(&mut first);
    key(&mut first, Modifiers::COMMAND, Key::S);
    type_path(&mut first, &path);
    let painted = picture(&first);
    drop(first);
    let mut window = window(Document::open(&path).unwrap());
    let named = |window: &Window| editor(window).document.scene.hair.paint.clone();
    assert!(named(&window).is_some());
    let set = |window: &mut Window, to: &str| {
        let assignment = hairlight::scene::parse_assignment(to).unwrap();
        let editor = window.state_mut().as_mut().unwrap();
        editor.document.scene.apply(vec![assignment]).unwrap();
        window.step();
    };
    set(&mut window, "hair.strands=1200");
    seen(&mut window);
    assert_eq!((named(&window), message(&window).contains("another groom")), (None, false));
    set(&mut window, "hair.strands=1000");
    assert!(named(&window).is_some());
    key(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!((editor(&window).document.scene.hair.strands, named(&window)), (1200, None));
    key(&mut window, Modifiers::COMMAND, Key::Z);
    seen(&mut window);
    assert!(!editor(&window).document.changed());
    assert!(apart(&picture(&window), &painted).0 <= 1);

    // The same file named for other hair: the reason is said, and that hair is seen without it.
    let mut scene = small();
    scene.hair.strands = 1200;
    let bare = picture(&self::window(Document::new(scene.clone(), None)));
    scene.hair.paint = Some(path.with_extension("paint").to_string_lossy().into_owned());
    let other = folder.path().join("other.toml");
    std::fs::write(&other, scene.to_toml()).unwrap();
    window.state_mut().as_mut().unwrap().open(&other);
    until(&mut window, "said", |window| message(window).contains("painted.paint"));
    assert!(message(&window).contains("another groom"), "{}", message(&window));
    seen(&mut window);
    assert!(message(&window).ends_with("in its place: no paint"), "{}", message(&window));
    assert_eq!(named(&window), None);
    assert!(apart(&picture(&window), &bare).0 <= 1);
    assert!(apart(&picture(&window), &painted).1 > 0.02, "the control");
}

#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }
    fn bytes(&self) -> Result<Vec<u8>, String> {
        Err("the editor reads files by their paths".to_owned())
    }
}

#[test]
fn dropped_files_are_opened() {
    let folder = tempdir().unwrap();
    crate::frames::write_tuft(folder.path());
    crate::frames::write_unit_map(folder.path());
    let mut scene = small();
    scene.fibre.eta = 1.7;
    let toml = folder.path().join("dropped.toml");
    std::fs::write(&toml, scene.to_toml()).unwrap();
    let bad = folder.path().join("notes.txt");
    std::fs::write(&bad, "no scene at all").unwrap();
    let mut window = window(Document::new(small(), None));
    let bob = picture(&window);
    let drop_on = |window: &mut Window, path: &Path| {
        window.input_mut().dropped_files.push(Arc::new(Dropped(path.to_owned())));
        window.run_steps(4);
    };
    let hair = folder.path().join("strands.hair");
    drop_on(&mut window, &hair);
    assert_eq!(editor(&window).document.scene.hair.source, hair.to_string_lossy());
    seen(&mut window);
    let tuft = picture(&window);
    assert!(tuft != bob, "other hair is seen");
    let map = folder.path().join("unit.exr");
    drop_on(&mut window, &map);
    assert_eq!(editor(&window).document.scene.environment.source, map.to_string_lossy());
    seen(&mut window);
    assert!(picture(&window) != tuft, "other light is seen");
    key(&mut window, Modifiers::COMMAND, Key::Z);
    key(&mut window, Modifiers::COMMAND, Key::Z);
    assert!(!editor(&window).document.changed(), "both are steps of the history");
    drop_on(&mut window, &bad);
    assert!(message(&window).contains("notes.txt"), "{}", message(&window));
    assert_eq!(editor(&window).document.path, None);
    drop_on(&mut window, &toml);
    assert_eq!(editor(&window).document.path, Some(toml.clone()));
    assert_eq!(editor(&window).document.scene.fibre.eta, 1.7);
    seen(&mut window);
    // Unsaved work is asked for first.
    exposed(&mut window, 1.0);
    let other = folder.path().join("other.toml");
    std::fs::write(&other, small().to_toml()).unwrap();
    drop_on(&mut window, &other);
    assert_eq!(editor(&window).document.path, Some(toml));
    click(&mut window, "Throw away");
    assert_eq!(editor(&window).document.path, Some(other));
}

#[test]
fn a_file_that_vanishes_is_named_and_the_last_picture_stays() {
    let folder = tempdir().unwrap();
    crate::frames::write_tuft(folder.path());
    crate::frames::write_unit_map(folder.path());
    let mut scene = small();
    let paths = ["strands.hair", "unit.exr"].map(|name| folder.path().join(name));
    [scene.hair.source, scene.environment.source] =
        [0, 1].map(|k| paths[k].to_string_lossy().into_owned());
    let mut window = window(Document::new(scene.clone(), None));
    let both = picture(&window);
    for (path, key) in
        paths.iter().zip(["hair.source=builtin:bob", "environment.source=builtin:studio"])
    {
        let document = |window: &mut Window, to: &str| {
            let assignment = hairlight::scene::parse_assignment(to).unwrap();
            let editor = window.state_mut().as_mut().unwrap();
            editor.document.scene.apply(vec![assignment]).unwrap();
            window.step();
        };
        document(&mut window, key);
        seen(&mut window);
        let other = picture(&window);
        assert!(other != both);
        let aside = path.with_extension("aside");
        std::fs::rename(path, &aside).unwrap();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let back = format!("{}={}", key.split('=').next().unwrap(), path.display());
        document(&mut window, &back);
        until(&mut window, "said", |window| message(window).contains(&name));
        assert!(picture(&window) == other, "the last good one stays");
        // There again, it is opened again.
        std::fs::rename(&aside, path).unwrap();
        document(&mut window, key);
        document(&mut window, &back);
        seen(&mut window);
        assert!(picture(&window) == both);
    }
}

#[test]
fn what_cannot_be_written_leaves_what_there_was() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, "as it was").unwrap();
    let full = |file: &mut std::fs::File| -> anyhow::Result<()> {
        std::io::Write::write_all(file, b"half of it")?;
        Err(std::io::Error::from(std::io::ErrorKind::StorageFull).into())
    };
    let line = format!("{:#}", hairlight::file::write_whole(&path, full).unwrap_err());
    assert!(line.contains("scene.toml: cannot be written") && !line.contains('\n'), "{line}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "as it was");
    let names = || std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(names(), 1, "nothing half written");

    // A pipe stays one, as a device would.
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let line = format!("{:#}", hairlight::file::write_whole(&pipe, |_| Ok(())).unwrap_err());
        assert!(line.contains("pipe: cannot be written: something that is no file"), "{line}");
        assert!(std::fs::metadata(&pipe).unwrap().file_type().is_fifo());
        std::fs::remove_file(&pipe).unwrap();
    }

    // Of a scene and its paint, neither is replaced where one cannot be.
    let stage = Geometry::load(&small()).unwrap();
    let mut document = Document::new(small(), None);
    document.begin_paint(Paint::bare(stage.groom().points.len()));
    std::fs::create_dir(path.with_extension("paint")).unwrap();
    document.scene.fibre.eta = 1.7;
    let line = format!("{:#}", document.save(&path, Some(stage.groom())).unwrap_err());
    assert!(line.contains("scene.toml") && line.contains("scene.paint"), "{line}");
    assert!(document.changed());
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "as it was");
    let long = folder.path().join("n".repeat(300)).with_extension("toml");
    let line = format!("{:#}", document.save(&long, Some(stage.groom())).unwrap_err());
    assert!(line.contains("nnn") && line.contains("cannot be written"), "{line}");
    let over = folder.path().join("over.paint");
    assert!(document.save(&over, Some(stage.groom())).is_err(), "the paint's own name");
    assert!(document.changed() && names() == 2);
    // The control: where both can be, both are.
    std::fs::remove_dir(path.with_extension("paint")).unwrap();
    document.save(&path, Some(stage.groom())).unwrap();
    assert!(!document.changed() && path.with_extension("paint").is_file());
    assert_eq!(Document::open(&path).unwrap().scene.fibre.eta, 1.7);
}

#[test]
fn a_picture_is_saved_as_capture_makes_it() {
    let folder = tempdir().unwrap();
    let mut scene = small();
    scene.environment.exposure = 1.0;
    let mut window = window(Document::new(scene, None));
    stroke(&mut window);
    assert!(editor(&window).document.changed(), "painted");
    let save = |window: &mut Window, name: &str, clear: bool| {
        click(window, "File");
        click(window, "Save picture…");
        if clear {
            click(window, "Transparent background");
            look(window, "save-picture.png");
        }
        type_path(window, &folder.path().join(name));
        if clear {
            // Behind the interface, which goes on.
            let under_way = |window: &Window| window.query_by_label("Cancel saving").is_some();
            until(window, "under way", |window| {
                under_way(window) || message(window).contains(name)
            });
            look(window, "saving.png");
        }
        until(window, "saved", |window| message(window).contains(name));
        assert!(message(window).starts_with("Saved"), "{}", message(window));
    };
    save(&mut window, "shown.png", false);
    save(&mut window, "clear.png", true);
    save(&mut window, "shown.exr", false);
    let editor = window.state_mut().as_mut().unwrap();
    editor.document.scene.output.path = "frame.png".to_owned();
    key(&mut window, Modifiers::COMMAND, Key::S);
    type_path(&mut window, &folder.path().join("scene.toml"));
    assert!(!self::editor(&window).document.changed(), "{}", message(&window));
    let png = |name: &str| image::open(folder.path().join(name)).unwrap().into_rgba8();
    crate::frames::captured(folder.path(), &["scene.toml", "-o", "frame.png"]);
    crate::frames::captured(
        folder.path(),
        &["scene.toml", "-o", "frame-clear.png", "--background", "transparent"],
    );
    crate::frames::captured(folder.path(), &["scene.toml", "-o", "frame.exr"]);
    for name in ["shown.png", "clear.png"] {
        let frame = name.replace("shown", "frame").replace("clear", "frame-clear");
        assert_eq!(png(name).dimensions(), (96, 96));
        let (most, _) = apart(png(name).as_raw(), png(&frame).as_raw());
        println!("{name}: greatest difference {most}");
        assert!(most <= 1, "{name}: {most}");
    }
    assert!(apart(png("shown.png").as_raw(), png("clear.png").as_raw()).1 > 0.1, "the control");
    let alpha = |name: &str| png(name).pixels().map(|p| p[3]).collect::<Vec<u8>>();
    assert_eq!(alpha("clear.png"), alpha("frame-clear.png"));
    assert!([0, 255].map(|a| alpha("clear.png").contains(&a)) == [true; 2], "clear and covered");
    assert!(alpha("shown.png").iter().all(|&a| a == 255), "the control");
    let planes = |name: &str| {
        exr::prelude::read_first_flat_layer_from_file(folder.path().join(name)).unwrap().layer_data
    };
    assert!(planes("shown.exr").channel_data == planes("frame.exr").channel_data);

    // Size and samples are the picture's own.
    click(&mut window, "File");
    click(&mut window, "Save picture…");
    for (label, number) in [("size, width", "60"), ("size, height", "40"), ("samples", "9")] {
        let all = window.get_all_by_role_and_label(Role::SpinButton, label);
        // The prompt's is the last.
        all.last().unwrap().click();
        window.run_steps(3);
        key(&mut window, Modifiers::COMMAND, Key::A);
        window.event(egui::Event::Text(number.to_owned()));
        window.step();
        key(&mut window, Modifiers::NONE, Key::Enter);
        window.run_steps(2);
    }
    type_path(&mut window, &folder.path().join("small.png"));
    until(&mut window, "saved", |window| message(window).contains("small.png"));
    assert!(message(&window).starts_with("Saved"), "{}", message(&window));
    let flags = ["scene.toml", "-o", "frame-small.png", "--size", "60x40", "--samples", "9"];
    crate::frames::captured(folder.path(), &flags);
    assert_eq!(png("small.png").dimensions(), (60, 40));
    assert!(apart(png("small.png").as_raw(), png("frame-small.png").as_raw()).0 <= 1);
    assert_eq!(self::editor(&window).document.scene.output.size, [96, 96], "the scene keeps its");

    // What cannot be saved is said; what is given up leaves nothing.
    click(&mut window, "File");
    click(&mut window, "Save picture…");
    type_path(&mut window, &folder.path().join("picture.jpg"));
    until(&mut window, "said", |window| message(window).contains("picture.jpg"));
    click(&mut window, "File");
    click(&mut window, "Save picture…");
    type_path(&mut window, &folder.path().join("given-up.png"));
    click(&mut window, "Cancel saving");
    assert_eq!(message(&window), "The picture was not saved");
    seen(&mut window);
    assert!(!folder.path().join("given-up.png").exists());

    // In one frame, whose output is looked at.
    let modifiers = Modifiers::COMMAND.plus(Modifiers::SHIFT);
    let (key, physical_key, repeat) = (Key::C, None, false);
    let pressed = egui::Event::Key { key, physical_key, pressed: true, repeat, modifiers };
    window.input_mut().events.push(pressed);
    window.step();
    let copied =
        window.output().platform_output.commands.iter().find_map(|command| match command {
            egui::OutputCommand::CopyImage(image) => Some(image.size),
            _ => None,
        });
    let size = self::editor(&window).picture().unwrap().size.map(|s| s as usize);
    assert_eq!(copied, Some(size), "{}", message(&window));
}

/// What is typed or pasted for a path: quotes, the home, an address as file managers give it.
#[test]
fn paths_are_read_as_they_are_pasted() {
    let home = std::env::home_dir().unwrap().to_string_lossy().into_owned();
    for (typed, path) in [
        ("/a/b.hair", "/a/b.hair"),
        ("  /a/b.hair\n", "/a/b.hair"),
        ("'/a/b c.hair'", "/a/b c.hair"),
        ("\"/a/b c.hair\"", "/a/b c.hair"),
        ("file:///a/b%20c%25.hair", "/a/b c%.hair"),
        ("file://localhost/a/%E6%97%A5.hair", "/a/日.hair"),
        ("'file:///a/b.hair'", "/a/b.hair"),
        ("file:///a/100%.hair", "/a/100%.hair"),
        ("builtin:bob", "builtin:bob"),
        ("~user/b.hair", "~user/b.hair"),
        ("a~/b.hair", "a~/b.hair"),
        ("it's.hair", "it's.hair"),
    ] {
        assert_eq!(typed_path(typed), path, "{typed}");
    }
    assert_eq!(typed_path("~/b.hair"), format!("{home}/b.hair"));
    assert_eq!(typed_path("'~/b.hair'"), format!("{home}/b.hair"));
    assert_eq!(typed_path("~"), home);
    let folder = tempdir().unwrap();
    let odd = folder.path().join("'odd'");
    std::fs::write(&odd, "").unwrap();
    assert_eq!(typed_path(odd.to_str().unwrap()), odd.to_string_lossy(), "it is there");

    // Wherever one is typed.
    crate::frames::write_tuft(folder.path());
    crate::frames::write_unit_map(folder.path());
    let [hair, map] = ["two words.hair", "two words.exr"].map(|name| folder.path().join(name));
    std::fs::rename(folder.path().join("strands.hair"), &hair).unwrap();
    std::fs::rename(folder.path().join("unit.exr"), &map).unwrap();
    let address = |path: &Path| format!("file://{}", path.display()).replace(' ', "%20");
    let mut window = crate::editor::window_of(Document::new(small(), None), [1280.0, 1600.0]);
    let scene = |window: &Window| editor(window).document.scene.clone();
    key(&mut window, Modifiers::COMMAND, Key::O);
    window.run_steps(2);
    type_path(&mut window, Path::new(&address(&hair)));
    assert_eq!(scene(&window).hair.source, hair.to_string_lossy(), "{}", message(&window));
    window.get_by_role_and_label(Role::ComboBox, "map").click();
    window.run_steps(3);
    window.get_by_label("Path of the map").click();
    window.run_steps(2);
    key(&mut window, Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text(format!("'{}'", map.display())));
    window.run_steps(2);
    key(&mut window, Modifiers::NONE, Key::Enter);
    window.run_steps(3);
    assert_eq!(scene(&window).environment.source, map.to_string_lossy());
    seen(&mut window);
    key(&mut window, Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::S);
    window.run_steps(2);
    let saved = folder.path().join("saved scene.toml");
    type_path(&mut window, Path::new(&address(&saved)));
    assert!(saved.is_file(), "{}", message(&window));
    click(&mut window, "Browse maps…");
    window.get_by_label("Folder").focus();
    window.step();
    key(&mut window, Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text(format!("\"{}\"", folder.path().display())));
    window.step();
    click(&mut window, "Add");
    until(&mut window, "listed", |window| window.query_by_label("Map two words.exr").is_some());
}

/// A scene is not written over a file that it is made of.
#[test]
fn a_scene_is_not_saved_over_its_hair() {
    let folder = tempdir().unwrap();
    crate::frames::write_tuft(folder.path());
    let hair = folder.path().join("strands.hair");
    let before = std::fs::read(&hair).unwrap();
    let mut scene = small();
    scene.hair.source = hair.to_string_lossy().into_owned();
    let mut document = Document::new(scene, None);
    let line = format!("{:#}", document.save(&hair, None).unwrap_err());
    println!("{line}");
    assert!(line.contains("strands.hair") && !line.contains('\n'), "{line}");
    assert_eq!(std::fs::read(&hair).unwrap(), before);
    // The control: anywhere else it is, again and again.
    let toml = folder.path().join("scene.toml");
    document.save(&toml, None).unwrap();
    document.save(&toml, None).unwrap();
}

/// Ctrl-C in the terminal closes the window, and what was not saved is offered at the next start.
#[test]
fn a_window_that_is_stopped_keeps_its_work() {
    static STOPPED: AtomicBool = AtomicBool::new(false);
    let folder = tempdir().unwrap();
    let state = folder.path().join("state");
    let own = state.clone();
    let mut window = window_on([860.0, 420.0], move |ctx| {
        let editor = Editor::new(Document::new(small(), None), ctx).stopped_by(&STOPPED);
        // No work is kept before the first hour.
        editor.keeping(&own, Duration::from_secs(3600), ctx)
    });
    exposed(&mut window, 1.0);
    window.run_steps(3);
    // What follows the first edit waits.
    exposed(&mut window, 2.0);
    window.run_steps(3);
    assert!(!commanded(&window, &egui::ViewportCommand::Close), "the control");
    STOPPED.store(true, std::sync::atomic::Ordering::Relaxed);
    window.step();
    assert!(commanded(&window, &egui::ViewportCommand::Close));
    assert!(closes(&mut window), "nothing is asked");
    drop(window);
    let mut again = keeping(Document::new(small(), None), &state);
    click(&mut again, "Recover untitled");
    until(&mut again, "recovered", |window| editor(window).document.changed());
    assert_eq!(editor(&again).document.scene.environment.exposure, 2.0);
}
