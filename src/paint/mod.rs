//! Paint: fibre parameters at strand points, in place of the scene's.
//!
//! - [`Paint`]: what was painted, and how thickly; each [`Channel`] is one thing to paint. It is kept in a file of
//!   its own (`file.rs`) beside the scene.
//! - [`Fibres`]: paint over the scene's fibre, ready to be shaded: renderer, field and path tracer ask it alone.
//!
//! Absorption is painted, mixed and interpolated as √σ_a, to which the logarithm of an assembly's colour is proportional
//! ([`crate::scene::assembly_color`]), so that a half is halfway to the eye. A painted width or tilt is that of R; TT and
//! TRT follow it where the scene links them to R.

mod cluster;
mod file;

pub use cluster::cluster;
pub use file::MAGIC;

use bytemuck::{Pod, Zeroable};
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use crate::hair::Hair;
use crate::scattering::azimuthal::eccentric_eta;
use crate::scattering::fibre::{BETA_DEG, Fibre, linked_alpha, linked_beta};
use crate::scene::{FibreSpec, Pigment, srgb_to_linear};

/// One thing to paint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Channel {
    /// √σ_a per radius, linear RGB.
    Absorption,
    /// β_R, degrees.
    Roughness,
    /// α_R, degrees.
    Tilt,
    /// η.
    Eta,
    /// Ratio of the cross section's axes.
    Eccentricity,
    /// Of the fibre, as a factor of its diameter: geometry, not the fibre's scattering.
    Thickness,
}

impl Channel {
    pub const ALL: [Self; 6] = [
        Self::Absorption,
        Self::Roughness,
        Self::Tilt,
        Self::Eta,
        Self::Eccentricity,
        Self::Thickness,
    ];

    /// What it is called by those who paint.
    pub fn name(self) -> &'static str {
        ["colour", "roughness", "tilt", "index of refraction", "eccentricity", "thickness"]
            [self as usize]
    }

    /// What a fibre has of it; of a channel of one number the others are 0.
    pub fn of(self, fibre: &Fibre) -> [f32; 3] {
        let one = |x: f64| [x as f32, 0.0, 0.0];
        match self {
            Self::Absorption => fibre.sigma_a.map(|s| s.sqrt() as f32),
            Self::Roughness => one(fibre.beta[0].to_degrees()),
            Self::Tilt => one(fibre.alpha[0].to_degrees()),
            Self::Eta => one(fibre.eta),
            Self::Eccentricity => one(fibre.eccentricity),
            Self::Thickness => one(1.0),
        }
    }

    /// Numbers of a value.
    pub const fn width(self) -> usize {
        match self {
            Self::Absorption => 3,
            _ => 1,
        }
    }

    /// Place of its first number in a [`PointFibre`]; None where it is no part of one.
    const fn first(self) -> Option<usize> {
        [Some(0), Some(3), Some(4), Some(5), Some(6), None][self as usize]
    }

    /// Least and greatest value.
    pub fn range(self) -> [f32; 2] {
        match self {
            // σ_a to 1000.
            Self::Absorption => [0.0, 31.622_776],
            Self::Roughness => [0.05, 45.0],
            Self::Tilt => [-20.0, 20.0],
            Self::Eta => [1.0, 3.0],
            Self::Eccentricity => [0.5, 2.0],
            Self::Thickness => [0.1, 5.0],
        }
    }
}

/// What is painted of one channel at every point.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    channel: Channel,
    /// Of each point its value, then its weight: 0 is bare, 1 covers the scene's own.
    texels: Vec<f16>,
}

impl Layer {
    /// Nothing painted yet.
    pub fn new(channel: Channel, points: usize) -> Self {
        Self { channel, texels: vec![f16::ZERO; points * (channel.width() + 1)] }
    }

    pub fn channel(&self) -> Channel {
        self.channel
    }

    /// How many points it is of.
    pub fn points(&self) -> usize {
        self.texels.len() / (self.channel.width() + 1)
    }

