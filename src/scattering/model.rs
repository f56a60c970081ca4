//! The fibres that `fast` evaluates. Across the strand they share one table (`azimuth_table.rs`); along it each has
//! its own M, and its own inclination that A_t follows from. Twins: shaders/marschner.wgsl, shaders/deon.wgsl.
//!
//! d'Eon's is that of `reference::deon::Deon::conserving`: M_p of d'Eon et al. 2011, Eq 7, with v = (2β)², A_p and
//! Φ_p at θ_o, one azimuthal blur σ = w_c/√2 of every lobe, TRRT and then all longer paths over an even azimuth, both
//! with TRT's β and no shift. Whatever its β and α, a clear fibre returns all light, so nothing is made up for.

use std::f64::consts::SQRT_2;

use super::{
    azimuth_table::{Mode, deficit, wrapped_deficit},
    fibre::Fibre,
    gaussian::{concentration, i0e},
    longitudinal::{longitudinal, longitudinal_bandwidth, projection},
    nodes::{Lobe, Taper, over_the_pole},
};

/// A fibre of real time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Marschner 2003: R, TT, TRT.
    Marschner,
    /// d'Eon et al. 2011: R, TT, TRT, TRRT and the rest.
    Deon,
}

impl Model {
    /// What the nodes over θ_i lean by.
    pub fn taper(self) -> Taper {
        match self {
            Self::Marschner => Taper::MARSCHNER,
            Self::Deon => Taper::DEON,
        }
    }

    /// Nodes over θ_i that keep every mode within 1 % (relative L2, rms over settings: tests/fast.rs).
    pub fn nodes(self) -> u32 {
        match self {
            Self::Marschner => 2,
            Self::Deon => 3,
        }
    }

    /// Its modes; of the last the longer paths take the width.
    pub fn modes(self) -> &'static [Mode] {
        match self {
            Self::Marschner => &Mode::ALL[..3],
            Self::Deon => &Mode::ALL,
        }
    }

    /// 1−⟨cos⟩ of the fibre's own blur.
    pub fn blur(self, fibre: &Fibre) -> f64 {
        match self {
            Self::Marschner => deficit(concentration(fibre.w_c)),
            Self::Deon => wrapped_deficit(fibre.w_c / SQRT_2),
        }
    }

    /// That of a mode.
    pub(super) fn blur_of(self, fibre: &Fibre, mode: Mode) -> f64 {
        if self == Self::Deon || mode == Mode::Trt { self.blur(fibre) } else { 0.0 }
    }

    /// Where the nodes lie under light of bandwidth `width` about θ_j.
    pub(super) fn lobe(
        self,
        fibre: &Fibre,
        mode: Mode,
        theta_o: f64,
        theta_j: f64,
        width: f64,
    ) -> Lobe {
        let (centre, lambda_m) = self.shape(fibre, mode, theta_o);
        let slope = self.taper().slope[mode as usize];
        Lobe::new(theta_o, theta_j, width, centre, lambda_m, slope)
    }

    /// M_t cos²θ_i/cos²θ_d, or d'Eon's M_p cosθ_i: 1/rad of θ_i.
    pub(super) fn longitudinal(self, fibre: &Fibre, mode: Mode, theta_i: f64, theta_o: f64) -> f64 {
        match self {
            Self::Marschner => {
                let t = mode as usize;
                longitudinal(theta_i, theta_o, fibre.alpha[t], fibre.beta[t])
                    * projection(theta_i, theta_o)
            }
            Self::Deon => {
                let (centre, lambda_m) = self.shape(fibre, mode, theta_o);
                von_mises(theta_i, centre, lambda_m) * theta_i.cos().max(0.0)
            }
        }
    }

    /// Cosine of the inclination that A_t and Φ_t follow from.
    pub(super) fn cos_path(self, theta_i: f64, theta_o: f64) -> f64 {
        match self {
            Self::Marschner => (0.5 * (theta_o - theta_i)).cos().max(0.0),
            Self::Deon => theta_o.cos().max(0.0),
        }
    }

    /// Centre and bandwidth of M over θ_i.
    pub(super) fn shape(self, fibre: &Fibre, mode: Mode, theta_o: f64) -> (f64, f64) {
        let t = mode as usize;
        let shift = fibre.alpha.get(t).map_or(0.0, |alpha| 2.0 * alpha);
        let lambda_m = longitudinal_bandwidth(fibre.beta[t.min(2)]);
        match self {
            Self::Marschner => (shift - theta_o, lambda_m),
            Self::Deon => (over_the_pole(shift - theta_o), lambda_m),
        }
    }
}

/// M_p of d'Eon et al. 2011, Eq 7, about `centre` with v = λ²/2: its integral with cosθ is 1 over θ_i, and over the
/// centre. Light that is even over the sphere stays even.
pub fn von_mises(theta_i: f64, centre: f64, lambda: f64) -> f64 {
    let v = 0.5 * lambda * lambda;
    let apart = 2.0 * (0.5 * (theta_i - centre)).sin().powi(2);
    i0e((theta_i.cos() * centre.cos()).max(0.0) / v) * (-apart / v).exp()
        / -(v * (-2.0 / v).exp_m1())
}
