//! `hairlight reference`.

use anyhow::Result;
use clap::{Arg, ArgMatches, Command, value_parser};

use super::{choice, print, quiet, reporting, scene, switch, with_scene, word};
use crate::reference::render::{self, Lighting, ReferenceOptions};
use crate::reference::tracer::Sampling;
use crate::scene::Field;

/// Fields that a path tracer has a use for.
fn has(field: &Field) -> bool {
    field.group() != "render" && !matches!(field.key, "output.stats" | "output.turntable")
}

pub fn command() -> Command {
    let reference = Command::new("reference")
        .about("Path traces the truth of a scene")
        .long_about(
            "Path traces the truth of a scene, which `capture` approximates: strand by strand, under the map \
             itself. An .exr holds each pixel's variance as well, and can be gone on with.",
        );
    with_scene(reference, has)
        .arg(
            Arg::new("spp")
                .long("spp")
                .value_name("N")
                .default_value("64")
                .value_parser(value_parser!(u32).range(1..=1 << 24))
                .help("Samples a pixel"),
        )
        .arg(
            Arg::new("max-depth")
                .long("max-depth")
                .value_name("N")
                .value_parser(value_parser!(u32).range(1..))
                .help(
                    "Most scattering events of a path; 1 is direct light alone [default: no bound]",
                ),
        )
        .arg(
            choice("lighting", &["map", "srbf"])
                .help("The map itself, or the lights fitted to it; lamps are exact either way"),
        )
        .arg(
            choice("sampling", &["both", "light", "fibre"])
                .help("What draws directions; all agree in the limit"),
        )
        .arg(
            Arg::new("rng-seed")
                .long("rng-seed")
                .value_name("N")
                .default_value("0")
                .value_parser(value_parser!(u32))
                .help("Another one gives other noise"),
        )
        .arg(switch("resume").help("Goes on with the .exr that is there"))
        .arg(
            switch("print-scene")
                .help("Prints the resolved scene as a scene file, and renders nothing"),
        )
        .arg(quiet())
}

pub fn run(command: &mut Command, matches: &ArgMatches) -> Result<()> {
    let scene = scene(command, matches)?;
    if matches.get_flag("print-scene") {
        return print(&scene.to_toml());
    }
    let number = |name| matches.get_one::<u32>(name).copied();
    let options = ReferenceOptions {
        spp: number("spp").unwrap_or(64),
        max_depth: number("max-depth").unwrap_or(u32::MAX),
        lighting: if word(matches, "lighting") == "srbf" { Lighting::Srbf } else { Lighting::Map },
        sampling: match word(matches, "sampling") {
            "light" => Sampling::Light,
            "fibre" => Sampling::Fibre,
            _ => Sampling::Both,
        },
        seed: number("rng-seed").unwrap_or(0),
        resume: matches.get_flag("resume"),
        reporting: reporting(matches),
    };
    render::run(&scene, &options)
}
