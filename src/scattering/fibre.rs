//! The parameters of one hair fibre (Xu 2011, Table 1; Marschner 2003).

/// A dielectric fibre with tilted scales. Arrays over modes are in the order R, TT, TRT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fibre {
    /// Index of refraction, 1 to 3.
    pub eta: f64,
    /// Absorption σ_a per fibre **radius**, linear RGB, 0 to 1e3.
    pub sigma_a: [f64; 3],
    /// Longitudinal shift α_t of each mode, radians of θ_h.
    pub alpha: [f64; 3],
    /// Longitudinal width β_t of each mode: the **standard deviation** of θ_h in radians, as in Marschner 2003.
    pub beta: [f64; 3],
    /// Azimuthal width of the TRT caustic: a **bandwidth** (√2 standard deviations), radians.
    pub w_c: f64,
    /// Eccentricity a of the cross section, 0.5 to 2; 1 is a circle.
    pub eccentricity: f64,
}

/// β of R, TT, TRT where those of TT and TRT follow R's (Marschner 2003, Table 1); any unit.
pub fn linked_beta(beta_r: f64) -> [f64; 3] {
    [beta_r, 0.5 * beta_r, 2.0 * beta_r]
}

/// The same of α.
pub fn linked_alpha(alpha_r: f64) -> [f64; 3] {
    [alpha_r, -0.5 * alpha_r, -1.5 * alpha_r]
}

/// Least and greatest β that is asked for, degrees; linked ones are held within.
pub const BETA_DEG: [f64; 2] = [0.05, 45.0];
