//! The head that is drawn, and the light on it: at vertices, and at points as dense as pixels where shadows begin and end.

use anyhow::Result;
use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::Gpu;
use super::resources::*;
use super::transmittance::PointTransmittance;
use super::uniforms::{HeadPlace, LightingHead};
use crate::head::{Detail, DetailPoint, FineHead, Head, SurfacePlace};
use crate::reference::transmittance::StrandRays;
use crate::srbf::SrbfLight;
use crate::stage::Geometry;
use crate::transport::draws::{self, HeadLight, HeadVertex, TracedLight};

/// Of the hair's radius: longest edge of the triangles that are drawn; and how far above them rays start.
const EDGE: f32 = 1.0 / 24.0;
const LIFT: f32 = 2e-5;
/// A light whose irradiance differs by more than this share of that of all lights together, if none were in the shade,
/// between the corners of a triangle is looked for at points between.
const CONTRAST: f32 = 0.025;
/// How often wide lights are evened out from neighbour to neighbour.
const SOFTENINGS: usize = 3;
/// Rays of a light at such a point: one for so much of its bandwidth, but at least and at most so many. All points look in
/// the same directions, so that its shadows are copies of each other and no noise.
const DETAIL_LAMBDA: f32 = 0.03;
const DETAIL_RAYS: [f32; 2] = [2.0, 10.0];
/// Points along an edge between vertices, at most.
const MOST_ACROSS: f32 = 8.0;

/// Rounds in which what is gathered is evened out from neighbour to neighbour.
const GATHER_SOFTENINGS: usize = 5;

/// Light at the vertices of the head that is drawn.
pub(super) struct VertexLight {
    /// What is known whole: irradiance, linear RGB.
    known: Vec<Vec3>,
    /// What each of the caster's lights of radiance 1 brings, vertex by vertex.
    of_lights: Vec<f32>,
}

/// What cameras see of the head.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenHead {
    /// Pixels that each triangle covers, those of all cameras together.
    pub pixels: Vec<f32>,
    /// A pixel's side at the head, world units.
    pub pixel: f32,
}

/// See the module.
pub(super) struct HeadSurface {
    fine: FineHead,
    center: Vec3,
    pub positions: wgpu::Buffer,
    pub corners: wgpu::Buffer,
    pub corner_count: u32,
    /// At vertices, then at points between them.
    pub radiance: wgpu::Buffer,
    /// Which those are: `Detail` of shaders/resolve.wgsl.
    pub detail: wgpu::Buffer,
    /// Made when first asked for.
    pipeline: Option<wgpu::ComputePipeline>,
}

/// What finds light, and how.
pub(super) struct HeadRayCaster<'a> {
    pub gpu: &'a Gpu,
    pub stage: &'a Geometry,
    /// What the device meets.
    pub traced: &'a PointTransmittance,
    /// What traces in the device's place.
    pub host: Option<&'a StrandRays>,
    /// [`HEAD_LIGHTS`](crate::transport::draws::HEAD_LIGHTS) at most.
    pub lights: &'a [HeadLight],
}

impl HeadSurface {
    pub fn new(device: &wgpu::Device, stage: &Geometry) -> HeadSurface {
        let longest = EDGE * stage.radius;
        let fine = stage.head.as_ref().map(|head| FineHead::new(head, longest)).unwrap_or_default();
        let Head { positions, triangles, .. } = &fine.head;
        let center = stage.center;
        let places: Vec<Vec4> = positions.iter().map(|&p| (p - center).extend(1.0)).collect();
        let corners: Vec<u32> = triangles.iter().flatten().copied().collect();
        let dark = vec![Vec4::ZERO; positions.len()];
        HeadSurface {
            center,
            positions: storage(device, "head positions", bytemuck::cast_slice(&places)),
            corners: storage(device, "head corners", bytemuck::cast_slice(&corners)),
            corner_count: corners.len() as u32,
            radiance: storage(device, "head radiance", bytemuck::cast_slice(&dark)),
            detail: detail_buffer(device, &Detail::default(), 0),
            pipeline: None,
            fine,
        }
    }

    pub fn triangles(&self) -> usize {
        self.fine.head.triangles.len()
    }

