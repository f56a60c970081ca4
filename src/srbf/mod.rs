//! Spherical radial basis functions: the light that hair is lit by (Xu 2011, Eq 1).
//!
//! An environment becomes a few isotropic lobes L(ω) = Σ rgb_j exp(2(ω·ω_j − 1)/λ_j²). [`fit`]
//! makes them, [`fit_cached`] remembers them, `lights.json` carries them.

mod blurred_lobe;
mod cache;
mod dense;
mod error;
mod fit;
mod harmonics;
mod lights_json;
mod sample;

use std::f64::consts::{LN_2, PI};

use anyhow::{Result, ensure};
use glam::DVec3;
use rayon::prelude::*;

use crate::environment::{Environment, uv_to_direction};
use crate::scattering::gaussian::concentration as sharpness;
use harmonics::{Harmonics, band_of_blur};

pub use crate::scattering::gaussian::srbf_integral as lobe_integral;
pub(crate) use cache::is_cached_fit;
pub use cache::{cache_folder, fit_cached, fit_cached_in};
pub use fit::{Fit, MAX_LIGHTS, fit};
pub use lights_json::{from_json, to_json, write_json};
pub use sample::{
    ORDINATES, direction_in_lobe, lattice, sample_lobe, sky_of, split_weak, split_wide,
};

/// One isotropic SRBF light: L(ω) = rgb · exp(2(ω·direction − 1)/lambda²).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SrbfLight {
    /// Unit vector, world frame, unrotated.
    pub direction: DVec3,
    /// Bandwidth λ_j > 0 (√2 times a standard deviation, in radians for narrow lobes).
    pub lambda: f64,
    /// Peak radiance, linear RGB ≥ 0.
    pub rgb: [f64; 3],
}

impl SrbfLight {
    /// ∫ L dω over the sphere, per channel: rgb · 2π(1 − e^(−2κ))/κ, κ = 2/λ². Exact for every λ.
    pub fn energy(&self) -> [f64; 3] {
        let integral = lobe_integral(self.lambda);
        self.rgb.map(|v| v * integral)
    }

    /// Radiance of this light from direction ω (a unit vector), per channel.
    pub fn radiance(&self, omega: DVec3) -> [f64; 3] {
        // 1 − cos by the chord, which keeps its digits where the lobe is narrow.
        let value =
            (-(omega - self.direction).length_squared() / (self.lambda * self.lambda)).exp();
        self.rgb.map(|v| v * value)
    }

    /// The angle in radians from `direction` at which the radiance is half its peak: 2 asin(λ √(ln 2)/2). None for a
    /// lobe so wide that it falls to no half.
    pub fn half_angle(&self) -> Option<f64> {
        let sin = 0.5 * self.lambda * LN_2.sqrt();
        (sin <= 1.0).then(|| 2.0 * sin.asin())
    }
}

/// Radiance of all the lights from direction ω (a unit vector), linear RGB.
pub fn radiance(lights: &[SrbfLight], omega: DVec3) -> [f64; 3] {
    lights.iter().fold([0.0; 3], |sum, light| {
        let radiance = light.radiance(omega);
        std::array::from_fn(|c| sum[c] + radiance[c])
    })
}

/// The lights as a lat-long map. Those narrower than a pixel are widened to one, with their energy.
pub fn preview(lights: &[SrbfLight], width: usize, height: usize) -> Environment {
    let pixel = PI / height as f64;
    let widened: Vec<SrbfLight> = lights
        .iter()
        .map(|light| {
            let lambda = light.lambda.max(pixel);
            let gain = lobe_integral(light.lambda) / lobe_integral(lambda);
            SrbfLight { lambda, rgb: light.rgb.map(|v| v * gain), ..*light }
        })
        .collect();
    let pixels = pixel_directions(width, height)
        .par_iter()
        .map(|&omega| radiance(&widened, omega).map(|v| v as f32))
        .collect();
    Environment::new(width, height, pixels)
}

/// The map blurred by the lobe of bandwidth λ ≥ 0.02 scaled to unit integral, at the pixel centres
/// of a new size; exact to 1e-9 of the map's peak (harmonics.rs).
pub fn blur_map(
    env: &Environment,
    lambda: f64,
    width: usize,
    height: usize,
) -> Result<Environment> {
    ensure!(lambda >= 0.02, "cannot blur by λ = {lambda}: choose 0.02 or more");
    let blurred = Harmonics::of_map(env, band_of_blur(lambda)).blurred(lambda);
    let radiances = blurred.at(&pixel_directions(width, height));
    // The cut-off series rings by 1e-9 about black.
    let pixels = radiances.iter().map(|rgb| rgb.map(|v| v.max(0.0) as f32)).collect();
    Ok(Environment::new(width, height, pixels))
}

fn pixel_directions(width: usize, height: usize) -> Vec<DVec3> {
    let centre = |i: usize, count: usize| (i as f64 + 0.5) / count as f64;
    (0..width * height)
        .map(|i| uv_to_direction([centre(i % width, width), centre(i / width, height)]))
        .collect()
}
