//! One frame: visibility → needed points → shading → resolve, pass by pass, and the background.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result, bail, ensure};
use bytemuck::Zeroable as _;
use glam::{DVec3, Mat4, Vec2, Vec3, Vec4};
use wgpu::util::DeviceExt as _;

use super::Gpu;
use super::gather::{Gather, GatherPipelines, GatherScene};
use super::head_light::{HeadRayCaster, HeadSurface, SeenHead};
use super::method::{Integrator, MethodData};
use super::resources::*;
use super::shaders::Shaders;
use super::sky_map::{SIDE, sky_texels};
use super::timer::PassTimer;
use super::transmittance::{PointTransmittance, Table, known_table};
use super::uniforms::{FieldGrid, LightEntry, NEEDED_LIST, ShadingUniform, ViewUniform};
use crate::environment::Environment;
use crate::field::Field;
use crate::hair::normals;
use crate::lamp::Lamp;
use crate::reference::transmittance::StrandRays;
use crate::scene::Lens;
use crate::srbf::{ORDINATES, SrbfLight, lobe_integral};
use crate::stage::Geometry;
use crate::transport::draws::{HeadLight, Rays, Words};

/// What stands behind the hair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    Environment,
    /// Linear RGB radiance.
    Color([f32; 3]),
    Transparent,
}

/// Which parts of the scattering to sum.
#[derive(Clone, Copy, Debug)]
pub struct Parts {
    pub single: bool,
    pub global: bool,
    pub local: bool,
}

/// Bits of [`Parts`] (shaders/fibre.wgsl).
const ALL_PARTS: u32 = 7;

impl Parts {
    fn bits(self) -> u32 {
        u32::from(self.single) | u32::from(self.global) << 1 | u32::from(self.local) << 2
    }

    /// Whether light is asked for that more than one strand has scattered.
    pub fn multiple(self) -> bool {
        self.global || self.local
    }
}

/// What shading a frame took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Done {
    pub points: u64,
    /// Pairs of a point and a light that matters to it.
    pub pairs: u64,
    /// Evaluations of a method's single and global scattering.
    pub single: u64,
    pub global: u64,
    /// Joins of a mode with a light over inclination, energy compensation's included; `fast` alone counts them.
    pub lobes: u64,
}

/// The shading pass for some parts of the scattering.
struct Shading {
    parts: u32,
    count: bool,
    pipeline: wgpu::ComputePipeline,
    scattering: wgpu::BindGroup,
}

