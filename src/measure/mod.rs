//! Judging: error metrics between frames, and plots of what was measured.

pub mod compare;
pub mod figures;
pub mod plot;
pub mod read;
