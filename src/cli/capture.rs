//! `hairlight capture`.

use anyhow::Result;
use clap::{ArgMatches, Command};

use super::{print, quiet, reporting, scene, switch, with_scene};
use crate::capture::{self, CaptureOptions};

pub fn command() -> Command {
    let capture =
        Command::new("capture").about("Renders a frame, or the frames of a turntable").long_about(
            "Renders a frame, or the frames of a turntable, from a scene file or flags.\n\n\
             Flags come after the file and change it. A preset is applied before the other flags, \
             whatever their order; otherwise the last of several flags for one key holds.",
        );
    with_scene(capture, |_| true)
        .arg(
            switch("print-scene")
                .help("Prints the resolved scene as a scene file, and renders nothing"),
        )
        .arg(
            switch("verify")
                .help("Measures transmittance against rays through the strands, for --stats"),
        )
        .arg(quiet())
}

pub fn run(command: &mut Command, matches: &ArgMatches) -> Result<()> {
    let scene = scene(command, matches)?;
    if matches.get_flag("print-scene") {
        return print(&scene.to_toml());
    }
    let reporting = reporting(matches);
    let options = CaptureOptions { paint: None, verify: matches.get_flag("verify"), reporting };
    capture::run(&scene, &options)
}
