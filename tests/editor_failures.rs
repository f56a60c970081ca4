//! When things go wrong around the editor: a lost device or surface, a full disk, no room, another monitor.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use eframe::egui::{Key, Modifiers, Vec2, ViewportId};
use eframe::egui_wgpu::SurfaceErrorAction;
use egui_kittest::kittest::Queryable;
use hairlight::editor::{Document, History, Step, options};
use hairlight::live::{Said, ScenePart, Session, Wish};
use hairlight::scene::{Scene, parse_assignment};
use tempfile::tempdir;

use crate::editor::{Window, apart, drag, editor, key, look, middle, picture, seen, small, window};
use crate::editor_files::{click, keeping, message, stroke, type_path, until};
use crate::editor_sessions::{alone, is_alone};

#[test]
fn a_lost_device_is_opened_anew() {
    let said = Mutex::new(Vec::new());
    let shown: Mutex<Vec<u8>> = Mutex::default();
    let say = |what: Said| match what {
        Said::Picture(picture) => *shown.lock().unwrap() = picture.rgba,
        Said::Failed(line) => said.lock().unwrap().push(line),
        _ => {}
    };
    let mut session = Session::default();
    let mut wish = Wish::new(small(), [64, 64]);
    assert!(session.see(&wish, &|| true, &say).unwrap());
    // The control: a device that is there is kept.
    wish.scene.environment.exposure = 0.5;
    assert!(session.see(&wish, &|| true, &say).unwrap());
    assert_eq!(*said.lock().unwrap(), Vec::<String>::new());
    session.gpu().unwrap().device.destroy();
    wish.scene.environment.exposure = 1.0;
    assert!(session.see(&wish, &|| true, &say).unwrap());
    assert_eq!(*said.lock().unwrap(), ["the graphics device was lost: another one is opened"]);
    let anew = std::mem::take(&mut *shown.lock().unwrap());
    Session::default().see(&wish, &|| true, &say).unwrap();
    assert!(anew == *shown.lock().unwrap(), "the same picture");
    // One that is lost while it works, between two groups of lights.
    let asked = AtomicUsize::new(0);
    let device = session.gpu().unwrap().device.clone();
    wish.scene.fibre.beta_r_deg = 12.0;
    let lose = || {
        if asked.fetch_add(1, Ordering::Relaxed) == 1 {
            device.destroy();
        }
        true
    };
    assert!(session.see(&wish, &lose, &say).unwrap());
    assert_eq!(said.lock().unwrap().len(), 2);
}

/// A minimised window has no room either.
#[test]
fn a_window_without_room_asks_for_no_picture() {
    let mut window = window(Document::new(small(), None));
    let before = picture(&window);
    for size in [Vec2::ZERO, Vec2::splat(1.0)] {
        window.set_size(size);
        window.run_steps(3);
        window.set_size(Vec2::new(860.0, 420.0));
        seen(&mut window);
        assert!(picture(&window) == before, "with room again, it is as it was");
    }
    for size in [Vec2::ZERO, Vec2::splat(1.0), Vec2::new(200.0, 20.0), Vec2::new(20.0, 300.0)] {
        window.set_size(size);
        window.run_steps(3);
        key(&mut window, Modifiers::NONE, Key::F);
        assert_eq!(message(&window), "", "{size:?}");
        if size.x <= 1.0 {
            assert!(picture(&window) == before, "no other picture for {size:?}");
        }
    }
    window.set_size(Vec2::new(860.0, 420.0));
    seen(&mut window);
}

/// On a monitor of twice as many pixels a point the picture has twice as many a side.
#[test]
fn another_monitor_gets_a_picture_of_its_own_pixels() {
    let mut window = window(Document::new(small(), None));
    let [width, height] = editor(&window).picture().unwrap().size;
    for scale in [2, 1] {
        let root = window.input_mut().viewports.entry(ViewportId::ROOT).or_default();
        root.native_pixels_per_point = Some(scale as f32);
        seen(&mut window);
        let [wide, high] = editor(&window).picture().unwrap().size;
        println!("{scale} pixels a point: {wide} × {high}");
        // Panels begin at whole pixels of either.
        assert!((scale * width).abs_diff(wide) <= 2 * scale, "{wide}");
        assert!((scale * height).abs_diff(high) <= 2 * scale, "{high}");
        assert_eq!(message(&window), "");
    }
}

