//! The command line. The flags of `capture` are the scene's table of fields; nothing here names one.
//!
//! Exit codes: 0 done; 2 wrong usage, that is, anything mistyped on the command line, `--set` keys
//! and values included; 1 wrong input, that is, a file that is missing or wrong inside, or a machine
//! without an adapter; 130 cancelled by Ctrl-C. An error is one line on stderr (usage errors are
//! clap's), and files are written whole or not at all.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{Read, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, anyhow, ensure};
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use indicatif::{ProgressBar, ProgressStyle};

use crate::capture::{self, CaptureOptions};
use crate::hair::LoadOptions;
use crate::head::Up;
use crate::progress::Reporting;
use crate::scene::{
    Assignment, FIELDS, Field, PRESETS, Scene, Value, field_named, parse_assignment,
};
use crate::{environment, hair, head, image, srbf};

/// Set by the first Ctrl-C; long work polls it. The second one ends the process at once.
static CANCELLED: AtomicBool = AtomicBool::new(false);

const EXIT_CANCELLED: u8 = 130;

/// Width and height of `fit --preview`.
const PREVIEW_SIZE: [usize; 2] = [1024, 512];

const EXIT_CODES: &str = "Exit codes: 0 done, 1 wrong input, 2 wrong usage, 130 cancelled.";

/// Runs the program on the process's arguments.
pub fn main() -> ExitCode {
    quiet_vulkan();
    let mut command = command();
    let matches = command.get_matches_mut();
    // Without a handler Ctrl-C still ends the process, so a failure to install it changes little.
    let _ = ctrlc::set_handler(|| {
        if CANCELLED.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CANCELLED.into());
        }
    });
    let outcome = match matches.subcommand() {
        Some(("capture", matches)) => run_capture(&mut command, matches),
        Some(("fit", matches)) => run_fit(matches),
        Some(("info", matches)) => run_info(matches),
        _ => unreachable!("clap asks for one of the subcommands"),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) if CANCELLED.load(Ordering::Relaxed) => {
            eprintln!("cancelled");
            ExitCode::from(EXIT_CANCELLED)
        }
        Err(error) => {
            let text = format!("{error:#}");
            let line: Vec<&str> = text.lines().map(str::trim).collect();
            eprintln!("error: {}", line.join(" "));
            ExitCode::FAILURE
        }
    }
}

/// Without a session, Mesa's device-select layer looks for a display and complains on stderr; it only
/// reorders adapters, which `--adapter` does here.
fn quiet_vulkan() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: this runs first of all, before any other thread.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

fn command() -> Command {
    Command::new("hairlight")
        .version(env!("CARGO_PKG_VERSION"))
        .about("Hair under environment lighting, after Xu et al. 2011")
        .after_help(EXIT_CODES)
        .subcommand_required(true)
        .arg_required_else_help(true)
        .subcommand(capture_command())
        .subcommand(fit_command())
        .subcommand(info_command())
}

fn capture_command() -> Command {
    let flags = FIELDS.iter().map(|field| flag(field).help_heading(field.group()));
    Command::new("capture")
        .about("Renders a frame, or the frames of a turntable")
        .long_about(
            "Renders a frame, or the frames of a turntable, from a scene file or flags.\n\n\
             Flags come after the file and change it. A preset is applied before the other flags, \
             whatever their order; otherwise the last of several flags for one key holds.",
        )
        .after_help(EXIT_CODES)
        .after_long_help(format!("{}\n{EXIT_CODES}", presets()))
        .arg(
            Arg::new("scene")
                .value_name("SCENE.toml")
                .value_parser(value_parser!(PathBuf))
                .help("Scene file; its paths are relative to it [default: the defaults below]"),
        )
        .arg(
            Arg::new("set")
                .long("set")
                .value_name("KEY=VALUE")
                .action(ArgAction::Append)
                .value_parser(parse_assignment)
                .help("Sets any key of a scene file, as fibre.eta=1.6"),
        )
        .arg(
            switch("print-scene")
                .help("Prints the resolved scene as a scene file, and renders nothing"),
        )
        .arg(
            switch("verify")
                .help("Measures transmittance against rays through the strands, for --stats"),
        )
        .arg(quiet())
        .args(flags)
}

