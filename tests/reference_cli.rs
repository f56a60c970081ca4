//! The reference side through the binary: `reference`, `compare`, `probe` and `figures`.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Output, Stdio};

use hairlight::measure::read::Picture;
use serde_json::Value;
use tempfile::tempdir;

use crate::cli::{hairlight, names, run, stderr, stdout};
use crate::frames::{write_tuft, write_unit_map};

/// A quick scene; `write_tuft` makes its strands.
const TUFT: [&str; 6] = ["--hair", "strands.hair", "--size", "48x32", "--chiang-beta-n", "0.4"];

fn done(folder: &Path, arguments: &[&str]) -> Output {
    let output = run(folder, arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", stderr(&output));
    output
}

fn refused(folder: &Path, arguments: &[&str]) -> String {
    let before = names(folder);
    let output = run(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {}", stdout(&output));
    let error = stderr(&output);
    assert_eq!(error.lines().count(), 1, "{arguments:?}: {error}");
    assert_eq!(names(folder), before, "{arguments:?} left files");
    error
}

fn reference(folder: &Path, arguments: &[&str]) {
    done(folder, &[&["reference", "-q"], &TUFT[..], arguments].concat());
}

fn compare(folder: &Path, frame: &str, truth: &str) -> Value {
    let output = done(folder, &["compare", frame, truth, "--json"]);
    serde_json::from_str(&stdout(&output)).unwrap()
}

/// Pictures used to be tiles of runs: they can be gone on with as well.
#[test]
fn a_reference_in_tiles_is_gone_on_with() {
    use exr::prelude::{Encoding, WritableImage, read_all_data_from_file};
    let folder = tempdir().unwrap();
    let path = folder.path();
    write_tuft(path);
    reference(path, &["--spp", "3", "-o", "old.exr"]);
    fs::copy(path.join("old.exr"), path.join("new.exr")).unwrap();
    let mut image = read_all_data_from_file(path.join("old.exr")).unwrap();
    image.layer_data[0].encoding = Encoding::FAST_LOSSLESS;
    image.write().to_file(path.join("old.exr")).unwrap();
    let tiled = |name: &str| {
        let bytes = fs::read(path.join(name)).unwrap();
        bytes.windows(9).any(|text| text == b"tiledesc\0")
    };
    assert!(tiled("old.exr") && !tiled("new.exr"));
    for name in ["old.exr", "new.exr"] {
        reference(path, &["--spp", "5", "-o", name, "--resume"]);
    }
    let [old, new] = ["old.exr", "new.exr"]
        .map(|name| Picture { name: String::new(), ..Picture::read(&path.join(name)).unwrap() });
    assert!(old == new && !tiled("old.exr"));
}

#[test]
fn a_resumed_reference_is_the_one_made_in_one_go() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    write_tuft(path);
    reference(path, &["--spp", "12", "-o", "whole.exr"]);
    reference(path, &["--spp", "5", "-o", "parts.exr"]);
    let five = Picture::read(&path.join("parts.exr")).unwrap();
    reference(path, &["--spp", "12", "-o", "parts.exr", "--resume"]);
    let [whole, parts] = ["whole.exr", "parts.exr"].map(|p| Picture::read(&path.join(p)).unwrap());
    let off = |a: &Picture, b: &Picture| {
        let of = |p: &Picture| p.rgb.iter().flatten().copied().collect::<Vec<f32>>();
        let apart = |(a, b): (&f32, &f32)| (a - b).abs() / (1e-3 + b.abs());
        of(a).iter().zip(&of(b)).map(apart).fold(0.0, f32::max)
    };
    println!("resumed against whole: {:.1e}", off(&parts, &whole));
    assert!(off(&parts, &whole) < 1e-4);
    assert_eq!(parts.hair, whole.hair);
    let noise = compare(path, "parts.exr", "whole.exr")["noise"]["relative_l2"].as_f64().unwrap();
    assert!(noise > 0.0 && noise < 1.0, "{noise}");
    assert!(off(&five, &whole) > 1e-2, "the control: five samples are as good as twelve");

    // Another scene, another option, another file.
    let resume = ["reference", "-q", "--spp", "20", "-o", "parts.exr", "--resume"];
    for other in [["--eta", "1.4"], ["--bcsdf", "chiang"], ["--rng-seed", "1"]] {
        let error = refused(path, &[&resume[..], &TUFT, &other].concat());
        assert!(error.contains("parts.exr") && error.contains("--resume"), "{error}");
    }
    done(
        path,
        &[
            "capture",
            "-q",
            "--adapter",
            "cpu",
            "--lights",
            "2",
            "--hair",
            "strands.hair",
            "--size",
            "48x32",
            "-o",
            "frame.exr",
        ],
    );
    let frame = ["reference", "-q", "-o", "frame.exr", "--resume", "--hair", "strands.hair"];
    assert!(refused(path, &frame).contains("frame.exr"));
}

/// Strands, head and backdrop lie where the frame has them, and are seen as much.
#[test]
fn the_reference_covers_the_pixels_that_a_frame_covers() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    let scene = ["--strands", "2000", "--size", "60x40", "--lights", "4", "--diameter", "0.002"];
    let frame = ["capture", "-q", "--adapter", "cpu", "--samples", "256", "-o", "frame.exr"];
    done(path, &[&frame[..], &scene].concat());
    let truth = ["reference", "-q", "--spp", "256", "--max-depth", "1", "-o", "truth.exr"];
    done(path, &[&truth[..], &scene].concat());
    let [a, b] = ["frame.exr", "truth.exr"].map(|p| Picture::read(&path.join(p)).unwrap());
    let coverage = |a: &Picture, b: &Picture, shift: usize| {
        let (a, b) = (a.hair.as_ref().unwrap(), b.hair.as_ref().unwrap());
        let apart: f32 = a.iter().skip(shift).zip(b).map(|(a, b)| (a - b).abs()).sum();
        f64::from(apart / b.iter().sum::<f32>())
    };
    let (same, moved) = (coverage(&a, &b, 0), coverage(&a, &b, 1));
    // 256 samples each leave noise of 0.03 in a pixel that is half covered.
    println!("coverage: {same:.4} apart, {moved:.4} if moved by a pixel");
    assert!(same < 0.03, "{same}");
    assert!(moved > 0.05, "the control passes: {moved}");
    // Past strands and head the backdrop is the same.
    let free = |i: usize| a.hair.as_ref().unwrap()[i] == 0.0 && i < 60 * 8;
    for i in (0..a.rgb.len()).filter(|&i| free(i)) {
        for c in 0..3 {
            let (a, b) = (a.rgb[i][c], b.rgb[i][c]);
            assert!((a - b).abs() < 1e-3 * b, "backdrop of pixel {i}: {a} against {b}");
        }
    }
}