/// What a shading pipeline is compiled from.
#[derive(PartialEq)]
struct PipelineKind {
    integrator: Integrator,
    exact: bool,
    constants: Vec<(&'static str, f64)>,
}

/// A frame in linear radiance.
pub struct Frame {
    pub size: [u32; 2],
    /// Premultiplied RGB and alpha, row-major from the top.
    pub pixels: Vec<[f32; 4]>,
    /// Share of each pixel that hair covers.
    pub hair_coverage: Vec<f32>,
    /// Strand points that were shaded, in the order they were found.
    pub shaded: Vec<u32>,
    /// GPU milliseconds by pass; empty where the adapter has no timestamps.
    pub passes: BTreeMap<&'static str, f64>,
}

impl Frame {
    /// Adds the next band.
    fn add_below(&mut self, band: Frame) {
        self.pixels.extend(band.pixels);
        self.hair_coverage.extend(band.hair_coverage);
        self.shaded.extend(band.shaded);
        self.shaded.sort_unstable();
        self.shaded.dedup();
        for (name, ms) in band.passes {
            *self.passes.entry(name).or_default() += ms;
        }
    }
}

/// What a camera sees. Frames of it in other light and with other fibres rasterise nothing.
pub struct Sight {
    lens: Lens,
    sampling: Sampling,
    work: Work,
    /// What frames draw again, with more samples than looked for it.
    again: Option<SeenAgain>,
    /// Strand points that its frames need, each once.
    pub points: Vec<u32>,
    /// What they show of the head.
    pub head: SeenHead,
    /// GPU milliseconds that it took, as [`Frame::passes`], of which they are a part.
    passes: BTreeMap<&'static str, f64>,
}

/// Segments that were seen, and those beside them on their strands, with points of no light of their own.
struct SeenAgain {
    ribbons: Ribbons,
    /// Pairs: such a point, and the nearest that was seen.
    fringe: wgpu::Buffer,
    fringe_count: u32,
}

/// Points beside those that were seen: a look misses segments of which it meets few samples, most at thin tips. Without them
/// hair would cover 0.9 % less of a 360×240 bob, and 2.9 % less of straight hair.
const FRINGE: usize = 4;
const NONE: u32 = u32::MAX;

/// Cull threshold: a narrow light is skipped at a point where it delivers less than this share of the mean irradiance of a
/// light, and a lobe of the fibre where less comes through it. What that leaves out of a frame is below 0.1 % (tests/work.rs).
pub const NEGLIGIBLE: f64 = 1e-3;

/// Pixels of a frame that are rendered at a time, in bands of whole rows: a band's sums fill a storage buffer of
/// WebGPU's default limit, 128 MiB, and its visibility buffer takes 0.4 GiB.
const BAND_PIXELS: u32 = 8 << 20;

/// Points that are shaded between two looks at whether to go on: 0.1 s on two cores.
const POINTS_A_LOOK: u32 = 1 << 16;

/// Place, diameter, tangent and the angle of the cross section's axis at each point, as shaders/view.wgsl has them.
fn strand_points(device: &wgpu::Device, stage: &Geometry) -> wgpu::Buffer {
    let Geometry { hair, diameters, frames, center, .. } = stage;
    let mut data: Vec<Vec4> = Vec::with_capacity(2 * hair.points.len());
    for (i, &p) in hair.points.iter().enumerate() {
        let (u, axis) = (frames.tangents[i], frames.axes[i]);
        let (x, y) = normals(u);
        data.push((p - center).extend(diameters[i]));
        data.push(u.extend(axis.dot(y).atan2(axis.dot(x))));
    }
    storage(device, "strand points", bytemuck::cast_slice(&data))
}

/// Mean of length times width.
fn segment_area(stage: &Geometry, segments: &[u32]) -> f64 {
    let Geometry { hair, diameters, .. } = stage;
    let area = |&first: &u32| {
        let i = first as usize;
        f64::from(hair.points[i].distance(hair.points[i + 1]) * diameters[i])
    };
    segments.iter().map(area).sum::<f64>() / segments.len().max(1) as f64
}

/// Pipelines that no method changes.
struct Fixed {
    hair: wgpu::RenderPipeline,
    head: wgpu::RenderPipeline,
    mark: wgpu::ComputePipeline,
    spread: wgpu::ComputePipeline,
    resolve: wgpu::ComputePipeline,
    backdrop: wgpu::ComputePipeline,
}

impl Fixed {
    fn new(device: &wgpu::Device, shaders: &Shaders, with_head: bool) -> Fixed {
        let raster = module(device, "raster", &shaders.raster());
        let mark = module(device, "mark", &shaders.mark());
        let resolve = module(device, "resolve", &shaders.resolve());
        let fringe = module(device, "fringe", &shaders.fringe());
        let with_head = [("WITH_HEAD", f64::from(with_head))];
        Fixed {
            hair: raster_pipeline(device, &raster, "hair"),
            head: raster_pipeline(device, &raster, "head"),
            mark: compute_pipeline(device, &mark, "mark", &[]),
            spread: compute_pipeline(device, &fringe, "spread", &[]),
            resolve: compute_pipeline(device, &resolve, "resolve", &with_head),
            backdrop: compute_pipeline(device, &resolve, "backdrop", &[]),
        }
    }
}

/// Geometry, lights and fibre on the GPU, ready to be seen from anywhere.
pub struct Renderer {
    pub gpu: Gpu,
    points: u32,
    center: Vec3,
    /// First point of every segment.
    every_segment: Vec<u32>,
    /// Mean of their lengths times widths, world units squared.
    segment_area: f64,
    /// Strand of every point; of so many strands one is drawn, as much wider.
    strand_of: Vec<u32>,
    thinning: u32,
    strand_points: wgpu::Buffer,
    /// First points of the segments that are to be drawn, and the straight pieces of each.
    drawn: Vec<u32>,
    pieces: u32,
    /// The same on the GPU; None until they are next drawn.
    ribbons: Option<Ribbons>,
    head: HeadSurface,
    /// [`NEGLIGIBLE`], or 0 to leave nothing out; for the lights that are set from now on.
    pub negligible: f64,
    /// Traces on the device even where the CPU does so faster.
    pub trace_on_device: bool,
    lights: wgpu::Buffer,
    /// Of the lights that are set.
    to_trace: (Vec<Lamp>, Vec<SrbfLight>, Vec<Rays>),
    traced: PointTransmittance,
    /// T̃ that is known, in place of what is traced.
    known: Option<Table>,
    light_count: u32,
    /// What paths that escape see, and its table (`sky_map`), made for the first gather.
    sky: Vec<SrbfLight>,
    sky_map: OnceCell<wgpu::TextureView>,
    /// Of which the first are lamps.
    lamp_count: u32,
    /// Where light is, that other strands have scattered.
    field: Option<FieldGrid>,
    /// Radiance over what the field has along the nearest ordinate.
    field_overlap: f32,
    /// How light between strands is found at points; None where the field alone has it.
    gather: Option<Gather>,
    gather_pipelines: Option<GatherPipelines>,
    /// First and last point of each point's strand.
    strand_ends: wgpu::Buffer,
    field_texture: wgpu::TextureView,
    field_sampler: wgpu::Sampler,
    /// `Fibres::points` of the method.
    painted: wgpu::TextureView,
    method: MethodData,
    environment: wgpu::TextureView,
    environment_rotation_rad: f32,
    environment_scale: f32,
    fixed: Fixed,
    pipelines: Vec<(PipelineKind, wgpu::ComputePipeline)>,
    /// Made when first asked for.
    shading: Vec<Shading>,
}

impl Renderer {
    /// Uploads strands and head; the hair's centre becomes the origin.
    pub fn new(gpu: Gpu, method: &MethodData, stage: &Geometry) -> Result<Renderer> {
        let Geometry { hair, .. } = stage;
        let center = stage.center;
        let points = hair.points.len() as u32;
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        let row = u64::from(gpu.device.limits().max_texture_dimension_2d) * POINTS_A_ROW as u64;
        let most = (limit / 32).min(row);
        ensure!(
            u64::from(points) <= most,
            "{points} hair points are more than the adapter `{}` can hold, {most}: use fewer strands or points, or \
             another adapter",
            gpu.info.name
        );
        let segments: Vec<u32> = hair
            .strands()
            .flat_map(|r| r.start as u32..r.end.max(r.start + 1) as u32 - 1)
            .collect();
        let strands = (0..).zip(hair.strands());
        let strand_of = strands
            .flat_map(|(strand, points)| std::iter::repeat_n(strand, points.len()))
            .collect();
        let device = &gpu.device;
        let strand_points = strand_points(device, stage);
        let head = HeadSurface::new(device, stage);
        let fixed = Fixed::new(device, &gpu.shaders, head.corner_count > 0);
        Ok(Renderer {
            points,
            center,
            drawn: segments.clone(),
            pieces: 1,
            ribbons: None,
            segment_area: segment_area(stage, &segments),
            every_segment: segments,
            strand_of,
            strand_points,
            head,
            negligible: NEGLIGIBLE,
            trace_on_device: false,
            thinning: 1,
            lights: storage(device, "lights", &[]),
            to_trace: Default::default(),
            traced: PointTransmittance::new(&gpu, stage),
            known: None,
            light_count: 0,
            sky: Vec::new(),
            sky_map: OnceCell::new(),
            lamp_count: 0,
            field: None,
            field_overlap: 0.0,
            gather: None,
            gather_pipelines: None,
            strand_ends: storage(device, "strand ends", bytemuck::cast_slice(&hair.strand_ends())),
            field_texture: volume_texture(&gpu, "field", [1; 3], &[Default::default()]),
            field_sampler: linear_sampler(device),
            painted: point_texture(&gpu, method.fibres.points()),
            method: method.clone(),
            environment: float_texture(&gpu, "environment", [1, 1], &[Vec4::ZERO]),
            environment_rotation_rad: 0.0,
            environment_scale: 1.0,
            fixed,
            pipelines: Vec::new(),
            shading: Vec::new(),
            gpu,
        })
    }

    /// Whether rays are for the CPU, which traces them faster than its adapter does.
    pub fn traces_on_cpu(&self) -> bool {
        self.gpu.info.device_type == wgpu::DeviceType::Cpu && !self.trace_on_device
    }

    /// The same strands with other diameters.
    pub fn set_diameters(&mut self, stage: &Geometry) {
        self.strand_points = strand_points(&self.gpu.device, stage);
        self.segment_area = segment_area(stage, &self.every_segment);
        self.traced.forget();
    }

    /// Draws by other shaders from now on.
    ///
    /// # Errors
    /// One line: what the device finds wrong with them. The ones before stay.
    pub fn set_shaders(&mut self, shaders: &Shaders) -> Result<()> {
        if self.gpu.shaders == *shaders {
            return Ok(());
        }
        let before = std::mem::replace(&mut self.gpu.shaders, shaders.clone());
        let compiled = (std::mem::take(&mut self.pipelines), std::mem::take(&mut self.shading));
        let scope = self.gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let fixed = Fixed::new(&self.gpu.device, shaders, self.head.corner_count > 0);
        self.shading_pipeline(0, false);
        if let Some(error) = pollster::block_on(scope.pop()) {
            self.gpu.shaders = before;
            (self.pipelines, self.shading) = compiled;
            let text = error.to_string();
            bail!("shaders: {}", text.split_whitespace().collect::<Vec<_>>().join(" "));
        }
        self.fixed = fixed;
        self.traced.forget_pipelines();
        self.gather_pipelines = None;
        self.head.forget_pipeline();
        Ok(())
    }

    /// Of so many strands one is drawn from now on, as many times wider: frames in a hurry. Points are to be found and
    /// lights set anew.
    pub fn set_thinning(&mut self, strands: u32) {
        self.thinning = strands.max(1);
    }

