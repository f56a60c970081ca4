//! Lamps: lights placed by hand around the hair, as a user states them.

use super::field::choice;

/// Lamps of a scene.
pub const LAMPS: usize = 4;

choice! {
    /// What a lamp is.
    LampKind {
        None = "none",
        /// A disc infinitely far away.
        Sun = "sun",
        /// Shines evenly from all of its surface.
        Sphere = "sphere",
        /// A square that faces the middle of the hair, and shines evenly to that side.
        Softbox = "softbox",
    }
}

/// A lamp. It stands in the world: the environment's rotation does not turn it, its exposure counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampSpec {
    pub kind: LampKind,
    /// Seen from the middle of the hair: degrees from +z (before the face) towards +x.
    pub azimuth_deg: f64,
    /// Degrees above the horizon.
    pub elevation_deg: f64,
    /// From the middle of the hair, in its radii; of no sun.
    pub distance: f64,
    /// Radius or half a side, in radii of the hair; of a sun the angular radius in degrees.
    pub size: f64,
    /// Linear RGB, 0 to 1.
    pub color: [f64; 3],
    /// What a surface in the middle of the hair that faces the lamp would receive with nothing between, for a colour of 1:
    /// radiance of the map × sr.
    pub irradiance: f64,
}

impl Default for LampSpec {
    /// None; as it comes to be, to the right before the face and above.
    fn default() -> Self {
        Self {
            kind: LampKind::None,
            azimuth_deg: 45.0,
            elevation_deg: 30.0,
            distance: 2.0,
            size: 0.25,
            color: [1.0; 3],
            irradiance: 1.0,
        }
    }
}
