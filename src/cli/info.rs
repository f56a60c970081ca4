//! `hairlight info`.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use clap::{Arg, ArgMatches, Command};

use super::{print, rows};
use crate::file_kind::{self, FileKind, Role};
use crate::hair::LoadOptions;
use crate::scene::Scene;
use crate::{environment, hair, head, srbf};

pub fn command() -> Command {
    Command::new("info").about("Prints what is known of a hair, head, map or scene file").arg(
        Arg::new("file")
            .value_name("FILE")
            .required(true)
            .help(".hair, .tfx, .obj, .exr, .hdr, .toml, lights .json, or builtin:NAME"),
    )
}

pub fn run(_: &mut Command, matches: &ArgMatches) -> Result<()> {
    let file = matches.get_one::<String>("file").expect("a required argument");
    let role = match file.strip_prefix("builtin:") {
        Some(style) if hair::groom::STYLES.contains(&style) => Role::Hair,
        Some(_) => Role::Map,
        None => {
            let kind = FileKind::of_file(Path::new(file))?;
            kind.role().with_context(|| format!("{file}: {}", kind.description()))?
        }
    };
    print(&match role {
        Role::Hair => hair_info(file)?,
        Role::Head => head_info(file)?,
        Role::Map => environment_info(file)?,
        Role::Lights => lights_info(file)?,
        Role::Scene => scene_info(file)?,
        Role::Paint => format!("{file}: {}\n", FileKind::Paint.description()),
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
    let loaded = head::load(file)?;
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
    ]) + &loaded.notes().iter().map(|note| format!("note: {note}\n")).collect::<String>())
}

fn environment_info(file: &str) -> Result<String> {
    let loaded = environment::load(file)?;
    let map = &loaded.environment;
    let number = |x: f64| match x == 0.0 || (1e-3..1e6).contains(&x) {
        true => format!("{x:.4}"),
        false => format!("{x:.4e}"),
    };
    let rgb = |rgb: [f64; 3]| rgb.map(number).join(" ");
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
    let bytes = std::fs::read(file).with_context(|| format!("{file}: cannot be read"))?;
    let lights =
        srbf::from_json(&file_kind::lossy_text(&bytes)).with_context(|| file.to_owned())?;
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