    /// Draws only these segments, by their first points, each in `pieces` straight pieces.
    fn draw_segments(&mut self, pieces: u32, mut segments: Vec<u32>) {
        segments.retain(|&first| self.strand_of[first as usize].is_multiple_of(self.thinning));
        self.drawn = segments;
        let most = self.gpu.device.limits().max_buffer_size / Ribbons::BYTES_PER_PIECE;
        let most = most / self.drawn.len().max(1) as u64;
        self.pieces = pieces.min(most as u32).max(1);
        self.ribbons = None;
    }

    fn make_ribbons(&mut self) {
        if self.ribbons.is_none() {
            self.ribbons = Some(Ribbons::new(&self.gpu.device, &self.drawn, self.pieces));
        }
    }

    /// The strand points that frames through `lenses`, of one size, need, each once. From now on segments are
    /// drawn in `pieces` straight pieces (`hair::pieces`).
    pub fn visible_points(
        &mut self,
        lenses: &[Lens],
        pieces: u32,
        samples: u32,
    ) -> Result<Vec<u32>> {
        Ok(self.visible(lenses, pieces, samples)?.0)
    }

    /// The same, and what they show of the head.
    pub fn visible(
        &mut self,
        lenses: &[Lens],
        pieces: u32,
        samples: u32,
    ) -> Result<(Vec<u32>, SeenHead)> {
        self.draw_segments(pieces, self.every_segment.clone());
        let (work, sampling, _) = self.find_all(lenses, samples)?;
        Ok((work.listed(&self.gpu)?, work.head(&self.gpu, lenses, sampling)?))
    }

    /// What is seen of the segments that are drawn, by lenses of one size.
    fn find_all(&mut self, lenses: &[Lens], samples: u32) -> Result<(Work, Sampling, PassTimer)> {
        let size = lenses.first().map_or([1; 2], |lens| lens.size);
        let look = lenses.iter().map(|lens| self.look_samples(lens)).max().unwrap_or(samples);
        let (work, sampling) = self.begin(size, [samples, look])?;
        let mark = self.bind_at(
            &self.fixed.mark,
            &[
                texture(0, &work.visibility),
                buffer(1, &work.marks),
                buffer(2, &work.needed),
                buffer(3, &work.head_seen),
            ],
        );
        let mut timer = PassTimer::new(&self.gpu);
        for lens in lenses.iter().flat_map(bands) {
            for pass in 0..sampling.looks {
                let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
                let view = self.view(&lens, Background::Transparent, sampling, pass);
                if let Some(ribbons) = &self.ribbons {
                    self.raster(&mut encoder, timer.render("raster"), &work, (&view, ribbons));
                }
                let mut compute = begin(&mut encoder, "mark", timer.compute("mark"));
                compute.set_pipeline(&self.fixed.mark);
                compute.set_bind_group(0, &mark, &[]);
                let [across, down] = work.texels.map(|side| side.div_ceil(8));
                compute.dispatch_workgroups(across, down, 1);
                drop(compute);
                self.gpu.queue.submit([encoder.finish()]);
            }
        }
        Ok((work, sampling, timer))
    }

    /// What is seen through `lens`, segments in `pieces` straight pieces (`hair::pieces`).
    ///
    /// # Errors
    /// One line: more than [`BAND_PIXELS`] pixels, of which what is seen is not kept.
    pub fn look(&mut self, lens: &Lens, pieces: u32, samples: u32) -> Result<Sight> {
        let [width, height] = lens.size;
        ensure!(
            bands(lens).count() == 1,
            "a view of {width}x{height} pixels is more than {BAND_PIXELS}: choose a smaller one"
        );
        self.draw_segments(pieces, self.every_segment.clone());
        self.sight(lens, samples)
    }

    /// Samples a pixel that find what is seen: most segments are met several times, and a segment between two that are seen is
    /// drawn too.
    fn look_samples(&self, lens: &Lens) -> u32 {
        const HITS: f64 = 8.0;
        const LEAST: f64 = 16.0;
        let pixels = lens.pixels_per_unit() / lens.distance;
        let area = self.segment_area * pixels * pixels * f64::from(self.thinning);
        (HITS / area.max(1e-6)).max(LEAST) as u32
    }

    /// What is seen of the segments that are drawn, by a lens of one band.
    fn sight(&mut self, lens: &Lens, samples: u32) -> Result<Sight> {
        let (work, sampling, timer) = self.find_all(&[*lens], samples)?;
        let points = work.listed(&self.gpu)?;
        let head = work.head(&self.gpu, &[*lens], sampling)?;
        let passes = timer.read(&self.gpu)?;
        let again = (sampling.passes > 1).then(|| self.seen_again(&points));
        Ok(Sight { lens: *lens, sampling, work, again, points, head, passes })
    }

    /// What finer passes draw where a look saw `points`.
    fn seen_again(&self, points: &[u32]) -> SeenAgain {
        let nearest = self.nearest_of(points);
        let strand = |first: u32| self.strand_of[first as usize];
        let there = |&first: &u32| {
            strand(first).is_multiple_of(self.thinning)
                && [first, first + 1].iter().all(|&end| nearest[end as usize] != NONE)
        };
        let segments: Vec<u32> = self.every_segment.iter().copied().filter(there).collect();
        let beside = (0..).zip(&nearest).filter(|&(point, &seen)| seen != NONE && seen != point);
        let fringe: Vec<[u32; 2]> = beside.map(|(point, &seen)| [point, seen]).collect();
        let device = &self.gpu.device;
        SeenAgain {
            ribbons: Ribbons::new(device, &segments, self.pieces),
            fringe_count: fringe.len() as u32,
            fringe: storage(device, "fringe", bytemuck::cast_slice(&fringe)),
        }
    }

    /// Of each point the nearest of `points` on its strand, itself or within [`FRINGE`]; [`NONE`] where none is.
    fn nearest_of(&self, points: &[u32]) -> Vec<u32> {
        let strand = &self.strand_of;
        let mut nearest = vec![NONE; strand.len()];
        // Of two as near the first, in whatever order they were seen.
        let mut points = points.to_vec();
        points.sort_unstable();
        for step in 0..=FRINGE {
            for &point in &points {
                let p = point as usize;
                for q in [p.wrapping_sub(step), p + step] {
                    if nearest.get(q) == Some(&NONE) && strand[q] == strand[p] {
                        nearest[q] = point;
                    }
                }
            }
        }
        nearest
    }

