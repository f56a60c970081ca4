//! What a fibre model is: lobes p = 0 (R), 1 (TT), 2 (TRT), …, each by a longitudinal part M_p, an
//! attenuation A_p(h), an exit azimuth Φ_p(h) and a detector D_p that blurs it:
//!
//! > S·cosθ_i = Σ_p M_p(θ_i; θ_o) · N_p(φ),  N_p(φ) = ½∫_{−1}^{1} A_p(h) D_p(φ − Φ_p(h)) dh
//!
//! (d'Eon 2011 Eq 2 and 10, Xu 2011 Eq 6–10, pbrt-v4 §9.9 before its h is averaged). Azimuths here are
//! φ = φ_i − φ_o and h = sin(φ_o − φ_n) ∈ [−1, 1], φ_n the azimuth of the surface's normal where the viewing
//! ray meets it, so that light reflected there has φ = −2 asin h. The viewing direction ω_o is fixed and ω_i
//! varies. Results are RGB, per steradian of ω_i, cosθ_i included: the integral over ω_i is the albedo.

use glam::DVec3;

use crate::scattering::azimuthal::wrap;

/// A unit direction in the fibre's frame, (sin θ, cos θ cos φ, cos θ sin φ) with the strand along x, root to
/// tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Of the inclination θ to the normal plane.
    pub sin_theta: f64,
    /// ≥ 0.
    pub cos_theta: f64,
    /// Azimuth, radians in [−π, π].
    pub phi: f64,
}

impl Direction {
    pub fn new(theta: f64, phi: f64) -> Self {
        let (sin_theta, cos_theta) = theta.sin_cos();
        Self { sin_theta, cos_theta: cos_theta.max(0.0), phi }
    }

    /// Of a unit vector; along the fibre φ is 0.
    pub fn of(vector: DVec3) -> Self {
        let cos_theta = vector.y.hypot(vector.z);
        Self { sin_theta: vector.x.clamp(-1.0, 1.0), cos_theta, phi: vector.z.atan2(vector.y) }
    }

    /// θ, radians in [−π/2, π/2].
    pub fn theta(&self) -> f64 {
        self.sin_theta.atan2(self.cos_theta)
    }

    pub fn vector(&self) -> DVec3 {
        let (sin_phi, cos_phi) = self.phi.sin_cos();
        DVec3::new(self.sin_theta, self.cos_theta * cos_phi, self.cos_theta * sin_phi)
    }
}

/// What the path through the cross section depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    pub theta_i: f64,
    pub theta_o: f64,
    /// (φ_i+φ_o)/2 from the ellipse's axis at which η* = η₁* (Xu 2011, Eq 24); round fibres ignore it.
    pub phi_h: f64,
}

/// Light that enters or leaves at offset h, after p−1 reflections inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Path {
    /// A_p(h), RGB in [0, 1].
    pub attenuation: [f64; 3],
    /// Φ_p(h), radians, not wrapped.
    pub azimuth: f64,
}

/// D_p: a density over the circle, of unit integral, by which a lobe's azimuth is blurred.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Detector {
    /// No blur.
    Delta,
    /// exp(κ(cos x − 1)) / 2π I₀e(κ): Xu's circular Gaussian of bandwidth λ, κ = 2/λ².
    Circular { kappa: f64 },
    /// A Gaussian of this standard deviation (radians) wrapped round the circle (d'Eon 2011, Eq 9).
    Wrapped { sigma: f64 },
    /// The logistic density of scale s, cut off at ±π and scaled to unit integral (pbrt-v4 §9.9.5).
    Logistic { scale: f64 },
    /// 1/2π.
    Uniform,
}

/// The value of a model for two directions and its sampling's density there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// S·cosθ_i, RGB, 1/sr.
    pub f_cos: [f64; 3],
    /// Density of [`FibreModel::sample`] at ω_i for the same ω_o and h, 1/sr; without the parts of a model
    /// that are deltas.
    pub pdf: f64,
}

/// A direction drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    pub direction: Direction,
    /// At that direction: f_cos/pdf is what a path is multiplied by.
    pub value: Evaluation,
}

/// A fibre that scatters light.
///
/// `evaluate` and `sample` are conditional on h. A near-field model (Chiang) takes the h at which the ray
/// met the fibre; a far-field one (Marschner, d'Eon) is the **mean over h** uniform in [−1, 1], so a path
/// tracer draws h and a far-field value needs [`Self::azimuthal`].
pub trait FibreModel: Send + Sync {
    /// Number of lobes: R, TT, TRT and what more the model has.
    fn lobes(&self) -> usize;

    /// M_p(θ_i; θ_o), cosθ_i and any 1/cos²θ_d included: S_p cosθ_i = M_p N_p. Times cosθ_i it is a density
    /// over θ_i.
    fn longitudinal(&self, p: usize, theta_i: f64, theta_o: f64) -> f64;

    /// A_p and Φ_p at h.
    fn path(&self, p: usize, h: f64, section: &Section) -> Path;

    fn detector(&self, p: usize) -> Detector;

    /// N_p(φ), RGB per radian: the far-field value of one lobe.
    fn azimuthal(&self, p: usize, phi: f64, section: &Section) -> [f64; 3];

    /// a_k of N_p(φ) = Σ_k a_k cos kφ, RGB, to 1e-13 of the lobe's energy: of a lobe whose N_p is the same at every
    /// θ_i and smooth enough.
    fn series(&self, _p: usize, _theta_o: f64) -> Option<Vec<[f64; 3]>> {
        None
    }

    /// S·cosθ_i and the sampling density, for a ray that meets the fibre at h.
    fn evaluate(&self, o: &Direction, i: &Direction, h: f64) -> Evaluation;

    /// Draws ω_i from four uniform numbers in [0, 1); None where the draw carries no light.
    fn sample(&self, o: &Direction, h: f64, u: [f64; 4]) -> Option<Sample>;

    /// Whether the h of [`Self::evaluate`] is the ray's own rather than a number to be drawn.
    fn near_field(&self) -> bool;

    /// Far-field S·cosθ_i of all lobes.
    fn f_cos(&self, o: &Direction, i: &Direction) -> [f64; 3] {
        let section =
            Section { theta_i: i.theta(), theta_o: o.theta(), phi_h: 0.5 * (i.phi + o.phi) };
        (0..self.lobes()).fold([0.0; 3], |sum, p| {
            let m = self.longitudinal(p, i.theta(), o.theta());
            let n = self.azimuthal(p, wrap(i.phi - o.phi), &section);
            std::array::from_fn(|c| sum[c] + m * n[c])
        })
    }
}
