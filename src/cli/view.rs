//! `hairlight view`.

use std::path::PathBuf;

use anyhow::Result;
use clap::{Arg, ArgMatches, Command, value_parser};

use crate::editor::{self, Document};
use crate::file::typed_path;
use crate::gpu::Gpu;
use crate::scene::Scene;

pub fn command() -> Command {
    Command::new("view")
        .about("Opens the editor: change and paint hair live")
        .arg(
            Arg::new("file")
                .value_name("FILE")
                .value_parser(value_parser!(PathBuf))
                .help("A scene .toml, hair, head or map [default: the default scene]"),
        )
        .arg(
            Arg::new("shaders")
                .long("shaders")
                .value_name("FOLDER")
                .value_parser(value_parser!(PathBuf))
                .help("Draws by the WGSL of this folder, read again whenever it changes"),
        )
}

pub fn run(_: &mut Command, matches: &ArgMatches) -> Result<()> {
    // Said before a window opens that could show nothing.
    Gpu::check()?;
    let document = match matches.get_one::<PathBuf>("file") {
        Some(path) => {
            Document::open(&path.to_str().map_or(path.clone(), |p| typed_path(p).into()))?
        }
        None => Document::new(Scene::default(), None),
    };
    let shaders = matches.get_one::<PathBuf>("shaders").cloned();
    editor::run(document, shaders, &super::CANCELLED)
}
