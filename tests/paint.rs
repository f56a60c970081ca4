//! Painted fibres: the file, the shader's fibre, and frames against frames and paths of the fibre that was painted.

use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex};

use hairlight::gpu::Gpu;
use hairlight::gpu::frame::Frame;
use hairlight::gpu::method::MethodData;
use hairlight::gpu::probe;
use hairlight::live::{Said, Session, Wish};
use hairlight::measure::compare::compare;
use hairlight::measure::read::Picture;
use hairlight::paint::{Channel, Fibres, Paint, PointFibre};
use hairlight::scattering::fibre::Fibre;
use hairlight::scattering::model::Model;
use hairlight::scene::{Scene, parse_assignment};
use hairlight::stage::Geometry;
use tempfile::tempdir;

use crate::frames::{capture, captured};

const STRANDS: &str = "--strands=2000";
const LOOK: [&str; 9] = [
    STRANDS,
    "--env",
    "builtin:sunset",
    "--size",
    "72x54",
    "--background",
    "transparent",
    "--samples",
    "64",
];

fn scene(settings: &[&str]) -> Scene {
    let mut scene = Scene::default();
    scene.hair.strands = 2000;
    scene.apply(settings.iter().map(|text| parse_assignment(text).unwrap()).collect()).unwrap();
    scene
}

/// What paints a whole channel as the fibre has it.
fn cover(paint: &mut Paint, channel: Channel, fibre: &Fibre, points: impl Iterator<Item = usize>) {
    let layer = paint.layer_mut(channel);
    let value = channel.of(fibre);
    points.for_each(|point| layer.set(point, value, 1.0));
}

/// Writes paint that makes the whole groom of `of` into its fibre.
fn write_cover(path: &Path, of: &Scene, channels: &[Channel]) {
    let stage = Geometry::load(of).unwrap();
    let hair = stage.groom();
    let mut paint = Paint::bare(hair.points.len());
    for &channel in channels {
        cover(&mut paint, channel, &of.fibre.resolve(), 0..hair.points.len());
    }
    paint.write(path, hair).unwrap();
}

/// Relative L2 of a frame over hair, and the mean ratio of green.
fn apart(folder: &Path, frame: &str, truth: &str) -> (f64, f64) {
    let read = |name: &str| Picture::read(&folder.join(name)).unwrap();
    let report = compare(&read(frame), &read(truth)).unwrap();
    (report.relative_l2, report.mean_ratio[1].unwrap())
}

#[test]
fn a_file_reads_back_and_is_refused_where_it_does_not_belong() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("hair.paint");
    let stage = Geometry::load(&scene(&[])).unwrap();
    let hair = stage.groom();
    let mut paint = Paint::bare(hair.points.len());
    for (i, channel) in Channel::ALL.into_iter().enumerate() {
        let layer = paint.layer_mut(channel);
        for point in (0..hair.points.len()).step_by(7 + i) {
            let value = 1.0 + 0.001 * (point % 100) as f32;
            layer.set(point, [value, 2.0 * value, 3.0 * value], 0.001 * (1 + point % 999) as f32);
        }
    }
    paint.write(&path, hair).unwrap();
    assert!(Paint::read(&path, hair).unwrap() == paint, "it reads back");
    let bytes = std::fs::read(&path).unwrap();
    println!("{} points, all channels: {} bytes", hair.points.len(), bytes.len());

    let refused = |bytes: &[u8], hair: &str, says: &str| {
        std::fs::write(&path, bytes).unwrap();
        let arguments = [STRANDS, "--paint", "hair.paint", "--hair", hair];
        let output = capture(folder.path(), &arguments);
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(error.contains("hair.paint") && error.contains(says), "{says}: {error}");
    };
    refused(&bytes, "builtin:curly", "another groom");
    let mut moved = hair.clone();
    moved.points[3].x += 1e-6;
    let error = Paint::read(&path, &moved).unwrap_err();
    assert!(format!("{error:#}").contains("another groom"), "{error:#}");
    refused(b"", "builtin:bob", "is empty");
    refused(b"[hair]\n", "builtin:bob", "is not paint but a scene file");
    refused(&bytes[..60], "builtin:bob", "cut short");
    refused(&bytes[..bytes.len() - 1], "builtin:bob", "damaged");
    for at in [90, bytes.len() / 2] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        refused(&damaged, "builtin:bob", "damaged");
    }
    let mut newer = bytes.clone();
    newer[7] = 2;
    refused(&newer, "builtin:bob", "version 2");
    std::fs::remove_file(&path).unwrap();
    let output = capture(folder.path(), &[STRANDS, "--paint", "hair.paint"]);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.contains("hair.paint") && error.contains("cannot be read"), "{error}");
    // The paper's method has tables of one fibre.
    paint.write(&path, hair).unwrap();
    let output = capture(folder.path(), &[STRANDS, "--paint", "hair.paint", "--method", "xu"]);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && error.contains("--method fast"), "{error}");
    // A builtin groom has no colours of its own.
    let output = capture(folder.path(), &[STRANDS, "--paint", "colors"]);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && error.contains("no colours"), "{error}");
}