    /// Compiles anew when it is next needed.
    pub fn forget_pipeline(&mut self) {
        self.pipeline = None;
    }

    /// What the caster's lights bring to the vertices beside `irradiance`, that of the stage's head's.
    ///
    /// # Errors
    /// The device was lost.
    pub fn at_vertices(
        &mut self,
        irradiance: &[Vec3],
        caster: &mut HeadRayCaster,
    ) -> Result<VertexLight> {
        let mut known = self.fine.spread(irradiance);
        known.resize(self.fine.places.len(), Vec3::ZERO);
        let mut of_lights = Vec::new();
        if let Some(head) = &caster.stage.head
            && !caster.lights.is_empty()
        {
            let of = |(vertex, place): (usize, &SurfacePlace)| {
                self.vertex(head, place, vertex as u32, u64::MAX)
            };
            let places: Vec<HeadVertex> = self.fine.places.par_iter().enumerate().map(of).collect();
            let spread = EDGE * caster.stage.radius;
            let lights = caster.lights;
            of_lights = caster.irradiance(&mut self.pipeline, &places, lights, spread)?;
            self.soften(lights, &mut of_lights);
        }
        Ok(VertexLight { known, of_lights })
    }

    /// Places from which light is gathered for the vertices.
    pub fn places(&self, stage: &Geometry) -> Vec<HeadPlace> {
        let Some(head) = &stage.head else { return Vec::new() };
        let place = |(vertex, place): (usize, &SurfacePlace)| {
            let HeadVertex { position, normal, .. } = self.vertex(head, place, 0, 0);
            let position = position + LIFT * stage.radius * normal;
            HeadPlace { position, seed: vertex as u32, normal, pad: 0 }
        };
        self.fine.places.iter().enumerate().map(place).collect()
    }

    /// Adds what was gathered at [`Self::places`], evened out with neighbours: relative to what a place that faces as it does
    /// would have of the open sky, so that the shape of the head stays.
    pub fn add_gathered(&self, light: &mut VertexLight, gathered: &[Vec3], sky: &[SrbfLight]) {
        let mean = gathered.iter().sum::<Vec3>() / gathered.len().max(1) as f32;
        let lobe = |one: &SrbfLight| {
            let energy = one.energy().map(|e| e as f32);
            (one.direction.as_vec3(), Vec3::from(energy))
        };
        let sky: Vec<(Vec3, Vec3)> = sky.iter().map(lobe).collect();
        let open = |normal: &Vec3| {
            let of = |&(direction, energy): &(Vec3, Vec3)| normal.dot(direction).max(0.0) * energy;
            (sky.iter().map(of).sum::<Vec3>() + mean).max(Vec3::splat(f32::MIN_POSITIVE))
        };
        let open: Vec<Vec3> = self.fine.head.normals.par_iter().map(open).collect();
        let shares = gathered.iter().zip(&open).map(|(&gathered, &open)| gathered / open);
        let shares = self.evened_out(shares.collect());
        let all = light.known.iter_mut().zip(shares).zip(open);
        all.for_each(|((known, share), open)| *known += share * open);
    }

    /// Shows the head in a light, with detail at what is `seen`.
    ///
    /// # Errors
    /// The device was lost.
    pub fn show(
        &mut self,
        light: &VertexLight,
        seen: Option<&SeenHead>,
        mut caster: HeadRayCaster,
    ) -> Result<()> {
        let mut all = light.irradiance(caster.lights);
        let vertices = all.len() as u32;
        let mut detail = Detail::default();
        if let Some(head) = &caster.stage.head
            && let Some(seen) = seen
            && !caster.lights.is_empty()
        {
            detail = self.wanted_detail(light, seen, &caster);
            all.extend(self.at_detail(head, &detail, light, &mut caster)?);
        }
        let to_radiance = caster.stage.head_albedo / std::f32::consts::PI;
        let padded: Vec<Vec4> = all.iter().map(|&e| (e * to_radiance).extend(1.0)).collect();
        let device = &caster.gpu.device;
        self.radiance = storage(device, "head radiance", bytemuck::cast_slice(&padded));
        self.detail = detail_buffer(device, &detail, vertices);
        Ok(())
    }

