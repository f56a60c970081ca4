//! Light that visible points have from other strands and from the head, by paths from them (shaders/gather.wgsl).
//!
//! Scattering is evaluated on the device. Rays are cast there too, but for a CPU's adapter, on which the CPU itself casts them
//! (see `transmittance`).

use std::cell::Cell;
use std::f32::consts::PI;
use std::sync::Arc;

use anyhow::Result;
use glam::{Vec3, Vec4};
use half::f16;
use rayon::prelude::*;

use super::Gpu;
use super::method::{Integrator, MethodData};
use super::resources::*;
use super::transmittance::PointTransmittance;
use super::uniforms::{CastUniform, FieldGrid, GatherSumUniform, GatherUniform, HeadPlace, Path};
use crate::field::{Judged, correction};
use crate::reference::tracer::strands::{CLEAR_RADII, StrandRay};
use crate::reference::transmittance::{Met, StrandRays};
use crate::srbf::ORDINATES;
use crate::stage::Geometry;
use crate::transport::draws::hashed;

/// Paths between two looks at whether to go on: 0.1 s on two cores.
const PATHS_PER_BATCH: usize = 1 << 16;

/// Strands that a path meets before the field stands for what comes. Relative L2 of a 360×240 bob, 64 paths a point, 64
/// samples, with 1, 2, 3 and 6: blond under sunset 11.5, 10.4, 10.1 and 10.2 %, white under overcast 7.8, 6.9, 6.7 and
/// 6.7 %, blond under studio 8.1, 5.1, 4.7 and 5.6 %.
const STRANDS_OF_POINTS: u32 = 2;

/// Paths of a place on the head, of which the builtin one has 16,200; neighbours even them out.
const PATHS_PER_PLACE: u32 = 32;

/// Beside so many paths one is whole: it goes on to so many strands, and corrects the field. Of white hair under overcast and
/// studio FLIP to the truth is 0.072 and 0.120 with one of sixteen, 0.066 and 0.107 with one of four, for 1.6 times the time.
const PATHS_PER_TRIAL: usize = 8;
const STRANDS_OF_TRIALS: u32 = 32;

/// As shaders/paths.wgsl has them.
const HIT_NOTHING: u32 = u32::MAX;
const HIT_HEAD: u32 = 1 << 31;

/// What is gathered, and by what.
pub struct Gather {
    /// Paths of a point, and times as many once rays were added.
    paths: u32,
    times: u32,
    /// Of the triangles of the stage's head, corner by corner.
    head_radiance: wgpu::Buffer,
    /// What casts rays in the device's place.
    rays: Option<Arc<StrandRays>>,
}

/// What a gather takes from the renderer.
pub(super) struct GatherScene<'a> {
    pub gpu: &'a Gpu,
    pub method: &'a MethodData,
    /// What the device casts rays by.
    pub traced: &'a PointTransmittance,
    pub strand_points: &'a wgpu::Buffer,
    pub strand_ends: &'a wgpu::Buffer,
    /// Strand of every point.
    pub strand_of: &'a [u32],
    pub lights: &'a wgpu::Buffer,
    pub light_count: u32,
    pub sky_count: u32,
    pub lamp_count: u32,
    pub painted: &'a wgpu::TextureView,
    /// Bits of the parts that are asked for.
    pub parts: u32,
    /// Light between strands: texture, sampler, and where it is; None where there is none.
    pub field: (&'a wgpu::TextureView, &'a wgpu::Sampler, Option<(FieldGrid, f32)>),
}

