//! 𝒩_t^G, the azimuthal side of global multiple scattering (Xu 2011, Eq 28), and its table.
//!
//! Where we deviate from the print: the closed forms are evaluated once per edit over (θ_d, φ) instead
//! of at every node, which makes 𝓜^G 4 times faster on lavapipe; and an eccentric fibre counts with the
//! mean of η*(φ_h) over φ_h, since light from a half circle has lost its azimuth.

use std::f64::consts::{FRAC_PI_2, PI};

use rayon::prelude::*;

use super::{
    azimuthal::{Energy, Fit, Fitter, eccentric_eta, r_coefficients},
    fibre::Fibre,
    gaussian::g_circular_integral,
    tables::{CircleTable, half_circle_cosines, pack},
    xu::Modes,
};

/// The fits that 𝒩^G is made of at one θ_d.
pub struct GlobalAzimuth {
    r: [f64; 7],
    tt: Fit,
    trt: Fit,
}

impl GlobalAzimuth {
    /// The fits of a fibre at θ_d.
    pub fn new(fibre: &Fibre, theta_d: f64, energy: Energy) -> Self {
        let fitter = Fitter::new(fibre, energy);
        let tt = fitter.fit(fibre.eta, theta_d);
        let trt = if fibre.eccentricity == 1.0 {
            tt
        } else {
            let (mean, _) = eccentric_eta(fibre.eta, fibre.eccentricity);
            fitter.fit(mean.max(1.0), theta_d)
        };
        Self { r: r_coefficients(fibre.eta, theta_d), tt, trt }
    }

    /// 𝒩_t^G = (1/π)∫_{φ_j−π/2}^{φ_j+π/2} N_t(θ_d, φ_o−φ_i) dφ_i at φ = φ_o−φ_j; `half(φ, κ)` is the
    /// share of g^c(·; 0, κ) within the half circle around φ.
    pub fn at(&self, phi: f64, half: impl Fn(f64, f64) -> f64) -> Modes {
        let lobe = |delta: f64, kappa: f64| g_circular_integral(kappa) * half(delta, kappa) / PI;
        let r: f64 = self.r.iter().zip(half_circle_cosines(phi)).map(|(c, h)| c * h).sum();
        Modes {
            r: [r.max(0.0) / PI; 3],
            tt: self.tt.tt(phi, lobe),
            trt: self.trt.trt(phi, lobe),
            longer: [0.0; 3],
        }
    }
}

/// 𝒩^G over |θ_d| in [0, π/2] (rows) and |φ| in [0, π] (columns).
pub struct GlobalTable {
    /// `rows[theta_d * COLUMNS + phi]`.
    rows: Vec<Modes>,
}

impl GlobalTable {
    /// Rows over |θ_d|, ends included.
    pub const ROWS: usize = 128;
    /// Columns over |φ|, ends included.
    pub const COLUMNS: usize = 64;

    /// Samples 𝒩^G of a fibre.
    pub fn new(fibre: &Fibre, energy: Energy, circle: &CircleTable) -> Self {
        let rows = (0..Self::ROWS)
            .into_par_iter()
            .flat_map_iter(|row| {
                let theta_d = FRAC_PI_2 * row as f64 / (Self::ROWS - 1) as f64;
                let azimuth = GlobalAzimuth::new(fibre, theta_d, energy);
                (0..Self::COLUMNS).map(move |column| {
                    let phi = PI * column as f64 / (Self::COLUMNS - 1) as f64;
                    azimuth.at(phi, |delta, kappa| circle.half(kappa, delta))
                })
            })
            .collect();
        Self { rows }
    }

    /// One packed entry each: (R, TT rgb), (TRT rgb, 0).
    pub fn to_gpu(&self) -> Vec<[u32; 4]> {
        self.rows
            .iter()
            .map(|m| pack([m.r[0], m.tt[0], m.tt[1], m.tt[2], m.trt[0], m.trt[1], m.trt[2], 0.0]))
            .collect()
    }
}
