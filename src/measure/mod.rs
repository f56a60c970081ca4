//! Judging: error metrics between frames, speed against error, and plots of what was measured.

pub mod bench;
pub mod compare;
pub mod figures;
pub mod plot;
pub mod read;