/// Hair painted twice as thick is hair of twice the diameter: frames, density of its shadows, and paths.
#[test]
fn painted_thickness_is_diameter() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    let stage = Geometry::load(&scene(&[])).unwrap();
    let points = stage.groom().points.len();
    let mut paint = Paint::bare(points);
    let layer = paint.layer_mut(Channel::Thickness);
    (0..points).for_each(|point| layer.set(point, [2.0; 3], 1.0));
    paint.write(&path.join("thick.paint"), stage.groom()).unwrap();
    let [once, twice] = [1.0, 2.0].map(|k| format!("fibre.diameter={}", k * stage.diameter));
    let frame = |name: &str, more: &[&str]| {
        captured(path, &[&LOOK[..], more, &["-o", name]].concat());
        Picture::read(&path.join(name)).unwrap()
    };
    let painted = frame("painted.exr", &["--set", &once, "--paint", "thick.paint"]);
    let thick = frame("thick.exr", &["--set", &twice]);
    let thin = frame("thin.exr", &["--set", &once]);
    assert!(painted.rgb == thick.rgb, "the very same frame");
    // The paper's method has no painted fibres, but fibres of any thickness.
    frame("xu.exr", &["--set", &once, "--paint", "thick.paint", "--method", "xu"]);
    let off = compare(&painted, &thin).unwrap().relative_l2;
    println!("twice as thick or not: {off:.3}");
    assert!(off > 0.2, "the control");

    // As the editor draws it: at once, and whole.
    let mut session = Session::default();
    let mut see = |paint: Option<Arc<Paint>>, moving: bool| {
        let shown = Mutex::new(None);
        let say = |said: Said| {
            if let Said::Picture(picture) = said {
                *shown.lock().unwrap() = Some(picture.frame);
            }
        };
        let mut scene = scene(&[&once]);
        scene.render.adapter = "cpu".to_owned();
        let wish = Wish { paint, moving, ..Wish::new(scene, [72, 54]) };
        assert!(session.see(&wish, &|| true, &say).unwrap());
        shown.into_inner().unwrap().expect("a picture")
    };
    let cover = |frame: &Frame| frame.hair_coverage.iter().sum::<f32>();
    let bare = see(None, false);
    let paint = Arc::new(paint);
    let hurried = see(Some(paint.clone()), true);
    assert!(cover(&hurried) > 1.2 * cover(&bare), "wider at once");
    let whole = see(Some(paint), false);
    assert!(cover(&whole) > 1.2 * cover(&bare));
    let again = see(None, false);
    assert_eq!(again.pixels, bare.pixels, "and back");
}

