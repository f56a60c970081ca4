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

use crate::paint::{self, Fibres, PointFibre};
use crate::scattering::{azimuthal::ClearRange, fibre::Fibre};
use crate::scene::{Bcsdf, FibreSpec};
use chiang::Chiang;
use deon::Deon;
use marschner::Marschner;
use model::FibreModel;

/// Lobes of d'Eon's model by themselves: R, TT, TRT, TRRT; the rest are one.
pub const DEON_LOBES: usize = 4;

/// The models of a groom's fibres.
pub struct Models<'a> {
    /// Of the scene's own.
    base: ModelThere<'a>,
    /// The same of what goes on to other strands, where that is another.
    passed_on: Option<ModelThere<'a>>,
    painted: Option<Painted<'a>>,
}

/// What models of painted fibres are made by.
struct Painted<'a> {
    spec: &'a FibreSpec,
    fibres: &'a Fibres,
    /// Of Marschner's: what fibres like these draw samples by, and energies of all their η.
    marschner: Option<(Vec<Marschner>, ClearRange)>,
}

/// A model at one place.
pub enum ModelThere<'a> {
    Lent(&'a dyn FibreModel),
    Own(Box<dyn FibreModel>),
}

impl ModelThere<'_> {
    pub fn model(&self) -> &dyn FibreModel {
        match self {
            Self::Lent(model) => *model,
            Self::Own(model) => &**model,
        }
    }
}

impl<'a> Models<'a> {
    /// One for all hair.
    pub fn even(model: &'a dyn FibreModel) -> Self {
        Self { base: ModelThere::Lent(model), passed_on: None, painted: None }
    }

    /// Of the scene's fibre as `spec` has it, and of what is painted in `fibres`.
    pub fn new(spec: &'a FibreSpec, fibres: &'a Fibres) -> Self {
        /// Points by which those that samples are drawn by are found, and their number.
        const JUDGED: usize = 4096;
        const DRAWN: usize = 8;
        let marschner = || {
            let step = fibres.points().len().div_ceil(JUDGED);
            let some: Vec<_> = fibres.points().iter().step_by(step).map(|p| p.to_f32()).collect();
            let (usual, _) = paint::cluster(&some, DRAWN);
            let fibre = |&numbers| fibres.fibre(PointFibre::from_f32(numbers));
            let models =
                usual.iter().map(|numbers| Marschner::compensated(&fibre(numbers).passed_on()));
            (models.collect(), ClearRange::new(fibres.eta_range()))
        };
        let painted = fibres.painted().then(|| Painted {
            spec,
            fibres,
            marschner: (spec.model == Bcsdf::Marschner).then(marschner),
        });
        let own = spec.resolve();
        let passed_on = own.passed_on();
        let passed_on = (passed_on != own).then(|| ModelThere::Own(model_for(spec, &passed_on)));
        Self { base: ModelThere::Own(model_for(spec, &own)), passed_on, painted }
    }

    /// Whether h is the ray's own.
    pub fn near_field(&self) -> bool {
        self.base.model().near_field()
    }

    /// `along` the way from strand point `point` to the next, to be seen from `theta_o` alone, by the eye or by what
    /// light goes on to.
    pub fn there(&self, point: u32, along: f32, theta_o: f64, by_eye: bool) -> ModelThere<'_> {
        let Some(Painted { spec, fibres, marschner }) = &self.painted else {
            let passed_on = self.passed_on.as_ref().filter(|_| !by_eye);
            return ModelThere::Lent(passed_on.unwrap_or(&self.base).model());
        };
        let [a, b] = [point, point + 1].map(|i| fibres.points()[i as usize]);
        let fibre = fibres.fibre(a.mix(b, along));
        let fibre = if by_eye { fibre } else { fibre.passed_on() };
        let nearest = marschner.as_ref().and_then(|(usual, clear)| {
            let away = |model: &&Marschner| apart(model.fibre(), &fibre);
            let nearest = usual.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
            nearest.map(|model| model.alike(&fibre, theta_o, clear))
        });
        ModelThere::Own(match nearest {
            Some(model) => Box::new(model),
            None => model_for(spec, &fibre),
        })
    }
}

/// How unlike the lobes of two fibres are.
fn apart(a: &Fibre, b: &Fibre) -> f64 {
    let colors = (0..3).map(|c| (a.sigma_a[c].sqrt() - b.sigma_a[c].sqrt()).powi(2));
    let lobes = (0..3)
        .map(|t| (a.beta[t].ln() - b.beta[t].ln()).powi(2) + (a.alpha[t] - b.alpha[t]).powi(2));
    colors.sum::<f64>() + lobes.sum::<f64>() + (a.eta - b.eta).powi(2)
}

/// The model of a scene's fibre.
pub fn model_of(spec: &FibreSpec) -> Box<dyn FibreModel> {
    model_for(spec, &spec.resolve())
}

/// The model of `spec` for another fibre than its own.
fn model_for(spec: &FibreSpec, fibre: &Fibre) -> Box<dyn FibreModel> {
    match spec.model {
        Bcsdf::Marschner => Box::new(Marschner::compensated(fibre)),
        // The published form loses or makes up to 15 % where β and α differ from lobe to lobe.
        Bcsdf::Deon => Box::new(Deon::conserving(fibre, fibre.w_c / SQRT_2, DEON_LOBES)),
        Bcsdf::Chiang => {
            let (beta_m, beta_n) = Chiang::matching(fibre);
            let own = spec.chiang;
            let bare = Chiang::new(
                own.beta_m.unwrap_or(beta_m),
                own.beta_n.unwrap_or(beta_n),
                own.alpha_deg.map_or(fibre.alpha[0], f64::to_radians),
                fibre.eta,
                fibre.sigma_a,
            );
            Box::new(bare.tinted(fibre))
        }
    }
}
