//! Hairlight: real-time hair under environment lighting, after Xu et al. 2011,
//! with its error against the exact quantity beside it.
//!
//! World: right-handed, y up. The rooms and the way of the data are in ARCHITECTURE.md.

mod bvh;
pub mod capture;
pub mod cli;
pub mod editor;
pub mod environment;
pub mod field;
pub mod file;
pub mod file_kind;
pub mod gpu;
pub mod hair;
pub mod head;
pub mod image;
pub mod lamp;
pub mod light;
pub mod live;
pub mod measure;
pub mod openexr;
pub mod paint;
pub mod probe;
pub mod progress;
pub mod quality;
pub mod reference;
pub mod scattering;
pub mod scene;
pub mod srbf;
pub mod stage;
pub mod stats;
pub mod transport;
