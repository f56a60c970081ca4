//! `hairlight figures`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};

use super::{EXIT_CODES, quiet, reporting};
use crate::measure::figures::{FIGURES, write};
use crate::progress::Clock;

pub fn command() -> Command {
    let list = FIGURES.iter().map(|f| format!("  {:<12}{}\n", f.name, f.shows));
    Command::new("figures")
        .about("Redraws the papers' plots from our own numbers: SVG, PNG and CSV")
        .after_long_help(format!("figures:\n{}\n{EXIT_CODES}", list.collect::<String>()))
        .arg(
            Arg::new("names")
                .value_name("NAME")
                .action(ArgAction::Append)
                .help("Figures to draw [default: all]"),
        )
        .arg(
            Arg::new("output")
                .long("output")
                .short('o')
                .value_name("FOLDER")
                .default_value("figures")
                .value_parser(value_parser!(PathBuf))
                .help("Where to write them; made where it is missing"),
        )
        .arg(quiet())
}

pub fn run(_: &mut Command, matches: &ArgMatches) -> Result<()> {
    let folder = matches.get_one::<PathBuf>("output").expect("it has a default");
    let names: Vec<String> = matches.get_many("names").into_iter().flatten().cloned().collect();
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: cannot be made a folder", folder.display()))?;
    let clock = Clock::new(reporting(matches));
    clock.watch("figures", |progress| write(&names, folder, progress))
}