#[test]
fn the_shader_unpacks_the_fibre_of_a_point() {
    let gpu = Gpu::new("cpu").unwrap();
    let linked = scene(&["fibre.alpha_r_deg=-3"]);
    let own = scene(&[
        "fibre.beta_tt_deg=3",
        "fibre.alpha_trt_deg=7",
        "fibre.eccentricity=1.2",
        "fibre.intensity_r=3",
        "fibre.tint_trt=[0.5, 0.25, 0]",
    ]);
    let points = [
        [0.5, 1.0, 2.0, 7.5, -2.5, 1.55, 1.0],
        [0.0, 0.1, 31.0, 0.05, 20.0, 1.0, 0.5],
        [1.0, 1.0, 1.0, 45.0, -20.0, 3.0, 2.0],
    ];
    let inputs: Vec<[f32; 8]> =
        points.iter().map(|p| std::array::from_fn(|k| p.get(k).copied().unwrap_or(0.0))).collect();
    for scene in [&linked, &own] {
        let mut fibres = Fibres::new(&scene.fibre, None);
        let mut paint = Paint::bare(2);
        cover(&mut paint, Channel::Eta, &Fibre { eta: 3.0, ..*fibres.base() }, 0..1);
        cover(
            &mut paint,
            Channel::Eccentricity,
            &Fibre { eccentricity: 2.0, ..*fibres.base() },
            0..1,
        );
        fibres.repaint(&paint);
        let method = MethodData::of(fibres.clone(), Model::Marschner, 2);
        let run = |statement: &str| probe::run(&gpu, statement, &method, &inputs).unwrap();
        let lobes = run("let f = painted_fibre(fibre, x[0], x[1]);
            y[0] = vec4f(f.alpha, f.eta); y[1] = vec4f(f.lambda, f.eta_star.x); y[2] = vec4f(f.sigma_a, f.eta_star.y);");
        let tints = run("let f = painted_fibre(fibre, x[0], x[1]);
            for (var t = 0u; t < 3u; t++) { y[t] = vec4f(f.tint[t], 0.0); }");
        for ((point, out), tints) in points.iter().zip(lobes).zip(tints) {
            let tint = [0, 1, 2].map(|t| [0, 1, 2].map(|c| f64::from(tints[4 * t + c])));
            assert_eq!(tint, fibres.base().tint, "tints are of the whole groom");
            let wanted = fibres.fibre(PointFibre::from_f32(*point));
            let (mean, half) =
                hairlight::scattering::azimuthal::eccentric_eta(wanted.eta, wanted.eccentricity);
            let numbers = [
                wanted.alpha.to_vec(),
                vec![wanted.eta],
                wanted.beta.map(|b| 8f64.sqrt() * b).to_vec(),
                vec![mean],
                wanted.sigma_a.to_vec(),
                vec![half],
            ]
            .concat();
            for (k, (got, wanted)) in out.iter().zip(&numbers).enumerate() {
                let off = (f64::from(*got) - wanted).abs();
                // Halves have eleven bits.
                assert!(off < 2e-3 * wanted.abs().max(0.01), "{k}: {got} for {wanted}");
            }
        }
    }
}

const TWO: [(&str, &[Channel], &[&str]); 3] = [
    ("colour", &[Channel::Absorption], &["fibre.eumelanin=0.2", "fibre.pheomelanin=0.5"]),
    (
        "lobes",
        &[Channel::Roughness, Channel::Tilt],
        &["fibre.preset=blond", "fibre.beta_r_deg=14", "fibre.alpha_r_deg=-7"],
    ),
    (
        "section",
        &[Channel::Eta, Channel::Eccentricity],
        &["fibre.preset=blond", "fibre.eta=1.8", "fibre.eccentricity=0.9"],
    ),
];

/// Makes a picture of hair of a fibre of [`TWO`], of other hair painted all over with it, and of that hair bare: how
/// far the painted and the bare are from the first.
fn painted_and_bare(
    folder: &Path,
    (name, channels, settings): (&str, &[Channel], &[&str]),
    make: impl Fn(&[&str]),
    own_arguments: &[&str],
) -> [(f64, f64); 2] {
    write_cover(&folder.join("all.paint"), &scene(settings), channels);
    // What is painted is taken back from the scene.
    let base = if name == "colour" { "fibre.eumelanin=8" } else { "fibre.preset=blond" };
    let own: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting]).collect();
    make(&[&own, own_arguments, &["-o", "own.exr"]].concat());
    make(&["--set", base, "--paint", "all.paint", "-o", "painted.exr"]);
    make(&["--set", base, "-o", "bare.exr"]);
    ["painted.exr", "bare.exr"].map(|picture| apart(folder, picture, "own.exr"))
}

