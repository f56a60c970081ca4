//! Light in the editor: made while pictures go on, seen with its rings, turned and chosen.

use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use eframe::egui::{self, Key, Modifiers, Pos2, Rect};
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use hairlight::editor::{Document, outline};
use hairlight::environment::{direction_to_uv, uv_to_direction};
use hairlight::live::{Light, Picture, Said, Session, Wish};
use hairlight::scene::{Orbit, Scene, View};
use hairlight::srbf::SrbfLight;
use hairlight::stage::place_light;
use tempfile::tempdir;

use crate::editor::{Window, apart, drag, editor, key, look, picture, seen, small, window_of};

/// A session that remembers no fits.
pub fn session() -> Session {
    let mut session = Session::default();
    session.cache = None;
    session
}

/// What a session says of a wish.
pub fn see(session: &mut Session, wish: &Wish) -> Vec<Said> {
    let said = Mutex::new(Vec::new());
    session.see(wish, &|| true, &|what| said.lock().unwrap().push(what)).unwrap();
    said.into_inner().unwrap()
}

pub fn pictures(said: &[Said]) -> Vec<&Picture> {
    let shown = said.iter().filter_map(|said| match said {
        Said::Picture(picture) => Some(picture),
        _ => None,
    });
    shown.collect()
}

fn lights(said: &[Said]) -> Vec<&Light> {
    let made = said.iter().filter_map(|said| match said {
        Said::Light(light) => Some(light.as_ref()),
        _ => None,
    });
    made.collect()
}

fn turned_camera(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    let orbit = Orbit::default();
    let azimuth_deg = orbit.azimuth_deg + 50.0;
    scene.camera.view = View::Orbit(Orbit { azimuth_deg, ..orbit });
    scene
}

#[test]
fn pictures_go_on_under_the_old_light_until_the_new_one_is_there() {
    let wish = |scene: &Scene| Wish::new(scene.clone(), [96, 96]);
    let scene = small();
    let mut session = session();
    see(&mut session, &wish(&scene));

    // Another map and a long fit, given up for a camera that turns at once.
    let mut slow = scene.clone();
    slow.environment.source = "builtin:sunset".to_owned();
    slow.environment.lights = Some(128);
    let begun = Instant::now();
    let brief = || begun.elapsed() < Duration::from_millis(100);
    assert!(!session.see(&wish(&slow), &brief, &|_| {}).unwrap(), "given up");
    let turned = turned_camera(&slow);
    let said = see(&mut session, &wish(&turned));
    println!("{:?} in all", begun.elapsed());

    let shown = pictures(&said);
    let light_at = said.iter().position(|what| matches!(what, Said::Light(_))).expect("a light");
    let early = pictures(&said[..light_at]);
    assert!(!early.is_empty() && early.iter().all(|picture| !picture.finished));
    let before = early.last().unwrap();
    let after = shown.last().unwrap();
    assert!(after.finished);
    assert!(
        said.iter().any(|what| matches!(what, Said::Progress("fitting lights", x) if *x > 0.0))
    );
    assert_eq!(lights(&said).len(), 1);
    assert_eq!(lights(&said)[0].source, "builtin:sunset");

    // Each is what a session makes that never knew another light.
    let fresh = |scene: &Scene| {
        let said = see(&mut self::session(), &wish(scene));
        pictures(&said).last().unwrap().rgba.clone()
    };
    let (old, new) = (fresh(&turned_camera(&scene)), fresh(&turned));
    assert_eq!(before.size, [96, 96], "whole");
    assert!(before.rgba == old, "under the old light: {:?}", apart(&before.rgba, &old));
    assert!(after.rgba == new, "under the new light: {:?}", apart(&after.rgba, &new));
    // The control: the lights differ.
    assert!(apart(&old, &new).1 > 0.05);
    // Back under it, nothing is made but pictures.
    assert!(lights(&see(&mut session, &wish(&slow))).is_empty());
}