    /// Value and weight at a point; of a channel of one number the others are 0.
    pub fn at(&self, point: usize) -> ([f32; 3], f32) {
        let width = self.channel.width();
        let texel = &self.texels[point * (width + 1)..][..=width];
        let value = std::array::from_fn(|k| if k < width { texel[k].to_f32() } else { 0.0 });
        (value, texel[width].to_f32())
    }

    /// What shows at a point: the value over `bare`, by its weight.
    pub fn over(&self, point: usize, bare: [f32; 3]) -> [f32; 3] {
        let (value, weight) = self.at(point);
        [0, 1, 2].map(|k| bare[k] + weight * (value[k] - bare[k]))
    }

    /// What shows between points: see [`crate::hair::Refined::places`].
    pub fn between(&self, places: &[(u32, f32)]) -> Layer {
        let mut layer = Layer::new(self.channel, places.len());
        for (point, &(first, s)) in places.iter().enumerate() {
            if s == 0.0 {
                layer.set_texel(point, self.texel(first as usize));
                continue;
            }
            let (a, b) = (self.at(first as usize), self.at(first as usize + 1));
            let (of_a, of_b) = ((1.0 - s) * a.1, s * b.1);
            let weight = of_a + of_b;
            if weight > 0.0 {
                layer.set(
                    point,
                    [0, 1, 2].map(|k| (of_a * a.0[k] + of_b * b.0[k]) / weight),
                    weight,
                );
            }
        }
        layer
    }

    /// Values and weights of a block of [`BLOCK`] points, or of those that are left.
    fn block(&self, block: usize) -> &[f16] {
        let row = self.channel.width() + 1;
        let first = row * block * BLOCK;
        &self.texels[first..(first + row * BLOCK).min(self.texels.len())]
    }

    /// Value and weight of a point as they are kept.
    pub fn texel(&self, point: usize) -> [f16; 4] {
        let width = self.channel.width();
        let texel = &self.texels[point * (width + 1)..][..=width];
        std::array::from_fn(|k| match k {
            3 => texel[width],
            k if k < width => texel[k],
            _ => f16::ZERO,
        })
    }

    /// The inverse of [`Self::texel`].
    pub fn set_texel(&mut self, point: usize, kept: [f16; 4]) {
        let width = self.channel.width();
        let texel = &mut self.texels[point * (width + 1)..][..=width];
        texel[..width].copy_from_slice(&kept[..width]);
        texel[width] = kept[3];
    }

    /// Sets value (held within the channel's range) and weight (within 0 … 1) at a point.
    pub fn set(&mut self, point: usize, value: [f32; 3], weight: f32) {
        let width = self.channel.width();
        let [least, most] = self.channel.range();
        let texel = &mut self.texels[point * (width + 1)..][..=width];
        let weight = f16::from_f32(weight.clamp(0.0, 1.0));
        if weight == f16::ZERO {
            // What is bare has no value of its own.
            return texel.fill(f16::ZERO);
        }
        for (stored, value) in texel.iter_mut().zip(value).take(width) {
            *stored = f16::from_f32(value.clamp(least, most));
        }
        texel[width] = weight;
    }
}

/// What is painted on a groom.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Paint {
    points: usize,
    /// Those that something is painted in, in the order of [`Channel::ALL`].
    layers: Vec<Layer>,
}

impl Paint {
    /// Bare hair of so many points.
    pub fn bare(points: usize) -> Self {
        Self { points, layers: Vec::new() }
    }

    /// The colours that a groom's file has for its points, taken as sRGB of the hair as a whole; None without.
    pub fn of_colors(hair: &Hair) -> Option<Self> {
        let colors = hair.color.as_ref()?;
        let mut paint = Self::bare(hair.points.len());
        let layer = paint.layer_mut(Channel::Absorption);
        for (point, color) in colors.iter().enumerate() {
            let [least, most] = [0.001, 0.999];
            let linear = color.map(|c| srgb_to_linear(f64::from(c)).clamp(least, most));
            let sigma_a = Pigment::Color(linear).sigma_a();
            layer.set(point, sigma_a.map(|s| s.sqrt() as f32), 1.0);
        }
        Some(paint)
    }

    pub fn points(&self) -> usize {
        self.points
    }

