//! Light that visible points have from other strands and from the head, by paths from them (shaders/gather.wgsl).
//!
//! Scattering is evaluated on the device. Rays are cast there too, but for a CPU's adapter, on which the CPU itself casts them
//! (see `transmittance`).

use std::f32::consts::PI;
use std::sync::Arc;

use anyhow::Result;
use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::Gpu;
use super::method::{Integrator, MethodData};
use super::resources::*;
use super::transmittance::PointTransmittance;
use super::uniforms::{
    CastUniform, FieldGrid, GatherSumUniform, GatherUniform, HeadPlace, Path, Queue,
};
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
    pub sky_map: &'a wgpu::TextureView,
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
    shine: wgpu::ComputePipeline,
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
        use Bound::{Float2d, Float3d, Read, Sampler, Uint2d, Uniform, Write};
        let of = |bindings: &[(u32, Bound)]| layout(device, bindings);
        Layouts {
            fibre: of(&[(0, Uniform), (1, Read), (2, Read)]),
            points: of(&[
                (0, Uniform),
                (1, Read),
                (2, Read),
                (3, Write),
                (4, Uint2d),
                (5, Uniform),
            ]),
            aim: of(&[(0, Read)]),
            aim_head: of(&[(6, Read)]),
            meet: of(&[
                (1, Write),
                (2, Read),
                (3, Read),
                (4, Float3d),
                (5, Sampler),
                (7, Float3d),
                (8, Float2d),
            ]),
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
            shine: of("shine", &layouts.meet),
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
        let threads = Threads::Count(count);
        dispatch(&mut encoder, "even out", &pipelines.even_out, &[&bound], threads);
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
        let (dims, texels) = correction(dims_of(&grid), &judged);
        Ok(Some(volume_texture(scene.gpu, "correction", dims, &texels)))
    }

    /// A correction that changes nothing. Of the size of one that does: lavapipe compiles a shader for each kind of size.
    fn no_correction(&self, scene: &GatherScene) -> wgpu::TextureView {
        let dims = scene.field.2.map_or([1; 3], |(grid, _)| dims_of(&grid));
        let (dims, texels) = correction(dims, &[]);
        volume_texture(scene.gpu, "correction", dims, &texels)
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
        let most = per_batch.min(origin_count) as u32 * paths;
        let judges = judged < strands;
        let flight = Flight::new(scene, pipelines, self.rays.as_deref(), most, judges);
        let scattering = scattering_group(scene, pipelines);
        let of_meet = self.meet_group(scene, pipelines, correction, &flight.hits);
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
                        buffer(3, &flight.paths),
                        texture(4, scene.painted),
                        buffer(5, &flight.queues),
                    ],
                )
            };
            let all = count as u32 * paths;
            let mut encoder = flight.begin(all);
            let groups = [&scattering, &of_points(0), &of_aim];
            dispatch(&mut encoder, "aim", aim, &groups, Threads::Count(count as u32));
            let mut onward = all;
            for event in 0..strands {
                let of_points = of_points(event);
                let groups = [&scattering, &of_points, &of_meet];
                encoder = flight.cast_nearest(encoder, (all, event), onward)?;
                encoder.copy_buffer_to_buffer(&flight.empty, 0, &flight.hits, 0, HITS_LIST);
                dispatch(&mut encoder, "meet", &pipelines.meet, &groups, flight.threads(ONWARD));
                flight.take_queues(&mut encoder);
                (encoder, onward) = flight.cast_any(encoder, all)?;
                dispatch(&mut encoder, "shine", &pipelines.shine, &groups, flight.threads(OPEN));
                if onward == 0 {
                    break;
                }
            }
            if let Some(means) = means {
                let sums = sum_uniform(device, paths, at);
                let bound =
                    [buffer(0, &sums), buffer(1, list), buffer(3, &flight.hits), buffer(4, means)];
                let bound = group(device, &pipelines.sum.get_bind_group_layout(0), &bound);
                let threads = Threads::Count(count as u32);
                dispatch(&mut encoder, "gather sum", &pipelines.sum, &[&bound], threads);
            }
            queue.submit([encoder.finish()]);
            scene.gpu.wait()?;
            if judges {
                let all = u64::from(all);
                let from = HITS_LIST + 2 * 16 * all;
                let hits: Vec<[u32; 4]> = scene.gpu.read_part(&flight.hits, from, 3 * 16 * all)?;
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
            texture(8, scene.sky_map),
        ];
        group(&scene.gpu.device, &pipelines.layouts.meet, &bound)
    }
}

