//! Settings.

use crate::gpu::frame::NEGLIGIBLE;
use crate::scene::Scene;
use crate::transport::Detail;

/// What error is bought with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Fitted to the map.
    pub lights: u32,
    /// Of coverage a pixel.
    pub samples: u32,
    /// Along the longest edge of the density volume.
    pub cells: usize,
    /// `Renderer::negligible`.
    pub negligible: f64,
}

impl Settings {
    /// Those of a scene that asks for no quality.
    pub fn of(scene: &Scene) -> Settings {
        let e=|n:&str,d:f64|std::env::var(n).ok().and_then(|v|v.parse().ok()).unwrap_or(d);
        Settings {
            lights: scene.environment.lights.unwrap_or(40),
            samples: scene.render.samples.unwrap_or(16),
            cells: e("CELLS",Detail::USUAL.cells as f64) as usize,
            negligible: e("NEG",NEGLIGIBLE),
        }
    }
}
