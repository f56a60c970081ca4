//! Spherical radial basis functions: the light that hair is lit by (Xu 2011, Eq 1).

use glam::DVec3;

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