/// A map that cannot be read says so, and the camera goes on under the light there was.
#[test]
fn a_broken_map_leaves_the_light_there_was() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("bad.exr");
    std::fs::write(&path, b"not a map").unwrap();
    let mut session = session();
    let mut wish = Wish::new(small(), [96, 96]);
    see(&mut session, &wish);
    let whole = see(&mut session, &Wish { scene: turned_camera(&wish.scene), ..wish.clone() });
    wish.scene.environment.source = path.to_string_lossy().into_owned();
    wish.scene = turned_camera(&wish.scene);
    // Other hair to see: what was seen is not shown twice.
    wish.scene.fibre.eta = 1.6;
    for _ in 0..2 {
        let said = Mutex::new(Vec::new());
        let failed = session.see(&wish, &|| true, &|what| said.lock().unwrap().push(what));
        let line = format!("{:#}", failed.unwrap_err());
        assert!(line.contains("bad.exr") && line.contains("is not a lat-long map"), "{line}");
        let said = said.into_inner().unwrap();
        let last = pictures(&said).last().cloned().cloned().expect("a picture");
        assert!(last.size == [96, 96] && !last.finished);
        assert!(apart(&last.rgba, &pictures(&whole).last().unwrap().rgba).1 > 0.01);
    }
    // The map comes to be, and is taken.
    exr::prelude::write_rgb_file(&path, 16, 8, |_, _| (1f32, 1f32, 1f32)).unwrap();
    let said = see(&mut session, &wish);
    assert!(pictures(&said).last().unwrap().finished && lights(&said).len() == 1);
}

#[test]
fn a_ring_is_where_the_light_falls_to_a_half() {
    let light = |direction: DVec3, lambda| SrbfLight {
        direction: direction.normalize(),
        lambda,
        rgb: [1.0, 2.0, 4.0],
    };
    let beside_pole = light(DVec3::new(0.05, 1.0, 0.1), 0.5);
    let at_seam = light(DVec3::new(0.02, 0.1, 1.0), 0.4);
    let aside = light(DVec3::new(1.0, -0.6, -0.4), 0.3);
    for light in [beside_pole, at_seam, aside] {
        let points = outline(&light);
        for &uv in &points {
            let half = light.radiance(uv_to_direction(uv))[2];
            assert!((half - 2.0).abs() < 1e-9, "{half}");
        }
        // No step is torn, whatever lies between.
        assert!(points.windows(2).all(|p| (p[1][0] - p[0][0]).abs() < 0.5));
    }
    let around = |light| {
        let points = outline(light);
        points.last().unwrap()[0] - points[0][0]
    };
    assert!((around(&beside_pole).abs() - 1.0).abs() < 1e-9, "once round the pole");
    assert!(around(&at_seam).abs() < 1e-9 && around(&aside).abs() < 1e-9, "closed");
    let crosses = outline(&at_seam).iter().any(|[u, _]| !(0.0..=1.0).contains(u));
    assert!(crosses, "goes on over the seam");
    // The control: wider by a hundredth it is no half; and so wide a light has none.
    let wider = SrbfLight { lambda: 1.01 * aside.lambda, ..aside };
    let off = |uv: &[f64; 2]| (aside.radiance(uv_to_direction(*uv))[2] - 2.0).abs() > 1e-3;
    assert!(outline(&wider).iter().all(off));
    assert!(outline(&light(DVec3::Y, 2.5)).is_empty());
    let degrees = light(DVec3::Y, 0.1).half_angle().unwrap() * 360.0 / TAU;
    assert!((degrees - 4.772).abs() < 1e-2, "{degrees}");
    assert!(light(DVec3::Y, 2.4).half_angle().unwrap() < PI);
}

/// A window with room for all of the panel.
fn tall(document: Document) -> Window {
    window_of(document, [860.0, 1400.0])
}

fn rect(window: &Window) -> Rect {
    window.get_by_label("Picture of the light").rect()
}

fn click(window: &mut Window, at: Pos2) {
    window.hover_at(at);
    window.step();
    window.drag_at(at);
    window.step();
    window.drop_at(at);
    window.run_steps(3);
}

