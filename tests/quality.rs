//! What `render.quality` picks, and whether the error it expects is the error of the frame.

use std::path::Path;
use std::process::Command;

use hairlight::gpu::method::Integrator;
use hairlight::quality::{Costs, Facts, pick};
use hairlight::scattering::model::Model;
use hairlight::scene::{Scene, Target};
use tempfile::tempdir;

use crate::frames::{capture, json};

const FACTS: Facts = Facts {
    contrast: 1.8,
    sky: 0.5,
    narrow: 0.5,
    albedo: 0.1,
    width_px: 0.1,
    multiple: true,
    integrator: Integrator::Fast(Model::Marschner),
};
const COSTS: Costs =
    Costs { pair_ns: 1000.0, path_ns: 2000.0, visibility_ms: 60.0, points: 10_000, split: 25 };

#[test]
fn more_time_buys_no_more_error_and_less_error_takes_no_less_time() {
    let scene = Scene::default();
    let picked = |target| pick(&scene, target, &FACTS, &COSTS, 0.04);
    let mut last = f64::INFINITY;
    for ms in [1.0, 100.0, 300.0, 1000.0, 3000.0, 10_000.0] {
        let pick = picked(Target::FrameMs(ms));
        println!("{}", pick.line(Target::FrameMs(ms)));
        assert_eq!(pick.reached, pick.frame_ms <= ms);
        assert!(pick.expected.total <= 1.011 * last, "{ms} ms");
        last = pick.expected.total;
    }
    assert!(!picked(Target::FrameMs(1.0)).reached && picked(Target::FrameMs(1000.0)).reached);
    let mut last = 0.0;
    for error in [0.5, 0.3, 0.2, 0.15, 0.01] {
        let pick = picked(Target::Error(error));
        println!("{}", pick.line(Target::Error(error)));
        assert_eq!(pick.reached, pick.expected.total <= error);
        assert!(pick.frame_ms >= 0.9 * last, "{error}");
        last = pick.frame_ms;
    }
    assert!(!picked(Target::Error(0.01)).reached && picked(Target::Error(0.15)).reached);
}

#[test]
fn what_the_scene_sets_stays() {
    let mut scene = Scene::default();
    scene.environment.lights = Some(17);
    scene.render.samples = Some(8);
    for target in [Target::Error(0.5), Target::Error(0.01), Target::FrameMs(1e4)] {
        let settings = pick(&scene, target, &FACTS, &COSTS, 0.04).settings;
        assert_eq!((settings.lights, settings.samples), (17, 8), "{target:?}");
    }
}

#[test]
fn the_expected_error_is_the_measured_one_within_a_factor_of_two() {
    let folder = tempdir().unwrap();
    let scene = "--hair builtin:bob --strands 3000 --size 120x90 --background transparent";
    let run = |subcommand: &str, arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_hairlight"))
            .arg(subcommand)
            .args(arguments)
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let mut off = Vec::new();
    for (map, preset) in
        [("studio", "black"), ("studio", "blond"), ("sunset", "black"), ("sunset", "blond")]
    {
        let map = format!("builtin:{map}");
        let looks = [&["--env", &map, "--preset", preset], &*words(scene)].concat();
        run("reference", &[&["-q", "--spp", "160", "-o", "truth.exr"], &*looks].concat());
        let [crude, fine] = ["40%", "14%"].map(|quality| {
            let more = ["--quality", quality, "--stats", "figures.json", "-o", "frame.exr"];
            let output = capture(folder.path(), &[&looks[..], &more].concat());
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let compared = run("compare", &["frame.exr", "truth.exr", "--json"]);
            let report: serde_json::Value = serde_json::from_slice(&compared).unwrap();
            let measured = report["noise"]["relative_l2_without"].as_f64().unwrap();
            let figures = json(Path::new(&folder.path().join("figures.json")));
            let expected = figures["quality"]["total"].as_f64().unwrap();
            let ratio = expected / measured;
            println!("{map} {preset} {quality}: expected {expected:.3}, measured {measured:.3}: {ratio:.2}");
            if !(0.5..=2.0).contains(&ratio) {
                off.push(format!("{map} {preset} {quality}: {ratio:.2}"));
            }
            (expected, measured)
        });
        assert!(crude.0 > fine.0, "{map} {preset}: {crude:?} {fine:?}");
        // Of pale hair multiple scattering is most of the error, whatever the setting.
        assert!(preset != "black" || crude.1 > fine.1, "{map} {preset}: {crude:?} {fine:?}");
    }
    assert!(off.is_empty(), "{off:?}");
}

fn words(text: &str) -> Vec<&str> {
    text.split_whitespace().collect()
}

/// The window follows a scene's quality: what it shows is what `capture` makes of it.
#[test]
fn a_quality_is_shown_as_it_is_captured() {
    let folder = tempdir().unwrap();
    let mut scene = crate::editor::small();
    // All settings reach these targets, so that the cheapest are picked, however fast the device is just now; or none
    // does, and those of the least error are.
    scene.environment.lights = None;
    scene.render.quality = Some(Target::Error(0.9));
    let mut window = crate::editor::window(hairlight::editor::Document::new(scene.clone(), None));
    let shown = |window: &crate::editor::Window| {
        let picture = crate::editor::editor(window).picture().unwrap().clone();
        (picture.size, picture.rgba, picture.figures.unwrap().picked.clone())
    };
    let ([width, height], rgba, picked) = shown(&window);
    let line = picked.expect("what was picked");
    assert!(line.contains("4 lights, 4 samples, 0.5 × rays, 3.0 % negligible"), "{line}");
    std::fs::write(folder.path().join("scene.toml"), scene.to_toml()).unwrap();
    let size = format!("{width}x{height}");
    let flags = ["scene.toml", "--size", &size, "-o", "frame.png", "--stats", "frame.json"];
    let output = capture(folder.path(), &flags);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let made = &json(&folder.path().join("frame.json"))["quality"];
    assert!(made["rays"] == 0.5 && made["lights"] == 4, "{made}");
    let captured = image::open(folder.path().join("frame.png")).unwrap().into_rgba8();
    let (most, _) = crate::editor::apart(&rgba, captured.as_raw());
    println!("{line}\ngreatest difference {most}");
    assert!(most <= 1, "{most}");
    // The control: without it, the picture is another.
    let document = &mut window.state_mut().as_mut().unwrap().document;
    document.scene.render.quality = None;
    document.scene.environment.lights = Some(4);
    crate::editor::seen(&mut window);
    let (_, usual, picked) = shown(&window);
    assert!(picked.is_none() && crate::editor::apart(&usual, &rgba).1 > 0.01);
}
