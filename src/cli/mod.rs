//! The command line. The flags of `capture` are the scene's table of fields; nothing here names one.
//!
//! Exit codes: 0 done; 2 wrong usage, that is, anything mistyped on the command line, `--set` keys
//! and values included; 1 wrong input, that is, a file that is missing or wrong inside, or a machine
//! without an adapter; 130 cancelled by Ctrl-C. An error is one line on stderr (usage errors are
//! clap's), and files are written whole or not at all.

mod bench;
mod capture;
mod compare;
mod figures;
mod fit;
mod info;
mod probe;
mod reference;
mod view;

use std::ffi::OsString;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result};
use clap::builder::PossibleValuesParser;
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};

use crate::progress::{Reporting, Unfinished};
use crate::scene::{Assignment, FIELDS, Field, PRESETS, Scene, Value, parse_assignment};

/// Set by the first Ctrl-C; long work polls it.
static CANCELLED: AtomicBool = AtomicBool::new(false);

const EXIT_CANCELLED: u8 = 130;

/// Work that does not end by itself so soon after Ctrl-C, such as a pass on the GPU or a library's decoder, is ended.
const GRACE: Duration = Duration::from_millis(600);

const EXIT_CODES: &str = "Exit codes: 0 done, 1 wrong input, 2 wrong usage, 130 cancelled.";

/// A subcommand: its arguments, and what it does.
struct Subcommand {
    command: fn() -> Command,
    run: fn(&mut Command, &ArgMatches) -> Result<()>,
}

const SUBCOMMANDS: [Subcommand; 9] = [
    Subcommand { command: view::command, run: view::run },
    Subcommand { command: capture::command, run: capture::run },
    Subcommand { command: reference::command, run: reference::run },
    Subcommand { command: compare::command, run: compare::run },
    Subcommand { command: probe::command, run: probe::run },
    Subcommand { command: figures::command, run: figures::run },
    Subcommand { command: bench::command, run: bench::run },
    Subcommand { command: fit::command, run: fit::run },
    Subcommand { command: info::command, run: info::run },
];

/// Runs the program on the process's arguments.
pub fn main() -> ExitCode {
    quiet_vulkan();
    let mut command = command();
    let matches = match command.try_get_matches_from_mut(std::env::args_os()) {
        Ok(matches) => matches,
        Err(error) if error.kind() == ErrorKind::InvalidUtf8 => {
            command.error(ErrorKind::InvalidUtf8, not_unicode(std::env::args_os())).exit()
        }
        Err(error) => error.exit(),
    };
    // Without a handler Ctrl-C still ends the process, so a failure to install it changes little.
    let _ = ctrlc::set_handler(cancel);
    let (name, matches) = matches.subcommand().expect("clap asks for one of the subcommands");
    let named = |s: &&Subcommand| (s.command)().get_name() == name;
    let subcommand = SUBCOMMANDS.iter().find(named).expect("a subcommand of the list");
    let own = command.find_subcommand_mut(name).expect("a subcommand");
    match (subcommand.run)(own, matches) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if CANCELLED.load(Ordering::Relaxed) => {
            eprintln!("{error:#}");
            ExitCode::from(EXIT_CANCELLED)
        }
        Err(error) => {
            let text = format!("{error:#}").replace(char::is_control, " ");
            let line: Vec<&str> = text.lines().map(str::trim).collect();
            eprintln!("error: {}", line.join(" "));
            ExitCode::FAILURE
        }
    }
}

/// What Ctrl-C does: the first one asks the command to end and ends the process after [`GRACE`], once all files that
/// are being written are whole; the second one ends it at once.
fn cancel() {
    let exit = || std::process::exit(EXIT_CANCELLED.into());
    if CANCELLED.swap(true, Ordering::Relaxed) {
        exit();
    }
    std::thread::spawn(move || {
        std::thread::sleep(GRACE);
        while Unfinished::any() {
            std::thread::sleep(Duration::from_millis(10));
        }
        eprintln!("cancelled");
        exit();
    });
}

