//! A fibre's lobes as curves: those that shading looks up, over those of the exact model.
//!
//! Across the strand N_p(φ) on the specular cone θ_o = −θ_i; along it ∫S_p cosθ_i dφ over θ_o. Both are of a light of
//! no width; of the three channels the luminance.

use std::f64::consts::{FRAC_PI_2, PI};

use anyhow::Result;
use rayon::prelude::*;

use crate::gpu::method::{Integrator, MethodData};
use crate::image::luminance;
use crate::paint::Fibres;
use crate::reference::model::{FibreModel, Section};
use crate::reference::model_of;
use crate::scattering::azimuthal::{ClearEnergies, Energy, TURNS};
use crate::scattering::fast::Fast;
use crate::scattering::longitudinal::longitudinal_bandwidth;
use crate::scattering::quadrature::GaussLegendre;
use crate::scattering::tables;
use crate::scattering::xu::{self, Modes};
use crate::scene::{Energies, FibreSpec, RenderSpec};

/// Steps over |φ| in [0, π] and over θ_o in [−π/2, π/2]; about each lobe's centre there are more of θ_o.
const ACROSS: usize = 361;
const ALONG: usize = 181;
const ABOUT: i32 = 24;

/// Lobes with less than this share of the light are not judged: see `MethodData::modes`.
const VISIBLE: f64 = 1.0 / 512.0;

/// Of [`Values`].
pub const NAMES: [&str; 4] = ["R", "TT", "TRT", "longer"];

/// What lobes are of.
#[derive(Clone, PartialEq)]
pub struct Subject {
    pub fibre: FibreSpec,
    pub render: RenderSpec,
    /// Of the light, radians within ±π/2.
    pub theta_i: f64,
}

/// Luminances of R, TT, TRT and all longer paths, per radian.
pub type Values = [f64; 4];

/// Over an angle in radians.
pub type Curve = [(f64, Values)];

/// Curves of one fibre.
pub struct Lobes {
    /// N over φ from 0, the light's side, to π; even in φ.
    pub across: Vec<(f64, Values)>,
    /// ∫S cosθ_i dφ over θ_o, energy compensation included; of an eccentric fibre the mean over its turn.
    pub along: Vec<(f64, Values)>,
}

impl Lobes {
    /// Without approximation.
    pub fn exact(subject: &Subject) -> Lobes {
        let model = model_of(&subject.fibre);
        let rule = GaussLegendre::new(48);
        let eccentric = subject.fibre.eccentricity != 1.0;
        let turns = if eccentric { &TURNS[..] } else { &TURNS[..1] };
        let theta_i = subject.theta_i;
        let lobes = |of: &dyn Fn(&dyn FibreModel, usize) -> [f64; 3]| {
            let mut values = [[0.0; 3]; 4];
            for p in 0..model.lobes() {
                let (sum, one) = (&mut values[p.min(3)], of(&*model, p));
                *sum = [0, 1, 2].map(|c| sum[c] + one[c]);
            }
            values
        };
        Self::sampled(
            subject,
            |phi| {
                // The light is at φ = 0.
                let section = Section { theta_i, theta_o: -theta_i, phi_h: 0.5 * phi };
                lobes(&|model, p| model.azimuthal(p, phi, &section))
            },
            |theta_o| {
                lobes(&|model, p| {
                    let m = model.longitudinal(p, theta_i, theta_o) * theta_i.cos();
                    let mut energy = [0.0; 3];
                    for &phi_h in if m > 0.0 { turns } else { &[] } {
                        let section = Section { theta_i, theta_o, phi_h };
                        for (gamma, weight) in rule.on(0.0, FRAC_PI_2) {
                            let a = model.path(p, gamma.sin(), &section).attenuation;
                            let share = m * weight * gamma.cos() / turns.len() as f64;
                            energy = [0, 1, 2].map(|c| energy[c] + share * a[c]);
                        }
                    }
                    energy
                })
            },
        )
    }

