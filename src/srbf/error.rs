//! How far lights are from their map.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use super::blurred_lobe::BlurredLobe;
use super::harmonics::Harmonics;
use super::{SrbfLight, sharpness};
use crate::environment::{Environment, direction_to_uv, uv_to_direction};

/// √(∫|M − L|² / ∫|M|²) once both are blurred by the unit lobe of bandwidth λ; 0 for a black map.
pub(super) fn relative_l2_blurred(map: &Harmonics, lights: &Harmonics, lambda: f64) -> f64 {
    let (map, lights) = (map.blurred(lambda), lights.blurred(lambda));
    ratio_or(map.squared_distance(&lights), map.squared_norm(), 0.0).sqrt()
}

/// The quotient, or `otherwise` where there is nothing to divide by.
pub(super) fn ratio_or(numerator: f64, denominator: f64, otherwise: f64) -> f64 {
    if denominator > 0.0 { numerator / denominator } else { otherwise }
}

/// A map at its own size and at halves of it.
pub(super) struct Pyramid<'a> {
    pub(super) map: &'a Environment,
    /// Each half of the one before.
    pub(super) smaller: Vec<Environment>,
}

/// A lobe is joined with pixels of at most this share of its bandwidth, if the map has them: the integral is then the
/// map's own to 1e-4.
const PIXEL_SHARE: f64 = 1.0 / 32.0;

impl<'a> Pyramid<'a> {
    /// Down to what the widest lobe needs.
    pub(super) fn new(map: &'a Environment) -> Self {
        let mut smaller: Vec<Environment> = Vec::new();
        loop {
            let last = smaller.last().unwrap_or(map);
            if last.width.min(2 * last.height) < 256 {
                return Self { map, smaller };
            }
            smaller.push(last.halved());
        }
    }

    /// The smallest size that has pixels for lobes of this bandwidth; the map itself where none has.
    pub(super) fn for_lobe(&self, lambda: f64) -> &Environment {
        let fine =
            |map: &&Environment| PI / map.height.min(map.width / 2) as f64 <= PIXEL_SHARE * lambda;
        self.smaller.iter().rev().find(fine).unwrap_or(self.map)
    }

    /// The largest size with no side above `most` pixels.
    pub(super) fn within(&self, most: usize) -> &Environment {
        let fits = |map: &&Environment| map.width.max(map.height) <= most;
        [self.map].into_iter().chain(&self.smaller).find(fits).unwrap_or(self.map)
    }

    /// √(∫|M − L|² / ∫|M|²) for the map M of constant patches; 0 for a black map.
    pub(super) fn relative_l2(&self, lights: &[SrbfLight]) -> f64 {
        let env = self.map;
        let squares = |y: usize| {
            let row = env.pixels[y * env.width..(y + 1) * env.width].iter().flatten();
            cell_area(y, env.height, env.width) * row.map(|&v| v as f64 * v as f64).sum::<f64>()
        };
        let rows: Vec<f64> = (0..env.height).into_par_iter().map(squares).collect();
        let map_squared: f64 = rows.iter().sum();
        let cross: Vec<f64> = lights.par_iter().map(|light| self.product(light)).collect();
        let squared =
            map_squared - 2.0 * cross.iter().sum::<f64>() + lights_product(lights, lights);
        ratio_or(squared.max(0.0), map_squared, 0.0).sqrt()
    }

    /// ∫ M L dω summed over RGB.
    pub(super) fn product(&self, light: &SrbfLight) -> f64 {
        map_product(self.for_lobe(light.lambda), light)
    }
}

/// ∫ A B dω summed over RGB, exact.
pub(super) fn lights_product(a: &[SrbfLight], b: &[SrbfLight]) -> f64 {
    let pair = |a: &SrbfLight, b: &SrbfLight| {
        let overlap = BlurredLobe::new(sharpness(a.lambda), sharpness(b.lambda))
            .value(0.5 * (a.direction - b.direction).length_squared());
        let (a, b) = (a.energy(), b.energy());
        overlap * (0..3).map(|c| a[c] * b[c]).sum::<f64>()
    };
    a.iter().flat_map(|a| b.iter().map(move |b| pair(a, b))).sum()
}

/// Solid angle of a cell in row y of a lat-long grid.
fn cell_area(y: usize, rows: usize, columns: usize) -> f64 {
    let edge = |y: usize| (y as f64 / rows as f64 * PI).cos();
    (edge(y) - edge(y + 1)) * TAU / columns as f64
}

/// ∫ M L dω summed over RGB for the map M of constant patches: a sum over cells of at most half a
/// bandwidth.
fn map_product(env: &Environment, light: &SrbfLight) -> f64 {
    let (lambda, direction) = (light.lambda, light.direction);
    let parts = (TAU / env.height as f64 / lambda)
        .max(2.0 * TAU / env.width as f64 / lambda)
        .ceil()
        .max(1.0);
    let parts = parts as usize;
    let (rows, columns) = (env.height * parts, env.width * parts);
    // Beyond this angle the lobe is below 1e-13 of its peak.
    let reach = 2.0 * (0.5 * lambda * 30f64.sqrt()).min(1.0).asin();
    let [u_light, v_light] = direction_to_uv(direction);
    let theta = v_light * PI;
    let to_row = |theta: f64| (theta / PI * rows as f64).clamp(0.0, rows as f64);
    let mut sum = 0.0;
    for y in to_row(theta - reach) as usize..to_row(theta + reach).ceil() as usize {
        let v = (y as f64 + 0.5) / rows as f64;
        let sin = (v * PI).sin();
        // Within reach, sin²(Δφ/2) sin θ sin θ_j ≤ sin²(reach/2).
        let share = (0.5 * reach).sin() / (sin * theta.sin()).sqrt().max(1e-12);
        let half_width = if share < 1.0 { 2.0 * share.asin() } else { PI };
        let half_columns = (half_width / TAU * columns as f64).ceil() as usize + 1;
        let centre = (u_light * columns as f64) as usize;
        let (first, count) = if 2 * half_columns + 1 < columns {
            (centre + columns - half_columns, 2 * half_columns + 1)
        } else {
            (0, columns)
        };
        let mut row_sum = 0.0;
        for x in (first..first + count).map(|x| x % columns) {
            let u = (x as f64 + 0.5) / columns as f64;
            let radiance = light.radiance(uv_to_direction([u, v]));
            let pixel = env.pixels[y / parts * env.width + x / parts];
            row_sum += (0..3).map(|c| radiance[c] * pixel[c] as f64).sum::<f64>();
        }
        sum += cell_area(y, rows, columns) * row_sum;
    }
    sum
}