/// Without a session, Mesa's device-select layer looks for a display and complains on stderr; it only
/// reorders adapters, which `--adapter` does here.
fn quiet_vulkan() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: this runs first of all, before any other thread.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

/// What is wrong with the first argument that is not Unicode, with the flag before it.
fn not_unicode(arguments: impl Iterator<Item = OsString>) -> String {
    let mut flag = String::new();
    for argument in arguments {
        match argument.to_str() {
            Some(text) if text.starts_with("--") => flag = format!("{text} "),
            Some(_) => flag.clear(),
            None => {
                let shown = argument.to_string_lossy();
                return format!("`{flag}{shown}` is not valid UTF-8: rename the file");
            }
        }
    }
    "an argument is not valid UTF-8: rename the file".to_owned()
}

fn command() -> Command {
    Command::new("hairlight")
        .version(env!("CARGO_PKG_VERSION"))
        .about("Hair under environment lighting, after Xu et al. 2011")
        .after_help(EXIT_CODES)
        .subcommand_required(true)
        .arg_required_else_help(true)
        .subcommands(SUBCOMMANDS.map(|s| (s.command)().after_help(EXIT_CODES)))
}

/// Adds what describes a scene: its file, `--set`, and the flags of the fields that `has` holds for.
fn with_scene(command: Command, has: fn(&Field) -> bool) -> Command {
    let flags = FIELDS.iter().filter(|f| has(f)).map(|f| flag(f).help_heading(f.group()));
    command
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
        .args(flags)
}

/// The scene of [`with_scene`]. Two ways to state one thing are wrong usage, and end the process.
fn scene(command: &mut Command, matches: &ArgMatches) -> Result<Scene> {
    let mut scene = match matches.get_one::<PathBuf>("scene") {
        Some(path) => Scene::read(path)?,
        None => Scene::default(),
    };
    if let Err(conflict) = scene.apply(assignments(matches)) {
        command.error(ErrorKind::ArgumentConflict, conflict).exit();
    }
    Ok(scene)
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

/// A flag that takes one of `words`, by default the first.
fn choice(name: &'static str, words: &'static [&'static str]) -> Arg {
    Arg::new(name)
        .long(name)
        .value_name(words.join("|"))
        .hide_possible_values(true)
        .default_value(words[0])
        .value_parser(PossibleValuesParser::new(words))
}

/// The value of an argument that has one.
fn word<'a>(matches: &'a ArgMatches, name: &str) -> &'a str {
    matches.get_one::<String>(name).map_or("", String::as_str)
}

fn switch(name: &'static str) -> Arg {
    Arg::new(name).long(name).action(ArgAction::SetTrue)
}

/// For commands without a scene, whose `render.adapter` says the same.
fn adapter() -> Arg {
    Arg::new("adapter")
        .long("adapter")
        .value_name("NAME")
        .default_value("auto")
        .help("auto, cpu, or part of an adapter's name")
}

fn quiet() -> Arg {
    switch("quiet").short('q').help("No progress, notes or warnings on stderr")
}

fn reporting(matches: &ArgMatches) -> Reporting<'static> {
    Reporting { quiet: matches.get_flag("quiet"), cancelled: &CANCELLED, told: None }
}

/// All flags and `--set`s as one level, in the order typed.
fn assignments(matches: &ArgMatches) -> Vec<Assignment> {
    let indices = |id| matches.indices_of(id).into_iter().flatten();
    let mut typed: Vec<(usize, Assignment)> = Vec::new();
    let offered = |field: &&Field| matches.try_contains_id(field.key).is_ok();
    for field in FIELDS.iter().filter(offered) {
        let values = matches.get_many::<Value>(field.key).into_iter().flatten().cloned();
        let values = values.map(|value| Assignment { field, value });
        typed.extend(indices(field.key).zip(values));
    }
    let set = matches.get_many::<Assignment>("set").into_iter().flatten().cloned();
    typed.extend(indices("set").zip(set));
    typed.sort_by_key(|(index, _)| *index);
    typed.into_iter().map(|(_, assignment)| assignment).collect()
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
