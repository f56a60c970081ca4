//! What the shaders read from uniform buffers, and other layouts that they share with Rust. tests/wgsl.rs
//! holds them against the WGSL.

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3};

use crate::scattering::{
    azimuthal::FitLayers, fibre::Fibre, longitudinal::longitudinal_bandwidth, model::Model,
};

/// `Fibre` of shaders/fibre.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct FibreUniform {
    pub alpha: [f32; 3],
    pub eta: f32,
    pub lambda: [f32; 3],
    /// Bits: β_TT, β_TRT, α_TT, α_TRT follow R's where that is painted.
    pub linked: u32,
    pub sigma_a: [f32; 3],
    pub blur: f32,
    pub eta_star: [f32; 2],
    pub eta_low: f32,
    pub eta_per_layer: f32,
    pub eta_layers: u32,
    pub w_c: f32,
    _pad: [u32; 2],
    /// RGB of R, TT, TRT, each with a number that is not read.
    pub tint: [[f32; 4]; 3],
}

impl FibreUniform {
    /// One fibre alone.
    pub fn new(fibre: &Fibre, model: Model) -> Self {
        Self::over(fibre, &FitLayers::new(fibre), 0, model)
    }

    /// The same where other fibres within `layers` are there as well, which `linked` is for.
    pub fn over(fibre: &Fibre, layers: &FitLayers, linked: u32, model: Model) -> Self {
        Self {
            alpha: fibre.alpha.map(|a| a as f32),
            eta: fibre.eta as f32,
            lambda: fibre.beta.map(|b| longitudinal_bandwidth(b) as f32),
            linked,
            sigma_a: fibre.sigma_a.map(|s| s as f32),
            blur: model.blur(fibre) as f32,
            eta_star: [layers.mean as f32, layers.half as f32],
            eta_low: layers.low as f32,
            eta_per_layer: layers.per_eta() as f32,
            eta_layers: layers.count as u32,
            w_c: fibre.w_c as f32,
            _pad: [0; 2],
            tint: fibre.tint.map(|[r, g, b]| [r as f32, g as f32, b as f32, 0.0]),
        }
    }
}

/// `View` of shaders/view.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ViewUniform {
    pub clip_from_pos: Mat4,
    pub eye: Vec3,
    pub pieces: u32,
    pub right: Vec3,
    pub background: u32,
    pub up: Vec3,
    pub environment_rotation_rad: f32,
    pub forward: Vec3,
    pub environment_scale: f32,
    pub background_rgb: Vec3,
    pub share: f32,
    pub size: [u32; 2],
    pub grid: u32,
    pub widened: f32,
}

/// `Light` of shaders/strand_point.wgsl, which says what it holds of a lamp.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LightEntry {
    pub direction: Vec3,
    pub lambda: f32,
    pub rgb: Vec3,
    pub energy: f32,
    pub least: f32,
    pub side: [f32; 3],
    pub chance: f32,
    pub end: f32,
    pub pad: [f32; 2],
}

/// `FieldGrid` of shaders/strand_point.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct FieldGrid {
    pub origin: Vec3,
    pub cell: f32,
    pub dims: Vec3,
    pub scale: f32,
}

impl FieldGrid {
    /// Of no field.
    pub const NONE: FieldGrid =
        FieldGrid { origin: Vec3::ZERO, cell: 1.0, dims: Vec3::ONE, scale: 0.0 };
}

/// `Shading` of shaders/shade.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ShadingUniform {
    pub eye: Vec3,
    pub parts: u32,
    pub first_light: u32,
    pub lights: u32,
    pub slots: u32,
    pub first_ordinate: u32,
    pub grid: FieldGrid,
    pub lamps: u32,
    pub stride: u32,
    pub last_column: u32,
    pub gathered: u32,
}

/// `Tracing` of shaders/transmittance.wgsl, before its lights.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct TracingHead {
    pub blocks: u32,
    pub points: u32,
    pub stride: u32,
    pub lights: u32,
    pub lights_a_thread: u32,
    pub pad: u32,
    pub head: [u32; 2],
}

/// `Lighting` of shaders/head_light.wgsl, before its lights.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LightingHead {
    pub vertices: u32,
    pub lights: u32,
    pub lift: f32,
    pub spread: f32,
    pub head: [u32; 2],
    pub pad: [u32; 2],
}

/// `Path` of shaders/paths.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Path {
    /// Relative to the hair's centre.
    pub origin: Vec3,
    /// 0 of a slot without a ray.
    pub most: f32,
    pub direction: Vec3,
    pub clear: f32,
    pub weight: Vec3,
    /// Place among the paths that are followed together.
    pub id: u32,
    pub own: [u32; 2],
    pub draw: [u32; 2],
}

/// `HeadPlace` of shaders/gather.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct HeadPlace {
    /// Just above the head, relative to the hair's centre.
    pub position: Vec3,
    /// By which its paths' numbers differ from others'.
    pub seed: u32,
    pub normal: Vec3,
    pub pad: u32,
}

/// `Queue` of shaders/paths.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Queue {
    /// Of a dispatch with a thread for each.
    pub workgroups: [u32; 3],
    pub count: u32,
}

impl Queue {
    /// With `count` in it.
    pub fn of(count: u32) -> Queue {
        Queue { workgroups: [count.div_ceil(64), 1, 1], count }
    }
}

/// `Gather` of shaders/gather.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct GatherUniform {
    pub eye: Vec3,
    pub paths: u32,
    pub grid: FieldGrid,
    pub first: u32,
    pub count: u32,
    pub lights: u32,
    pub lamps: u32,
    pub first_ordinate: u32,
    pub ordinate_share: f32,
    pub parts: u32,
    pub event: u32,
    pub strands: u32,
    pub judged: u32,
    pub pad: [u32; 2],
}

/// `Cast` of shaders/cast.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CastUniform {
    /// Place of the first path that is cast, and how many are followed together.
    pub first: u32,
    pub all: u32,
    pub head: [u32; 2],
}

/// `GatherSum` of shaders/gather_sum.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct GatherSumUniform {
    pub first: u32,
    pub count: u32,
    pub paths: u32,
    pub pad: u32,
}

/// Byte offset of the list in `Needed` (shaders/mark.wgsl).
pub const NEEDED_LIST: u64 = 8;