/// Mean radiance of a frame and its standard error.
fn mean(path: &Path) -> [f64; 2] {
    let picture = Picture::read(path).unwrap();
    let count = picture.rgb.len() as f64;
    let sum: f64 = picture.rgb.iter().map(|p| f64::from(p[1])).sum();
    let variance: f64 = picture.variance.unwrap().iter().map(|v| f64::from(v[1])).sum();
    [sum / count, variance.sqrt() / count]
}

#[test]
fn ten_thousand_clear_strands_under_a_unit_map_are_a_furnace() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    write_unit_map(path);
    let furnace = |model: &str, sigma_a: &str| {
        let groom = ["--hair", "builtin:curly", "--strands", "10000", "--head", "none"];
        let options = ["--env", "unit.exr", "--size", "24x24", "--spp", "64", "-o", "white.exr"];
        let fibre = ["--bcsdf", model, "--sigma-a", sigma_a];
        done(path, &[&["reference", "-q"][..], &groom, &options, &fibre].concat());
        mean(&path.join("white.exr"))
    };
    for model in ["deon", "chiang"] {
        let [mean, error] = furnace(model, "0,0,0");
        println!("{model}: {mean:.5} ± {error:.5}");
        assert!((mean - 1.0).abs() < 4.0 * error + 1e-5, "{model}: {mean} ± {error}");
        assert!(error < 5e-3, "too noisy to tell: {error}");
    }
    // Marschner's three lobes leave out the paths past TRT: 0.008 an event at normal incidence, more at
    // grazing, of many events. They must not make light.
    let [three_lobes, error] = furnace("marschner", "0,0,0");
    println!("marschner: {three_lobes:.5} ± {error:.5}");
    assert!(three_lobes < 0.97 && three_lobes > 0.92, "{three_lobes} ± {error}");
    assert!(error < 5e-3, "too noisy to tell: {error}");
    let [grey, _] = furnace("deon", "0.05,0.05,0.05");
    assert!(grey < 0.95, "the control: {grey} with absorption");
}

