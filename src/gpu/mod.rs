//! The GPU: device, uniforms, passes, read-back. The maths is in `scattering`, the files elsewhere.

pub mod device;
pub mod frame;
pub mod gather;
pub mod head_light;
pub mod method;
pub mod probe;
mod resources;
pub mod shaders;
pub mod sky_map;
mod timer;
pub mod transmittance;
pub mod uniforms;

pub use device::Gpu;
