//! Ground truth: fibre models without approximation, their integrals by adaptive quadrature, and a path
//! tracer over the real strands. f64 where it is maths, f32 where it is rays.
//!
//! Every model is a sum of lobes (`model`), each the product of a longitudinal part and the mean over the
//! fibre's width of an azimuthal one. What the exact integrals need and what the path tracer needs both
//! follow from that one description.

pub mod model;