#[test]
fn compare_judges_and_refuses() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    write_tuft(path);
    reference(path, &["--spp", "4", "-o", "a.exr"]);
    reference(path, &["--spp", "4", "--rng-seed", "1", "-o", "b.exr"]);
    let report = compare(path, "b.exr", "a.exr");
    assert!(report["relative_l2"].as_f64().unwrap() > 0.0);
    assert_eq!(compare(path, "a.exr", "a.exr")["relative_l2"].as_f64(), Some(0.0));
    let shown = done(path, &["compare", "b.exr", "a.exr", "--out", "diff.png"]);
    assert!(stdout(&shown).contains("relative L2"), "{}", stdout(&shown));
    assert!(image::open(path.join("diff.png")).unwrap().width() >= 4 * 48);

    reference(path, &["--spp", "1", "--size", "24x32", "-o", "small.exr"]);
    fs::write(path.join("text.exr"), "no picture").unwrap();
    for (frame, says) in
        [("small.exr", "24"), ("text.exr", "text.exr"), ("missing.exr", "missing.exr")]
    {
        let error = refused(path, &["compare", frame, "a.exr"]);
        assert!(error.contains(says) && !error.contains('\u{1b}'), "{error}");
    }
    refused(path, &["compare", "a.exr", "b.exr", "--out", "diff.exr"]);
}

/// `probe` with `input` on its stdin.
fn probe(arguments: &[&str], input: &str) -> Output {
    let folder = tempdir().unwrap();
    let mut child = hairlight(folder.path())
        .arg("probe")
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    child.wait_with_output().unwrap()
}

#[test]
fn the_gpu_answers_probes_as_its_twin_does() {
    let srbf = "theta_o,phi_o,theta_j,phi_j,lambda_j,eta,sigma_a,beta_r_deg,w_c\n\
        0.3,1,-0.2,0,0.3,1.55,0.2,7,0.15\n-0.5,2.9,0.4,0,0.6,1.55,0.2,7,0.15\n\
        0.1,0.4,0,-0.3,0.15,1.6,1.3,9,0.2\n";
    let dual = "eta,theta,sigma_a,beta_r_deg,w_c\n1.55,0.3,0.2,7,0.15\n1.5,-1,0,9,0.2\n";
    for (function, method, input) in
        [("srbf", "fast", srbf), ("srbf", "xu", srbf), ("dual", "xu", dual)]
    {
        let table = |arguments: &[&str]| {
            let output = probe(&[&[function], arguments].concat(), input);
            assert!(output.status.success(), "{}", stderr(&output));
            let rows: Vec<Vec<String>> = stdout(&output)
                .lines()
                .map(|l| l.split(',').map(str::to_owned).collect())
                .collect();
            rows
        };
        let cpu = table(&["--method", method]);
        let gpu = table(&["--method", method, "--on", "gpu", "--adapter", "cpu"]);
        assert_eq!(cpu[0], gpu[0], "{function}");
        let given = input.lines().next().unwrap().split(',').count();
        let mut worst = 0f64;
        for (cpu, gpu) in cpu[1..].iter().zip(&gpu[1..]) {
            for (a, b) in cpu[given..].iter().zip(&gpu[given..]) {
                let [a, b]: [f64; 2] = [a, b].map(|v| v.parse().unwrap());
                worst = worst.max((a - b).abs() / (2e-3 * a.abs() + 2e-4));
            }
        }
        println!("{function}: {worst:.3} of the tolerance of tests/wgsl.rs");
        assert!(worst < 1.0, "{function}: {worst}");
        // The control: the exact quantity is not the method's.
        assert_ne!(table(&["--method", "exact"])[1][given], cpu[1][given]);
    }
    let wrong = probe(&["srbf"], "theta_o,phi_x\n1,2\n");
    assert_eq!(wrong.status.code(), Some(1));
    assert!(stderr(&wrong).contains("phi_x") && stdout(&wrong).is_empty(), "{}", stderr(&wrong));
}

#[test]
fn figures_are_drawn_by_name() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    done(path, &["figures", "pbrt_9_52", "-q", "-o", "plots"]);
    assert_eq!(names(&path.join("plots")), ["pbrt_9_52.csv", "pbrt_9_52.png", "pbrt_9_52.svg"]);
    assert!(refused(path, &["figures", "pbrt_1", "-o", "plots"]).contains("pbrt_9_52"));
}

/// Ctrl-C keeps the samples that are there, and --resume goes on with them.
#[cfg(unix)]
#[test]
fn a_cancelled_reference_keeps_its_samples() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    write_tuft(path);
    let arguments =
        |spp: &'static str| [&["reference", "--spp", spp, "-o", "long.exr"], &TUFT[..]].concat();
    let child = hairlight(path).args(arguments("1000000")).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(3000));
    let sent = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(stderr(&output).contains("--resume"), "{}", stderr(&output));
    let kept = Picture::read(&path.join("long.exr")).unwrap();
    assert!(kept.variance.is_some());
    let resumed = run(path, &[&arguments("1")[..], &["--resume"]].concat());
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    assert_eq!(Picture::read(&path.join("long.exr")).unwrap().rgb.len(), kept.rgb.len());
}