/// Compiled for one kind of method.
pub(super) struct GatherPipelines {
    integrator: Integrator,
    constants: Vec<(&'static str, f64)>,
    layouts: Layouts,
    aim: wgpu::ComputePipeline,
    aim_head: wgpu::ComputePipeline,
    meet: wgpu::ComputePipeline,
    cast_nearest: wgpu::ComputePipeline,
    cast_any: wgpu::ComputePipeline,
    sum: wgpu::ComputePipeline,
    even_out: wgpu::ComputePipeline,
}

/// Of bindings; the shader's third group is another for each entry point.
struct Layouts {
    fibre: wgpu::BindGroupLayout,
    points: wgpu::BindGroupLayout,
    aim: wgpu::BindGroupLayout,
    aim_head: wgpu::BindGroupLayout,
    meet: wgpu::BindGroupLayout,
}

impl Layouts {
    fn new(device: &wgpu::Device) -> Layouts {
        use Bound::{Float3d, Read, Sampler, Uint2d, Uniform, Write};
        let of = |bindings: &[(u32, Bound)]| layout(device, bindings);
        Layouts {
            fibre: of(&[(0, Uniform), (1, Read), (2, Read)]),
            points: of(&[(0, Uniform), (1, Read), (2, Read), (3, Write), (4, Uint2d)]),
            aim: of(&[(0, Read)]),
            aim_head: of(&[(6, Read)]),
            meet: of(&[(1, Write), (2, Read), (3, Read), (4, Float3d), (5, Sampler), (7, Float3d)]),
        }
    }
}

impl GatherPipelines {
    /// `known` where it is of the same kind.
    fn new(known: Option<GatherPipelines>, scene: &GatherScene) -> GatherPipelines {
        let GatherScene { gpu, method, lamp_count, .. } = *scene;
        let integrator = method.integrator;
        let mut constants = method.constants();
        constants.push(("LAMPS", f64::from(method.general || lamp_count > 0)));
        if let Some(known) = known
            && known.integrator == integrator
            && known.constants == constants
        {
            return known;
        }
        let Gpu { device, shaders, .. } = gpu;
        let layouts = Layouts::new(device);
        let scattering = module(device, "gather", &shaders.gather(integrator));
        let cast = module(device, "cast", &shaders.cast());
        let sum = module(device, "gather sum", &shaders.gather_sum());
        let of = |entry, last| {
            let groups = [&layouts.fibre, &layouts.points, last];
            pipeline_over(device, &scattering, entry, &groups, &constants)
        };
        GatherPipelines {
            aim: of("aim", &layouts.aim),
            aim_head: of("aim_head", &layouts.aim_head),
            meet: of("meet", &layouts.meet),
            cast_nearest: compute_pipeline(device, &cast, "cast_nearest", &[]),
            cast_any: compute_pipeline(device, &cast, "cast_any", &[]),
            sum: compute_pipeline(device, &sum, "sum", &[]),
            even_out: compute_pipeline(device, &sum, "even_out", &[]),
            integrator,
            constants,
            layouts,
        }
    }
}

/// Where paths begin.
enum Origins<'a> {
    /// Strand points, seen from an eye.
    Points(Vec3, &'a [u32]),
    Head(&'a [HeadPlace]),
}

impl Gather {
    /// `paths` of each point; `rays` cast in the device's place.
    pub fn new(gpu: &Gpu, paths: u32, rays: Option<Arc<StrandRays>>) -> Gather {
        let head_radiance = storage(&gpu.device, "corner radiance", &[]);
        Gather { paths: paths.max(1), times: 1, head_radiance, rays }
    }

    /// Sets the irradiance at the vertices of the stage's head, linear RGB.
    pub(super) fn set_head(&mut self, gpu: &Gpu, stage: &Geometry, irradiance: &[Vec3]) {
        let to_radiance = stage.head_albedo / PI;
        let triangles = stage.head.as_ref().map_or(&[][..], |head| &head.triangles);
        let radiance = |&vertex: &u32| {
            let irradiance = irradiance.get(vertex as usize).copied().unwrap_or_default();
            (irradiance * to_radiance).extend(1.0)
        };
        let corners: Vec<Vec4> = triangles.iter().flatten().map(radiance).collect();
        self.head_radiance =
            storage(&gpu.device, "corner radiance", bytemuck::cast_slice(&corners));
    }

    pub(super) fn paths_per_point(&self) -> u32 {
        self.paths * self.times
    }

    /// From now on points have `times` as many paths as were asked for.
    pub(super) fn multiply(&mut self, times: u32) {
        self.times = times;
    }

    /// Whether rays are cast on the device.
    pub(super) fn casts_on_device(&self) -> bool {
        self.rays.is_none()
    }

    /// Writes what `points` have, seen from `eye`, to their places in `radiance`. `known` pipelines are used again. False
    /// where `go_on` said no.
    ///
    /// # Errors
    /// The device was lost.
    pub(super) fn at_points(
        &self,
        scene: &GatherScene,
        known: &mut Option<GatherPipelines>,
        (eye, points): (Vec3, &[u32]),
        radiance: &wgpu::Buffer,
        go_on: &dyn Fn() -> bool,
    ) -> Result<bool> {
        if points.is_empty() || scene.light_count == 0 {
            return Ok(true);
        }
        let before = known.take();
        let pipelines = &*known.insert(GatherPipelines::new(before, scene));
        let Gpu { device, queue, .. } = scene.gpu;
        let seen = storage(device, "seen", bytemuck::cast_slice(points));
        let means = storage_of(device, "gathered", 16 * scene.strand_of.len() as u64);
        let origins = Origins::Points(eye, points);
        let paths = self.paths_per_point();
        let Some(correction) = self.correct_field(scene, pipelines, (eye, points), go_on)? else {
            return Ok(false);
        };
        let ask = Ask { paths, strands: STRANDS_OF_POINTS, judged: u32::MAX };
        let into = Some(&means);
        if self
            .collect(scene, pipelines, ask, (&origins, &seen), &correction, into, go_on)?
            .is_none()
        {
            return Ok(false);
        }
        let count = points.len() as u32;
        let sums = sum_uniform(device, paths, [0, count]);
        let bound = [
            buffer(0, &sums),
            buffer(1, &seen),
            buffer(4, &means),
            buffer(5, scene.strand_ends),
            buffer(6, radiance),
        ];
        let bound = group(device, &pipelines.even_out.get_bind_group_layout(0), &bound);
        let mut encoder = device.create_command_encoder(&Default::default());
        dispatch(&mut encoder, "even out", &pipelines.even_out, &[&bound], count);
        queue.submit([encoder.finish()]);
        Ok(true)
    }

    /// Irradiance that `places` on the head have from the sky, from strands and from the head, linear RGB; None where
    /// `go_on` said no.
    ///
    /// # Errors
    /// The device was lost.
    pub(super) fn at_head(
        &self,
        scene: &GatherScene,
        known: &mut Option<GatherPipelines>,
        places: &[HeadPlace],
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<Vec<Vec3>>> {
        if places.is_empty() || scene.light_count == 0 {
            return Ok(Some(vec![Vec3::ZERO; places.len()]));
        }
        let before = known.take();
        let pipelines = &*known.insert(GatherPipelines::new(before, scene));
        let device = &scene.gpu.device;
        let means = storage_of(device, "gathered", 16 * places.len() as u64);
        let even = self.no_correction(scene);
        let all: Vec<u32> = (0..places.len() as u32).collect();
        let all = storage(device, "places", bytemuck::cast_slice(&all));
        let origins = Origins::Head(places);
        let ask = Ask { paths: PATHS_PER_PLACE, strands: 1, judged: u32::MAX };
        let into = Some(&means);
        if self.collect(scene, pipelines, ask, (&origins, &all), &even, into, go_on)?.is_none() {
            return Ok(None);
        }
        let means: Vec<Vec4> = scene.gpu.read(&means)?;
        Ok(Some(means.into_iter().map(|mean| PI * mean.truncate()).collect()))
    }

    /// By what the field is to be multiplied where paths from `points` end in it: found by some that go on. None where
    /// `go_on` said no.
    fn correct_field(
        &self,
        scene: &GatherScene,
        pipelines: &GatherPipelines,
        (eye, points): (Vec3, &[u32]),
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<wgpu::TextureView>> {
        let even = self.no_correction(scene);
        let Some((grid, _)) = scene.field.2 else { return Ok(Some(even)) };
        // Those of a smaller share are among those of a larger one, whatever is seen.
        let paths = self.paths_per_point() as usize;
        let sparse = PATHS_PER_TRIAL.div_ceil(paths).next_power_of_two().ilog2();
        let mut some: Vec<u32> = points.to_vec();
        some.retain(|&point| hashed(point).trailing_zeros() >= sparse);
        some.sort_unstable();
        let list = storage(&scene.gpu.device, "trials", bytemuck::cast_slice(&some));
        let paths = (paths / PATHS_PER_TRIAL).max(1) as u32;
        let ask = Ask { paths, strands: STRANDS_OF_TRIALS, judged: STRANDS_OF_POINTS };
        let origins = Origins::Points(eye, &some);
        let judged = self.collect(scene, pipelines, ask, (&origins, &list), &even, None, go_on)?;
        let Some(judged) = judged else { return Ok(None) };
        let dims = grid.dims.to_array().map(|n| n as usize);
        let (dims, texels) = correction(dims, &judged);
        Ok(Some(volume_texture(scene.gpu, "correction", dims, &texels)))
    }

    fn no_correction(&self, scene: &GatherScene) -> wgpu::TextureView {
        volume_texture(scene.gpu, "correction", [1; 3], &[[f16::ONE.to_bits(); 4]])
    }

    /// Writes the mean over the paths of each origin to `means`, at the places that `list` has. What the field is judged by,
    /// path by path, where that is asked for; None where `go_on` said no.
    #[allow(clippy::too_many_arguments)]
    fn collect(
        &self,
        scene: &GatherScene,
        pipelines: &GatherPipelines,
        ask: Ask,
        (origins, list): (&Origins, &wgpu::Buffer),
        correction: &wgpu::TextureView,
        means: Option<&wgpu::Buffer>,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<Vec<Judged>>> {
        let Ask { paths, strands, judged } = ask;
        let mut all_judged = Vec::new();
        let Gpu { device, queue, .. } = scene.gpu;
        let layouts = &pipelines.layouts;
        let (eye, origin_count) = match origins {
            Origins::Points(eye, points) => (*eye, points.len()),
            Origins::Head(places) => (Vec3::ZERO, places.len()),
        };
        if origin_count == 0 {
            return Ok(Some(all_judged));
        }
        let (aim, of_aim) = match origins {
            Origins::Points(..) => {
                (&pipelines.aim, group(device, &layouts.aim, &[buffer(0, list)]))
            }
            Origins::Head(places) => {
                let places = storage(device, "head places", bytemuck::cast_slice(places));
                let bound = group(device, &layouts.aim_head, &[buffer(6, &places)]);
                (&pipelines.aim_head, bound)
            }
        };
        let per_batch = (PATHS_PER_BATCH / paths as usize).max(64);
        let most = (per_batch.min(origin_count) * paths as usize) as u64;
        let slots = storage_of(device, "paths", 2 * size_of::<Path>() as u64 * most);
        let kinds = if judged < strands { 4 } else { 2 };
        let hits = storage_of(device, "hits", kinds * 16 * most);
        let scattering = scattering_group(scene, pipelines);
        let of_meet = self.meet_group(scene, pipelines, correction, &hits);
        for first in (0..origin_count).step_by(per_batch) {
            if !go_on() {
                return Ok(None);
            }
            let count = per_batch.min(origin_count - first);
            let at = [first as u32, count as u32];
            let of_points = |event: u32| {
                let uniform = uniform(scene, ask, eye, at, event);
                group(
                    device,
                    &layouts.points,
                    &[
                        buffer(0, &uniform),
                        buffer(1, scene.strand_points),
                        buffer(2, scene.strand_ends),
                        buffer(3, &slots),
                        texture(4, scene.painted),
                    ],
                )
            };
            let all = count as u32 * paths;
            let over = Cell::new(false);
            let batch = Batch { scene, pipelines, paths: &slots, hits: &hits, count: all, over };
            let mut encoder = device.create_command_encoder(&Default::default());
            let groups = [&scattering, &of_points(0), &of_aim];
            dispatch(&mut encoder, "aim", aim, &groups, count as u32);
            for event in 0..strands {
                encoder = batch.cast(encoder, Cast::Nearest, self.rays.as_deref())?;
                let groups = [&scattering, &of_points(event), &of_meet];
                dispatch(&mut encoder, "meet", &pipelines.meet, &groups, all);
                encoder = batch.cast(encoder, Cast::Any, self.rays.as_deref())?;
                if batch.over.get() {
                    break;
                }
            }
            if let Some(means) = means {
                let sums = sum_uniform(device, paths, at);
                let bound = [buffer(0, &sums), buffer(1, list), buffer(3, &hits), buffer(4, means)];
                let bound = group(device, &pipelines.sum.get_bind_group_layout(0), &bound);
                dispatch(&mut encoder, "gather sum", &pipelines.sum, &[&bound], count as u32);
            }
            queue.submit([encoder.finish()]);
            scene.gpu.wait()?;
            if judged < strands {
                let all = u64::from(all);
                let hits: Vec<[u32; 4]> = scene.gpu.read_part(&hits, 16 * all, 3 * 16 * all)?;
                all_judged.extend(judged_of(&hits));
            }
        }
        Ok(Some(all_judged))
    }

    fn meet_group(
        &self,
        scene: &GatherScene,
        pipelines: &GatherPipelines,
        correction: &wgpu::TextureView,
        hits: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let (field, field_sampler, _) = scene.field;
        let bound = [
            buffer(1, hits),
            buffer(2, scene.lights),
            buffer(3, &self.head_radiance),
            texture(4, field),
            sampler(5, field_sampler),
            texture(7, correction),
        ];
        group(&scene.gpu.device, &pipelines.layouts.meet, &bound)
    }
}

/// How paths go.
#[derive(Clone, Copy)]
struct Ask {
    /// From each origin.
    paths: u32,
    /// That they meet at most.
    strands: u32,
    /// After which the field is compared with what a path goes on to find.
    judged: u32,
}

/// Of the hits of second slots and the two kinds after them, as shaders/gather.wgsl leaves them.
fn judged_of(hits: &[[u32; 4]]) -> impl Iterator<Item = Judged> {
    /// Parts of a cell in which a place is told.
    const STEPS: f32 = 32.0;
    let all = hits.len() / 3;
    let rgb = |words: [u32; 4]| Vec3::from_array([0, 1, 2].map(|k| f32::from_bits(words[k])));
    (0..all).map(move |path| {
        let [last, foretold, before] = [0, 1, 2].map(|kind| hits[kind * all + path]);
        let steps = [0, 10, 20].map(|shift| (foretold[3] >> shift & 1023) as f32 + 0.5);
        Judged {
            cell: Vec3::from_array(steps) / STEPS,
            foretold: rgb(foretold),
            found: rgb(last) - rgb(before),
        }
    })
}

fn uniform(
    scene: &GatherScene,
    Ask { paths, strands, judged }: Ask,
    eye: Vec3,
    [first, count]: [u32; 2],
    event: u32,
) -> wgpu::Buffer {
    let ordinates = ORDINATES as u32;
    let (grid, overlap) = scene.field.2.unwrap_or((FieldGrid::NONE, 0.0));
    let uniform = GatherUniform {
        eye,
        paths,
        grid,
        first,
        count,
        lights: scene.light_count,
        lamps: scene.lamp_count,
        first_ordinate: scene.light_count.saturating_sub(ordinates),
        ordinates,
        ordinate_share: overlap,
        parts: scene.parts,
        sky: scene.sky_count,
        event,
        strands,
        judged,
    };
    uniform_buffer(&scene.gpu.device, "gather", bytemuck::bytes_of(&uniform))
}

fn sum_uniform(device: &wgpu::Device, paths: u32, [first, count]: [u32; 2]) -> wgpu::Buffer {
    let uniform = GatherSumUniform { first, count, paths, pad: 0 };
    uniform_buffer(device, "gather sum", bytemuck::bytes_of(&uniform))
}

fn scattering_group(scene: &GatherScene, pipelines: &GatherPipelines) -> wgpu::BindGroup {
    let (device, method) = (&scene.gpu.device, scene.method);
    let fibre = uniform_buffer(device, "fibre", bytemuck::bytes_of(&method.fibre));
    let [a, b] = method.tables.each_ref().map(|table| storage(device, "table", table));
    let bound = [buffer(0, &fibre), buffer(1, &a), buffer(2, &b)];
    group(device, &pipelines.layouts.fibre, &bound)
}

/// A storage buffer of `size` bytes, all 0, that is read back and written to.
fn storage_of(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    let usage =
        wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
    let descriptor =
        wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
    device.create_buffer(&descriptor)
}

#[derive(Clone, Copy)]
enum Cast {
    Nearest,
    Any,
}

/// Paths whose rays are cast together.
struct Batch<'a> {
    scene: &'a GatherScene<'a>,
    pipelines: &'a GatherPipelines,
    paths: &'a wgpu::Buffer,
    hits: &'a wgpu::Buffer,
    count: u32,
    /// Whether none goes on, as far as is known.
    over: Cell<bool>,
}

impl Batch<'_> {
    /// Casts the rays that `encoder` prepares; returns one to go on with.
    fn cast(
        &self,
        mut encoder: wgpu::CommandEncoder,
        cast: Cast,
        host: Option<&StrandRays>,
    ) -> Result<wgpu::CommandEncoder> {
        let Gpu { device, queue, .. } = self.scene.gpu;
        let Some(rays) = host else {
            self.on_device(&mut encoder, cast);
            return Ok(encoder);
        };
        queue.submit([encoder.finish()]);
        let gpu = self.scene.gpu;
        let count = u64::from(self.count);
        let first = match cast {
            Cast::Nearest => 0,
            Cast::Any => count,
        };
        let size = size_of::<Path>() as u64;
        let paths: Vec<Path> = gpu.read_part(self.paths, size * first, size * count)?;
        let mut hits = match cast {
            Cast::Nearest => vec![words(Met::Nothing); paths.len()],
            Cast::Any => gpu.read_part(self.hits, 16 * first, 16 * count)?,
        };
        let ray = |path: &Path| {
            let strand = self.scene.strand_of[path.own[0] as usize];
            let radius = path.clear / CLEAR_RADII;
            StrandRay::along(path.origin, radius, strand, path.direction, path.most)
        };
        if let Cast::Nearest = cast {
            self.over.set(paths.iter().all(|path| path.most <= 0.0));
        }
        hits.par_iter_mut().zip(&paths).with_min_len(256).for_each(|(hit, path)| match cast {
            _ if path.most <= 0.0 => {}
            Cast::Nearest => *hit = words(rays.cast_nearest(&ray(path))),
            Cast::Any if rays.cast_any(&ray(path)) => {
                for (word, more) in hit.iter_mut().zip(path.weight.to_array()) {
                    *word = (f32::from_bits(*word) + more).to_bits();
                }
            }
            Cast::Any => {}
        });
        queue.write_buffer(self.hits, 16 * first, bytemuck::cast_slice(&hits));
        Ok(device.create_command_encoder(&Default::default()))
    }

    fn on_device(&self, encoder: &mut wgpu::CommandEncoder, cast: Cast) {
        let Some(([bvh, items, shapes], head)) = self.scene.traced.met() else { return };
        let device = &self.scene.gpu.device;
        let pipeline = match cast {
            Cast::Nearest => &self.pipelines.cast_nearest,
            Cast::Any => &self.pipelines.cast_any,
        };
        let uniform = CastUniform { count: self.count, pad: 0, head };
        let uniform = uniform_buffer(device, "cast", bytemuck::bytes_of(&uniform));
        let bound = [
            buffer(0, bvh),
            buffer(1, items),
            buffer(3, shapes),
            buffer(4, self.paths),
            buffer(5, self.hits),
            buffer(6, &uniform),
        ];
        let bound = group(device, &pipeline.get_bind_group_layout(0), &bound);
        dispatch(encoder, "cast", pipeline, &[&bound], self.count);
    }
}

/// As shaders/paths.wgsl has a hit.
fn words(met: Met) -> [u32; 4] {
    match met {
        Met::Nothing => [HIT_NOTHING, 0, 0, 0],
        Met::Strand { point, path } => [point, path.to_bits(), 0, 0],
        Met::Head { triangle, path, weights } => {
            [HIT_HEAD | triangle, path.to_bits(), weights[1].to_bits(), weights[2].to_bits()]
        }
    }
}

/// Runs one thread for each of `count` items, 64 in a workgroup.
fn dispatch(
    encoder: &mut wgpu::CommandEncoder,
    label: &'static str,
    pipeline: &wgpu::ComputePipeline,
    groups: &[&wgpu::BindGroup],
    count: u32,
) {
    let mut pass = begin(encoder, label, None);
    pass.set_pipeline(pipeline);
    for (place, group) in (0..).zip(groups) {
        pass.set_bind_group(place, *group, &[]);
    }
    pass.dispatch_workgroups(count.div_ceil(64), 1, 1);
}