    /// Values at vertices, each with its neighbours.
    fn evened_out(&self, mut values: Vec<Vec3>) -> Vec<Vec3> {
        for _ in 0..GATHER_SOFTENINGS {
            let mut sums: Vec<(Vec3, f32)> =
                values.iter().map(|&value| (2.0 * value, 2.0)).collect();
            for t in &self.fine.head.triangles {
                for (to, from) in [(0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)] {
                    let (sum, weight) = &mut sums[t[to] as usize];
                    *sum += 0.5 * values[t[from] as usize];
                    *weight += 0.5;
                }
            }
            values = sums.into_iter().map(|(sum, weight)| sum / weight).collect();
        }
        values
    }

    /// Which vertices lie within so many triangles of what is seen.
    fn around(&self, seen: &SeenHead, triangles: usize) -> Vec<bool> {
        let all = &self.fine.head.triangles;
        let mut shown = vec![false; self.fine.places.len()];
        let covered = all.iter().zip(&seen.pixels).filter(|(_, pixels)| **pixels > 0.0);
        covered.flat_map(|(corners, _)| corners).for_each(|&vertex| shown[vertex as usize] = true);
        for _ in 1..triangles {
            let before = shown.clone();
            for corners in all {
                if corners.iter().any(|&vertex| before[vertex as usize]) {
                    corners.iter().for_each(|&vertex| shown[vertex as usize] = true);
                }
            }
        }
        shown
    }

    /// Evens out T̃ of wide lights, of which a vertex has few rays, over vertices that are near each other.
    fn soften(&self, lights: &[HeadLight], all: &mut [f32]) {
        let Head { normals, triangles, .. } = &self.fine.head;
        let sides = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        let sides: Vec<[u32; 2]> = triangles.iter().flat_map(sides).collect();
        let soften = |(j, one): (usize, &HeadLight)| {
            // Of a lobe that is half below the horizon, some arrives.
            let least = 0.3 * one.light.lambda;
            let facing = |normal: &Vec3| one.energy * normal.dot(one.light.direction).max(least);
            let of = |vertex: usize| (all[vertex * lights.len() + j], facing(&normals[vertex]));
            let bare: Vec<(f32, f32)> = (0..normals.len()).map(of).collect();
            let mut sums = bare.clone();
            for _ in 0..SOFTENINGS {
                let before = sums.clone();
                for [a, b] in sides.iter().map(|side| side.map(|vertex| vertex as usize)) {
                    for (to, from) in [(a, b), (b, a)] {
                        sums[to].0 += before[from].0;
                        sums[to].1 += before[from].1;
                    }
                }
                // So that sums do not grow without end.
                sums.iter_mut().for_each(|sum| *sum = (0.1 * sum.0, 0.1 * sum.1));
            }
            let t = |sum: (f32, f32)| sum.0 / sum.1.max(f32::MIN_POSITIVE);
            (j, bare.iter().zip(sums).map(|(bare, sum)| bare.1 * t(sum)).collect())
        };
        let wide = lights.par_iter().enumerate().filter(|(_, one)| one.wide == 1);
        let softened: Vec<(usize, Vec<f32>)> = wide.map(soften).collect();
        for (j, of_vertices) in softened {
            for (vertex, of) in of_vertices.into_iter().enumerate() {
                all[vertex * lights.len() + j] = of;
            }
        }
    }

    /// A lattice where light that is seen differs much from corner to corner.
    fn wanted_detail(
        &self,
        VertexLight { known, of_lights }: &VertexLight,
        seen: &SeenHead,
        caster: &HeadRayCaster,
    ) -> Detail {
        let edge = EDGE * caster.stage.radius / seen.pixel.max(f32::MIN_POSITIVE);
        let across = edge.log2().round().exp2().clamp(1.0, MOST_ACROSS) as u32;
        if across < 2 {
            return Detail::default();
        }
        let triangles = &self.fine.head.triangles;
        let near = self.around(seen, 1);
        let lights = caster.lights.len();
        let of = |vertex: u32| &of_lights[vertex as usize * lights..][..lights];
        let mean = known.iter().map(|e| e.element_sum()).sum::<f32>() / known.len().max(1) as f32;
        let most = CONTRAST * (caster.whole() + mean);
        let rough = |(triangle, corners): (usize, &[u32; 3])| {
            let beside = corners.iter().any(|&vertex| near[vertex as usize]);
            let lights = if beside { caster.differing(corners.map(of), most) } else { 0 };
            (lights != 0).then_some((triangle as u32, lights, seen.pixels[triangle] > 0.0))
        };
        let rough: Vec<(u32, u64, bool)> = triangles.iter().enumerate().filter_map(rough).collect();
        Detail::new(&self.fine, across, &rough)
    }