fn dims_of(grid: &FieldGrid) -> [usize; 3] {
    grid.dims.to_array().map(|n| n as usize)
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

/// Of what paths found and the two kinds of hits after that, as shaders/gather.wgsl leaves them.
fn judged_of(hits: &[[u32; 4]]) -> impl Iterator<Item = Judged> {
    /// Parts of a cell in which a place is told.
    const STEPS: f32 = 32.0;
    const KNOWN: u32 = 1 << 31;
    let all = hits.len() / 3;
    let rgb = |words: [u32; 4]| Vec3::from_array([0, 1, 2].map(|k| f32::from_bits(words[k])));
    (0..all).filter_map(move |path| {
        let [last, foretold, before] = [0, 1, 2].map(|kind| hits[kind * all + path]);
        let steps = [0, 10, 20].map(|shift| (foretold[3] >> shift & 1023) as f32 + 0.5);
        let went_on = before[3] == KNOWN;
        (foretold[3] & KNOWN != 0).then(|| Judged {
            cell: Vec3::from_array(steps) / STEPS,
            foretold: rgb(foretold),
            found: if went_on { rgb(last) - rgb(before) } else { Vec3::ZERO },
        })
    })
}

fn uniform(
    scene: &GatherScene,
    Ask { paths, strands, judged }: Ask,
    eye: Vec3,
    [first, count]: [u32; 2],
    event: u32,
) -> wgpu::Buffer {
    let (grid, overlap) = scene.field.2.unwrap_or((FieldGrid::NONE, 0.0));
    let uniform = GatherUniform {
        eye,
        paths,
        grid,
        first,
        count,
        lights: scene.light_count,
        lamps: scene.lamp_count,
        first_ordinate: scene.light_count.saturating_sub(ORDINATES as u32),
        ordinate_share: overlap,
        parts: scene.parts,
        event,
        strands,
        judged,
        pad: [0; 2],
    };
    uniform_buffer(&scene.gpu.device, "gather", bytemuck::bytes_of(&[uniform; 2]))
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
    buffer_of(device, label, size, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC)
}

fn buffer_of(
    device: &wgpu::Device,
    label: &str,
    size: u64,
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    let usage = usage | wgpu::BufferUsages::COPY_DST;
    let descriptor =
        wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
    device.create_buffer(&descriptor)
}

/// Queues: paths that go on, rays to the lights that they draw, and those of them that are open.
const ONWARD: usize = 0;
const SHADOWS: usize = 1;
const OPEN: usize = 2;

/// Offset of the list in `Hits` of shaders/paths.wgsl, which its queues come before.
const HITS_LIST: u64 = 3 * size_of::<Queue>() as u64;

/// Paths that are followed together, and their rays.
struct Flight<'a> {
    scene: &'a GatherScene<'a>,
    pipelines: &'a GatherPipelines,
    /// What casts rays in the device's place.
    host: Option<&'a StrandRays>,
    /// As shaders/paths.wgsl has them.
    paths: wgpu::Buffer,
    hits: wgpu::Buffer,
    /// What `meet` left in the queues of `hits`; and queues that nothing is in.
    queues: wgpu::Buffer,
    empty: wgpu::Buffer,
}

