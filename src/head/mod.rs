//! The head: triangles that block light, hide hair, and are lit softly.

pub mod builtin;
mod obj;
mod rays;
mod up;

use glam::Vec3;

pub use obj::{LoadedHead, load};
pub use rays::HeadRays;
pub use up::{Up, check_scale};

/// A triangle mesh with one unit normal a vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Head {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}