#[test]
fn hair_painted_all_over_is_hair_of_that_fibre() {
    let folder = tempdir().unwrap();
    for of in TWO {
        let name = of.0;
        for bcsdf in ["marschner", "deon"].into_iter().take(1 + usize::from(name == "lobes")) {
            let make = |more: &[&str]| {
                captured(folder.path(), &[&LOOK[..], &["--bcsdf", bcsdf], more].concat());
            };
            let [painted, bare] = painted_and_bare(folder.path(), of, make, &[]);
            println!("{name}, {bcsdf}: painted {painted:.4?}, bare {bare:.4?}");
            assert!(painted.0 < 0.01, "{name}, {bcsdf}: {painted:?}");
            // The control.
            assert!(bare.0 > 0.05, "{name}, {bcsdf}: {bare:?}");
        }
    }
}

pub fn referenced(folder: &Path, arguments: &[&str]) {
    let run = Command::new(env!("CARGO_BIN_EXE_hairlight"))
        .current_dir(folder)
        .args(["reference", "-q"])
        .args(arguments)
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

const TRACED: [&str; 7] =
    [STRANDS, "--env", "builtin:overcast", "--size", "40x30", "--background", "transparent"];

#[test]
fn paths_through_painted_hair_are_those_of_its_fibre() {
    let folder = tempdir().unwrap();
    for of in TWO {
        let name = of.0;
        for bcsdf in ["marschner", "deon"] {
            let look = [&TRACED[..], &["--bcsdf", bcsdf, "--spp", "128"]].concat();
            let make = |more: &[&str]| referenced(folder.path(), &[&look[..], more].concat());
            let [painted, bare] = painted_and_bare(folder.path(), of, make, &["--rng-seed", "1"]);
            println!("{name}, {bcsdf}: mean ratio painted {:.4}, bare {:.4}", painted.1, bare.1);
            assert!((painted.1 - 1.0).abs() < 0.015, "{name}, {bcsdf}: {painted:?}");
            // The control.
            assert!((bare.1 - 1.0).abs() > 0.03, "{name}, {bcsdf}: {bare:?}");
        }
    }
}

#[test]
fn tints_are_of_painted_hair_too() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    let tints = ["--intensity-r", "2", "--intensity-tt", "0.5", "--tint-trt", "1,0.8,0.2"];
    let shade = |more: &[&str]| captured(path, &[&LOOK[..], &tints, more].concat());
    let [painted, bare] = painted_and_bare(path, TWO[0], shade, &[]);
    println!("frame: painted {painted:.4?}, bare {bare:.4?}");
    assert!(painted.0 < 0.01 && bare.0 > 0.05, "{painted:?} {bare:?}");
    let traced = [&TRACED[..], &tints, &["--spp", "128"]].concat();
    let trace = |more: &[&str]| referenced(path, &[&traced[..], more].concat());
    let [painted, bare] = painted_and_bare(path, TWO[0], trace, &["--rng-seed", "1"]);
    println!("path traced: mean ratio painted {:.4}, bare {:.4}", painted.1, bare.1);
    assert!((painted.1 - 1.0).abs() < 0.015 && (bare.1 - 1.0).abs() > 0.03);
}

/// Dark roots and pale tips, rougher towards them: the frame against the path tracer, which know paint each for itself.
#[test]
fn a_painted_frame_is_as_near_to_its_truth_as_an_even_one() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    let stage = Geometry::load(&scene(&[])).unwrap();
    let hair = stage.groom();
    let mut paint = Paint::bare(hair.points.len());
    for strand in hair.strands() {
        let count = strand.len() as f32 - 1.0;
        for (k, point) in strand.enumerate() {
            let t = k as f32 / count;
            let root = 1.3 - 1.2 * t;
            paint.layer_mut(Channel::Absorption).set(
                point,
                [0.5 * root, 0.8 * root, 1.1 * root],
                1.0,
            );
            paint.layer_mut(Channel::Roughness).set(point, [5.0 + 8.0 * t, 0.0, 0.0], 1.0);
        }
    }
    paint.write(&path.join("tips.paint"), hair).unwrap();
    let look =
        [STRANDS, "--env", "builtin:overcast", "--size", "64x48", "--background", "transparent"];
    let (tips, blond) = (["--paint", "tips.paint"], ["--preset", "blond"]);
    let error = |shown: &[&str], traced: &[&str]| {
        referenced(path, &[&look[..], traced, &["--spp", "96", "-o", "truth.exr"]].concat());
        captured(path, &[&look[..], shown, &["--samples", "64", "-o", "frame.exr"]].concat());
        apart(path, "frame.exr", "truth.exr")
    };
    let (painted, even) = (error(&tips, &tips), error(&blond, &blond));
    let wrong = error(&blond, &tips);
    println!("painted {painted:.3?}, even {even:.3?}, another's {wrong:.3?}");
    assert!(painted.0 < 1.4 * even.0, "{painted:?} {even:?}");
    // The control.
    assert!(wrong.0 > 2.0 * painted.0, "{wrong:?}");
}