    /// The frame of what `sight` saw, in the light that is set at its points, as [`Self::render`] makes it. `go_on` is
    /// asked every [`POINTS_A_LOOK`] points, and None is a frame that was given up.
    pub fn render_seen(
        &mut self,
        sight: &Sight,
        background: Background,
        parts: Parts,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<Frame>> {
        let Sight { lens, sampling, work, again, points, passes, .. } = sight;
        let mut timer = PassTimer::new(&self.gpu);
        let begun = Instant::now();
        let Some(gathered) = self.gather(sight, parts, go_on)? else { return Ok(None) };
        let gather_ms = 1e3 * begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        if !self.shade(sight, (parts, false, gathered), &mut timer, go_on)? {
            return Ok(None);
        }
        let shade_ms = 1e3 * begun.elapsed().as_secs_f64();
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&work.sum, 0, None);
        encoder.clear_buffer(&work.hair_sum, 0, None);
        if let Some(again) = again {
            self.spread(&mut encoder, again, work);
        }
        for pass in 0..sampling.passes {
            let view = self.view(lens, background, *sampling, pass);
            // What one pass saw is there still.
            if let Some(SeenAgain { ribbons, .. }) = again {
                self.raster(&mut encoder, timer.render("raster"), work, (&view, ribbons));
            }
            self.resolve(&mut encoder, &mut timer, work, &view);
            if pass + 1 == sampling.passes {
                self.backdrop(&mut encoder, &mut timer, work, &view);
            }
            self.gpu.queue.submit([encoder.finish()]);
            encoder = self.gpu.device.create_command_encoder(&Default::default());
        }
        let (pixels, hair_coverage) = (self.gpu.read(&work.sum)?, self.gpu.read(&work.hair_sum)?);
        let mut all = passes.clone();
        for (name, ms) in timer.read(&self.gpu)? {
            *all.entry(name).or_default() += ms;
        }
        // Each submission was waited for; of those without a raster pass lavapipe's timestamps tell nothing.
        if let Some(shade) = all.get_mut("shade") {
            *shade = shade_ms;
            if gathered {
                all.insert("gather", gather_ms);
            }
        }
        let shaded = points.clone();
        Ok(Some(Frame { size: lens.size, pixels, hair_coverage, shaded, passes: all }))
    }

    /// Gathers light between strands at the points of a sight, where that is asked for; whether it was. None where `go_on`
    /// said no.
    fn gather(
        &mut self,
        sight: &Sight,
        parts: Parts,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<bool>> {
        // Pictures without a gather leave its pipelines where they are.
        if self.gather.is_none() {
            return Ok(Some(false));
        }
        let mut pipelines = self.gather_pipelines.take();
        let Some(gather) = self.gather.as_ref() else { return Ok(Some(false)) };
        let scene = self.gather_scene(parts);
        let at = (sight.lens.eye.as_vec3(), &sight.points[..]);
        let radiance = &sight.work.radiance;
        let done = gather.at_points(&scene, &mut pipelines, at, radiance, go_on);
        self.gather_pipelines = pipelines;
        Ok(done?.then_some(true))
    }

    fn gather_scene(&self, parts: Parts) -> GatherScene<'_> {
        GatherScene {
            gpu: &self.gpu,
            method: &self.method,
            traced: &self.traced,
            strand_points: &self.strand_points,
            strand_ends: &self.strand_ends,
            strand_of: &self.strand_of,
            lights: &self.lights,
            light_count: self.light_count,
            sky_map: self.sky_map.get_or_init(|| self.sky_texture()),
            lamp_count: self.lamp_count,
            painted: &self.painted,
            parts: parts.bits(),
            field: (
                &self.field_texture,
                &self.field_sampler,
                self.field.map(|grid| (grid, self.field_overlap)),
            ),
        }
    }

    /// Shades the points of a sight; false where `go_on` said no. `count`: counts in place of radiance. `gathered`: light
    /// between strands is there.
    fn shade(
        &mut self,
        sight: &Sight,
        (parts, count, gathered): (Parts, bool, bool),
        timer: &mut PassTimer,
        go_on: &dyn Fn() -> bool,
    ) -> Result<bool> {
        let Sight { lens, work, points, .. } = sight;
        let shading = self.shading(parts, count);
        let shading = &self.shading[shading];
        let groups = self.shading_groups(shading, lens, (parts, gathered), work);
        let all = points.len() as u32;
        for first in (0..all).step_by(POINTS_A_LOOK as usize) {
            if !go_on() {
                return Ok(false);
            }
            let end = all.min(first + POINTS_A_LOOK);
            // `count` and `shaded` of shaders/mark.wgsl.
            self.gpu.queue.write_buffer(&work.needed, 0, bytemuck::cast_slice(&[end, first]));
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            let mut compute = begin(&mut encoder, "shade", timer.compute("shade"));
            compute.set_pipeline(&shading.pipeline);
            compute.set_bind_group(0, &shading.scattering, &[]);
            for group in &groups {
                compute.set_bind_group(1, group, &[]);
                compute.dispatch_workgroups((end - first).div_ceil(64), 1, 1);
            }
            drop(compute);
            self.gpu.queue.submit([encoder.finish()]);
            self.gpu.wait()?;
        }
        Ok(true)
    }

    /// Sets lamps and lights (world frame, exposure included); their T̃ is to follow, by [`Self::trace`] or
    /// [`Self::upload`]. `rays`: times as many as at 64 samples.
    ///
    /// Comes after [`Self::set_method`], which says how many lights a pass may sum, and before [`Self::set_field`].
    pub fn set_lights(
        &mut self,
        lamps: &[Lamp],
        lights: &[SrbfLight],
        sky: &[SrbfLight],
        rays: f64,
    ) {
        let power = |light: &SrbfLight| light.energy().iter().sum::<f64>();
        let middle = self.center.as_dvec3();
        let powers = lamps.iter().map(|lamp| power(&lamp.lobe(middle)));
        let powers: Vec<f64> = powers.chain(lights.iter().map(power)).collect();
        let bright = powers.iter().filter(|&&power| power > 0.0).count();
        let fair = powers.iter().sum::<f64>() / bright.max(1) as f64;
        let least =
            |integral: f64| (self.negligible * fair / (3.0 * integral)).min(f64::from(f32::MAX));
        let of_lamps = lamps.iter().filter_map(|lamp| {
            let (center, size, side) = lamp.place()?;
            Some(LightEntry {
                direction: (center - middle).as_vec3(),
                lambda: size as f32,
                rgb: Vec3::from(lamp.radiance.map(|c| c as f32)),
                energy: 1.0,
                least: least(1.0) as f32,
                side: side.as_vec3().to_array(),
                ..LightEntry::zeroed()
            })
        });
        let distant = |light: &SrbfLight| LightEntry {
            direction: light.direction.as_vec3(),
            lambda: light.lambda as f32,
            rgb: Vec3::from(light.rgb.map(|c| c as f32)),
            energy: lobe_integral(light.lambda) as f32,
            least: least(lobe_integral(light.lambda)) as f32,
            ..LightEntry::zeroed()
        };
        let mut entries: Vec<LightEntry> = of_lamps.chain(lights.iter().map(distant)).collect();
        self.light_count = entries.len() as u32;
        let whole = powers.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mut end = 0.0;
        for (entry, power) in entries.iter_mut().zip(&powers) {
            end += power / whole;
            (entry.chance, entry.end) = ((power / whole) as f32, end as f32);
        }
        (self.sky, self.sky_map) = (sky.to_vec(), OnceCell::new());
        self.lights = storage(&self.gpu.device, "lights", bytemuck::cast_slice(&entries));
        let had_lamps = self.lamp_count > 0;
        self.lamp_count = lamps.len() as u32;
        if had_lamps == lamps.is_empty() {
            self.shading.clear();
        }
        let ordinates = if lights.len() >= ORDINATES { ORDINATES } else { 0 };
        self.to_trace = (lamps.to_vec(), lights.to_vec(), Rays::of(&powers, ordinates, rays));
    }

