//! The hair model of pbrt-v4 §9.9 (after Chiang et al. 2016): d'Eon's lobes with the h of the ray itself, a
//! logistic blur instead of a Gaussian, and two roughnesses in [0, 1] that look evenly spaced.
//!
//! A_p and Φ_p follow from θ_o and h; R, TT, TRT and one lobe for the rest of the series (p_max = 3).
//! pbrt's tilt turns θ_o by −2α, α and 4α, which in Marschner's α_p is α, −α/2 and −2α.
//!
//! Where we deviate from pbrt: I₀ at full accuracy (pbrt's log I₀ jumps by 1.5 % at x = 12), a lobe is
//! chosen by the mean of RGB and not by luminance, which is no light's business here, and where f = T = 1
//! the rest of the series is 0 and not 0/0.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use super::deon::{Blur, Paths, Rough};
use super::detector::TrimmedLogistic;
use super::model::Detector;
use crate::scattering::fibre::Fibre;

/// The smoothest fibre that either roughness can make: √v_0 = 0.4°, s = 0.1°. Below, a path tracer sees
/// deltas.
pub const ROUGHNESS_MIN: f64 = 0.01;

/// pbrt's hair.
pub type Chiang = Rough<TrimmedLogistic>;

impl Blur for TrimmedLogistic {
    const NEAR_FIELD: bool = true;

    fn detector(&self) -> Detector {
        Detector::Logistic { scale: self.scale() }
    }

    fn density(&self, x: f64) -> f64 {
        self.density(x)
    }

    fn sample(&self, u: f64) -> f64 {
        self.sample(u)
    }
}

impl Chiang {
    /// `beta_m`, `beta_n`: longitudinal and azimuthal roughness, held within [[`ROUGHNESS_MIN`], 1];
    /// `alpha` in radians; `sigma_a` per radius.
    pub fn new(beta_m: f64, beta_n: f64, alpha: f64, eta: f64, sigma_a: [f64; 3]) -> Self {
        let [beta_m, beta_n] = [beta_m, beta_n].map(|beta| beta.clamp(ROUGHNESS_MIN, 1.0));
        let v = deviation(beta_m).powi(2);
        let lobes = [(v, alpha), (0.25 * v, -0.5 * alpha), (4.0 * v, -2.0 * alpha), (4.0 * v, 0.0)];
        let blur = TrimmedLogistic::new(scale(beta_n));
        Rough::of(eta, sigma_a, lobes.into_iter(), blur, Paths::OfView)
    }

    /// (β_m, β_n) under which R spreads as `fibre` says, v_0 = (2β_R)², and azimuths have the standard
    /// deviation of its caustic, πs/√3 = w_c/√2; held within [[`ROUGHNESS_MIN`], 1].
    pub fn matching(fibre: &Fibre) -> (f64, f64) {
        let s = fibre.w_c * FRAC_1_SQRT_2 * f64::sqrt(3.0) / PI;
        (invert(deviation, 2.0 * fibre.beta[0]), invert(scale, s))
    }
}

/// √v_0 of a longitudinal roughness, radians of θ_i.
fn deviation(beta_m: f64) -> f64 {
    0.726 * beta_m + 0.812 * beta_m.powi(2) + 3.7 * beta_m.powi(20)
}

/// The logistic's scale s of an azimuthal roughness, radians.
fn scale(beta_n: f64) -> f64 {
    (PI / 8.0).sqrt() * (0.265 * beta_n + 1.194 * beta_n.powi(2) + 5.372 * beta_n.powi(22))
}

/// The roughness that a growing map takes to `value`, by bisection.
fn invert(map: impl Fn(f64) -> f64, value: f64) -> f64 {
    let (mut low, mut high) = (ROUGHNESS_MIN, 1.0);
    for _ in 0..52 {
        let middle = 0.5 * (low + high);
        if map(middle) < value { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}