#[test]
fn lights_are_chosen_by_key_and_by_click_and_turn_with_the_picture() {
    let mut scene = small();
    scene.environment.rotation_deg = 70.0;
    scene.environment.exposure = 1.0;
    let mut window = tall(Document::new(scene.clone(), None));
    let mut session = Session::default();
    let wish = Wish { moving: true, ..Wish::new(scene.clone(), [8, 8]) };
    let said = see(&mut session, &wish);
    let fitted = &lights(&said)[0].fit.lights;
    let count = fitted.len();

    // By key, round and back again.
    assert!(window.query_by_label(&format!("Light 1 of {count}")).is_none());
    window.get_by_label("Next light").focus();
    window.step();
    key(&mut window, Modifiers::NONE, Key::Space);
    window.run_steps(3);
    window.get_by_label(&format!("Light 1 of {count}"));
    let placed = place_light(&fitted[0], &scene);
    let [x, y, z] = placed.direction.to_array();
    window.get_by_label(&format!("{x:.3}, {y:.3}, {z:.3}"));
    window.get_by_label("Previous light").click();
    window.run_steps(3);
    window.get_by_label(&format!("Light {count} of {count}"));

    // By click on its centre, which the picture has turned with the light; not where it would be unturned.
    let place = |window: &Window, direction: DVec3| {
        let [u, v] = direction_to_uv(direction).map(|x| x as f32);
        let rect = rect(window);
        rect.min + egui::vec2(u * rect.width(), v * rect.height())
    };
    let at = place(&window, placed.direction);
    click(&mut window, at);
    window.get_by_label(&format!("Light 1 of {count}"));
    look(&mut window, "light_chosen.png");

    // What is under the pointer stays under it.
    let step = egui::vec2(20.0, 0.0);
    drag(&mut window, &[at, at + step, at + 2.0 * step]);
    window.run_steps(3);
    let turned = editor(&window).document.scene.clone();
    assert!(turned.environment.rotation_deg != scene.environment.rotation_deg, "a drag turns it");
    let after = place(&window, place_light(&fitted[0], &turned).direction);
    let moved = (after.x - at.x).rem_euclid(rect(&window).width());
    println!("the drag moved the light by {moved}");
    assert!(moved > 15.0 && moved < 45.0 && (after.y - at.y).abs() < 1e-3);
    assert_eq!(editor(&window).history.steps().1, 1, "one step");
    seen(&mut window);
    click(&mut window, after);
    window.get_by_label(&format!("Light 1 of {count}"));
    key(&mut window, Modifiers::COMMAND, Key::Z);
    window.run_steps(2);
    assert!(editor(&window).document.scene == scene, "undone");
}

#[test]
fn a_map_is_chosen_among_thumbnails() {
    let folder = tempdir().unwrap();
    let [good, bad] = ["good.exr", "bad.hdr"].map(|name| folder.path().join(name));
    let sky = |_: usize, y: usize| if y < 8 { (0.2f32, 0.5f32, 2.0f32) } else { (0.3, 0.2, 0.1) };
    exr::prelude::write_rgb_file(&good, 32, 16, sky).unwrap();
    std::fs::write(&bad, b"#?RADIANCE\ncut short").unwrap();
    std::fs::write(folder.path().join("other.txt"), b"no map").unwrap();
    let mut window = tall(Document::new(small(), None));
    let studio = picture(&window);
    window.get_by_label("Browse maps…").click();
    window.run_steps(3);
    window.get_by_label("Map overcast").click();
    seen(&mut window);
    assert_eq!(editor(&window).document.scene.environment.source, "builtin:overcast");
    let overcast = picture(&window);
    assert!(apart(&studio, &overcast).1 > 0.05);

    // A folder, typed.
    let edit = window.get_by_label("Folder");
    edit.focus();
    window.step();
    window.event(egui::Event::Text(folder.path().to_string_lossy().into_owned()));
    window.step();
    key(&mut window, Modifiers::NONE, Key::Enter);
    let begun = Instant::now();
    let broken = |window: &Window| {
        let name = "Map bad.hdr: is cut short";
        window.query_by_label_contains(name).is_some()
    };
    while !broken(&window) {
        assert!(begun.elapsed() < Duration::from_secs(30), "no word on the broken file");
        std::thread::sleep(Duration::from_millis(5));
        window.step();
    }
    let thumbnails = Instant::now();
    while thumbnails.elapsed() < Duration::from_secs(1) {
        std::thread::sleep(Duration::from_millis(10));
        window.step();
    }
    assert!(window.query_by_label_contains("other.txt").is_none());
    look(&mut window, "maps.png");
    window.get_by_label("Map good.exr").click();
    seen(&mut window);
    assert_eq!(Path::new(&editor(&window).document.scene.environment.source), good);
    assert!(apart(&picture(&window), &overcast).1 > 0.05);
    look(&mut window, "map_chosen.png");
    // Undone like every edit.
    key(&mut window, Modifiers::NONE, Key::Escape);
    key(&mut window, Modifiers::COMMAND, Key::Z);
    seen(&mut window);
    assert_eq!(picture(&window), overcast);
}