    fn sky_texture(&self) -> wgpu::TextureView {
        let (_, lights, _) = &self.to_trace;
        let ordinates = &lights[lights.len().saturating_sub(ORDINATES)..];
        let sky = if self.sky.is_empty() { ordinates } else { &self.sky };
        float_texture(&self.gpu, "sky", [SIDE as u32; 2], &sky_texels(sky, ordinates))
    }

    /// Traces what is not known yet of the lights at `points`: on the device, or by `host`. Segments with other points are
    /// no longer drawn: from the cameras that [`Self::visible_points`] was asked for they are hidden anyway, and leaving
    /// them out rasterises the same frame in a quarter of the time (sintel). False where `progress` said no.
    ///
    /// # Errors
    /// The device was lost.
    pub fn trace(
        &mut self,
        stage: &Geometry,
        points: &[u32],
        rays: Option<&StrandRays>,
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Result<bool> {
        self.known = None;
        if rays.is_none() {
            self.traced.prepare(&self.gpu, stage);
        }
        let (lamps, lights, shares) = &self.to_trace;
        let counts = self.method.counts_strands();
        // A gather looks for the ordinates itself.
        let direct = &lights[..self.direct_lights() as usize - lamps.len()];
        self.traced.set_lights((lamps, direct), shares, counts, self.center);
        let done = self.foresee(stage, points, rays, progress)?;
        self.draw_known();
        Ok(done)
    }

    /// Traces as [`Self::trace`] does, of the lights that it set, for pictures that are yet to be asked for.
    ///
    /// # Errors
    /// The device was lost.
    pub fn foresee(
        &mut self,
        stage: &Geometry,
        points: &[u32],
        rays: Option<&StrandRays>,
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Result<bool> {
        let host = rays.map(|rays| (stage, rays));
        let Renderer { gpu, strand_points, traced, .. } = self;
        traced.compute(gpu, strand_points, points, host, progress)
    }

    /// How many of `points` nothing is traced at.
    pub fn untraced(&self, points: &[u32]) -> usize {
        points.iter().filter(|&&point| !self.traced.table.has(point as usize)).count()
    }

    /// Adds `times` as many rays to `points`, which are traced with as many, see [`Self::trace`]; paths that are gathered grow
    /// with them.
    ///
    /// # Errors
    /// The device was lost.
    pub fn add_rays(
        &mut self,
        stage: &Geometry,
        points: &[u32],
        times: u32,
        rays: Option<&StrandRays>,
        progress: &(dyn Fn(f32) -> bool + Sync),
    ) -> Result<bool> {
        let host = rays.map(|rays| (stage, rays));
        let Renderer { gpu, strand_points, traced, gather, .. } = self;
        let done = traced.add_rays(gpu, strand_points, points, times, host, progress)?;
        if let Some(gather) = gather.as_mut().filter(|_| done) {
            gather.multiply(2 * times);
        }
        Ok(done)
    }

    /// Sets T̃ that is known at `points`: `words[j][k]` is light j, lamps first, at `points[k]`.
    pub fn upload(&mut self, points: &[u32], words: &[Vec<Words>]) {
        let words = &words[..self.direct_lights() as usize];
        let pair = if self.method.counts_strands() { 2 } else { 1 };
        self.known = Some(known_table(&self.gpu, points, words, pair, self.points as usize));
        self.draw_known();
    }

    /// What is traced of each light, lamps first, at `points`.
    ///
    /// # Errors
    /// The device was lost.
    pub fn traced_words(&self, points: &[u32]) -> Result<Vec<Vec<Words>>> {
        self.traced.read(&self.gpu, points)
    }

    /// Rays that were traced so far.
    pub fn traced_rays(&self) -> u64 {
        self.traced.rays
    }

    /// Lights, lamps first, whose T̃ points have.
    fn direct_lights(&self) -> u32 {
        let ordinates = if self.gather.is_some() { ORDINATES as u32 } else { 0 };
        self.light_count - ordinates
    }

    fn table(&self) -> &Table {
        self.known.as_ref().unwrap_or(&self.traced.table)
    }

    /// Draws the segments of which T̃ is known at both ends.
    fn draw_known(&mut self) {
        let table = self.table();
        let known = |first: &u32| table.has(*first as usize) && table.has(*first as usize + 1);
        let segments = self.every_segment.iter().copied().filter(known).collect();
        self.draw_segments(self.pieces, segments);
    }

    /// From now on no strand is lit by another.
    pub fn clear_field(&mut self) {
        self.field = None;
        self.gather = None;
    }

    /// Whether the method can gather light.
    pub fn can_gather(&self) -> bool {
        self.method.twin.is_some()
    }

    /// Whether light is gathered.
    pub fn gathers(&self) -> bool {
        self.gather.is_some()
    }

    /// Paths that are gathered at each point; 0 where nothing is.
    pub fn paths_per_point(&self) -> u32 {
        self.gather.as_ref().map_or(0, Gather::paths_per_point)
    }

    /// From now on light of the sky and between strands is gathered, or with None comes from ordinates and the field. Where
    /// the device casts the rays, `stage` is brought to it.
    pub fn set_gather(&mut self, stage: &Geometry, gather: Option<Gather>) {
        if gather.as_ref().is_some_and(Gather::casts_on_device) {
            self.traced.prepare(&self.gpu, stage);
        }
        self.gather = gather;
    }

    /// Sets what other strands have scattered of the lights that are set, of which the last are the ordinates.
    pub fn set_field(&mut self, field: &Field) {
        let (texels, scale) = field.to_gpu();
        let [nx, ny, nz] = field.dims;
        self.field_texture = volume_texture(&self.gpu, "field", [nx, ny, nz * ORDINATES], &texels);
        self.field_overlap = field.overlap;
        self.field = Some(FieldGrid {
            origin: field.origin - self.center,
            cell: field.cell,
            dims: Vec3::new(nx as f32, ny as f32, nz as f32),
            scale,
        });
    }

    /// Sets the method, its fibre and tables; geometry and lights stay. To or from exact integrals lights are to be
    /// set anew.
    pub fn set_method(&mut self, method: &MethodData) {
        if !Arc::ptr_eq(&self.method.fibres, &method.fibres) {
            let (before, points) = (self.method.fibres.points(), method.fibres.points());
            if before.is_empty() || before.len() != points.len() {
                self.painted = point_texture(&self.gpu, points);
            } else {
                repaint_texture(&self.gpu, &self.painted, before, points);
            }
        }
        self.method = method.clone();
        self.shading.clear();
    }

    /// Place of the shading pass for `parts`, which is made where it is not there.
    fn shading(&mut self, parts: Parts, count: bool) -> usize {
        let parts = if self.method.general { ALL_PARTS } else { parts.bits() };
        let there = self.shading.iter().position(|s| (s.parts, s.count) == (parts, count));
        there.unwrap_or_else(|| {
            let pipeline = self.shading_pipeline(parts, count);
            let (device, method) = (&self.gpu.device, &self.method);
            let fibre = uniform_buffer(device, "fibre", bytemuck::bytes_of(&method.fibre));
            let [a, b] = method.tables.each_ref().map(|table| storage(device, "table", table));
            let layout = pipeline.get_bind_group_layout(0);
            let scattering = bind(device, &layout, &[&fibre, &a, &b]);
            self.shading.push(Shading { parts, count, pipeline, scattering });
            self.shading.len() - 1
        })
    }

    /// Compiled once for all methods that are alike in what they compile to.
    fn shading_pipeline(&mut self, parts: u32, count: bool) -> wgpu::ComputePipeline {
        let method = &self.method;
        let mut constants = method.constants();
        let lamps = method.general || self.lamp_count > 0;
        let own = [("PARTS", f64::from(parts)), ("COUNT", f64::from(count))];
        constants.extend(own.into_iter().chain([("LAMPS", f64::from(lamps))]));
        let kind =
            PipelineKind { integrator: method.integrator, exact: method.exact_single, constants };
        if let Some((_, pipeline)) = self.pipelines.iter().find(|(known, _)| *known == kind) {
            return pipeline.clone();
        }
        let source =
            method.specialised(&self.gpu.shaders, self.gpu.shaders.shade(method.integrator));
        let device = &self.gpu.device;
        let module = module(device, "shade", &source);
        let pipeline = compute_pipeline(device, &module, "shade", &kind.constants);
        self.pipelines.push((kind, pipeline.clone()));
        pipeline
    }

    /// Sets the irradiance of the vertices of the stage's head, and adds that of `lights` at what is `seen`, or at all
    /// vertices: by rays on the device, or by `rays`. False where `go_on` said no.
    ///
    /// # Errors
    /// The device was lost.
    pub fn light_head(
        &mut self,
        stage: &Geometry,
        irradiance: &[Vec3],
        lights: &[HeadLight],
        seen: Option<&SeenHead>,
        rays: Option<&StrandRays>,
        go_on: &dyn Fn() -> bool,
    ) -> Result<bool> {
        if rays.is_none() && !lights.is_empty() {
            self.traced.prepare(&self.gpu, stage);
        }
        let Renderer { gpu, traced, head, .. } = &mut *self;
        let mut caster = HeadRayCaster { gpu, stage, traced, host: rays, lights };
        let mut light = head.at_vertices(irradiance, &mut caster)?;
        if let Some(mut gather) = self.gather.take() {
            gather.set_head(&self.gpu, stage, &light.irradiance(lights));
            let multiple = self.field.is_some();
            let parts = Parts { single: true, global: multiple, local: multiple };
            let mut pipelines = self.gather_pipelines.take();
            let places = self.head.places(stage);
            let scene = self.gather_scene(parts);
            let gathered = gather.at_head(&scene, &mut pipelines, &places, go_on);
            self.gather_pipelines = pipelines;
            if let Ok(Some(gathered)) = &gathered {
                let (_, distant, _) = &self.to_trace;
                let sky = &distant[distant.len().saturating_sub(ORDINATES)..];
                self.head.add_gathered(&mut light, gathered, sky);
                gather.set_head(&self.gpu, stage, &light.irradiance(lights));
            }
            self.gather = Some(gather);
            if gathered?.is_none() {
                return Ok(false);
            }
        }
        let Renderer { gpu, traced, head, .. } = self;
        head.show(&light, seen, HeadRayCaster { gpu, stage, traced, host: rays, lights })?;
        Ok(true)
    }

    /// Sets the map behind the hair: turned by `rotation_rad` about +y, multiplied by `scale`.
    pub fn set_environment(&mut self, map: &Environment, rotation_rad: f32, scale: f32) {
        // A texture of this side fits every adapter.
        let small = map.shrunk(4096);
        let texels: Vec<_> = small.pixels.iter().map(|&rgb| Vec3::from(rgb).extend(0.0)).collect();
        let size = [small.width, small.height].map(|n| n as u32);
        self.environment = float_texture(&self.gpu, "environment", size, &texels);
        self.turn_environment(rotation_rad);
        self.environment_scale = scale;
    }

    /// Turns the map that is set.
    pub fn turn_environment(&mut self, rotation_rad: f32) {
        self.environment_rotation_rad = rotation_rad;
    }

    /// Renders a frame with at least `samples` samples a pixel (a multiple of four is taken), in bands of at most
    /// [`BAND_PIXELS`].
    pub fn render(
        &mut self,
        lens: &Lens,
        samples: u32,
        background: Background,
        parts: Parts,
    ) -> Result<Frame> {
        let mut whole: Option<Frame> = None;
        for band in bands(lens) {
            let sight = self.sight(&band, samples)?;
            let Some(frame) = self.render_seen(&sight, background, parts, &|| true)? else {
                bail!("cancelled");
            };
            match &mut whole {
                None => whole = Some(Frame { size: lens.size, ..frame }),
                Some(whole) => whole.add_below(frame),
            }
        }
        whole.context("a frame has no pixels")
    }

    /// Gives points beside those that are seen the light of these.
    fn spread(&self, encoder: &mut wgpu::CommandEncoder, again: &SeenAgain, work: &Work) {
        let layout = self.fixed.spread.get_bind_group_layout(0);
        let bound = bind(&self.gpu.device, &layout, &[&again.fringe, &work.radiance]);
        let mut compute = begin(encoder, "spread", None);
        compute.set_pipeline(&self.fixed.spread);
        compute.set_bind_group(0, &bound, &[]);
        compute.dispatch_workgroups(again.fringe_count.div_ceil(64), 1, 1);
    }

    /// Adds a pass's share of each pixel.
    fn resolve(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut PassTimer,
        work: &Work,
        view: &PassView,
    ) {
        let resolve = self.bind_at(
            &self.fixed.resolve,
            &[
                buffer(0, &view.uniform),
                texture(1, &work.visibility),
                buffer(2, &work.radiance),
                buffer(3, &self.head.radiance),
                buffer(4, &self.head.corners),
                buffer(6, &work.sum),
                buffer(7, &work.hair_sum),
                buffer(8, &self.head.detail),
            ],
        );
        self.over_pixels(encoder, timer, work, "resolve", (&self.fixed.resolve, &resolve));
    }

    /// Puts the background behind all passes.
    fn backdrop(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut PassTimer,
        work: &Work,
        view: &PassView,
    ) {
        let backdrop = self.bind_at(
            &self.fixed.backdrop,
            &[buffer(0, &view.uniform), texture(5, &self.environment), buffer(6, &work.sum)],
        );
        self.over_pixels(encoder, timer, work, "backdrop", (&self.fixed.backdrop, &backdrop));
    }

    fn over_pixels(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut PassTimer,
        work: &Work,
        name: &'static str,
        (pipeline, group): (&wgpu::ComputePipeline, &wgpu::BindGroup),
    ) {
        let [across, down] = work.size.map(|side| side.div_ceil(8));
        let mut compute = begin(encoder, name, timer.compute(name));
        compute.set_pipeline(pipeline);
        compute.set_bind_group(0, group, &[]);
        compute.dispatch_workgroups(across, down, 1);
    }

    /// Shades a frame once more to count what that takes; see [`Self::render`].
    pub fn count(&mut self, lens: &Lens, samples: u32, parts: Parts) -> Result<Done> {
        let mut done = Done::default();
        for band in bands(lens) {
            let sight = self.sight(&band, samples)?;
            let mut timer = PassTimer::new(&self.gpu);
            self.shade(&sight, (parts, true, false), &mut timer, &|| true)?;
            let counts: Vec<[f32; 4]> = self.gpu.read(&sight.work.radiance)?;
            let sum =
                |k: usize| sight.points.iter().map(|&i| counts[i as usize][k] as u64).sum::<u64>();
            done.points += sight.points.len() as u64;
            done.pairs += sum(0);
            done.single += sum(1);
            done.global += sum(2);
            done.lobes += sum(3);
        }
        Ok(done)
    }

    /// Bytes of what shading reads: tables, lights, the field, T̃ of its points, and the points.
    pub fn shading_bytes(&self) -> u64 {
        let tables: usize = self.method.tables.iter().map(Vec::len).sum();
        let cells = self.field.map_or(0.0, |field| field.dims.element_product());
        let field = 8 * ORDINATES as u64 * cells as u64;
        // A point is two vec4f and its slot.
        let table = self.table();
        tables as u64
            + self.lights.size()
            + field
            + table.bytes()
            + (32 + 4) * u64::from(table.count)
    }

    /// Checks the size against the adapter and makes the buffers of a frame's tallest band.
    fn begin(&mut self, size: [u32; 2], samples: [u32; 2]) -> Result<(Work, Sampling)> {
        let edge = self.gpu.device.limits().max_texture_dimension_2d;
        let [width, height] = size;
        ensure!(
            width.max(height) <= edge,
            "a frame of {width}x{height} is more than the adapter `{}` can hold, {edge} pixels a side: choose a \
             smaller size, or another adapter",
            self.gpu.info.name
        );
        let size = [width, band_rows(size)];
        let sampling = Sampling::new(samples, size, edge);
        self.make_ribbons();
        let counts = [self.points, self.head.triangles() as u32];
        Ok((Work::new(&self.gpu.device, counts, size, sampling.grid), sampling))
    }

    fn bind_at(
        &self,
        pipeline: &wgpu::ComputePipeline,
        entries: &[wgpu::BindGroupEntry],
    ) -> wgpu::BindGroup {
        self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries,
        })
    }

