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
    /// What the light of R, TT and TRT is multiplied by, linear RGB, 0 to 4; longer paths take TRT's (Sadeghi et al.
    /// 2010, "An artist friendly hair shading system"). A physical fibre has 1.
    pub tint: [[f64; 3]; 3],
}

impl Fibre {
    pub const UNTINTED: [[f64; 3]; 3] = [[1.0; 3]; 3];

    /// Tints of R, TT, TRT and all longer paths.
    pub fn tints(&self) -> [[f64; 3]; 4] {
        let [r, tt, trt] = self.tint;
        [r, tt, trt, trt]
    }

    /// The fibre as other strands see it: no tint above 1, for else hair would make light.
    pub fn passed_on(&self) -> Self {
        Self { tint: self.tint.map(|rgb| rgb.map(|t| t.min(1.0))), ..*self }
    }
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
