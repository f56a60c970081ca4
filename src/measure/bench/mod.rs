//! `hairlight bench`: speed against error, all methods side by side in one run.
//!
//! Two parts: single evaluations against adaptive quadrature (`integrals`), and frames against the path tracer
//! (`images`), whose error is then taken apart by cause (`causes`). Everything timed is warmed up, repeated in
//! rounds that take all methods in turn, and reported by its median and quartiles: a machine that slows down
//! slows all alike, and ratios are taken within a round. A method is a row of [`METHODS`].

pub mod causes;
pub mod here;
pub mod images;
pub mod integrals;
pub mod method;
mod report;
pub mod statistics;

use std::path::Path;

use anyhow::{Result, ensure};
use serde::Serialize;

use crate::gpu::Gpu;
use crate::progress::{Clock, Reporting};
use crate::scattering::tables::{self, Tables};
use crate::scene::Scene;
use images::Image;
use integrals::Integrals;
use method::{METHODS, Method};

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// For each mode and combination of the grid of integrals; a power of two spreads them evenly.
    pub points: usize,
    /// Inputs of a timed run, and how often it is repeated.
    pub timed: usize,
    pub rounds: usize,
    /// Of pictures, pixels.
    pub size: [u32; 2],
    /// Coverage samples a pixel of frames.
    pub samples: u32,
    pub frame_rounds: usize,
    /// Builtin maps, and which colour is shown under which.
    pub maps: &'static [&'static str],
    pub pictures: &'static [(&'static str, &'static str)],
    /// Samples a pixel of the truth, and where path tracing is judged.
    pub truth_samples: u32,
    pub traced: &'static [u32],
    /// Rays for an exact reach.
    pub rays: usize,
    /// Numbers of lights, on the first picture.
    pub lights: &'static [u32],
    /// Strands of builtin grooms.
    pub strands: u32,
}

const MAPS: &[&str] = &["studio", "sunset", "overcast"];

impl Effort {
    /// Three minutes on two slow cores.
    pub const QUICK: Effort = Effort {
        points: 16,
        timed: 1 << 15,
        rounds: 5,
        size: [40, 40],
        samples: 16,
        frame_rounds: 2,
        maps: MAPS,
        pictures: &[("black", "studio"), ("blond", "sunset"), ("white", "overcast")],
        truth_samples: 128,
        traced: &[1, 4, 16],
        rays: 8,
        lights: &[10],
        strands: 1000,
    };

    pub const FULL: Effort = Effort {
        points: 32,
        timed: 1 << 17,
        rounds: 9,
        size: [96, 96],
        samples: 16,
        frame_rounds: 3,
        maps: MAPS,
        pictures: &[
            ("black", "studio"),
            ("blond", "studio"),
            ("white", "studio"),
            ("black", "sunset"),
            ("blond", "sunset"),
            ("white", "sunset"),
            ("black", "overcast"),
            ("blond", "overcast"),
            ("white", "overcast"),
        ],
        truth_samples: 256,
        traced: &[1, 4, 16, 64],
        rays: 32,
        lights: &[10, 20, 40, 80],
        strands: 3000,
    };
}

/// Hair and head to be shown.
#[derive(Clone, Debug)]
pub struct Groom {
    pub name: String,
    /// Its colour and map are taken from the pictures asked for.
    pub scene: Scene,
}

/// What is asked of a run.
pub struct Options {
    pub quick: bool,
    /// `auto`, `cpu`, or part of an adapter's name.
    pub adapter: String,
    /// Shown beside the builtin bob.
    pub groom: Option<Groom>,
    pub reporting: Reporting<'static>,
}

/// What ran it.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    pub version: &'static str,
    pub adapter: String,
    pub backend: String,
    /// Of the CPU: path tracing and exact quadrature.
    pub threads: usize,
}

/// All results.
#[derive(Clone, Debug, Serialize)]
pub struct Bench {
    pub quick: bool,
    pub machine: Machine,
    pub integrals: Integrals,
    pub images: Vec<Image>,
}

/// Measures everything and writes bench.md, bench.json, and its plots as SVG, PNG and CSV into `folder`.
///
/// # Errors
/// One line: no adapter, a folder that is not there, hair that cannot be read, "cancelled".
pub fn run(options: &Options, folder: &Path) -> Result<()> {
    ensure!(folder.is_dir(), "{}: no such folder: make it first", folder.display());
    let mut clock = Clock::new(options.reporting);
    let effort = if options.quick { Effort::QUICK } else { Effort::FULL };
    let mut bob = Scene::default();
    bob.hair.strands = effort.strands;
    let mut grooms = vec![Groom { name: "bob".to_owned(), scene: bob }];
    grooms.extend(options.groom.clone());
    let gpu = Gpu::new(&options.adapter)?;
    let bench = measure(gpu, &METHODS, &grooms, &effort, options.quick, &mut clock)?;
    report::write(&bench, folder)?;
    clock.note(&format!(
        "{}: measured in {:.0} s on {}",
        folder.join("bench.md").display(),
        1e-3 * clock.total_ms(),
        bench.machine.adapter
    ));
    Ok(())
}

/// What every part of a run needs.
pub struct Context<'a> {
    pub methods: &'a [Method],
    pub effort: &'a Effort,
    pub tables: &'a Tables,
    pub clock: &'a Clock<'a>,
}

/// Measures `methods`, of which the [`method::BASELINE`]th is what others are compared with.
pub fn measure(
    mut gpu: Gpu,
    methods: &[Method],
    grooms: &[Groom],
    effort: &Effort,
    quick: bool,
    clock: &mut Clock,
) -> Result<Bench> {
    let tables = tables::build();
    let machine = Machine {
        version: env!("CARGO_PKG_VERSION"),
        adapter: gpu.info.name.clone(),
        backend: gpu.info.backend.to_string(),
        threads: rayon::current_num_threads(),
    };
    let integrals = clock.watch("integrals", |progress| {
        integrals::measure(&gpu, methods, effort, &tables, progress)
    })?;
    clock.step("integrals")?;
    let mut images = Vec::new();
    for groom in grooms {
        let context = Context { methods, effort, tables: &tables, clock };
        let (back, found) = images::measure(gpu, groom, &context)?;
        gpu = back;
        images.extend(found);
        clock.step("images")?;
    }
    Ok(Bench { quick, machine, integrals, images })
}