    fn shading_groups(
        &self,
        shading: &Shading,
        lens: &Lens,
        (parts, gathered): (Parts, bool),
        work: &Work,
    ) -> Vec<wgpu::BindGroup> {
        let device = &self.gpu.device;
        let layout = shading.pipeline.get_bind_group_layout(1);
        let table = self.table();
        // Groups hold lights from the last to the first.
        let a_pass = self.method.lights_a_pass() as u32;
        let passes = table.groups.iter().rev().flat_map(|group| {
            let last_column = self.direct_lights().saturating_sub(1 + group.first);
            let end = self.direct_lights().saturating_sub(group.first);
            let first = end.saturating_sub(group.count);
            (first..end)
                .step_by(a_pass as usize)
                .map(move |first| (group, first, a_pass.min(end - first), last_column))
        });
        passes
            .map(|(group, first_light, lights, last_column)| {
                let uniform = ShadingUniform {
                    eye: lens.eye.as_vec3(),
                    parts: parts.bits(),
                    first_light,
                    lights,
                    slots: table.count,
                    first_ordinate: match self.field {
                        Some(_) if !gathered => self.light_count - ORDINATES as u32,
                        _ => u32::MAX,
                    },
                    grid: self.field.unwrap_or(FieldGrid::NONE),
                    lamps: self.lamp_count,
                    stride: table.pair * group.count,
                    last_column,
                    gathered: u32::from(gathered),
                };
                let uniform = uniform_buffer(device, "shading", bytemuck::bytes_of(&uniform));
                let buffers = [
                    &uniform,
                    &self.strand_points,
                    &work.needed,
                    &self.lights,
                    &group.words,
                    &work.radiance,
                    &table.slots,
                ];
                let buffers = (0..).zip(buffers).map(|(binding, bound)| buffer(binding, bound));
                let sampled = [
                    texture(7, &self.field_texture),
                    sampler(8, &self.field_sampler),
                    texture(9, &self.painted),
                ];
                device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout: &layout,
                    entries: &buffers.chain(sampled).collect::<Vec<_>>(),
                })
            })
            .collect()
    }

    fn raster(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timestamp_writes: Option<wgpu::RenderPassTimestampWrites>,
        work: &Work,
        (view, ribbons): (&PassView, &Ribbons),
    ) {
        let device = &self.gpu.device;
        let mut raster = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("raster"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &work.visibility,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &work.depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            timestamp_writes,
            ..Default::default()
        });
        let [width, height] = view.texels.map(|side| side as f32);
        raster.set_viewport(0.0, 0.0, width, height, 0.0, 1.0);
        if self.head.corner_count > 0 {
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("head"),
                layout: &self.fixed.head.get_bind_group_layout(0),
                entries: &[
                    buffer(0, &view.uniform),
                    buffer(3, &self.head.positions),
                    buffer(4, &self.head.corners),
                ],
            });
            raster.set_pipeline(&self.fixed.head);
            raster.set_bind_group(0, &group, &[]);
            raster.draw(0..self.head.corner_count, 0..1);
        }
        if ribbons.count > 0 {
            let layout = self.fixed.hair.get_bind_group_layout(0);
            let group =
                bind(device, &layout, &[&view.uniform, &self.strand_points, &ribbons.segments]);
            raster.set_pipeline(&self.fixed.hair);
            raster.set_bind_group(0, &group, &[]);
            raster.set_index_buffer(ribbons.indices.slice(..), wgpu::IndexFormat::Uint32);
            raster.draw_indexed(0..ribbons.count, 0, 0..1);
        }
    }

    fn view(&self, lens: &Lens, background: Background, sampling: Sampling, pass: u32) -> PassView {
        let size = lens.size;
        let [width, height] = size.map(|s| s as f32);
        let shift = 2.0 * jitter(pass, sampling) / Vec2::new(width, height);
        let eye = lens.eye.as_vec3();
        let row = |axis: DVec3| axis.as_vec3().extend(-axis.dot(lens.eye) as f32);
        let [x, y, w] = lens.image_axes().map(row);
        // Infinite reversed depth: near / distance. The image moves against the jitter, y up in clip space and
        // down in pixels.
        let near = 1e-3 * lens.distance.max(1e-6) as f32;
        let rows = [x - shift.x * w, y + shift.y * w, Vec4::new(0.0, 0.0, 0.0, near), w];
        let (kind, color) = match background {
            Background::Environment => (0, Vec3::ZERO),
            Background::Color(rgb) => (1, Vec3::from(rgb)),
            Background::Transparent => (2, Vec3::ZERO),
        };
        let uniform = ViewUniform {
            clip_from_pos: Mat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose(),
            eye,
            pieces: self.pieces,
            right: lens.right.as_vec3(),
            background: kind,
            up: lens.up.as_vec3(),
            environment_rotation_rad: self.environment_rotation_rad,
            forward: lens.forward.as_vec3(),
            environment_scale: self.environment_scale,
            background_rgb: color,
            share: 1.0 / sampling.passes as f32,
            size,
            grid: sampling.grid,
            widened: self.thinning as f32,
        };
        let uniform = uniform_buffer(&self.gpu.device, "view", bytemuck::bytes_of(&uniform));
        PassView { uniform, texels: size.map(|side| sampling.grid * side) }
    }
}

