//! The environment: distant light as a lat-long map of linear RGB radiance.

/// A lat-long radiance map, row-major from the zenith down.
/// The centre column looks along −z: u = 0.5 + atan2(x, −z)/2π, v = arccos(y)/π.
#[derive(Clone, Debug)]
pub struct Environment {
    pub width: usize,
    pub height: usize,
    /// Linear RGB, finite and ≥ 0 once mended; length width · height.
    pub pixels: Vec<[f32; 3]>,
}
