//! When things go wrong around the editor: a lost device or surface, a full disk, no room, another monitor.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use eframe::egui::{Key, Modifiers, Vec2, ViewportId};
use eframe::egui_wgpu::SurfaceErrorAction;
use hairlight::editor::{Document, options};
use hairlight::live::{Said, Session, Wish};
use tempfile::tempdir;

use crate::editor::{editor, key, picture, seen, small, window};
use crate::editor_files::{keeping, message, stroke, type_path, until};
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