    /// As the method of `subject` has them.
    ///
    /// # Errors
    /// One line: a model that the method does not have.
    pub fn shaded(subject: &Subject) -> Result<Lobes> {
        let fibre = subject.fibre.resolve();
        let theta_i = subject.theta_i;
        let method = MethodData::new(subject.fibre.model, Fibres::even(&fibre), &subject.render)?;
        if let (Integrator::Fast(model), Some(tables)) = (method.integrator, &method.twin) {
            let fast = Fast::new(&fibre, model, tables);
            let across = |phi: f64| values(fast.azimuthal(theta_i, phi, phi.cos()));
            let along = |theta_o| values(fast.longitudinal(theta_i, theta_o));
            return Ok(Self::sampled(subject, across, along));
        }
        let tables = tables::build();
        let energy = match subject.render.energies {
            Energies::Quadrature => Energy::Quadrature,
            Energies::Taylor => Energy::Taylor(&tables.absorption),
        };
        let clear = ClearEnergies::new(fibre.eta);
        let segments = subject.render.segments;
        let across = |phi: f64| values(xu::azimuthal(&fibre, energy, theta_i, phi, phi.cos()));
        let along = |theta_o| {
            values(xu::longitudinal(&fibre, segments, energy, &clear, [theta_i, theta_o]))
        };
        Ok(Self::sampled(subject, across, along))
    }

    fn sampled(
        subject: &Subject,
        across: impl Fn(f64) -> [[f64; 3]; 4] + Sync,
        along: impl Fn(f64) -> [[f64; 3]; 4] + Sync,
    ) -> Lobes {
        let fibre = subject.fibre.resolve();
        let step = |k: usize, of: usize| PI * k as f64 / (of - 1) as f64;
        let mut thetas: Vec<f64> = (0..ALONG).map(|k| step(k, ALONG) - FRAC_PI_2).collect();
        for (alpha, beta) in fibre.alpha.into_iter().zip(fibre.beta) {
            let reach = 2.5 * longitudinal_bandwidth(beta) / f64::from(ABOUT);
            let about =
                (-ABOUT..=ABOUT).map(|k| 2.0 * alpha - subject.theta_i + f64::from(k) * reach);
            thetas.extend(about.filter(|theta| theta.abs() < FRAC_PI_2));
        }
        thetas.sort_by(f64::total_cmp);
        let bright = |rgb: [f64; 3]| f64::from(luminance(rgb.map(|x| x as f32)));
        Lobes {
            across: (0..ACROSS)
                .into_par_iter()
                .map(|k| step(k, ACROSS))
                .map(|phi| (phi, across(phi).map(bright)))
                .collect(),
            along: thetas.into_par_iter().map(|theta| (theta, along(theta).map(bright))).collect(),
        }
    }

    /// The greatest sum of lobes, across and along.
    pub fn most(&self) -> [f64; 2] {
        let sum = |(_, values): &(f64, Values)| values.iter().sum();
        [&self.across, &self.along].map(|curve| curve.iter().map(sum).fold(0.0, f64::max))
    }

    /// ‖this − `exact`‖₂/‖`exact`‖₂ of each lobe over φ or over θ_o, whichever is greater; none of what is too faint
    /// to be seen.
    pub fn apart(&self, exact: &Lobes) -> [Option<f64>; 4] {
        let seen: f64 = (0..4).map(|p| integral(&exact.along, |k| exact.along[k].1[p])).sum();
        std::array::from_fn(|p| {
            let own = integral(&exact.along, |k| exact.along[k].1[p]);
            let off = |curve: &Curve, exact: &Curve| {
                let difference = integral(exact, |k| (curve[k].1[p] - exact[k].1[p]).powi(2));
                let whole = integral(exact, |k| exact[k].1[p].powi(2));
                (difference / whole.max(f64::MIN_POSITIVE)).sqrt()
            };
            let off = || off(&self.across, &exact.across).max(off(&self.along, &exact.along));
            (own > VISIBLE * seen).then(off)
        })
    }
}

/// By the trapezoidal rule, of what step k has.
fn integral(curve: &Curve, of: impl Fn(usize) -> f64) -> f64 {
    let panel = |k: usize| 0.5 * (curve[k + 1].0 - curve[k].0) * (of(k) + of(k + 1));
    (0..curve.len().saturating_sub(1)).map(panel).sum()
}

fn values(modes: Modes) -> [[f64; 3]; 4] {
    [modes.r, modes.tt, modes.trt, modes.longer]
}
