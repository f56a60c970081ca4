//! Ground truth: fibre models without approximation, their integrals by adaptive quadrature, and a path
//! tracer over the real strands. f64 where it is maths, f32 where it is rays.
//!
//! Every model is a sum of lobes (`model`), each the product of a longitudinal part and the mean over the
//! fibre's width of an azimuthal one. What the exact integrals need and what the path tracer needs both
//! follow from that one description.

pub mod adaptive;
pub mod averages;
pub mod chiang;
pub mod deon;
pub mod detector;
pub mod hery;
pub mod integral;
pub mod longitudinal;
pub mod marschner;
pub mod model;
pub mod render;
pub mod tracer;
pub mod transmittance;

use std::f64::consts::SQRT_2;

use crate::scene::{Bcsdf, FibreSpec};
use chiang::Chiang;
use deon::Deon;
use marschner::Marschner;
use model::FibreModel;

/// Lobes of d'Eon's model by themselves: R, TT, TRT, TRRT; the rest are one.
pub const DEON_LOBES: usize = 4;

/// The model of a scene's fibre.
pub fn model_of(spec: &FibreSpec) -> Box<dyn FibreModel> {
    let fibre = spec.resolve();
    match spec.model {
        Bcsdf::Marschner => Box::new(Marschner::compensated(&fibre)),
        // The published form loses or makes up to 15 % where β and α differ from lobe to lobe.
        Bcsdf::Deon => Box::new(Deon::conserving(&fibre, fibre.w_c / SQRT_2, DEON_LOBES)),
        Bcsdf::Chiang => {
            let (beta_m, beta_n) = Chiang::matching(&fibre);
            let own = spec.chiang;
            Box::new(Chiang::new(
                own.beta_m.unwrap_or(beta_m),
                own.beta_n.unwrap_or(beta_n),
                own.alpha_deg.map_or(fibre.alpha[0], f64::to_radians),
                fibre.eta,
                fibre.sigma_a,
            ))
        }
    }
}
