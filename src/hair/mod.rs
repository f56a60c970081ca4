//! Strands: what a groom is, wherever it comes from.

use glam::Vec3;

/// Strands of hair, each a polyline from root to tip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hair {
    /// Points of all strands, strand after strand, root first.
    pub points: Vec<Vec3>,
    /// Strand `s` owns `points[offsets[s]..offsets[s + 1]]`; length: strands + 1, first 0.
    pub offsets: Vec<u32>,
    /// Thickness (a diameter, in the file's own unit) at each point, where the source has it.
    pub thickness: Option<Vec<f32>>,
    /// Colour at each point (0…1), where the source has it.
    pub color: Option<Vec<[f32; 3]>>,
    /// Transparency at each point (0…1), where the source has it.
    pub transparency: Option<Vec<f32>>,
}