fn fit_command() -> Command {
    let lights = field_named("environment.lights").expect("a key of the table");
    Command::new("fit")
        .about("Fits lights to an environment map and prints how well they stand for it")
        .after_help(EXIT_CODES)
        .arg(
            Arg::new("map")
                .value_name("MAP")
                .required(true)
                .help("Lat-long map: .exr, .hdr or builtin:NAME"),
        )
        .arg(flag(lights))
        .arg(
            Arg::new("output")
                .long("output")
                .short('o')
                .value_name("FILE")
                .value_parser(value_parser!(PathBuf))
                .help("Writes the lights as JSON [default: none]"),
        )
        .arg(
            Arg::new("preview")
                .long("preview")
                .value_name("FILE")
                .value_parser(value_parser!(PathBuf))
                .help("Writes a PNG of the lights as a map [default: none]"),
        )
        .arg(quiet())
}

fn info_command() -> Command {
    Command::new("info")
        .about("Prints what is known of a hair, head, map or scene file")
        .after_help(EXIT_CODES)
        .arg(
            Arg::new("file")
                .value_name("FILE")
                .required(true)
                .help(".hair, .tfx, .obj, .exr, .hdr, .toml, lights .json, or builtin:NAME"),
        )
}

/// The flag of a field. Given twice, the later one holds.
fn flag(field: &'static Field) -> Arg {
    let arg = Arg::new(field.key)
        .long(field.flag)
        .value_name(field.placeholder())
        .action(ArgAction::Append)
        .allow_hyphen_values(true)
        .value_parser(|text: &str| field.parse(text))
        .help(field.help)
        .long_help(long_help(field));
    match field.short {
        Some(short) => arg.short(short),
        None => arg,
    }
}

fn long_help(field: &Field) -> String {
    let default = match field.get(&Scene::default()) {
        Some(value) => format!("; default {}", field.format(&value)),
        None => String::new(),
    };
    format!("{} ({}{default}) [{}]", field.help, field.expects(), field.key)
}

fn presets() -> String {
    let lines = PRESETS.iter().map(|preset| format!("  {:<8}{}\n", preset.name, preset.rationale));
    format!("presets:\n{}", lines.collect::<String>())
}

fn switch(name: &'static str) -> Arg {
    Arg::new(name).long(name).action(ArgAction::SetTrue)
}

fn quiet() -> Arg {
    switch("quiet").short('q').help("No progress, notes or warnings on stderr")
}

fn run_capture(command: &mut Command, matches: &ArgMatches) -> Result<()> {
    let mut scene = match matches.get_one::<PathBuf>("scene") {
        Some(path) => Scene::read(path)?,
        None => Scene::default(),
    };
    if let Err(conflict) = scene.apply(assignments(matches)) {
        let capture = command.find_subcommand_mut("capture").expect("a subcommand");
        capture.error(ErrorKind::ArgumentConflict, conflict).exit();
    }
    if matches.get_flag("print-scene") {
        return print(&scene.to_toml());
    }
    let options =
        CaptureOptions { verify: matches.get_flag("verify"), reporting: reporting(matches) };
    capture::run(&scene, &options)
}

fn reporting(matches: &ArgMatches) -> Reporting {
    Reporting { quiet: matches.get_flag("quiet"), cancelled: &CANCELLED }
}

/// All flags and `--set`s as one level, in the order typed.
fn assignments(matches: &ArgMatches) -> Vec<Assignment> {
    let indices = |id| matches.indices_of(id).into_iter().flatten();
    let mut typed: Vec<(usize, Assignment)> = Vec::new();
    for field in FIELDS {
        let values = matches.get_many::<Value>(field.key).into_iter().flatten().cloned();
        let values = values.map(|value| Assignment { field, value });
        typed.extend(indices(field.key).zip(values));
    }
    let set = matches.get_many::<Assignment>("set").into_iter().flatten().cloned();
    typed.extend(indices("set").zip(set));
    typed.sort_by_key(|(index, _)| *index);
    typed.into_iter().map(|(_, assignment)| assignment).collect()
}