/// Panels of maps, for the eye.
#[test]
#[ignore = "by hand: pictures of the panel"]
fn by_hand_panels() {
    for name in ["studio", "sunset"] {
        let mut scene = small();
        scene.environment.source = format!("builtin:{name}");
        scene.environment.lights = None;
        scene.environment.rotation_deg = 30.0;
        let mut window = window_of(Document::new(scene, None), [1280.0, 1100.0]);
        window.get_by_label("Fibre").click();
        seen(&mut window);
        window.get_by_label_contains("Fit:").click();
        window.get_by_label("Next light").click();
        std::thread::sleep(Duration::from_millis(300));
        seen(&mut window);
        for what in ["Map", "Lights", "Difference"] {
            window.get_by_label(what).click();
            window.run_steps(4);
            look(&mut window, &format!("light_{name}_{}.png", what.to_lowercase()));
        }
    }
}

/// Milliseconds to hurried pictures of a camera that turns, at rest and while lights are fitted.
#[test]
#[ignore = "by hand: prints times"]
fn by_hand_latency_while_lights_are_fitted() {
    let mut session = session();
    let mut wish = Wish::new(Scene::default(), [720, 480]);
    see(&mut session, &wish);
    wish.moving = true;
    let mut turn = |wish: &mut Wish, k: usize| {
        let orbit = Orbit::default();
        let azimuth_deg = orbit.azimuth_deg + 5.0 * k as f64;
        wish.scene.camera.view = View::Orbit(Orbit { azimuth_deg, ..orbit });
        let begun = Instant::now();
        let said = see(&mut session, wish);
        let shown = pictures(&said);
        let fitting = lights(&said).is_empty() && shown.iter().all(|picture| !picture.finished);
        (begun.elapsed().as_millis(), shown.len(), fitting)
    };
    let rest: Vec<_> = (1..9).map(|k| turn(&mut wish, k)).collect();
    wish.scene.environment.lights = Some(128);
    let fitting: Vec<_> = (9..17).map(|k| turn(&mut wish, k)).collect();
    println!("at rest {rest:?}\nfitting {fitting:?}");
    wish.moving = false;
    println!("then whole under the new light: {:?} ms", turn(&mut wish, 17).0);
}

/// Memory of the process around the thumbnail of an 8192 × 4096 map.
#[test]
#[ignore = "by hand: prints megabytes"]
fn by_hand_memory_of_a_large_map() {
    let megabytes = |name: &str| {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
        line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
    };
    let folder = tempdir().unwrap();
    let pixel = |x: usize, y: usize| (x as f32 / 8192.0, y as f32 / 4096.0, 0.5f32);
    exr::prelude::write_rgb_file(folder.path().join("large.exr"), 8192, 4096, pixel).unwrap();
    let mut window = tall(Document::new(small(), None));
    window.get_by_label("Browse maps…").click();
    window.run_steps(3);
    let before = megabytes("VmRSS");
    std::fs::write("/proc/self/clear_refs", "5").unwrap();
    window.get_by_label("Folder").focus();
    window.step();
    window.event(egui::Event::Text(folder.path().to_string_lossy().into_owned()));
    window.step();
    key(&mut window, Modifiers::NONE, Key::Enter);
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(50));
        window.step();
    }
    look(&mut window, "maps_large.png");
    let (most, after) = (megabytes("VmHWM"), megabytes("VmRSS"));
    println!("before {before:.0} MB, at most {most:.0} MB, after {after:.0} MB");
}