/// A surface that is lost is made anew, and one that is out of date configured again.
#[test]
fn a_lost_surface_is_made_anew() {
    let told = options().wgpu_options.on_surface_status;
    use wgpu::CurrentSurfaceTexture::{Lost, Occluded, Outdated};
    assert!(matches!(told(&Lost), SurfaceErrorAction::RecreateSurface));
    assert!(matches!(told(&Outdated), SurfaceErrorAction::Reconfigure));
    assert!(matches!(told(&Occluded), SurfaceErrorAction::SkipFrame));
}

/// In a process whose files cannot grow beyond 1 kB, writing fails midway as on a full disk.
#[test]
fn a_full_disk_is_said_and_the_work_is_kept() {
    if !is_alone() {
        let name = "editor_failures::a_full_disk_is_said_and_the_work_is_kept";
        return alone(name, "ulimit -S -f 2; trap '' XFSZ;");
    }
    let folder = tempdir().unwrap();
    let (state, path) = (folder.path().join("state"), folder.path().join("scene.toml"));
    std::fs::write(&path, "as it was").unwrap();
    let mut window = keeping(Document::new(small(), None), &state);
    stroke(&mut window);
    until(&mut window, "said", |window| message(window).contains("is not kept"));
    let painted = picture(&window);
    key(&mut window, Modifiers::COMMAND, Key::S);
    type_path(&mut window, &path);
    let said = message(&window);
    assert!(said.contains("scene.toml: cannot be written"), "{said}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "as it was");
    assert!(!path.with_extension("paint").exists());
    assert!(editor(&window).document.changed() && picture(&window) == painted, "the work is kept");
    let names = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(names, 2, "nothing half written");
    // Once there is room again, the same save does.
    let pid = std::process::id().to_string();
    let room = std::process::Command::new("prlimit")
        .args(["--pid", &pid, "--fsize=unlimited:unlimited"])
        .status();
    assert!(room.unwrap().success());
    type_path(&mut window, &path);
    assert!(!editor(&window).document.changed(), "{}", message(&window));
    assert_eq!(Document::open(&path).unwrap().scene.hair.strands, 1000);
    assert!(path.with_extension("paint").is_file());
}

/// Files of each kind that are not what their names say.
fn write_broken(folder: &Path) {
    for (name, bytes) in [
        ("broken.hair", &b"HAIR but not really"[..]),
        ("broken.tfx", b"short"),
        ("broken.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        ("broken.exr", b"no map"),
        ("broken.hdr", b"#?RADIANCE\n"),
        ("broken.paint", b"no paint"),
    ] {
        std::fs::write(folder.join(name), bytes).unwrap();
    }
}

fn set(window: &mut Window, to: &str) {
    let assignment = parse_assignment(to).unwrap();
    let editor = window.state_mut().as_mut().unwrap();
    editor.document.scene.apply(vec![assignment]).unwrap();
    window.step();
}

fn scene_of(window: &Window) -> Scene {
    editor(window).document.scene.clone()
}

/// After whatever cannot be used, all goes on with what could be, and that is what is saved.
#[test]
fn what_cannot_be_used_stops_nothing_else() {
    let folder = tempdir().unwrap();
    write_broken(folder.path());
    crate::frames::write_tuft(folder.path());
    crate::frames::write_unit_map(folder.path());
    let path = |name: &str| folder.path().join(name);
    let saved = path("scene.toml");
    let mut document = Document::new(small(), None);
    document.save(&saved, None).unwrap();
    let mut window = window(Document::open(&saved).unwrap());
    let (whole, good) = (picture(&window), scene_of(&window));
    let open = |window: &mut Window, name: &str| {
        window.state_mut().as_mut().unwrap().open(&path(name));
        window.step();
    };
    for (name, to) in [
        ("broken.hair", None),
        ("broken.tfx", None),
        ("broken.obj", None),
        ("broken.exr", None),
        ("broken.hdr", None),
        ("broken.paint", Some("hair.paint")),
        ("no such adapter", Some("render.adapter")),
    ] {
        match to {
            None => open(&mut window, name),
            Some("hair.paint") => {
                set(&mut window, &format!("hair.paint={}", path(name).display()));
            }
            Some(key) => set(&mut window, &format!("{key}={name}")),
        }
        assert!(scene_of(&window) != good, "{name} was asked for");
        until(&mut window, name, |window| {
            message(window).contains("; in its place: ") && message(window).contains(name)
        });
        let said = message(&window);
        println!("{said}");
        assert!(!said.contains('\n') && said.contains(name), "{said}");
        seen(&mut window);
        assert!(scene_of(&window) == good, "{name}: the last good one is the scene's");
        assert!(picture(&window) == whole, "{name}");
        assert!(!editor(&window).document.changed(), "{name}: nothing to be saved");
        assert_eq!(editor(&window).history.steps().0.len(), 0, "{name} is no step");
        // What else is done is seen, and taken back.
        click(&mut window, "white");
        seen(&mut window);
        assert!(apart(&picture(&window), &whole).1 > 0.05, "{name}: a preset");
        key(&mut window, Modifiers::COMMAND, Key::Z);
        seen(&mut window);
        let at = middle(&window);
        drag(&mut window, &[at, at + Vec2::new(40.0, 0.0), at + Vec2::new(60.0, 0.0)]);
        seen(&mut window);
        assert!(apart(&picture(&window), &whole).1 > 0.05, "{name}: the camera");
        window.state_mut().as_mut().unwrap().document.scene.camera = good.camera;
        seen(&mut window);
        assert!(picture(&window) == whole, "{name}: and back");
    }
    look(&mut window, "refused.png");
    key(&mut window, Modifiers::COMMAND, Key::S);
    assert!(Document::open(&saved).unwrap().scene == good, "what is saved is good");

    // After a wrong one a good one of its kind is taken, and named in the history.
    open(&mut window, "broken.hair");
    until(&mut window, "said", |window| message(window).contains("broken.hair: not"));
    open(&mut window, "strands.hair");
    seen(&mut window);
    assert!(picture(&window) != whole);
    window.get_by_label("Step 1: Open strands.hair");
    open(&mut window, "broken.exr");
    until(&mut window, "said", |window| message(window).contains("broken.exr is not"));
    open(&mut window, "unit.exr");
    seen(&mut window);
    window.get_by_label("Step 2: Open unit.exr");
    assert_eq!(editor(&window).history.steps().0.len(), 2);
    key(&mut window, Modifiers::COMMAND, Key::Z);
    key(&mut window, Modifiers::COMMAND, Key::Z);
    seen(&mut window);
    assert!(picture(&window) == whole && scene_of(&window) == good, "undone");
}

/// Of two that are wrong at once both are said, and so are those of a file that the window begins with.
#[test]
fn a_scene_whose_files_are_all_wrong_begins_with_the_defaults() {
    let folder = tempdir().unwrap();
    write_broken(folder.path());
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let mut scene = small();
    scene.hair.source = path("broken.hair");
    scene.head.source = path("broken.obj");
    scene.environment.source = path("broken.exr");
    let toml = folder.path().join("scene.toml");
    std::fs::write(&toml, scene.to_toml()).unwrap();
    let mut window = window(Document::open(&toml).unwrap());
    let said = message(&window);
    println!("{said}");
    let lines: Vec<&str> = said.lines().collect();
    for name in ["broken.hair", "broken.obj", "broken.exr"] {
        assert!(lines.iter().any(|line| line.contains(name)), "{name}: {said}");
    }
    assert_eq!(lines.len(), 3);
    let now = scene_of(&window);
    assert_eq!((&*now.hair.source, &*now.environment.source), ("builtin:bob", "builtin:studio"));
    assert!(editor(&window).document.changed(), "it is not what the file says");
    look(&mut window, "all-refused.png");
    drop(window);
    // A hair alone, as `hairlight view broken.hair` opens it, leaves no work to be saved.
    let document = Document::open(&folder.path().join("broken.hair")).unwrap();
    let mut window = self::window(document);
    assert!(message(&window).contains("broken.hair"), "{}", message(&window));
    assert!(!editor(&window).document.changed());
    click(&mut window, "blond");
    seen(&mut window);
}

/// Hair that was painted on and is gone from the disk when it is to come back: what is there stays, with its paint, and
/// the history holds what can be had.
#[test]
fn undo_to_a_file_that_is_gone_stays_where_it_is() {
    let folder = tempdir().unwrap();
    crate::frames::write_tuft(folder.path());
    let (first, second) = (folder.path().join("strands.hair"), folder.path().join("other.hair"));
    std::fs::copy(&first, &second).unwrap();
    let mut scene = small();
    scene.hair.source = first.to_string_lossy().into_owned();
    let mut window = window(Document::new(scene, None));
    stroke(&mut window);
    let strokes = editor(&window).history.steps().0.len();
    window.state_mut().as_mut().unwrap().open(&second);
    seen(&mut window);
    let other = picture(&window);
    let steps = editor(&window).history.steps();
    assert_eq!((steps.0.len(), steps.1), (strokes + 1, strokes + 1));
    std::fs::remove_file(&first).unwrap();
    key(&mut window, Modifiers::COMMAND, Key::Z);
    until(&mut window, "said", |window| message(window).contains("strands.hair"));
    seen(&mut window);
    assert!(scene_of(&window).hair.source.ends_with("other.hair"));
    assert!(picture(&window) == other, "what was there stays");
    assert_eq!(editor(&window).history.steps().0.len(), 0, "no way back to what is gone");
    key(&mut window, Modifiers::COMMAND, Key::Z);
    seen(&mut window);
    assert_eq!(message(&window), "Nothing to undo");
    key(&mut window, Modifiers::NONE, Key::V);
    window.run_steps(2);
    click(&mut window, "white");
    seen(&mut window);
    assert_eq!(editor(&window).history.steps().1, 1);
}

/// A history forgets a part that was refused, and only that.
#[test]
fn a_history_forgets_what_was_refused() {
    let mut scenes = [(); 4].map(|()| small());
    scenes[1].hair.source = "broken.hair".to_owned();
    scenes[2].hair.source = "broken.hair".to_owned();
    scenes[2].fibre.eta = 1.7;
    scenes[3].fibre.eta = 1.7;
    scenes[3].hair.source = "builtin:wavy".to_owned();
    let mut history = History::default();
    for pair in scenes.windows(2) {
        let [before, after] = [0, 1].map(|k| Box::new(pair[k].clone()));
        history.push(Step::Scene { before, after });
    }
    let labels =
        |history: &History| -> Vec<String> { history.steps().0.iter().map(Step::label).collect() };
    assert_eq!(labels(&history), ["Open broken.hair", "eta", "Open builtin:wavy"]);
    history.replace(ScenePart::Head, &scenes[1], &scenes[0]);
    assert_eq!(history.steps().0.len(), 3, "the control: nothing of a head was refused");
    history.replace(ScenePart::Hair, &scenes[1], &scenes[0]);
    assert_eq!(labels(&history), ["eta", "Open builtin:wavy"]);
    assert_eq!(history.steps().1, 2);
    let (mut scene, mut paint) = (scenes[3].clone(), hairlight::paint::Paint::default());
    while history.undo(&mut scene, &mut paint) {
        assert_ne!(scene.hair.source, "broken.hair");
    }
    assert!(scene == scenes[0]);
}