fn run_fit(matches: &ArgMatches) -> Result<()> {
    let map = matches.get_one::<String>("map").expect("a required argument");
    let quiet = matches.get_flag("quiet");
    let mut scene = Scene::default();
    let lights = matches.get_many::<Value>("environment.lights").into_iter().flatten();
    let field = field_named("environment.lights").map_err(|e| anyhow!(e))?;
    let level = lights.map(|value| Assignment { field, value: value.clone() });
    scene.apply(level.collect())?;

    let loaded = environment::load(map)?;
    if loaded.mended.any() && !quiet {
        eprintln!("{map}: {}", loaded.mended);
    }
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(1000) };
    bar.set_style(ProgressStyle::with_template("fitting lights {bar:40} {percent} %")?);
    let fit = srbf::fit_cached(&loaded.environment, scene.environment.lights as usize, &|done| {
        bar.set_position((f64::from(done) * 1000.0) as u64);
        !CANCELLED.load(Ordering::Relaxed)
    });
    bar.finish_and_clear();
    let fit = fit.with_context(|| map.clone())?;

    if let Some(path) = matches.get_one::<PathBuf>("preview") {
        let [width, height] = PREVIEW_SIZE;
        image::write_png_map(path, &srbf::preview(&fit.lights, width, height))?;
    }
    if let Some(path) = matches.get_one::<PathBuf>("output") {
        srbf::write_json(&fit.lights, path)?;
    }
    let percent = |x: f64| format!("{:.2} %", 100.0 * x);
    print(&rows(&[
        ("lights", fit.lights.len().to_string()),
        ("relative L2", percent(fit.relative_l2)),
        ("blurred, λ = 0.15", percent(fit.relative_l2_blurred_0_15)),
        ("blurred, λ = 0.3", percent(fit.relative_l2_blurred_0_30)),
        ("energy ratio", format!("{:.4}", fit.energy_ratio)),
        ("fitted in", format!("{:.2} s{}", fit.seconds, if fit.cached { ", cached" } else { "" })),
    ]))
}

const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
const HDR_MAGIC: &[u8] = b"#?";

/// What a file holds, judged by its first bytes.
enum FileKind {
    Hair,
    Head,
    Environment,
    Lights,
    Scene,
}

fn run_info(matches: &ArgMatches) -> Result<()> {
    let file = matches.get_one::<String>("file").expect("a required argument");
    let kind = match file.strip_prefix("builtin:") {
        Some(style) if hair::groom::STYLES.contains(&style) => FileKind::Hair,
        Some(_) => FileKind::Environment,
        None => file_kind(Path::new(file))?,
    };
    print(&match kind {
        FileKind::Hair => hair_info(file)?,
        FileKind::Head => head_info(file)?,
        FileKind::Environment => environment_info(file)?,
        FileKind::Lights => lights_info(file)?,
        FileKind::Scene => scene_info(file)?,
    })
}

fn file_kind(path: &Path) -> Result<FileKind> {
    const START: u64 = 4096;
    let mut start = Vec::new();
    File::open(path)
        .and_then(|file| file.take(START).read_to_end(&mut start))
        .with_context(|| format!("{}: cannot be read", path.display()))?;
    ensure!(!start.is_empty(), "{}: is empty; export it again", path.display());
    if start.starts_with(&EXR_MAGIC) || start.starts_with(HDR_MAGIC) {
        return Ok(FileKind::Environment);
    }
    if start.starts_with(hair::hair_format::MAGIC) || start.contains(&0) {
        return Ok(FileKind::Hair);
    }
    let text = String::from_utf8_lossy(&start);
    let mut lines = text.lines().map(str::trim);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with('#')).unwrap_or_default();
    Ok(match first.split_whitespace().next().unwrap_or_default() {
        "v" | "vn" | "vt" | "f" | "o" | "g" | "s" | "mtllib" | "usemtl" => FileKind::Head,
        word if word.starts_with('{') => FileKind::Lights,
        _ => FileKind::Scene,
    })
}

fn hair_info(file: &str) -> Result<String> {
    let loaded = hair::load(file, &LoadOptions::default())?;
    let (low, high) = loaded.hair.bounds();
    let size = high - low;
    let [fewest, most] = loaded.file.segments;
    let diameter = hair::fibre_diameter(&loaded.hair);
    let mut text = rows(&[
        ("format", loaded.file.format.clone()),
        ("strands", loaded.file.strands.to_string()),
        ("points", loaded.file.points.to_string()),
        ("segments a strand", format!("{fewest} to {most}")),
        ("arrays", loaded.file.arrays.join(", ")),
        ("lower corner", format!("{:.4} {:.4} {:.4}", low.x, low.y, low.z)),
        ("upper corner", format!("{:.4} {:.4} {:.4}", high.x, high.y, high.z)),
        ("size", format!("{:.4} {:.4} {:.4}", size.x, size.y, size.z)),
        ("mean length", format!("{:.4}", mean_length(&loaded.hair))),
        ("fibre diameter", format!("{:.3e}: {}", diameter.diameter, diameter.reason)),
        ("mended, dropped", format!("{}, {}", loaded.mended.mended, loaded.mended.dropped)),
    ]);
    if let Some(header) = &loaded.file.header {
        text += &rows(&[
            ("default thickness", header.default_thickness.to_string()),
            ("default transparency", header.default_transparency.to_string()),
            ("default colour", format!("{:?}", header.default_color)),
            ("text", header.info_text()),
        ]);
    }
    for note in loaded.assumed.iter().chain(&loaded.mended.notes) {
        let _ = writeln!(text, "note: {note}");
    }
    Ok(text)
}

