//! One binary, a module per room: it links once.

mod azimuth_table;
mod bench;
mod chi_square;
mod cli;
mod environment;
mod fast;
mod field;
mod frames;
mod groom;
mod hair;
mod hard_cases;
mod measure;
mod nodes;
mod probe;
mod quality;
mod reference_cli;
mod reference_integral;
mod reference_marschner;
mod reference_models;
mod reference_tracer;
mod scattering;
mod scene;
mod srbf;
mod transport;
mod wgsl;
mod work;
