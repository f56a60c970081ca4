//! One binary, a module per room: it links once.

mod cli;
mod environment;
mod frames;
mod groom;
mod hair;
mod scattering;
mod scene;
mod srbf;
mod transport;
mod wgsl;