fn mean_length(hair: &hair::Hair) -> f64 {
    hair.total_length() / hair.strand_count().max(1) as f64
}

fn head_info(file: &str) -> Result<String> {
    let loaded = head::load(file, Up::default(), 1.0)?;
    let positions = &loaded.head.positions;
    let low = positions.iter().copied().reduce(|a, b| a.min(b)).unwrap_or_default();
    let high = positions.iter().copied().reduce(|a, b| a.max(b)).unwrap_or_default();
    Ok(rows(&[
        ("format", "Wavefront OBJ".to_owned()),
        ("vertices", positions.len().to_string()),
        ("triangles", loaded.head.triangles.len().to_string()),
        ("dropped triangles", loaded.dropped_triangles.to_string()),
        ("computed normals", loaded.computed_normals.to_string()),
        ("lower corner", format!("{:.4} {:.4} {:.4}", low.x, low.y, low.z)),
        ("upper corner", format!("{:.4} {:.4} {:.4}", high.x, high.y, high.z)),
    ]))
}

fn environment_info(file: &str) -> Result<String> {
    let loaded = environment::load(file)?;
    let map = &loaded.environment;
    let rgb = |[r, g, b]: [f64; 3]| format!("{r:.4} {g:.4} {b:.4}");
    let most = map.pixels.iter().flatten().copied().fold(0.0, f32::max);
    let mut text = rows(&[
        ("size", format!("{} × {}", map.width, map.height)),
        ("mean radiance", rgb(map.mean_radiance())),
        ("largest value", most.to_string()),
    ]);
    let _ = writeln!(text, "{}", loaded.source);
    if loaded.mended.any() {
        let _ = writeln!(text, "{}", loaded.mended);
    }
    Ok(text)
}

fn lights_info(file: &str) -> Result<String> {
    let text = std::fs::read_to_string(file).with_context(|| format!("{file}: cannot be read"))?;
    let lights = srbf::from_json(&text).with_context(|| file.to_owned())?;
    let lambdas = || lights.iter().map(|light| light.lambda);
    let mut energy = [0.0; 3];
    for light in &lights {
        let own = light.energy();
        (0..3).for_each(|c| energy[c] += own[c]);
    }
    Ok(rows(&[
        ("lights", lights.len().to_string()),
        ("narrowest λ", format!("{:.4}", lambdas().fold(f64::INFINITY, f64::min))),
        ("widest λ", format!("{:.4}", lambdas().fold(0.0, f64::max))),
        ("energy", format!("{:.4} {:.4} {:.4}", energy[0], energy[1], energy[2])),
    ]))
}

/// The scene as it resolves, and the fibre parameters that the maths sees.
fn scene_info(file: &str) -> Result<String> {
    let scene = Scene::read(Path::new(file))?;
    let fibre = scene.fibre.resolve();
    let degrees = |xs: [f64; 3]| {
        let [r, tt, trt] = xs.map(f64::to_degrees);
        format!("{r:.3} {tt:.3} {trt:.3}")
    };
    let [r, g, b] = fibre.sigma_a;
    let resolved = rows(&[
        ("# sigma_a", format!("{r:.4} {g:.4} {b:.4} per radius, RGB")),
        ("# beta", format!("{} degrees, R TT TRT", degrees(fibre.beta))),
        ("# alpha", format!("{} degrees, R TT TRT", degrees(fibre.alpha))),
    ]);
    Ok(format!("{}\n{resolved}", scene.to_toml()))
}

/// Names and values in two columns.
fn rows(rows: &[(&str, String)]) -> String {
    rows.iter().map(|(name, value)| format!("{name:<22}{value}\n")).collect()
}

/// Writes to stdout; a reader that went away early is no error.
fn print(text: &str) -> Result<()> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        other => other.context("cannot write to stdout"),
    }
}
