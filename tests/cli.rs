//! The program through its binary: exit codes, error lines, and what is left on the disk.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use hairlight::scene::{FIELDS, Scene};
use tempfile::{TempDir, tempdir};

use crate::scene::{samples, scene_with};

pub fn hairlight(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hairlight"));
    command.current_dir(folder).env("HAIRLIGHT_CACHE", folder.join("cache")).stdin(Stdio::null());
    command
}

pub fn run(folder: &Path, arguments: &[&str]) -> Output {
    hairlight(folder).args(arguments).output().expect("the binary runs")
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

pub fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn every_flag_does_what_its_key_does() {
    let folder = tempdir().unwrap();
    for field in FIELDS {
        let literal = samples(field).swap_remove(0);
        let typed = literal.trim_matches('"');
        let output =
            run(folder.path(), &["capture", &format!("--{}", field.flag), typed, "--print-scene"]);
        assert_eq!(output.status.code(), Some(0), "--{} {typed}: {}", field.flag, stderr(&output));
        let printed = Scene::from_toml(&stdout(&output), "printed", Path::new("")).unwrap();
        assert_eq!(printed, scene_with(field, &literal), "--{} {typed}", field.flag);
    }
    assert!(names(folder.path()).is_empty());
}

#[test]
fn later_flags_hold_over_earlier_ones_and_over_the_file() {
    let folder = tempdir().unwrap();
    fs::write(folder.path().join("a.toml"), "[fibre]\neta = 1.4\nsigma_a = [1, 2, 3]\n").unwrap();
    let scene = |arguments: &[&str]| {
        let arguments = [&["capture", "a.toml", "--print-scene"], arguments].concat();
        let output = run(folder.path(), &arguments);
        Scene::from_toml(&stdout(&output), "printed", Path::new("")).unwrap()
    };
    assert_eq!(scene(&[]).fibre.eta, 1.4);
    assert_eq!(scene(&["--eta", "1.5", "--set", "fibre.eta=1.6"]).fibre.eta, 1.6);
    assert_eq!(scene(&["--set", "fibre.eta=1.6", "--eta", "1.5"]).fibre.eta, 1.5);
    assert_eq!(scene(&["--eta", "1.5", "--eta", "1.7"]).fibre.eta, 1.7);
    let red = scene(&["--beta-r", "9", "--preset", "red"]).fibre;
    assert_eq!((red.beta_r_deg, red.preset.as_str()), (9.0, "red"));
    assert_ne!(red.pigment, scene(&[]).fibre.pigment);
}

#[test]
fn wrong_usage_exits_with_2_and_says_what_to_type() {
    let folder = tempdir().unwrap();
    for (arguments, says) in [
        (&[][..], "Usage"),
        (&["render"], "render"),
        (&["capture", "--colour", "red"], "--colour"),
        (&["capture", "--eta", "9"], "`fibre.eta` must be a number from 1 to 3, not 9"),
        (&["capture", "--set", "fibre.etta=1.6"], "did you mean `fibre.eta`?"),
        (&["capture", "--set", "fibre.eta"], "key=value"),
        (&["capture", "--size", "0x10"], "each side from 1 to 8192"),
        (&["capture", "--preset", "blonde"], "blond"),
        (&["capture", "--hair", "builtin:mohawk"], "builtin:wavy"),
        (&["capture", "-o", "frame.jpg"], ".png or .exr"),
        (&["capture", "--sigma-a", "1,1,1", "--color", "#804020"], "keep one"),
        (&["capture", "--position", "0,0,5", "--set", "camera.distance=3"], "keep one"),
        (&["fit"], "MAP"),
        (&["fit", "builtin:studio", "--lights", "257"], "from 1 to 256"),
        (&["info"], "FILE"),
    ] {
        let output = run(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stdout(&output).is_empty(), "{arguments:?}");
        assert!(stderr(&output).contains(says), "{arguments:?}: {}", stderr(&output));
    }
    assert!(names(folder.path()).is_empty());
}

#[test]
fn wrong_input_exits_with_1_and_one_line_and_writes_nothing() {
    let folder = folder_of_wrong_files();
    let before = names(folder.path());
    for (arguments, says) in [
        (&["capture", "absent.toml"][..], "absent.toml: "),
        (&["capture", "range.toml"], "range.toml:3: `fibre.eta` must be a number from 1 to 3"),
        (&["capture", "unknown.toml"], "did you mean `output.size`?"),
        (&["capture", "syntax.toml"], "syntax.toml:1:"),
        (&["capture", "conflict.toml"], "conflict.toml: `fibre.sigma_a` and `fibre.color`"),
        (&["capture", "binary.toml"], "binary.toml: is not a scene file"),
        (&["capture", "."], ".: "),
        (&["capture", "--hair", "absent.hair"], "absent.hair: "),
        (&["capture", "--hair", "empty.hair"], "empty.hair: "),
        (&["capture", "--head", "absent.obj"], "absent.obj: "),
        (&["capture", "--env", "cut.exr"], "cut.exr"),
        (&["capture", "--adapter", "no such adapter"], "adapter"),
        (&["capture", "-o", "absent/frame.png"], "absent"),
        (&["fit", "absent.exr", "-o", "lights.json"], "absent.exr"),
        (&["fit", "cut.exr", "--preview", "preview.png"], "cut.exr"),
        (&["info", "absent.hair"], "absent.hair: "),
        (&["info", "cut.exr"], "cut.exr"),
        (&["info", "empty.hair"], "empty.hair: "),
        (&["info", "range.toml"], "range.toml:3: "),
        (&["info", "lights.txt"], "lights.txt: "),
    ] {
        let output = run(folder.path(), arguments);
        let error = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {error}");
        // Notes may come first, but there is one error, it comes last, and it is one line.
        let last = error.lines().last().unwrap_or_default();
        assert!(last.starts_with("error: ") && last.contains(says), "{arguments:?}: {error}");
        assert_eq!(error.matches("error: ").count(), 1, "{arguments:?}: {error}");
        assert!(stdout(&output).is_empty(), "{arguments:?}");
    }
    let after: Vec<String> = names(folder.path()).into_iter().filter(|n| n != "cache").collect();
    assert_eq!(after, before);
}

fn folder_of_wrong_files() -> TempDir {
    let folder = tempdir().unwrap();
    let files: [(&str, &[u8]); 8] = [
        ("range.toml", b"# high\n[fibre]\neta = 9\n"),
        ("unknown.toml", b"outputs.size = [10, 10]"),
        ("syntax.toml", b"[fibre\n"),
        ("conflict.toml", b"fibre.sigma_a = [1, 1, 1]\nfibre.color = '#804020'"),
        ("binary.toml", b"HAIR\xff\xfe\x00"),
        ("empty.hair", b""),
        ("cut.exr", b"\x76\x2f\x31\x01\x02\x00\x00\x00"),
        ("lights.txt", b"{ \"lights\": [3] }"),
    ];
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    folder
}

#[test]
fn info_tells_files_by_their_content() {
    let folder = tempdir().unwrap();
    let triangle = "# a head\nv 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n";
    fs::write(folder.path().join("head.txt"), triangle).unwrap();
    fs::write(folder.path().join("scene.txt"), "fibre.preset = 'white'").unwrap();
    for (file, says) in [
        ("head.txt", "triangles             1\n"),
        ("scene.txt", "preset = \"white\""),
        ("builtin:bob", "strands               20000\n"),
        ("builtin:night", "512 × 256"),
    ] {
        let output = run(folder.path(), &["info", file]);
        assert_eq!(output.status.code(), Some(0), "{file}: {}", stderr(&output));
        assert!(stdout(&output).contains(says), "{file}: {}", stdout(&output));
    }
}

#[test]
fn fit_writes_lights_that_info_reads_and_a_preview() {
    let folder = tempdir().unwrap();
    let arguments =
        ["fit", "builtin:overcast", "--lights", "2", "-o", "l.json", "--preview", "l.png"];
    for cached in [false, true] {
        let output = run(folder.path(), &arguments);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert!(stdout(&output).contains("energy ratio"), "{}", stdout(&output));
        assert_eq!(stdout(&output).contains("cached"), cached, "{}", stdout(&output));
        assert_eq!(stderr(&output), "", "no progress where stderr is no terminal");
    }
    assert_eq!(names(folder.path()), ["cache", "l.json", "l.png"]);
    let info = run(folder.path(), &["info", "l.json"]);
    assert!(stdout(&info).contains("lights                2\n"), "{}", stdout(&info));
}

/// A groom that takes seconds in every stage.
const LONG: [&str; 4] = ["--strands", "60000", "--size", "960x640"];

/// Where there is no Vulkan, OpenGL is no way out: its frames would lack the hair.
#[cfg(target_os = "linux")]
#[test]
fn without_vulkan_one_line_says_what_to_install_and_no_frame_is_written() {
    let folder = tempdir().unwrap();
    let small = ["--strands", "1000", "--size", "32x32", "--lights", "2", "-q", "-o", "frame.png"];
    let capture = |more: &[&'static str]| [&["capture"], &small[..], more].concat();
    let all =
        [capture(&[]), capture(&["--method", "xu"]), capture(&["--quality", "30%"]), vec!["view"]];
    for arguments in all {
        for (variable, value, says) in [
            ("VK_DRIVER_FILES", "/nowhere", "mesa-vulkan-drivers"),
            ("WGPU_BACKEND", "gl", "WGPU_BACKEND"),
        ] {
            let mut command = hairlight(folder.path());
            let output = command.args(&arguments).env(variable, value).output().unwrap();
            let error = stderr(&output);
            assert_eq!(output.status.code(), Some(1), "{variable} {arguments:?}: {error}");
            assert_eq!(error.lines().count(), 1, "{variable} {arguments:?}: {error}");
            assert!(error.contains(says), "{variable} {arguments:?}: {error}");
            assert!(!folder.path().join("frame.png").exists());
        }
    }
    let output = run(folder.path(), &capture(&[]));
    assert_eq!(output.status.code(), Some(0), "with Vulkan: {}", stderr(&output));
}

#[test]
fn an_input_is_not_written_over() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    let map = ["fit", "builtin:overcast", "--lights", "1", "-q", "--preview"];
    assert_eq!(run(path, &[&map[..], &["map.png"]].concat()).status.code(), Some(0));
    fs::write(path.join("map.exr"), "a map").unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("map.exr", path.join("link.exr")).unwrap();
    fs::create_dir(path.join("folder")).unwrap();
    for arguments in [
        &["capture", "--env", "map.exr", "-o", "map.exr"][..],
        &["capture", "--env", "map.exr", "-o", "folder/../map.exr"],
        #[cfg(unix)]
        &["capture", "--env", "map.exr", "-o", "link.exr"],
        &["capture", "--env", "map.0001.exr", "--turntable", "2", "-o", "map.exr"],
        &["reference", "--env", "map.exr", "-o", "map.exr"],
        &["fit", "map.exr", "-o", "map.exr"],
        &["fit", "builtin:night", "-o", "same.json", "--preview", "same.json"],
        &["capture", "--env", "map.json", "--stats", "map.json"],
    ] {
        let output = run(path, arguments);
        let error = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {error}");
        assert_eq!(error.lines().count(), 1, "{arguments:?}: {error}");
        assert!(error.contains("choose another name"), "{arguments:?}: {error}");
        assert_eq!(fs::read_to_string(path.join("map.exr")).unwrap(), "a map", "{arguments:?}");
    }
}

#[cfg(unix)]
#[test]
fn an_output_that_is_a_link_writes_what_it_leads_to() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    fs::create_dir(path.join("real")).unwrap();
    std::os::unix::fs::symlink("real/lights.json", path.join("link.json")).unwrap();
    let fit = ["fit", "builtin:overcast", "--lights", "1", "-q", "-o", "link.json"];
    // The first time the link leads nowhere yet.
    for _ in 0..2 {
        assert_eq!(run(path, &fit).status.code(), Some(0));
        assert!(fs::symlink_metadata(path.join("link.json")).unwrap().is_symlink());
        assert!(fs::symlink_metadata(path.join("real/lights.json")).unwrap().is_file());
        assert_eq!(names(&path.join("real")), ["lights.json"]);
    }
    std::os::unix::fs::symlink("b.json", path.join("a.json")).unwrap();
    std::os::unix::fs::symlink("a.json", path.join("b.json")).unwrap();
    let output = run(path, &["fit", "builtin:overcast", "--lights", "1", "-q", "-o", "a.json"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("a.json"), "{}", stderr(&output));
}

#[test]
fn a_shorter_turntable_tells_of_the_frames_of_a_longer_one() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    let turn = |frames: &str| {
        let scene = ["--strands", "1000", "--size", "16x16", "--lights", "1", "--adapter", "cpu"];
        let output = run(path, &[&["capture", "--turntable", frames], &scene[..]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        stderr(&output)
    };
    assert!(!turn("3").contains("longer turn"));
    assert!(!turn("3").contains("longer turn"));
    let notes = turn("1");
    let says = "hairlight.0001.png to hairlight.0002.png stay from a longer turn";
    assert!(notes.contains(says), "{notes}");
}

#[cfg(unix)]
#[test]
fn a_path_that_is_not_unicode_is_named() {
    use std::os::unix::ffi::OsStrExt as _;
    let folder = tempdir().unwrap();
    let path = std::ffi::OsStr::from_bytes(b"caf\xe9.hair");
    for (before, says) in [(&["capture", "--hair"][..], "--hair caf"), (&["info"], "`caf")] {
        let output = hairlight(folder.path()).args(before).arg(path).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{before:?}");
        assert!(stderr(&output).contains(says), "{before:?}: {}", stderr(&output));
    }
}

/// Whatever is under way when the signal comes: loading, a fit, light through hair, a pass on the GPU, a reader of stdin.
#[cfg(unix)]
#[test]
fn interrupt_ends_any_stage_within_a_second_and_leaves_nothing() {
    use std::time::{Duration, Instant};
    let folder = tempdir().unwrap();
    let capture = ["capture", "--adapter", "cpu", "-o", "frame.png", "--turntable", "9"];
    let capture = [&capture[..], &LONG].concat();
    let reference = [&["reference", "-o", "truth.png", "--preset", "white"], &LONG[..]].concat();
    let after = |seconds: f64, arguments: &[&str]| {
        let mut command = hairlight(folder.path());
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.args(arguments).spawn().unwrap();
        // Waiting for the child would close its input, and end what reads it.
        let _input = child.stdin.take();
        std::thread::sleep(Duration::from_secs_f64(seconds));
        assert!(child.try_wait().unwrap().is_none(), "{arguments:?} is over after {seconds} s");
        let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        let begun = Instant::now();
        assert!(sent.success());
        let (code, took) = (child.wait().unwrap().code(), begun.elapsed().as_secs_f64());
        assert_eq!(code, Some(130), "{arguments:?} after {seconds} s");
        // Under load a process takes longer to go than it waits.
        assert!(took < 2.0, "{arguments:?} after {seconds} s: {took:.2} s");
        took
    };
    let mut slowest: f64 = 0.0;
    for seconds in [0.2, 0.7, 1.5, 2.5, 4.0, 6.0] {
        slowest = slowest.max(after(seconds, &capture));
    }
    for seconds in [0.5, 3.0] {
        slowest = slowest.max(after(seconds, &reference));
    }
    slowest = slowest.max(after(0.5, &["probe", "bcsdf"]));
    println!("ended after at most {slowest:.2} s");
    let left = names(folder.path());
    assert!(left.iter().all(|name| name == "cache" || name.starts_with("frame.0")), "{left:?}");
}

/// The fit is made long enough (256 lights) to be still at work when the signal comes.
#[cfg(unix)]
#[test]
fn interrupt_exits_with_130_and_leaves_nothing() {
    let folder = tempdir().unwrap();
    let mut child = hairlight(folder.path())
        .args(["fit", "builtin:studio", "--lights", "256", "-o", "lights.json"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1000));
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(!names(folder.path()).contains(&"lights.json".to_owned()));
}
