//! `hairlight fit`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::{Arg, ArgMatches, Command, value_parser};

use super::{flag, print, quiet, reporting, rows};
use crate::progress::Clock;
use crate::quality::Settings;
use crate::scene::{Assignment, Field, Scene, Value, field_named};
use crate::stage::load_map;
use crate::{image, srbf};

/// Width and height of `--preview`.
const PREVIEW_SIZE: [usize; 2] = [1024, 512];

pub fn command() -> Command {
    Command::new("fit")
        .about("Fits lights to an environment map and prints how well they stand for it")
        .arg(
            Arg::new("map")
                .value_name("MAP")
                .required(true)
                .help("Lat-long map: .exr, .hdr or builtin:NAME"),
        )
        .args(fields().map(flag))
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

/// Those of a scene that count here.
fn fields() -> impl Iterator<Item = &'static Field> {
    ["environment.layer", "environment.lights"].into_iter().filter_map(|key| field_named(key).ok())
}

pub fn run(_: &mut Command, matches: &ArgMatches) -> Result<()> {
    let map = matches.get_one::<String>("map").expect("a required argument");
    let clock = Clock::new(reporting(matches));
    let mut scene = Scene::default();
    scene.environment.source.clone_from(map);
    let level = fields().flat_map(|field| {
        let values = matches.get_many::<Value>(field.key).into_iter().flatten();
        values.map(move |value| Assignment { field, value: value.clone() })
    });
    scene.apply(level.collect())?;

    let [preview, lights] = ["preview", "output"].map(|name| matches.get_one::<PathBuf>(name));
    let outputs: Vec<&Path> = [preview, lights].into_iter().flatten().map(|p| &**p).collect();
    scene.check_outputs(&outputs)?;

    let loaded = load_map(&scene.environment, &clock)?;
    let wanted = Settings::of(&scene).lights as usize;
    let fit = clock.watch("fitting lights", |progress| {
        srbf::fit_cached(&loaded.environment, wanted, progress)
    });
    let fit = fit.with_context(|| map.clone())?;

    if let Some(path) = preview {
        let [width, height] = PREVIEW_SIZE;
        image::write_png_map(path, &srbf::preview(&fit.lights, width, height))?;
    }
    if let Some(path) = lights {
        srbf::write_json(&fit.lights, path)?;
    }
    print(&rows(&fit.figures()))
}