    /// Irradiance at the points of a lattice: of the lights that differ by rays, of others between corners.
    fn at_detail(
        &mut self,
        head: &Head,
        detail: &Detail,
        light: &VertexLight,
        caster: &mut HeadRayCaster,
    ) -> Result<Vec<Vec3>> {
        let place = |point: &DetailPoint| detail.place(&self.fine, point);
        let of = |point: &DetailPoint| self.vertex(head, &place(point), 0, point.lights);
        let places: Vec<HeadVertex> = detail.points.par_iter().map(of).collect();
        let spread = EDGE * caster.stage.radius / detail.across as f32;
        let [least, most] = DETAIL_RAYS;
        let of_light = |one: &HeadLight| {
            let wide = if one.light.lamp == 1 { most } else { one.light.lambda / DETAIL_LAMBDA };
            let rays = wide.ceil().clamp(least, most) as u32;
            HeadLight { light: TracedLight { rays, ..one.light }, ..*one }
        };
        let of_lights: Vec<HeadLight> = caster.lights.iter().map(of_light).collect();
        let mut found = caster.irradiance(&mut self.pipeline, &places, &of_lights, spread)?;
        let lights = caster.lights.len();
        let between = |(point, found): (&DetailPoint, &mut [f32])| {
            let mut sum = Vec3::ZERO;
            let corners = detail.corners(&self.fine, point);
            for (vertex, share) in corners {
                sum += share * light.known[vertex as usize];
                let known = &light.of_lights[vertex as usize * lights..][..lights];
                for (j, found) in found.iter_mut().enumerate() {
                    let looked_for = point.lights >> j & 1 == 1;
                    *found += if looked_for { 0.0 } else { share * known[j] };
                }
            }
            sum + irradiance_of(caster.lights, found)
        };
        Ok(detail.points.iter().zip(found.chunks_mut(lights)).map(between).collect())
    }

    /// A place on `head`, the one that this was made of, as rays leave it.
    fn vertex(&self, head: &Head, place: &SurfacePlace, seed: u32, lights: u64) -> HeadVertex {
        let position = place.lifted(head, 1.0) - self.center;
        let normal = place.of(&head.normals).normalize_or(Vec3::Y);
        HeadVertex::new(position, normal, seed, lights)
    }
}

/// As the shader has it, of points that come after so many vertices.
fn detail_buffer(device: &wgpu::Device, detail: &Detail, vertices: u32) -> wgpu::Buffer {
    let head = [detail.across, vertices];
    let mut words: Vec<u32> = head.into_iter().chain(detail.words.iter().copied()).collect();
    words.resize(words.len().max(3), 0);
    storage(device, "head detail", bytemuck::cast_slice(&words))
}

impl VertexLight {
    /// Of all that is there, linear RGB, vertex by vertex.
    pub fn irradiance(&self, lights: &[HeadLight]) -> Vec<Vec3> {
        let mut all = self.known.clone();
        let sums = self.of_lights.chunks(lights.len().max(1)).map(|of| irradiance_of(lights, of));
        all.iter_mut().zip(sums).for_each(|(all, sum)| *all += sum);
        all
    }
}

/// Irradiance of what lights bring, each by itself.
fn irradiance_of(lights: &[HeadLight], of_lights: &[f32]) -> Vec3 {
    lights.iter().zip(of_lights).map(|(light, &of)| of * light.rgb).sum()
}

