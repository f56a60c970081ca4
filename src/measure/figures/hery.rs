//! Hery & Ramamoorthi 2012: their sampling of R against samples of the light, and both by the balance
//! heuristic, in the direct light of a map on a cylinder of 30 fibres, each a circle (their Fig 1).

use std::f64::consts::TAU;

use anyhow::{Result, ensure};
use glam::{DVec3, Vec3};

use super::Progress;
use crate::environment;
use crate::hair::{Frames, Hair};
use crate::measure::plot::{Axis, COLOURS, Curves, Plot, Series, Stroke};
use crate::reference::Models;
use crate::reference::hery::Hery;
use crate::reference::marschner::Marschner;
use crate::reference::tracer::film::Film;
use crate::reference::tracer::light::Light;
use crate::reference::tracer::strands::Strands;
use crate::reference::tracer::{Sampling, TraceScene, trace};
use crate::scattering::fibre::Fibre;
use crate::scene::Lens;

const STRATEGIES: [(&str, Sampling); 3] = [
    ("light sampling", Sampling::Light),
    ("Hery sampling", Sampling::Fibre),
    ("MIS", Sampling::Both),
];
const SIZE: [u32; 2] = [32, 32];

/// Standard error at 16 samples a pixel against β, under an overcast sky.
pub fn error_by_width(progress: Progress) -> Result<Plot> {
    const BETAS: [f64; 10] = [1.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.0, 19.0];
    let cylinder = Cylinder::new();
    let map = environment::load("builtin:overcast")?.environment;
    let light = Light::map(&map, 0.0, 1.0)?;
    let mut series = Vec::new();
    for (k, (name, sampling)) in STRATEGIES.into_iter().enumerate() {
        let mut points = Vec::new();
        for (j, beta) in BETAS.into_iter().enumerate() {
            let mut film = Film::new(SIZE);
            let before = (k * BETAS.len() + j) as f32;
            let share = |of_this: f32| progress((before + of_this) / (3.0 * BETAS.len() as f32));
            let estimate = Estimate { light: &light, beta_deg: beta, sampling, seed: 1 };
            cylinder.trace(&estimate, &mut film, 16, &share)?;
            points.push([beta.to_radians(), standard_error(&film)]);
        }
        series.extend(marked(name, k, points));
    }
    Ok(Plot::Curves {
        panels: vec![Curves {
            title: "R under an overcast sky, 16 samples a pixel".to_owned(),
            x: Axis::degrees("longitudinal width β_R", 0.0, 20.0, 5.0),
            y: Axis::linear("relative error", 0.0, 1.0, 0.25),
            series,
        }],
        per_row: 1,
    })
}

/// Measured error against the number of samples, β_R = 7.5°, from even light to a small sun.
pub fn error_by_samples(progress: Progress) -> Result<Plot> {
    const SAMPLES: [u32; 7] = [1, 2, 4, 8, 16, 32, 64];
    const TRUTH: u32 = 1024;
    const BETA: f64 = 7.5;
    const MAPS: [(&str, &str); 4] = [
        ("builtin:overcast", "An overcast sky"),
        ("builtin:studio", "A studio's soft boxes"),
        ("builtin:sunset", "A low sun"),
        ("builtin:night", "Lamps at night"),
    ];
    let cylinder = Cylinder::new();
    let mut panels = Vec::new();
    for (j, (name, title)) in MAPS.into_iter().enumerate() {
        // Nearly all of the work is the truth.
        let share = |of_this: f32| progress((j as f32 + of_this) / MAPS.len() as f32);
        let map = environment::load(name)?.environment;
        let light = Light::map(&map, 0.0, 1.0)?;
        let mut truth = Film::new(SIZE);
        let both = Estimate { light: &light, beta_deg: BETA, sampling: Sampling::Both, seed: 2 };
        cylinder.trace(&both, &mut truth, TRUTH, &share)?;
        let mut series = Vec::new();
        for (k, (name, sampling)) in STRATEGIES.into_iter().enumerate() {
            let estimate = Estimate { sampling, seed: 1, ..both };
            let mut film = Film::new(SIZE);
            let mut points = Vec::new();
            for samples in SAMPLES {
                cylinder.trace(&estimate, &mut film, samples, &|_| share(1.0))?;
                points.push([f64::from(samples), distance(&film, &truth)]);
            }
            series.extend(marked(name, k, points));
        }
        panels.push(Curves {
            title: title.to_owned(),
            x: Axis::log("samples a pixel", 1.0, 64.0, 2.0),
            y: Axis::log("relative error", 0.03, 300.0, 10.0),
            series,
        });
    }
    Ok(Plot::Curves { panels, per_row: 2 })
}

