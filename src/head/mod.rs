//! The head: triangles that block light, hide hair, and are lit softly.

pub mod builtin;
mod detail;
mod obj;
mod orient;
mod place;
mod rays;
mod refine;
mod smooth;
mod up;

use glam::Vec3;

pub use detail::{Detail, DetailPoint};
pub use obj::{LoadedHead, load};
pub use place::{Fit, Placement, Surface, Wanted, fit_builtin};
pub use rays::HeadRays;
pub use refine::FineHead;
pub use smooth::SurfacePlace;
pub use up::{Up, check_scale};

/// Diffuse reflectance of a head of which nothing else is said, linear RGB: warm clay.
pub const CLAY: [f32; 3] = [0.42, 0.36, 0.32];

/// A triangle mesh with one unit normal a vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Head {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}