/// The camera of one pass.
struct PassView {
    uniform: wgpu::Buffer,
    /// Width and height of its image in the visibility buffer.
    texels: [u32; 2],
}

/// Whether what is seen in a frame of this size can be kept: see [`Renderer::look`].
pub fn can_be_kept(size: [u32; 2]) -> bool {
    band_rows(size) >= size[1]
}

/// Rows of a frame's bands but the last.
fn band_rows([width, height]: [u32; 2]) -> u32 {
    (BAND_PIXELS / width.max(1)).clamp(1, height.max(1))
}

/// The bands of a frame from its top, as lenses of their own.
fn bands(lens: &Lens) -> impl Iterator<Item = Lens> + use<> {
    let (lens, height, rows) = (*lens, lens.size[1], band_rows(lens.size));
    (0..height).step_by(rows as usize).map(move |first| lens.rows(first..height.min(first + rows)))
}

/// Segments as triangles, for one number of pieces a segment.
struct Ribbons {
    segments: wgpu::Buffer,
    indices: wgpu::Buffer,
    /// Of `indices`.
    count: u32,
}

impl Ribbons {
    /// Of `indices`, for a straight piece: two triangles.
    const BYTES_PER_PIECE: u64 = 24;

    fn new(device: &wgpu::Device, segments: &[u32], pieces: u32) -> Ribbons {
        // Segments that follow each other share a vertex; after the last of a run its end comes.
        let mut entries: Vec<u32> = Vec::with_capacity(segments.len() + segments.len() / 8);
        let mut indices: Vec<u32> = Vec::with_capacity(6 * segments.len() * pieces as usize);
        for (at, &first) in segments.iter().enumerate() {
            let pairs = entries.len() as u32 * pieces;
            entries.push(first);
            // The first vertex of a triangle says which segment it is of.
            for left in (pairs..pairs + pieces).map(|pair| 2 * pair) {
                indices.extend([left, left + 1, left + 2, left + 1, left + 3, left + 2]);
            }
            if segments.get(at + 1) != Some(&(first + 1)) {
                entries.push(first + 1);
            }
        }
        let buffer = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("ribbons"),
            contents: bytemuck::cast_slice(&indices),
            usage: wgpu::BufferUsages::INDEX,
        });
        let segments = storage(device, "segments", bytemuck::cast_slice(&entries));
        Ribbons { segments, indices: buffer, count: indices.len() as u32 }
    }
}