/// What paint costs where it is, and what a stroke over all points takes.
#[test]
#[ignore = "by hand: prints times"]
fn by_hand_cost_of_paint() {
    use std::time::Instant;

    use hairlight::gpu::frame::{Background, Parts, Renderer};
    use hairlight::light::HairMedium;
    use hairlight::stage::shaded_lights;

    let mut scene = Scene::default();
    scene.output.size = [360, 240];
    let stage = Geometry::load(&scene).unwrap();
    let lens = stage.camera(&scene).unwrap().lens(stage.center, scene.output.size);
    let medium = HairMedium::new(&stage, true);
    let map = hairlight::environment::load("builtin:studio").unwrap().environment;
    let fit = hairlight::srbf::fit_cached(&map, 40, &|_| true).unwrap();
    let lights = shaded_lights(&fit.lights, &scene);
    let of = |channels: &[Channel]| {
        let mut fibres = Fibres::new(&scene.fibre, None);
        let mut paint = Paint::bare(stage.groom().points.len());
        let begun = Instant::now();
        for &channel in channels {
            let layer = paint.layer_mut(channel);
            for point in 0..stage.groom().points.len() {
                let t = (point % 26) as f32 / 25.0;
                let value = match channel {
                    Channel::Absorption => [0.2 + 0.6 * t, 0.3 + 0.7 * t, 0.4 + 0.9 * t],
                    Channel::Roughness => [5.0 + 8.0 * t, 0.0, 0.0],
                    Channel::Tilt => [-5.0 * t, 0.0, 0.0],
                    Channel::Eta => [1.45 + 0.2 * t, 0.0, 0.0],
                    Channel::Eccentricity => [0.9 + 0.2 * t, 0.0, 0.0],
                    Channel::Thickness => [0.5 + t, 0.0, 0.0],
                };
                layer.set(point, value, 1.0);
            }
        }
        if !channels.is_empty() {
            fibres.repaint(&stage.at_points(&paint));
        }
        (fibres, 1e3 * begun.elapsed().as_secs_f64())
    };
    let parts = Parts { single: true, global: true, local: true };
    let cases = [
        ("even", &[][..]),
        ("colour", &[Channel::Absorption]),
        ("colour, roughness, tilt", &[Channel::Absorption, Channel::Roughness, Channel::Tilt]),
        ("all", &Channel::ALL),
    ];
    let gpu = || Gpu::new("cpu").unwrap();
    let mut first = None;
    for (name, channels) in cases {
        let (fibres, stroke_ms) = of(channels);
        let begun = Instant::now();
        let method = MethodData::of(fibres, Model::Marschner, 2);
        let tables_ms = 1e3 * begun.elapsed().as_secs_f64();
        let mut renderer = Renderer::new(gpu(), &method, &stage).unwrap();
        let points = renderer.visible_points(&[lens], stage.pieces(&lens), 16).unwrap();
        let lit = medium.bring(&stage, lights.clone(), &points, &|_| true).unwrap();
        let begun = Instant::now();
        let field = lit.field(&stage, &medium, &method, &|_| true).unwrap();
        let field_ms = 1e3 * begun.elapsed().as_secs_f64();
        let at = (&stage, &medium);
        lit.show(at, &mut renderer, &method, field.as_ref(), 1.0, &|_| true).unwrap();
        let mut best = f64::INFINITY;
        for _ in 0..5 {
            let frame = renderer.render(&lens, 16, Background::Transparent, parts).unwrap();
            let shade = frame.passes.get("shade").copied();
            best = best.min(shade.unwrap_or(f64::INFINITY));
        }
        let even = *first.get_or_insert(best);
        println!(
            "{name}: {} points painted in {stroke_ms:.0} ms, tables {tables_ms:.0} ms, field {field_ms:.0} ms, \
             shading {:.2} of an even one's ({best:.0} ms)",
            stage.groom().points.len(),
            best / even
        );
    }
}
