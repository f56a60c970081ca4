//! `hairlight compare`.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::{Arg, ArgMatches, Command, value_parser};

use super::{print, switch};
use crate::file::check_outputs;
use crate::image::{Format, write_png_rgb};
use crate::measure::compare::{compare, difference_picture};
use crate::measure::read::Picture;

pub fn command() -> Command {
    let path = |name: &'static str| {
        Arg::new(name).required(true).value_parser(value_parser!(PathBuf)).value_name("FILE.exr")
    };
    let layer = |name: &'static str, help: &str| {
        let help = format!("{help} [default: its finished picture]");
        Arg::new(name).long(name).value_name("NAME").help(help)
    };
    Command::new("compare")
        .about("Judges a frame by the truth, over the pixels that hair covers")
        .arg(path("frame").help("The frame to judge, linear"))
        .arg(path("truth").help("What it should be, of the same size"))
        .arg(layer("frame-layer", "Layer of the frame, where its file has several"))
        .arg(layer("truth-layer", "Layer of the truth, where its file has several"))
        .arg(switch("json").help("Prints the figures as JSON"))
        .arg(
            Arg::new("out")
                .long("out")
                .value_name("FILE.png")
                .value_parser(value_parser!(PathBuf))
                .help(
                    "Writes frame, truth, signed difference and FLIP side by side [default: none]",
                ),
        )
}

pub fn run(_: &mut Command, matches: &ArgMatches) -> Result<()> {
    let path = |name| matches.get_one::<PathBuf>(name).expect("a required argument");
    let out = matches.get_one::<PathBuf>("out");
    if let Some(out) = out {
        let png = Format::of(out)? == Format::Png;
        ensure!(png, "{}: the difference is a picture: name it .png", out.display());
        check_outputs(&[out], &[path("frame"), path("truth")])?;
    }
    let read = |name, layer: &str| {
        let wanted = matches.get_one::<String>(layer).map(String::as_str);
        Picture::read_layer(path(name), wanted, &format!("--{layer}"))
    };
    let (frame, truth) = (read("frame", "frame-layer")?, read("truth", "truth-layer")?);
    let report = compare(&frame, &truth)?;
    if let Some(out) = out {
        write_png_rgb(out, &difference_picture(&frame, &truth)?)?;
    }
    print(&match matches.get_flag("json") {
        true => serde_json::to_string_pretty(&report)? + "\n",
        false => report.to_string(),
    })
}
