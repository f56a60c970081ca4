//! The path tracer: what a camera sees of strands and head under distant light, without approximation of
//! transport or light.
//!
//! Radiance is estimated by paths from the camera (`integrate`) over round strands (`strands`) and the head's
//! triangles (`skin`) under BVHs. At every place a path meets, a direction drawn from the light (`light`) and
//! one drawn from the fibre are joined by the balance heuristic (Veach and Guibas 1995). Sums, squares and
//! coverage are kept per pixel (`film`), so that a render can go on and knows its own noise.
//!
//! A ray with its share of scattering takes 1.9 µs of one core on sintel and 1.8 µs on a ball of 2,000 curls
//! (256², chiang): 1.0 and 1.1 million path segments a second on two cores.

pub mod film;
mod integrate;
pub mod light;
pub mod skin;
pub mod strands;
mod wide;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use anyhow::{Result, ensure};
use rayon::prelude::*;

use super::Models;
use crate::scene::Lens;
use film::{Film, Pixel};
use integrate::Integrator;
use light::Light;
use skin::Skin;
use strands::Strands;

/// Side of a tile in pixels.
const TILE: u32 = 16;
/// A pass takes so many samples of all pixels together, and of each pixel from 1 to so many: that is what a
/// cancelled render loses.
const PASS_TOTAL: u32 = 1 << 18;
const PASS_SAMPLES: u32 = 16;

/// Which draws estimate the light that a place scatters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// Light and fibre, by the balance heuristic.
    Both,
    Light,
    Fibre,
}

impl Sampling {
    /// The density a sample counts with, given those of both strategies.
    fn pdf(self, light: f64, fibre: f64) -> f64 {
        match self {
            Sampling::Both => light + fibre,
            Sampling::Light => light,
            Sampling::Fibre => fibre,
        }
    }
}

/// All that a render depends on beside its film.
#[derive(Clone, Copy)]
pub struct TraceScene<'a> {
    pub strands: &'a Strands<'a>,
    pub skin: Option<&'a Skin<'a>>,
    pub light: &'a Light<'a>,
    /// Their `evaluate` knows all that their `sample` draws.
    pub models: &'a Models<'a>,
    /// Relative to the centre of strands and skin.
    pub lens: Lens,
    pub sampling: Sampling,
    /// Scattering events of a path at most, by strand or head: 1 is direct light alone.
    pub max_depth: u32,
    /// Renders of different seeds are independent.
    pub seed: u32,
}

/// Adds samples to every pixel of `film` until each has `until_samples`; whether it got so far. Samples already
/// there must come of the same scene.
///
/// The result does not depend on the number of threads, nor on how the samples are split into calls. `progress`
/// is told the share done in [0, 1] after every tile, from any thread; when it returns false, the render stops
/// with the passes that are finished, and all pixels have the same number of samples.
///
/// # Errors
/// One line, if a sample is not finite and ≥ 0 (pixel, sample and the inputs of the place are named) or the
/// film does not fit the camera. The film then keeps the passes before.
pub fn trace(
    scene: &TraceScene,
    film: &mut Film,
    until_samples: u32,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Result<bool> {
    let size = film.size;
    let count = u64::from(size[0]) * u64::from(size[1]);
    ensure!(
        film.pixels.len() as u64 == count && scene.lens.size == size,
        "a film of {} pixels, {} × {}, does not fit a camera of {} × {}: begin a new one",
        film.pixels.len(),
        size[0],
        size[1],
        scene.lens.size[0],
        scene.lens.size[1]
    );
    let integrator = Integrator::new(scene);
    let tiles = Tiles { size, across: size[0].div_ceil(TILE) };
    let tile_count = tiles.across * size[1].div_ceil(TILE);
    let per_pass = (u64::from(PASS_TOTAL) / count.max(1)).clamp(1, PASS_SAMPLES.into()) as u32;
    let work = u64::from(until_samples.saturating_sub(film.samples)) * u64::from(tile_count);
    let done = AtomicU64::new(0);
    let stopped = AtomicBool::new(false);
    while film.samples < until_samples {
        let samples = film.samples..until_samples.min(film.samples + per_pass);
        let before = &film.pixels;
        let pass: Option<Vec<Tile>> = (0..tile_count)
            .into_par_iter()
            .map(|tile| {
                if stopped.load(Ordering::Relaxed) {
                    return Ok(None);
                }
                let mut pixels = Vec::with_capacity((TILE * TILE) as usize);
                let mut rays = 0;
                for (x, y) in tiles.pixels(tile) {
                    let mut pixel = before[tiles.index(x, y)];
                    for index in samples.clone() {
                        let seen = integrator.sample([x, y], size, index)?;
                        pixel.add(seen.radiance.to_array(), seen.covered, seen.hair);
                        rays += u64::from(seen.rays);
                    }
                    pixels.push(pixel);
                }
                let share = u64::from(samples.end - samples.start);
                let done = done.fetch_add(share, Ordering::Relaxed) + share;
                if !progress(done as f32 / work as f32) {
                    stopped.store(true, Ordering::Relaxed);
                }
                Ok(Some(Tile { pixels, rays }))
            })
            .collect::<Result<_>>()?;
        let Some(pass) = pass else { return Ok(false) };
        for (tile, Tile { pixels, rays }) in (0..).zip(pass) {
            for ((x, y), pixel) in tiles.pixels(tile).zip(pixels) {
                film.pixels[tiles.index(x, y)] = pixel;
            }
            film.segments += rays;
        }
        film.samples = samples.end;
        if stopped.load(Ordering::Relaxed) {
            break;
        }
    }
    Ok(film.samples >= until_samples)
}

/// A tile with a pass added to it.
struct Tile {
    pixels: Vec<Pixel>,
    rays: u64,
}

/// An image in tiles, row by row.
struct Tiles {
    size: [u32; 2],
    /// Tiles in a row.
    across: u32,
}

impl Tiles {
    /// The pixels of a tile, row by row.
    fn pixels(&self, tile: u32) -> impl Iterator<Item = (u32, u32)> + use<> {
        let (left, top) = (TILE * (tile % self.across), TILE * (tile / self.across));
        let (right, bottom) = ((left + TILE).min(self.size[0]), (top + TILE).min(self.size[1]));
        (top..bottom).flat_map(move |y| (left..right).map(move |x| (x, y)))
    }

    fn index(&self, x: u32, y: u32) -> usize {
        y as usize * self.size[0] as usize + x as usize
    }
}