impl HeadRayCaster<'_> {
    /// Irradiance (R + G + B) on what faces all lights at once, in the middle of the hair.
    fn whole(&self) -> f32 {
        let of = |one: &HeadLight| {
            let lamp = one.energy < 0.0;
            let energy = if lamp { draws::solid_angle(&one.light, Vec3::ZERO) } else { one.energy };
            energy * one.rgb.element_sum()
        };
        self.lights.iter().map(of).sum()
    }

    /// Bit by bit, of which lights the corners of a triangle have irradiances (R + G + B) that differ by more than `most`.
    fn differing(&self, corners: [&[f32]; 3], most: f32) -> u64 {
        let differs = |j: usize| {
            let of = corners.map(|of| of[j]);
            let range = of.iter().copied().fold(0.0, f32::max)
                - of.iter().copied().fold(f32::INFINITY, f32::min);
            range * self.lights[j].rgb.element_sum() > most
        };
        (0..self.lights.len()).filter(|&j| differs(j)).fold(0, |bits, j| bits | 1 << j)
    }

    /// What each of the lights brings to places on the head, place by place, were its radiance 1; each stands for a square
    /// of `spread` a side.
    fn irradiance(
        &mut self,
        pipeline: &mut Option<wgpu::ComputePipeline>,
        vertices: &[HeadVertex],
        lights: &[HeadLight],
        spread: f32,
    ) -> Result<Vec<f32>> {
        let lift = LIFT * self.stage.radius;
        if vertices.is_empty() {
            return Ok(Vec::new());
        }
        if let Some(rays) = self.host {
            let of = |vertex: &HeadVertex| {
                let of = |j: usize| rays.irradiance(vertex, [lift, spread], &lights[j]);
                let all = (0..lights.len()).map(|j| if vertex.looks_for(j) { of(j) } else { 0.0 });
                all.collect::<Vec<f32>>()
            };
            return Ok(vertices.par_iter().flat_map_iter(of).collect());
        }
        // A buffer holds what one dispatch finds.
        let limit = self.gpu.device.limits().max_storage_buffer_binding_size as usize;
        let most = (limit / (4 * lights.len()).max(size_of::<HeadVertex>())).max(1);
        let mut found = Vec::with_capacity(vertices.len() * lights.len());
        for some in vertices.chunks(most) {
            found.extend(self.on_device(pipeline, some, lights, [lift, spread])?);
        }
        Ok(found)
    }

    /// The same on the device, of as many places as one buffer has room for.
    fn on_device(
        &mut self,
        pipeline: &mut Option<wgpu::ComputePipeline>,
        vertices: &[HeadVertex],
        lights: &[HeadLight],
        [lift, spread]: [f32; 2],
    ) -> Result<Vec<f32>> {
        let Some((buffers, head)) = self.traced.met() else { return Ok(Vec::new()) };
        let Gpu { device, queue, shaders, .. } = self.gpu;
        let pipeline = pipeline.get_or_insert_with(|| {
            let module = module(device, "head light", &shaders.head_light());
            compute_pipeline(device, &module, "light_head", &[])
        });
        let [count, of_each] = [vertices.len(), lights.len()].map(|count| count as u32);
        let lighting =
            LightingHead { vertices: count, lights: of_each, lift, spread, head, pad: [0; 2] };
        let mut data = bytemuck::bytes_of(&lighting).to_vec();
        data.extend_from_slice(bytemuck::cast_slice(lights));
        let [bvh, items, shapes] = buffers;
        let of_vertices = storage(device, "head vertices", bytemuck::cast_slice(vertices));
        let lighting = storage(device, "lighting", &data);
        let found = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("head irradiance"),
            size: 4 * u64::from(count) * u64::from(of_each),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        // Of the strand points, at 2, the shader needs none.
        let entries = [
            buffer(0, bvh),
            buffer(1, items),
            buffer(3, shapes),
            buffer(4, &of_vertices),
            buffer(5, &found),
            buffer(6, &lighting),
        ];
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = begin(&mut encoder, "head light", None);
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        let groups = count.div_ceil(64);
        pass.dispatch_workgroups(groups.min(4096), groups.div_ceil(4096), 1);
        drop(pass);
        queue.submit([encoder.finish()]);
        self.gpu.read(&found)
    }
}