/// A line and its points.
fn marked(name: &str, k: usize, points: Vec<[f64; 2]>) -> [Series; 2] {
    let line = Series::new(name, COLOURS[k], points);
    let dots = line.clone().stroke(Stroke::Dots).unlisted();
    [line, dots]
}

/// √(Σ variance of the mean / Σ mean²) over pixels and channels.
fn standard_error(film: &Film) -> f64 {
    let pixels = || 0..film.pixels.len();
    let variance: f64 = pixels().map(|i| film.variance(i).iter().sum::<f64>()).sum();
    (variance / pixels().map(|i| square(film.mean(i))).sum::<f64>()).sqrt()
}

/// Relative L2 between the means of two films.
fn distance(film: &Film, truth: &Film) -> f64 {
    let pixels = || 0..film.pixels.len();
    let apart = |i: usize| {
        let (a, b) = (film.mean(i), truth.mean(i));
        square(std::array::from_fn(|c| a[c] - b[c]))
    };
    let error: f64 = pixels().map(apart).sum();
    (error / pixels().map(|i| square(truth.mean(i))).sum::<f64>()).sqrt()
}

fn square([r, g, b, _]: [f64; 4]) -> f64 {
    r * r + g * g + b * b
}

/// What a render estimates, and how.
#[derive(Clone, Copy)]
struct Estimate<'a> {
    light: &'a Light<'a>,
    beta_deg: f64,
    sampling: Sampling,
    seed: u32,
}

/// Thirty rings of radius 1 upon each other, and a camera in front.
struct Cylinder {
    hair: Hair,
    frames: Frames,
    diameters: Vec<f32>,
}

impl Cylinder {
    fn new() -> Cylinder {
        const RINGS: usize = 30;
        const POINTS: usize = 64;
        let diameter = 2.0 / RINGS as f32;
        let mut hair = Hair { offsets: vec![0], ..Hair::default() };
        for ring in 0..RINGS {
            let y = (ring as f32 + 0.5) * diameter - 1.0;
            hair.points.extend((0..=POINTS).map(|k| {
                let (sin, cos) = (TAU as f32 * k as f32 / POINTS as f32).sin_cos();
                // The seam lies behind.
                Vec3::new(-sin, y, -cos)
            }));
            hair.offsets.push(hair.points.len() as u32);
        }
        let frames = Frames::new(&hair);
        let diameters = vec![diameter; hair.points.len()];
        Cylinder { hair, frames, diameters }
    }

    /// R alone, direct light alone, until `film` has `samples`.
    fn trace(
        &self,
        estimate: &Estimate,
        film: &mut Film,
        samples: u32,
        progress: Progress,
    ) -> Result<()> {
        let &Estimate { light, beta_deg, sampling, seed } = estimate;
        let fibre = Fibre {
            eta: 1.55,
            // Nothing comes through.
            sigma_a: [100.0; 3],
            alpha: [0.0; 3],
            beta: [beta_deg.to_radians(); 3],
            w_c: 0.1,
            eccentricity: 1.0,
            tint: Fibre::UNTINTED,
        };
        let strands = Strands::new(&self.hair, &self.diameters, &self.frames, 1, Vec3::ZERO);
        let half = 0.18;
        let model = Hery::new(Marschner::new(&fibre));
        let models = Models::even(&model);
        let scene = TraceScene {
            strands: &strands,
            skin: None,
            light,
            models: &models,
            lens: Lens {
                eye: DVec3::new(0.0, 1.5, 6.5),
                forward: -DVec3::new(0.0, 1.5, 6.5).normalize(),
                right: half * DVec3::X,
                up: half * DVec3::new(0.0, 6.5, -1.5).normalize(),
                distance: 6.7,
                size: SIZE,
            },
            sampling,
            max_depth: 1,
            seed,
        };
        ensure!(trace(&scene, film, samples, progress)?, "cancelled");
        Ok(())
    }
}
