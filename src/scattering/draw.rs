//! Directions that light comes to a fibre from, drawn by what the fibre sends of it to one viewer: for rays between
//! strands.
//!
//! A draw is an offset h across the fibre, a lobe by the light that its path there has left, and θ_i by the lobe's M_t; the
//! path through the cross section says φ. Pale fibres' weights are near 1, so that paths of many draws have little noise.
//! A draw needs no value of S: the mean of [`Drawn::weight`] times any radiance is ∫L S cosθ_i dω_i, energy compensation
//! and tint included, as [`Fast::single_scattering`] has it of an SRBF: within 0.3 % (relative L2 over lights, Marschner's
//! and d'Eon's, σ_a to 2, β_R to 15°), and 1.5 % for an eccentric fibre
//! (a = 0.85), tests/draw.rs. Twin: shaders/fibre_draw.wgsl.

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2, TAU};

use super::{
    azimuth_table::Mode,
    azimuthal::{exit_azimuth, wrap},
    fast::Fast,
    fresnel::fresnel,
    longitudinal::projection,
    model::Model,
};

/// A direction and what becomes of the light from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// Radians in [−π/2, π/2].
    pub theta_i: f64,
    /// Radians in [−π, π], counted as φ_o is.
    pub phi_i: f64,
    /// By what radiance from there is multiplied, linear RGB.
    pub weight: [f64; 3],
}

/// What a draw chooses from: R, TT, TRT, TRRT and all longer paths.
const LOBES: usize = 5;