    /// What shows between points: see [`crate::hair::Refined::places`].
    pub fn between(&self, places: &[(u32, f32)]) -> Paint {
        let layers = self.layers.iter().map(|layer| layer.between(places)).collect();
        Paint { points: places.len(), layers }
    }

    /// Lets go of layers that cover no point.
    pub fn forget_bare(&mut self) {
        self.layers.retain(|layer| {
            let row = layer.channel.width() + 1;
            layer.texels.chunks_exact(row).any(|texel| texel[row - 1] != f16::ZERO)
        });
    }

    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    pub fn layer(&self, channel: Channel) -> Option<&Layer> {
        self.layers.iter().find(|layer| layer.channel == channel)
    }

    /// The channel's layer, added where it is not there.
    pub fn layer_mut(&mut self, channel: Channel) -> &mut Layer {
        let at = self.layers.partition_point(|layer| layer.channel < channel);
        if self.layers.get(at).is_none_or(|layer| layer.channel != channel) {
            self.layers.insert(at, Layer::new(channel, self.points));
        }
        &mut self.layers[at]
    }
}

/// √σ_a, β_R, α_R in degrees, η, eccentricity.
pub type Numbers = [f32; 7];

/// The fibre at a strand point: [`Numbers`] as shaders/fibre.wgsl unpacks them, and a place that is free.
#[repr(transparent)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PointFibre([f16; 8]);

impl PointFibre {
    fn values(self) -> [f64; 8] {
        self.0.map(f16::to_f64)
    }

    /// Between two points, `f` of the way.
    pub fn mix(self, other: Self, f: f32) -> Self {
        let (a, b) = (self.values(), other.values());
        Self(std::array::from_fn(|k| f16::from_f64(a[k] + f64::from(f) * (b[k] - a[k]))))
    }

    pub fn to_f32(self) -> Numbers {
        std::array::from_fn(|k| self.0[k].to_f32())
    }

    /// The inverse of [`Self::to_f32`].
    pub fn from_f32(values: Numbers) -> Self {
        Self(std::array::from_fn(|k| f16::from_f32(values.get(k).copied().unwrap_or(0.0))))
    }
}

/// The scene's fibre, and what is painted over it.
#[derive(Clone, Debug)]
pub struct Fibres {
    base: Fibre,
    /// Whether β_TT, β_TRT, α_TT and α_TRT follow R's.
    links: [bool; 4],
    points: Vec<PointFibre>,
}

impl Fibres {
    /// One fibre for the whole groom.
    pub fn even(base: &Fibre) -> Self {
        Self { base: *base, links: [true; 4], points: Vec::new() }
    }

    /// The scene's fibre under paint, if there is any.
    pub fn new(spec: &FibreSpec, paint: Option<&Paint>) -> Self {
        let mut fibres = Self { links: spec.links(), ..Self::even(&spec.resolve()) };
        if let Some(paint) = paint {
            fibres.repaint(paint);
        }
        fibres
    }

    /// Puts paint over the scene's own at every point.
    pub fn repaint(&mut self, paint: &Paint) {
        let scatters = |layer: &Layer| layer.channel.first().is_some();
        let points = if paint.layers.iter().any(scatters) { paint.points } else { 0 };
        self.points = vec![PointFibre::zeroed(); points];
        let blocks = self.points.par_chunks_mut(BLOCK).enumerate();
        blocks.for_each(|(block, points)| under_paint(&self.base, paint, block, points));
    }

    /// The same fibres under `paint` in place of `before`: only where these differ anything is made anew.
    pub fn repainted(&self, before: &Paint, paint: &Paint) -> Self {
        let channels =
            |paint: &Paint| -> Vec<_> { paint.layers.iter().map(|layer| layer.channel).collect() };
        let mut fibres = self.clone();
        let alike = channels(before) == channels(paint) && before.points == paint.points;
        if !alike || self.points.len() != paint.points {
            fibres.repaint(paint);
            return fibres;
        }
        fibres.points.par_chunks_mut(BLOCK).enumerate().for_each(|(block, points)| {
            let mut layers = before.layers.iter().zip(&paint.layers);
            if layers.any(|(a, b)| a.block(block) != b.block(block)) {
                under_paint(&self.base, paint, block, points);
            }
        });
        fibres
    }

