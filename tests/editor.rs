//! The editor by its own widgets, over the real renderer: what is clicked, dragged and typed reaches the picture, the
//! history and the file.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eframe::egui::{self, Key, Modifiers, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use hairlight::editor::{Document, Editor};
use hairlight::scene::Scene;
use tempfile::tempdir;

use crate::frames::capture;

type Window = Harness<'static, Option<Editor>>;

/// A small bob, quickly seen.
fn small() -> Scene {
    let mut scene = Scene::default();
    scene.hair.strands = 1000;
    scene.environment.lights = Some(4);
    scene.render.samples = Some(4);
    scene.render.adapter = "cpu".to_owned();
    scene.output.size = [96, 96];
    scene
}

fn window(document: Document) -> Window {
    let app = move |ui: &mut egui::Ui, state: &mut Option<Editor>| {
        state.get_or_insert_with(|| Editor::new(document.clone(), ui.ctx())).ui(ui);
    };
    let mut window = Harness::builder().with_size([860.0, 420.0]).build_ui_state(app, None);
    seen(&mut window);
    window
}

fn editor(window: &Window) -> &Editor {
    window.state().as_ref().expect("an editor")
}

/// Goes on until the picture is whole.
fn seen(window: &mut Window) {
    let begun = Instant::now();
    // Clicks take some frames to be one.
    window.run_steps(4);
    loop {
        window.step();
        if editor(window).finished() {
            // What the picture says is drawn too.
            window.run_steps(2);
            return;
        }
        let message = editor(window).message().unwrap_or_default().to_owned();
        assert!(begun.elapsed() < Duration::from_secs(120), "no picture: {message}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn picture(window: &Window) -> Vec<u8> {
    editor(window).picture().expect("a picture").rgba.clone()
}

/// The greatest difference between two pictures, and the share of bytes that differ by more than 2.
fn apart(a: &[u8], b: &[u8]) -> (u8, f64) {
    assert_eq!(a.len(), b.len());
    let off = || a.iter().zip(b).map(|(a, b)| a.abs_diff(*b));
    let far = off().filter(|&d| d > 2).count();
    (off().max().unwrap_or(0), far as f64 / a.len() as f64)
}

fn middle(window: &Window) -> Pos2 {
    window.get_by_label("Picture").rect().center()
}

/// Drags the pointer, pressed, over places.
fn drag(window: &mut Window, places: &[Pos2]) {
    window.hover_at(places[0]);
    window.step();
    window.drag_at(places[0]);
    window.step();
    for &place in &places[1..] {
        window.hover_at(place);
        window.step();
    }
    window.drop_at(places[places.len() - 1]);
    window.step();
}

fn key(window: &mut Window, modifiers: Modifiers, key: Key) {
    window.key_press_modifiers(modifiers, key);
    window.step();
}

/// Writes what the window looks like, for the eye.
fn look(window: &mut Window, name: &str) {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("editor");
    std::fs::create_dir_all(&folder).unwrap();
    window.render().unwrap().save(folder.join(name)).unwrap();
}

#[test]
fn what_is_shown_is_what_capture_makes() {
    let folder = tempdir().unwrap();
    let mut scene = small();
    scene.environment.exposure = 1.0;
    scene.environment.rotation_deg = 40.0;
    let mut window = window(Document::new(scene.clone(), None));
    let size = editor(&window).picture().unwrap().size;
    scene.output.size = size;
    std::fs::write(folder.path().join("scene.toml"), scene.to_toml()).unwrap();
    let output = capture(folder.path(), &["scene.toml", "-o", "frame.png"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let captured = image::open(folder.path().join("frame.png")).unwrap().into_rgba8();
    let (most, far) = apart(&picture(&window), captured.as_raw());
    println!("{size:?}: greatest difference {most}, {far:.4} by more than 2");
    assert!(most <= 1, "{most}");
    look(&mut window, "opened.png");
    // The control: another fibre.
    window.get_by_label("red").click();
    seen(&mut window);
    assert!(apart(&picture(&window), captured.as_raw()).1 > 0.05);
}

#[test]
fn a_stroke_is_painted_undone_redone_saved_and_captured() {
    let folder = tempdir().unwrap();
    let mut window = window(Document::new(small(), None));
    key(&mut window, Modifiers::NONE, Key::B);
    seen(&mut window);
    let bare = picture(&window);
    {
        let brush = &mut window.state_mut().as_mut().unwrap().brush;
        (brush.value, brush.radius) = ([0.0; 3], 0.15);
    }
    let at = middle(&window);
    let places: Vec<Pos2> = (0..8).map(|k| at + Vec2::new(8.0 * k as f32 - 28.0, -20.0)).collect();
    drag(&mut window, &places);
    seen(&mut window);
    let painted = picture(&window);
    let (_, far) = apart(&painted, &bare);
    println!("a stroke changes {far:.3} of the picture");
    assert!(far > 0.02);
    window.get_by_label("set absorption");
    look(&mut window, "painted.png");

    key(&mut window, Modifiers::COMMAND, Key::Z);
    seen(&mut window);
    assert_eq!(picture(&window), bare, "undone");
    key(&mut window, Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
    seen(&mut window);
    assert_eq!(picture(&window), painted, "done again");

    // Saved, it is what is opened and what is captured.
    let path = folder.path().join("painted.toml");
    key(&mut window, Modifiers::COMMAND, Key::S);
    window.step();
    let edit = window.get_by_label("Path");
    edit.focus();
    window.step();
    key(&mut window, Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text(path.to_string_lossy().into_owned()));
    window.step();
    key(&mut window, Modifiers::NONE, Key::Enter);
    window.step();
    let message = editor(&window).message().unwrap_or_default().to_owned();
    assert!(path.is_file() && folder.path().join("painted.paint").is_file(), "{message}");
    assert!(!editor(&window).document.changed());
    let mut again = self::window(Document::open(&path).unwrap());
    key(&mut again, Modifiers::NONE, Key::B);
    seen(&mut again);
    let (most, _) = apart(&picture(&again), &painted);
    assert!(most <= 1, "opened again: {most}");
    let [width, height] = editor(&window).picture().unwrap().size;
    let size = format!("{width}x{height}");
    let output = capture(folder.path(), &["painted.toml", "--size", &size, "-o", "frame.png"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let captured = image::open(folder.path().join("frame.png")).unwrap().into_rgba8();
    let (most, _) = apart(captured.as_raw(), &painted);
    assert!(most <= 1, "captured: {most}");
}

#[test]
fn fields_reach_the_scene_and_the_history() {
    let mut window = window(Document::new(small(), None));
    let before = editor(&window).document.scene.clone();
    window.get_by_label("blond").click();
    window.run_steps(3);
    let after = editor(&window).document.scene.clone();
    assert_eq!(after.fibre.preset, "blond");
    assert!(editor(&window).document.changed());
    // A slider by the keyboard of those who have no pointer.
    let slider =
        window.get_by_role_and_label(egui::accesskit::Role::SpinButton, "index of refraction");
    slider.focus();
    window.step();
    assert_eq!(editor(&window).history.steps().1, 1);
    key(&mut window, Modifiers::COMMAND, Key::Z);
    window.run_steps(2);
    assert!(editor(&window).document.scene == before, "undone");
    // The camera is no step.
    let at = middle(&window);
    drag(&mut window, &[at, at + Vec2::new(30.0, 0.0), at + Vec2::new(60.0, 10.0)]);
    let turned = &editor(&window).document.scene;
    assert!(turned.camera != before.camera, "a drag turns the camera");
    assert_eq!(editor(&window).history.steps().1, 0);
    key(&mut window, Modifiers::NONE, Key::Escape);
    key(&mut window, Modifiers::NONE, Key::F);
    window.event(egui::Event::Text("?".to_owned()));
    window.run_steps(2);
    window.get_by_label("Eyedropper: take the value under the pointer");
}

#[test]
fn what_cannot_be_opened_is_said_and_nothing_is_lost() {
    let folder = tempdir().unwrap();
    let mut window = window(Document::new(small(), None));
    let (scene, shown) = (editor(&window).document.scene.clone(), picture(&window));
    let mut open = |path: &Path| {
        let editor = window.state_mut().as_mut().unwrap();
        editor.open(path);
        window.run_steps(2);
        for _ in 0..200 {
            std::thread::sleep(Duration::from_millis(5));
            window.step();
        }
        let editor = window.state_mut().as_mut().unwrap();
        let said = editor.message().unwrap_or_default().to_owned();
        editor.document.scene = scene.clone();
        window.run_steps(2);
        said
    };
    let missing = open(&folder.path().join("none.hair"));
    assert!(missing.contains("none.hair") && missing.contains("cannot be read"), "{missing}");
    let bad: PathBuf = folder.path().join("bad.hair");
    std::fs::write(&bad, b"HAIR but not really").unwrap();
    let said = open(&bad);
    assert!(said.contains("bad.hair"), "{said}");
    let toml = folder.path().join("bad.toml");
    std::fs::write(&toml, "[fibre]\neta = 9\n").unwrap();
    let said = open(&toml);
    assert!(said.contains("bad.toml") && said.contains("fibre.eta"), "{said}");
    seen(&mut window);
    assert_eq!(picture(&window), shown, "the last good one goes on");
}
