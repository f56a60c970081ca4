//! The scattering maths in f64 (Xu 2011), without GPU or scene.