    /// The scene's own.
    pub fn base(&self) -> &Fibre {
        &self.base
    }

    /// One a point; empty where nothing is painted.
    pub fn points(&self) -> &[PointFibre] {
        &self.points
    }

    pub fn painted(&self) -> bool {
        !self.points.is_empty()
    }

    /// Bits for the shader: what follows R's β and α.
    pub fn linked(&self) -> u32 {
        (0..).zip(self.links).map(|(bit, linked)| u32::from(linked) << bit).sum()
    }

    /// What `point` says, on the scene's own fibre.
    pub fn fibre(&self, point: PointFibre) -> Fibre {
        let [r, g, b, beta_r, alpha_r, eta, eccentricity, _] = point.values();
        let [least, most] = BETA_DEG;
        let beta = linked_beta(beta_r).map(|beta| beta.clamp(least, most).to_radians());
        let alpha = linked_alpha(alpha_r).map(f64::to_radians);
        let Self { base, links: [beta_tt, beta_trt, alpha_tt, alpha_trt], .. } = *self;
        let either = |follows: [bool; 3], linked: [f64; 3], own: [f64; 3]| {
            std::array::from_fn(|t| if follows[t] { linked[t] } else { own[t] })
        };
        Fibre {
            sigma_a: [r, g, b].map(|root| root * root),
            eta,
            eccentricity,
            alpha: either([true, alpha_tt, alpha_trt], alpha, base.alpha),
            beta: either([true, beta_tt, beta_trt], beta, base.beta),
            ..base
        }
    }

    /// Least and greatest η* (Xu 2011, Eq 24) of all fibres, their own η included.
    pub fn eta_range(&self) -> [f64; 2] {
        let of = |eta: f64, eccentricity: f64| {
            let (mean, half) = eccentric_eta(eta, eccentricity);
            [eta.min(mean - half.abs()), eta.max(mean + half.abs())]
        };
        let wider = |[low, high]: [f64; 2], [l, h]: [f64; 2]| [low.min(l), high.max(h)];
        let own = of(self.base.eta, self.base.eccentricity);
        let points = self.points.par_iter();
        points.map(|point| of(point.0[5].to_f64(), point.0[6].to_f64())).reduce(|| own, wider)
    }

    /// Fibres that stand for all, each as often as it is there: the scene's own, or those of some points.
    pub fn sample(&self, most: usize) -> Vec<Fibre> {
        if self.points.is_empty() {
            return vec![self.base];
        }
        let step = self.points.len().div_ceil(most.max(1)).max(1);
        self.points.iter().step_by(step).map(|&point| self.fibre(point)).collect()
    }
}

/// Points that paint is put on at once.
const BLOCK: usize = 256;

/// Fills a block of points with `base` under paint.
fn under_paint(base: &Fibre, paint: &Paint, block: usize, points: &mut [PointFibre]) {
    let mut own = Numbers::default();
    for channel in Channel::ALL {
        if let Some(first) = channel.first() {
            own[first..][..channel.width()].copy_from_slice(&channel.of(base)[..channel.width()]);
        }
    }
    points.fill(PointFibre::from_f32(own));
    let (mut values, mut kept) = ([0.0; 4 * BLOCK], [f16::ZERO; 4 * BLOCK]);
    for layer in &paint.layers {
        let Some(first) = layer.channel.first() else { continue };
        let (width, texels) = (layer.channel.width(), layer.block(block));
        let (values, kept) = (&mut values[..texels.len()], &mut kept[..texels.len()]);
        texels.convert_to_f32_slice(values);
        for texel in values.chunks_exact_mut(width + 1) {
            let weight = texel[width];
            for (value, own) in texel.iter_mut().zip(&own[first..][..width]) {
                *value = own + weight * (*value - own);
            }
        }
        kept.convert_from_f32_slice(values);
        for (fibre, shown) in points.iter_mut().zip(kept.chunks_exact(width + 1)) {
            fibre.0[first..][..width].copy_from_slice(&shown[..width]);
        }
    }
}