impl<'a> Flight<'a> {
    /// For `most` paths at a time.
    fn new(
        scene: &'a GatherScene<'a>,
        pipelines: &'a GatherPipelines,
        host: Option<&'a StrandRays>,
        most: u32,
        judges: bool,
    ) -> Flight<'a> {
        use wgpu::BufferUsages as Usage;
        let device = &scene.gpu.device;
        let kinds = if judges { 5 } else { 3 };
        let all = u64::from(most);
        let usage = Usage::UNIFORM | Usage::INDIRECT | Usage::COPY_SRC;
        let empty = buffer_of(device, "empty", HITS_LIST, Usage::COPY_SRC);
        scene.gpu.queue.write_buffer(&empty, 0, bytemuck::bytes_of(&[Queue::of(0); 3]));
        Flight {
            paths: storage_of(device, "paths", 3 * size_of::<Path>() as u64 * all),
            hits: storage_of(device, "hits", HITS_LIST + kinds * 16 * all),
            queues: buffer_of(device, "queues", HITS_LIST, usage),
            empty,
            scene,
            pipelines,
            host,
        }
    }

    /// With `all` paths that have found nothing yet.
    fn begin(&self, all: u32) -> wgpu::CommandEncoder {
        let Gpu { device, queue, .. } = self.scene.gpu;
        let queues = [Queue::of(all), Queue::of(0), Queue::of(0)];
        queue.write_buffer(&self.queues, 0, bytemuck::bytes_of(&queues));
        let mut encoder = device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&self.hits, HITS_LIST, None);
        encoder
    }

    /// A thread for each of a queue.
    fn threads(&self, queue: usize) -> Threads<'_> {
        Threads::Queue(&self.queues, (queue * size_of::<Queue>()) as u64)
    }

    /// Has dispatches follow the queues that grew.
    fn take_queues(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.copy_buffer_to_buffer(&self.hits, 0, &self.queues, 0, HITS_LIST);
    }

    /// Casts the rays of paths that go on, `count` of them where the host casts.
    fn cast_nearest(
        &self,
        mut encoder: wgpu::CommandEncoder,
        (all, event): (u32, u32),
        count: u32,
    ) -> Result<wgpu::CommandEncoder> {
        let first = (event & 1) * all;
        let Some(rays) = self.host else {
            let uniform = CastUniform { first, all, head: [0; 2] };
            self.on_device(&mut encoder, &self.pipelines.cast_nearest, uniform, ONWARD);
            return Ok(encoder);
        };
        let Gpu { device, queue, .. } = self.scene.gpu;
        queue.submit([encoder.finish()]);
        let paths = self.read_paths(first, count)?;
        let cast = |path: &Path| match path.most {
            most if most <= 0.0 => words(Met::Nothing),
            _ => words(rays.cast_nearest(&self.ray(path))),
        };
        let hits: Vec<[u32; 4]> = paths.par_iter().with_min_len(256).map(cast).collect();
        queue.write_buffer(&self.hits, HITS_LIST, bytemuck::cast_slice(&hits));
        Ok(device.create_command_encoder(&Default::default()))
    }

    /// Casts rays to lights, and lists those that are open; how many paths go on, as far as that is known.
    fn cast_any(
        &self,
        mut encoder: wgpu::CommandEncoder,
        all: u32,
    ) -> Result<(wgpu::CommandEncoder, u32)> {
        let first = 2 * all;
        let Some(rays) = self.host else {
            let uniform = CastUniform { first, all, head: [0; 2] };
            self.on_device(&mut encoder, &self.pipelines.cast_any, uniform, SHADOWS);
            self.take_queues(&mut encoder);
            return Ok((encoder, all));
        };
        let Gpu { device, queue, .. } = self.scene.gpu;
        queue.submit([encoder.finish()]);
        let queues: Vec<Queue> = self.scene.gpu.read(&self.queues)?;
        let paths = self.read_paths(first, queues[SHADOWS].count)?;
        let open: Vec<[u32; 4]> = (paths.par_iter().enumerate().with_min_len(256))
            .filter(|(_, path)| rays.cast_any(&self.ray(path)))
            .map(|(at, _)| [at as u32, 0, 0, 0])
            .collect();
        queue.write_buffer(
            &self.hits,
            HITS_LIST + 16 * u64::from(all),
            bytemuck::cast_slice(&open),
        );
        let queues = [queues[ONWARD], queues[SHADOWS], Queue::of(open.len() as u32)];
        queue.write_buffer(&self.queues, 0, bytemuck::bytes_of(&queues));
        let encoder = device.create_command_encoder(&Default::default());
        Ok((encoder, queues[ONWARD].count))
    }

    fn read_paths(&self, first: u32, count: u32) -> Result<Vec<Path>> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let [first, size] = [first, count].map(|n| size_of::<Path>() as u64 * u64::from(n));
        self.scene.gpu.read_part(&self.paths, first, size)
    }

    fn ray(&self, path: &Path) -> StrandRay {
        let strand = self.scene.strand_of[path.own[0] as usize];
        let radius = path.clear / CLEAR_RADII;
        StrandRay::along(path.origin, radius, strand, path.direction, path.most)
    }

    fn on_device(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pipeline: &wgpu::ComputePipeline,
        uniform: CastUniform,
        queue: usize,
    ) {
        let Some(([bvh, items, shapes], head)) = self.scene.traced.met() else { return };
        let device = &self.scene.gpu.device;
        let uniform = CastUniform { head, ..uniform };
        let uniform = uniform_buffer(device, "cast", bytemuck::bytes_of(&uniform));
        let bound = [
            buffer(0, bvh),
            buffer(1, items),
            buffer(3, shapes),
            buffer(4, &self.paths),
            buffer(5, &self.hits),
            buffer(6, &uniform),
            buffer(7, &self.queues),
        ];
        let bound = group(device, &pipeline.get_bind_group_layout(0), &bound);
        dispatch(encoder, "cast", pipeline, &[&bound], self.threads(queue));
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

/// Threads of a dispatch, 64 in a workgroup.
#[derive(Clone, Copy)]
enum Threads<'a> {
    Count(u32),
    /// As many as a queue (`Queue` of shaders/paths.wgsl) says that is at this offset.
    Queue(&'a wgpu::Buffer, u64),
}

fn dispatch(
    encoder: &mut wgpu::CommandEncoder,
    label: &'static str,
    pipeline: &wgpu::ComputePipeline,
    groups: &[&wgpu::BindGroup],
    threads: Threads,
) {
    let mut pass = begin(encoder, label, None);
    pass.set_pipeline(pipeline);
    for (place, group) in (0..).zip(groups) {
        pass.set_bind_group(place, *group, &[]);
    }
    match threads {
        Threads::Count(count) => pass.dispatch_workgroups(count.div_ceil(64), 1, 1),
        Threads::Queue(queues, offset) => pass.dispatch_workgroups_indirect(queues, offset),
    }
}
