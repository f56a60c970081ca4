//! One binary, a module per room: it links once.

mod cli;
mod environment;
mod hair;
mod scattering;
mod scene;
mod srbf;
mod wgsl;