impl Fast<'_> {
    /// Draws by four uniform numbers in [0, 1), for the viewer at θ_o and φ_o, radians, φ_o counted from the minor axis of
    /// an eccentric fibre; None where the draw carries no light.
    pub fn draw(&self, theta_o: f64, phi_o: f64, u: [f64; 4]) -> Option<Drawn> {
        let gamma = (2.0 * u[3] - 1.0).clamp(-1.0, 1.0).asin();
        let (shares, factors) = self.lobe_shares(theta_o, gamma);
        let total: f64 = shares.iter().sum();
        let mut left = u[0] * total;
        let p = shares.iter().position(|share| {
            left -= share;
            left < 0.0
        })?;
        // What the choice leaves of its number is as even as the number was.
        let rest = 1.0 + left / shares[p];
        let mode = Mode::ALL[p.min(3)];
        let theta_i = self.draw_inclination(mode, theta_o, [u[1], u[2]])?;
        let cos_path = self.model.cos_path(theta_i, theta_o);
        let along = match self.model {
            Model::Marschner => projection(theta_i, theta_o),
            Model::Deon => 1.0,
        };
        let scale = along * total / shares[p];
        let weighted = |own: [f64; 3]| [0, 1, 2].map(|c| (scale * factors[p][c] * own[c]).max(0.0));
        if p == 4 {
            let own = [0, 1, 2].map(|c| self.rest_energy(cos_path, c));
            let phi_i = wrap(phi_o + TAU * u[3]);
            return Some(Drawn { theta_i, phi_i, weight: weighted(own) });
        }
        let blurred = self.model == Model::Deon || mode == Mode::Trt;
        let sigma = if blurred { self.fibre.w_c / SQRT_2 } else { 0.0 };
        let blur = sigma * normal_quantile(rest);
        let azimuth = |eta: f64| {
            let q = cos_path / slant(eta, cos_path);
            wrap(phi_o + exit_azimuth(mode.crossings(), gamma, q.min(1.0)) + blur)
        };
        let mut eta = self.mean_eta(mode);
        if mode == Mode::Trt && self.fibre.eccentricity != 1.0 {
            // η* follows from φ_h, and that from the azimuth that η* gives: one step towards both.
            eta = self.eta_star(mode, (azimuth(eta) + phi_o).cos());
        }
        let own = self.attenuation(mode, eta, cos_path, gamma);
        Some(Drawn { theta_i, phi_i: azimuth(eta), weight: weighted(own) })
    }

    /// The lobes' chances at h = sin γ, not summing to 1, and their energy compensation times tint.
    fn lobe_shares(&self, theta_o: f64, gamma: f64) -> ([f64; LOBES], [[f64; 3]; LOBES]) {
        let factors = self.factors(theta_o);
        let factors = [factors.r, factors.tt, factors.trt, factors.longer, factors.longer];
        let cos_path = theta_o.cos().max(0.0);
        let has_longer = self.model.modes().contains(&Mode::Trrt);
        let shares = std::array::from_fn(|p| {
            let mean = |own: [f64; 3]| {
                ((0..3).map(|c| factors[p][c] * own[c]).sum::<f64>() / 3.0).max(0.0)
            };
            let own = |mode| self.attenuation(mode, self.mean_eta(mode), cos_path, gamma);
            match p {
                0..=2 => mean(own(Mode::ALL[p])),
                3 if has_longer => mean(own(Mode::Trrt)),
                4 if has_longer => mean([0, 1, 2].map(|c| self.rest_energy(cos_path, c))),
                _ => 0.0,
            }
        });
        (shares, factors)
    }

    /// θ_i drawn from M_t; None where Marschner's Gaussian goes past ±π/2.
    fn draw_inclination(&self, mode: Mode, theta_o: f64, [u, v]: [f64; 2]) -> Option<f64> {
        let (centre, lambda) = self.model.shape(&self.fibre, mode, theta_o);
        let cos_turn = (TAU * v).cos();
        match self.model {
            Model::Marschner => {
                // Box and Muller 1958.
                let theta = centre + lambda * (-(-u).ln_1p()).max(0.0).sqrt() * cos_turn;
                (theta.abs() < FRAC_PI_2).then_some(theta)
            }
            Model::Deon => {
                // d'Eon et al. 2013: a Gaussian on the sphere about a place of the cone.
                let v = 0.5 * lambda * lambda;
                let drop = (-v * (u * (-2.0 / v).exp_m1()).ln_1p()).clamp(0.0, 2.0);
                let across = (drop * (2.0 - drop)).max(0.0).sqrt();
                let sin = across * cos_turn * centre.cos() + (1.0 - drop) * centre.sin();
                Some(sin.clamp(-1.0, 1.0).asin())
            }
        }
    }

    /// A_t(h) with h = sin γ, RGB.
    fn attenuation(&self, mode: Mode, eta: f64, cos_path: f64, gamma: f64) -> [f64; 3] {
        let f = fresnel(cos_path * gamma.cos(), eta);
        let crossings = mode.crossings() as i32;
        if crossings == 0 {
            return [f; 3];
        }
        let slant = slant(eta, cos_path);
        let h_t = gamma.sin() * (cos_path / slant).min(1.0);
        let chord = 2.0 * eta / slant * (1.0 - h_t * h_t).max(0.0).sqrt();
        let surface = (1.0 - f).powi(2) * f.powi(crossings - 1);
        self.fibre.sigma_a.map(|sigma| surface * (-f64::from(crossings) * sigma * chord).exp())
    }
}

/// √(η²−sin²θ) of the path's cosθ.
fn slant(eta: f64, cos_path: f64) -> f64 {
    (eta * eta - 1.0 + cos_path * cos_path).max(1e-30).sqrt()
}

/// x below which lies the share u of a normal distribution of σ = 1, to 4e-3: Winitzki 2008.
fn normal_quantile(u: f64) -> f64 {
    const A: f64 = 0.147;
    let x = (2.0 * u - 1.0).clamp(-1.0 + 1e-7, 1.0 - 1e-7);
    let log = (1.0 - x * x).ln();
    let b = 2.0 / (PI * A) + 0.5 * log;
    let root = ((b * b - log / A).sqrt() - b).max(0.0).sqrt();
    (SQRT_2 * root).copysign(x)
}
