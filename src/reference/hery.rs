//! The sampling of Hery & Ramamoorthi 2012 for the Marschner model's values.
//!
//! Their Algorithm 1 draws R alone: θ_s = β √(−2 ln u₁) cos 2πu₂ (Box–Muller), kept within ±θ_max,
//! θ_max = π/2 − |θ_o/2−α|, so that |θ_i| ≤ π for θ_i = 2(θ_s+α)−θ_o; a θ_i beyond ±π/2 is folded back, and
//! φ = 2 asin(2u₃−1). They state the density g^u(θ_s; β) cos(φ/2)/(8 cosθ_i) (Eq 9). Here as well:
//! - TRT as they suggest, "a regular reflection lobe derived from R" with its own α and β. TT likewise, but
//!   about φ = π: |sin(φ/2)|. A lobe is drawn by the same probabilities as in [`Marschner`], in the mean over h.
//! - f_cos is the Marschner model's, with Fresnel, attenuation and cos²θ_i/cos²θ_d, which they leave out.
//!   f_cos/pdf is bounded for R and TT. For TRT it is not: the caustic rises to 4/(√π w_c) times cos(φ/2)/4,
//!   which is 0 at φ = π. At θ_o = 0 (blond, β_R = 10°) the variance is 383 times that of [`Marschner`]'s own
//!   sampling, at θ_o = 1.5 116 times.
//! - The density stated is not that of what is drawn. Kept samples are a point mass (at |θ_i| = π, folded
//!   to 0), and a direction reached by a fold is stated without it: of a lobe about −θ_o = −1.5 of
//!   β = 7.5°, 39 % is folded. [`Hery::new`] goes on folding instead of keeping samples within θ_max, which
//!   takes the whole line into ±π/2, and sums the density over all that is folded onto one θ_i.
//!   [`Hery::as_published`] leaves both as printed: its density integrates to 0.58 at θ_o = 1.5 (β_R = 10°),
//!   and its albedo there is 1.25 for 0.75.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::{
    marschner::Marschner,
    model::{Detector, Direction, Evaluation, FibreModel, Path, Sample, Section},
};
use crate::scattering::{azimuthal::wrap, longitudinal::longitudinal};

/// Standard deviations of a Gaussian beyond which nothing is folded back: Box–Muller reaches 8.6 with a
/// uniform number of 53 bits.
const REACH: f64 = 9.0;

/// Values of the Marschner model, sampling of Hery & Ramamoorthi.
#[derive(Clone, Debug)]
pub struct Hery {
    marschner: Marschner,
    published: bool,
}

impl Hery {
    /// With the density of what is drawn.
    pub fn new(marschner: Marschner) -> Self {
        Self { marschner, published: false }
    }

    /// As printed: samples clamped, and a density that leaves out those clamped and folded. Biased: a mean
    /// of f_cos/pdf is not the albedo.
    pub fn as_published(marschner: Marschner) -> Self {
        Self { marschner, published: true }
    }

    /// θ_i of lobe p by Box–Muller.
    fn draw_inclination(&self, p: usize, theta_o: f64, u: [f64; 2]) -> f64 {
        let fibre = self.marschner.fibre();
        let (alpha, beta) = (fibre.alpha[p], fibre.beta[p]);
        let mut theta_s = beta * (-2.0 * (1.0 - u[0]).ln()).sqrt() * (TAU * u[1]).cos();
        if self.published {
            let most = (FRAC_PI_2 - (0.5 * theta_o - alpha).abs()).max(0.0);
            theta_s = theta_s.clamp(-most, most);
        }
        fold(2.0 * (theta_s + alpha) - theta_o)
    }

    /// Density of [`Self::draw_inclination`] over θ_i.
    fn inclination_density(&self, p: usize, theta_i: f64, theta_o: f64) -> f64 {
        let fibre = self.marschner.fibre();
        let (alpha, beta) = (fibre.alpha[p], fibre.beta[p]);
        let at = |theta: f64| longitudinal(theta, theta_o, alpha, beta);
        if self.published {
            return at(theta_i);
        }
        // All that folds onto θ_i: θ_i + 2πk and π−θ_i + 2πk.
        let (centre, reach) = (2.0 * alpha - theta_o, REACH * 2.0 * beta);
        [theta_i, PI - theta_i]
            .into_iter()
            .map(|first| {
                let low = ((centre - reach - first) / TAU).ceil() as i32;
                let high = ((centre + reach - first) / TAU).floor() as i32;
                (low..=high).map(|k| at(first + TAU * f64::from(k))).sum::<f64>()
            })
            .sum()
    }

    fn density(&self, share: &[f64; 3], o: &Direction, i: &Direction) -> f64 {
        let (sin_half, cos_half) = (0.5 * wrap(i.phi - o.phi)).sin_cos();
        let sum: f64 = (0..3)
            .map(|p| {
                let azimuth = 0.25 * if p == 1 { sin_half.abs() } else { cos_half };
                share[p] * azimuth * self.inclination_density(p, i.theta(), o.theta())
            })
            .sum();
        sum / i.cos_theta.max(1e-17)
    }
}

/// θ as the paper takes it into [−π/2, π/2]: sign(θ)(π−|θ|) beyond, and on until it is within.
fn fold(theta: f64) -> f64 {
    let turns = (theta / PI).round();
    let rest = theta - PI * turns;
    if turns % 2.0 == 0.0 { rest } else { -rest }
}

impl FibreModel for Hery {
    fn lobes(&self) -> usize {
        self.marschner.lobes()
    }

    fn longitudinal(&self, p: usize, theta_i: f64, theta_o: f64) -> f64 {
        self.marschner.longitudinal(p, theta_i, theta_o)
    }

    fn path(&self, p: usize, h: f64, section: &Section) -> Path {
        self.marschner.path(p, h, section)
    }

    fn detector(&self, p: usize) -> Detector {
        self.marschner.detector(p)
    }

    fn azimuthal(&self, p: usize, phi: f64, section: &Section) -> [f64; 3] {
        self.marschner.azimuthal(p, phi, section)
    }

    fn evaluate(&self, o: &Direction, i: &Direction, h: f64) -> Evaluation {
        let choice = self.marschner.choice(o);
        let f_cos = self.marschner.evaluate_by(&choice, o, i, h).f_cos;
        Evaluation { f_cos, pdf: self.density(&choice.share, o, i) }
    }

    fn sample(&self, o: &Direction, h: f64, u: [f64; 4]) -> Option<Sample> {
        let p = self.marschner.choice(o).lobe(u[0])?;
        let theta_i = self.draw_inclination(p, o.theta(), [u[1], u[2]]);
        let about = if p == 1 { PI } else { 0.0 };
        let phi_i = wrap(o.phi + about + 2.0 * (2.0 * u[3] - 1.0).asin());
        let direction = Direction::new(theta_i, phi_i);
        let value = self.evaluate(o, &direction, h);
        (value.pdf > 0.0).then_some(Sample { direction, value })
    }

    fn near_field(&self) -> bool {
        false
    }
}