/// The buffers of one frame, all born zero.
struct Work {
    /// Of the frame in pixels, and of the visibility buffer.
    size: [u32; 2],
    texels: [u32; 2],
    visibility: wgpu::TextureView,
    depth: wgpu::TextureView,
    marks: wgpu::Buffer,
    head_seen: wgpu::Buffer,
    needed: wgpu::Buffer,
    radiance: wgpu::Buffer,
    sum: wgpu::Buffer,
    hair_sum: wgpu::Buffer,
}

impl Work {
    fn new(device: &wgpu::Device, counts: [u32; 2], size: [u32; 2], grid: u32) -> Work {
        let texels = size.map(|s| grid * s);
        let target = |label, format, usage| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: texels[0],
                    height: texels[1],
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: SAMPLES_PER_TEXEL,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            });
            texture.create_view(&Default::default())
        };
        let zeros = |label, size: u64, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size.max(16),
                usage: wgpu::BufferUsages::STORAGE | usage,
                mapped_at_creation: false,
            })
        };
        let [points, triangles] = counts.map(u64::from);
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let (nothing, read) = (wgpu::BufferUsages::empty(), wgpu::BufferUsages::COPY_SRC);
        let again = read | wgpu::BufferUsages::COPY_DST;
        Work {
            size,
            texels,
            visibility: target("visibility", VISIBILITY, wgpu::TextureUsages::TEXTURE_BINDING),
            depth: target("depth", DEPTH, wgpu::TextureUsages::empty()),
            marks: zeros("marks", 4 * points, nothing),
            head_seen: zeros("head seen", 4 * triangles, read),
            needed: zeros("needed", NEEDED_LIST + 4 * points, again),
            radiance: zeros("radiance", 16 * points, read),
            sum: zeros("sum", 16 * pixels, again),
            hair_sum: zeros("hair sum", 4 * pixels, again),
        }
    }

    /// What was seen of the head so far.
    fn head(&self, gpu: &Gpu, lenses: &[Lens], sampling: Sampling) -> Result<SeenHead> {
        let seen: Vec<u32> = gpu.read(&self.head_seen)?;
        let a_pixel = sampling.looks * sampling.grid * sampling.grid * SAMPLES_PER_TEXEL;
        let pixels = seen.into_iter().map(|samples| samples as f32 / a_pixel as f32).collect();
        let pixel = |lens: &Lens| {
            (2.0 * lens.right.length() * lens.eye.length()) as f32 / lens.size[0] as f32
        };
        Ok(SeenHead { pixels, pixel: lenses.iter().map(pixel).fold(f32::INFINITY, f32::min) })
    }

    /// The points listed so far.
    fn listed(&self, gpu: &Gpu) -> Result<Vec<u32>> {
        let needed: Vec<u32> = gpu.read(&self.needed)?;
        let list = &needed[NEEDED_LIST as usize / 4..];
        Ok(list[..needed[0] as usize].to_vec())
    }
}

/// How samples are spread: passes of grid × grid texels a pixel, four samples each.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sampling {
    grid: u32,
    passes: u32,
    /// Passes that look for what is seen: all others draw that alone.
    looks: u32,
}

impl Sampling {
    /// A pass costs as much for its vertices as for its samples, so sixteen samples are best taken at once,
    /// as long as the visibility buffer (48 bytes a texel) stays within 256 MiB.
    ///
    /// `look`: samples that find what is seen.
    fn new([samples, look]: [u32; 2], size: [u32; 2], edge: u32) -> Sampling {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let fits = 4 * 48 * pixels <= 256 << 20 && size.iter().all(|&s| 2 * s <= edge);
        let grid = if samples >= 4 * SAMPLES_PER_TEXEL && fits { 2 } else { 1 };
        let passes = |samples: u32| samples.div_ceil(grid * grid * SAMPLES_PER_TEXEL).max(1);
        Sampling { grid, passes: passes(samples), looks: passes(look.min(samples)) }
    }
}

/// Offset of a pass in pixels, within a texel of the grid: the R2 sequence, and 0 for a lone pass.
fn jitter(pass: u32, sampling: Sampling) -> Vec2 {
    if sampling.passes == 1 {
        return Vec2::ZERO;
    }
    let n = f64::from(pass) + 0.5;
    let at = |a: f64| ((n * a).fract() - 0.5) as f32 / sampling.grid as f32;
    Vec2::new(at(0.754_877_666_246_693), at(0.569_840_290_998_053))
}

fn float_texture(
    gpu: &Gpu,
    label: &str,
    [width, height]: [u32; 2],
    texels: &[Vec4],
) -> wgpu::TextureView {
    let (size, texels) = ([width, height, 1], bytemuck::cast_slice(texels));
    let format = wgpu::TextureFormat::Rgba32Float;
    texture_of(gpu, label, size, wgpu::TextureDimension::D2, format, texels)
}
