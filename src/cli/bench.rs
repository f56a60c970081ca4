//! `hairlight bench`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::{Arg, ArgMatches, Command, value_parser};

use super::{adapter, quiet, reporting, switch};
use crate::measure::bench::{self, Groom, Options};
use crate::scene::Scene;

pub fn command() -> Command {
    Command::new("bench")
        .about("Measures speed against error, method by method, and why frames are off the truth")
        .long_about(
            "Measures all methods side by side: single integrals against adaptive quadrature, frames against the \
             path tracer, and by cause why they differ. Writes bench.md, bench.json and plots.",
        )
        .arg(switch("quick").help("Fewer and smaller: three minutes on two cores without a GPU"))
        .arg(
            Arg::new("output")
                .long("output")
                .short('o')
                .value_name("FOLDER")
                .default_value("bench")
                .value_parser(value_parser!(PathBuf))
                .help("Where to write; made where it is missing"),
        )
        .arg(
            Arg::new("hair")
                .long("hair")
                .value_name("HAIR")
                .help("A groom to show beside the builtin bob, as `capture` takes it"),
        )
        .arg(
            Arg::new("head")
                .long("head")
                .value_name("HEAD")
                .requires("hair")
                .help("Its head, as `capture` takes it"),
        )
        .arg(adapter())
        .arg(quiet())
}

pub fn run(_: &mut Command, matches: &ArgMatches) -> Result<()> {
    let folder = matches.get_one::<PathBuf>("output").expect("it has a default");
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: cannot be made a folder", folder.display()))?;
    let groom = matches.get_one::<String>("hair").map(|hair| {
        let mut scene = Scene::default();
        scene.hair.source.clone_from(hair);
        if let Some(head) = matches.get_one::<String>("head") {
            scene.head.source.clone_from(head);
        }
        let name = std::path::Path::new(hair).file_stem().unwrap_or_default();
        Groom { name: name.to_string_lossy().into_owned(), scene }
    });
    let options = Options {
        quick: matches.get_flag("quick"),
        adapter: super::word(matches, "adapter").to_owned(),
        groom,
        reporting: reporting(matches),
    };
    bench::run(&options, folder)
}
