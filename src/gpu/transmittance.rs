//! T̃ of lights at strand points, by rays (shaders/transmittance.wgsl), kept on the device from frame to frame.
//!
//! A pair of a point and a light is traced once: another camera traces points that were not seen before, a turned light
//! the lobes that moved. Words lie point by point; the last light has the first place, so that the ordinates, which come
//! last and never move, stay where they are however many lights there are before them.
//!
//! On a CPU's adapter the twin of the shader traces in its place: on two cores 3.7 million rays a second, sintel's and the
//! builtin bob's, where lavapipe has 1.0 to 1.3 million, for whose SIMD code each lane loads for itself.

use anyhow::Result;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use wgpu::util::DeviceExt as _;

use super::Gpu;
use super::resources::*;
use super::uniforms::TracingHead;
use crate::lamp::{Lamp, Shape};
use crate::reference::transmittance::StrandRays;
use crate::srbf::SrbfLight;
use crate::stage::Geometry;
use crate::transport::draws::{Block, Rays, TracedLight, Words};
use crate::transport::occlusion::RayBvh;

/// Slot of a point whose T̃ is not known (shaders/shade.wgsl).
pub const NO_SLOT: u32 = u32::MAX;
/// Rays between two looks at whether to go on: 0.1 s on two cores.
const RAYS_A_LOOK: u64 = 1 << 19;
/// Lights that a thread traces one after the other.
const LIGHTS_A_THREAD: u32 = 8;
/// Bytes of words that are made at first, about.
const FIRST_BYTES: u64 = 4 << 20;
/// Columns of a group at most.
const COLUMNS_A_GROUP: u32 = 256;

/// What decides T̃ of a light at every point; None of a black light, which is not traced.
type Key = Option<Form>;

#[derive(Clone, Copy, PartialEq)]
enum Form {
    Lobe(DVec3, f64),
    Lamp(Shape),
}

/// A light's place among the words of a point.
struct Column {
    key: Key,
    /// When this light came: points that were traced before do not have it.
    since: u64,
    light: TracedLight,
    /// Points that share its rays.
    points: u32,
}

/// Columns that share one buffer of words.
pub(super) struct Group {
    /// Its columns.
    pub first: u32,
    pub count: u32,
    pub words: wgpu::Buffer,
    /// The same on the CPU, where that traces.
    host: Vec<u32>,
}

impl Group {
    fn copy(&self, gpu: &Gpu) -> Group {
        let words = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("transmittance"),
            size: self.words.size(),
            usage: WORDS_USAGE,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&self.words, 0, &words, 0, words.size());
        gpu.queue.submit([encoder.finish()]);
        Group { words, host: self.host.clone(), ..*self }
    }
}

/// Words of points as shading reads them.
pub(super) struct Table {
    pub groups: Vec<Group>,
    /// Words of a pair: 2 where strands are counted.
    pub pair: u32,
    /// Slot of each point.
    pub slots: wgpu::Buffer,
    pub count: u32,
    slot_of: Vec<u32>,
}

impl Table {
    fn new(gpu: &Gpu, points: usize) -> Table {
        let slot_of = vec![NO_SLOT; points];
        let slots = slot_buffer(gpu, &slot_of);
        Table { groups: Vec::new(), pair: 1, slots, count: 0, slot_of }
    }

    /// Whether something is known of a point.
    pub fn has(&self, point: usize) -> bool {
        self.slot_of[point] != NO_SLOT
    }

    fn upload_slots(&self, gpu: &Gpu) {
        gpu.queue.write_buffer(&self.slots, 0, bytemuck::cast_slice(&self.slot_of));
    }

    pub fn bytes(&self) -> u64 {
        self.groups.iter().map(|group| u64::from(group.count)).sum::<u64>()
            * u64::from(4 * self.pair * self.count)
    }
}

/// How strands and head are met on the device.
struct Device {
    bvh: wgpu::Buffer,
    items: wgpu::Buffer,
    shapes: wgpu::Buffer,
    /// [`RayBvh::head`].
    head: [u32; 2],
}

/// What traces on the CPU, and what it is of.
pub type Host<'a> = Option<(&'a Geometry, &'a StrandRays)>;

/// Told the share done; false ends it.
type Progress<'a> = &'a (dyn Fn(f32) -> bool + Sync);

/// See the module.
pub struct PointTransmittance {
    /// Made for the first rays on the device.
    device: Option<Device>,
    /// By whether strands are counted.
    pipelines: [Option<wgpu::ComputePipeline>; 2],
    /// First and last point of each point's strand.
    strands: Vec<[u32; 2]>,
    /// By light from the last to the first.
    columns: Vec<Column>,
    pub(super) table: Table,
    /// The words before rays were added.
    plain: Option<Vec<Group>>,
    capacity: u32,
    /// When each slot was traced last.
    times: Vec<u64>,
    now: u64,
    /// Rays that were traced so far.
    pub rays: u64,
}

impl PointTransmittance {
    pub fn new(gpu: &Gpu, stage: &Geometry) -> PointTransmittance {
        PointTransmittance {
            device: None,
            pipelines: [None, None],
            strands: stage.hair.strand_ends(),
            columns: Vec::new(),
            table: Table::new(gpu, stage.hair.points.len()),
            plain: None,
            capacity: 0,
            times: Vec::new(),
            now: 0,
            rays: 0,
        }
    }

    /// Forgets all T̃: strands have other diameters.
    pub fn forget(&mut self) {
        self.device = None;
        self.plain = None;
        self.times.clear();
        self.table.slot_of.fill(NO_SLOT);
        self.table.groups.clear();
        self.table.count = 0;
        self.capacity = 0;
    }

    /// Compiles anew when it is next needed.
    pub fn forget_pipelines(&mut self) {
        self.pipelines = [None, None];
    }

    /// Lamps and lights from now on, of which `rays` are traced; points count from `center`. `counts`: whether strands are
    /// counted on the way.
    pub fn set_lights(
        &mut self,
        (lamps, lights): (&[Lamp], &[SrbfLight]),
        rays: &[Rays],
        counts: bool,
        center: Vec3,
    ) {
        let pair = if counts { 2 } else { 1 };
        if pair != self.table.pair {
            self.table.pair = pair;
            self.columns.clear();
            let device = self.device.take();
            self.forget();
            self.device = device;
        }
        self.now += 1;
        let middle = center.as_dvec3();
        let of_lamps = lamps.iter().filter_map(|lamp| {
            let light = TracedLight::near(lamp, middle)?;
            Some((Some(Form::Lamp(lamp.shape)), light))
        });
        let of_lights = lights.iter().map(|one| {
            let shines = one.rgb != [0.0; 3];
            let key = shines.then_some(Form::Lobe(one.direction, one.lambda));
            (key, TracedLight::distant(one))
        });
        let all: Vec<(Key, TracedLight)> = of_lamps.chain(of_lights).collect();
        let mut old = std::mem::take(&mut self.columns).into_iter();
        let columns = all.into_iter().zip(rays).rev().enumerate();
        self.columns = columns
            .map(|(column, ((key, light), &rays))| {
                // A light that is black for a while is still known, but that of other rays is not.
                let known = old.next().filter(|known| {
                    let same = known.light.rays == rays.count && known.points == rays.points;
                    known.key == key && same || key.is_none()
                });
                let light = TracedLight { column: column as u32, rays: rays.count, ..light };
                match known {
                    Some(known) if key.is_none() => known,
                    Some(known) => Column { light, ..known },
                    None => Column { key, since: self.now, light, points: rays.points },
                }
            })
            .collect();
    }

    /// Lights that are set.
    pub(super) fn lights(&self) -> u32 {
        self.columns.len() as u32
    }

    /// Traces what is not known yet of the lights at `points`, and takes back rays that were added, so that what is shown
    /// does not depend on what was shown before. False where `progress` said no: what was traced is kept.
    ///
    /// # Errors
    /// The device was lost.
    pub fn compute(
        &mut self,
        gpu: &Gpu,
        strand_points: &wgpu::Buffer,
        points: &[u32],
        host: Host,
        progress: Progress,
    ) -> Result<bool> {
        if let Some(plain) = self.plain.take() {
            self.table.groups = plain;
        }
        self.make_room(gpu, points);
        // In the order of the strands, so that blocks are whole.
        let mut points = points.to_vec();
        points.sort_unstable();
        let mut groups: Vec<(u64, Vec<u32>)> = Vec::new();
        for point in points {
            let slot = self.table.slot_of[point as usize];
            let since = if slot == NO_SLOT { 0 } else { self.times[slot as usize] };
            if since == self.now {
                continue;
            }
            match groups.iter_mut().find(|group| group.0 == since) {
                Some(group) => group.1.push(point),
                None => groups.push((since, vec![point])),
            }
        }
        let whole: u64 = groups.iter().map(|(since, points)| self.work(*since, points.len())).sum();
        let (mut done, mut go_on) = (0, true);
        'all: for (since, points) in groups {
            for points in points.chunks(self.chunk(since, 1)) {
                go_on = progress(done as f32 / whole.max(1) as f32);
                if !go_on {
                    break 'all;
                }
                for &point in points {
                    let slot = &mut self.table.slot_of[point as usize];
                    if *slot == NO_SLOT {
                        *slot = self.table.count;
                        self.table.count += 1;
                        self.times.push(0);
                    }
                }
                self.trace(gpu, strand_points, points, since, None, host)?;
                for &point in points {
                    self.times[self.table.slot_of[point as usize] as usize] = self.now;
                }
                done += self.work(since, points.len());
            }
        }
        self.upload(gpu, host);
        Ok(go_on)
    }

    /// Adds `times` as many rays as were asked for at `points`, which are known. False where `progress` said no: what was
    /// traced is kept.
    ///
    /// # Errors
    /// The device was lost.
    pub fn add_rays(
        &mut self,
        gpu: &Gpu,
        strand_points: &wgpu::Buffer,
        points: &[u32],
        times: u32,
        host: Host,
        progress: Progress,
    ) -> Result<bool> {
        if self.plain.is_none() {
            let copies = self.table.groups.iter().map(|group| group.copy(gpu)).collect();
            self.plain = Some(copies);
        }
        let mut points = points.to_vec();
        points.sort_unstable();
        let mut done = 0;
        let mut go_on = true;
        for some in points.chunks(self.chunk(0, times)) {
            go_on = progress(done as f32 / points.len() as f32);
            if !go_on {
                break;
            }
            self.trace(gpu, strand_points, some, 0, Some(times), host)?;
            done += some.len();
        }
        self.upload(gpu, host);
        Ok(go_on)
    }

    /// Points between two looks at whether to go on.
    fn chunk(&self, since: u64, times: u32) -> usize {
        const MANY: usize = 1 << 20;
        let work = u64::from(times) * self.work(since, MANY);
        (RAYS_A_LOOK * MANY as u64 / work.max(1)).max(256) as usize
    }

    /// Rays of the lights that slots of this time lack at so many points, about.
    fn work(&self, since: u64, points: usize) -> u64 {
        let lights = self.missing(since);
        let rays = lights.map(|column| f64::from(column.light.rays) / f64::from(column.points));
        (rays.sum::<f64>() * points as f64) as u64
    }

    /// Lights that a slot of this time lacks.
    fn missing(&self, since: u64) -> impl Iterator<Item = &Column> {
        let lacks = move |column: &&Column| column.key.is_some() && column.since > since;
        self.columns.iter().filter(lacks)
    }

    /// Makes buffers for so many points beside those that are known, and all columns.
    fn make_room(&mut self, gpu: &Gpu, points: &[u32]) {
        let Table { slot_of, count, pair, groups: old, .. } = &mut self.table;
        let new = points.iter().filter(|&&point| slot_of[point as usize] == NO_SLOT).count();
        let wanted = *count + new as u32;
        let columns = self.columns.len() as u32;
        let there = old.iter().map(|group| group.count).sum::<u32>();
        if wanted <= self.capacity && columns <= there {
            return;
        }
        let columns = columns.max(there).max(1);
        let first = (FIRST_BYTES / u64::from(4 * *pair * columns)) as u32;
        let most = slot_of.len() as u32;
        let capacity = wanted.max(2 * self.capacity).max(first).min(most).max(1);
        let per_group = columns_a_group(gpu, *pair, capacity);
        let group = |first: u32| {
            let count = per_group.min(columns - first);
            let words = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("transmittance"),
                size: 4 * u64::from(*pair) * u64::from(capacity) * u64::from(count),
                usage: WORDS_USAGE,
                mapped_at_creation: false,
            });
            Group { first, count, words, host: Vec::new() }
        };
        let mut groups: Vec<Group> = (0..columns).step_by(per_group as usize).map(group).collect();
        // What is known is kept where it lies alike; else it is traced again.
        match (&mut groups[..], &mut old[..]) {
            ([new], [old]) if new.count == old.count && *count > 0 => {
                let bytes = 4 * u64::from(*pair * old.count) * u64::from(*count);
                let mut encoder = gpu.device.create_command_encoder(&Default::default());
                encoder.copy_buffer_to_buffer(&old.words, 0, &new.words, 0, bytes);
                gpu.queue.submit([encoder.finish()]);
                new.host = std::mem::take(&mut old.host);
            }
            _ => self.times.fill(0),
        }
        *old = groups;
        self.capacity = capacity;
    }

    /// Traces the lights that slots of the time `since` lack at `points`, which follow the strands; or adds `times` as
    /// many rays to them.
    fn trace(
        &mut self,
        gpu: &Gpu,
        strand_points: &wgpu::Buffer,
        points: &[u32],
        since: u64,
        times: Option<u32>,
        host: Host,
    ) -> Result<()> {
        let mut sizes: Vec<u32> = self.missing(since).map(|column| column.points).collect();
        sizes.sort_unstable();
        sizes.dedup();
        for size in sizes {
            let blocks = self.blocks(points, size);
            for group in 0..self.table.groups.len() {
                let Group { first, count, .. } = self.table.groups[group];
                let lights: Vec<TracedLight> = self
                    .missing(since)
                    .filter(|column| column.points == size)
                    .map(|column| column.light)
                    .filter(|light| (first..first + count).contains(&light.column))
                    .map(|light| TracedLight {
                        column: light.column - first,
                        rays: light.rays * times.unwrap_or(1),
                        fresh: u32::from(times.is_none()),
                        ..light
                    })
                    .collect();
                if lights.is_empty() {
                    continue;
                }
                match host {
                    Some(host) => self.trace_on_host(points, &blocks, size, &lights, group, host),
                    None => {
                        self.dispatch(gpu, strand_points, points, (&blocks, size), &lights, group);
                    }
                }
                let rays: u64 = lights.iter().map(|light| u64::from(light.rays)).sum();
                self.rays += rays * blocks.len() as u64;
            }
        }
        if host.is_none() {
            gpu.wait()?;
        }
        Ok(())
    }

    fn trace_on_host(
        &mut self,
        points: &[u32],
        blocks: &[Block],
        size: u32,
        lights: &[TracedLight],
        group: usize,
        (stage, rays): (&Geometry, &StrandRays),
    ) {
        let Table { groups, pair, slot_of, .. } = &mut self.table;
        let (pair, counts) = (*pair as usize, *pair == 2);
        let Group { count, words, host, .. } = &mut groups[group];
        host.resize(words.size() as usize / 4, 0);
        let stride = pair * *count as usize;
        let row = |place: usize| slot_of[points[place] as usize] as usize * stride;
        let traced: Vec<Vec<Words>> = blocks
            .par_iter()
            .with_min_len(16)
            .map(|block| {
                let known = row(block.seen().start);
                let before = |light: &TracedLight| {
                    let at = known + pair * light.column as usize;
                    let mut words = [0; 2];
                    if light.fresh == 0 {
                        words[..pair].copy_from_slice(&host[at..at + pair]);
                    }
                    words
                };
                let mut words: Vec<Words> = lights.iter().map(before).collect();
                rays.trace(stage, block, size, lights, counts, &mut words);
                words
            })
            .collect();
        for (block, traced) in blocks.iter().zip(traced) {
            for place in block.seen() {
                let row = row(place);
                for (light, words) in lights.iter().zip(&traced) {
                    let at = row + pair * light.column as usize;
                    host[at..at + pair].copy_from_slice(&words[..pair]);
                }
            }
        }
    }

    /// Brings what was traced on the CPU, and the slots, to the device.
    fn upload(&mut self, gpu: &Gpu, host: Host) {
        self.table.upload_slots(gpu);
        let Table { groups, pair, count, .. } = &self.table;
        for group in groups.iter().filter(|group| host.is_some() && !group.host.is_empty()) {
            let words = (pair * count) as usize * group.count as usize;
            gpu.queue.write_buffer(&group.words, 0, bytemuck::cast_slice(&group.host[..words]));
        }
    }

    fn dispatch(
        &mut self,
        gpu: &Gpu,
        strand_points: &wgpu::Buffer,
        points: &[u32],
        (blocks, size): (&[Block], u32),
        lights: &[TracedLight],
        group: usize,
    ) {
        let pipeline = self.pipeline(gpu);
        let device = &gpu.device;
        let Some(met) = &self.device else { return };
        let Table { groups, pair, slot_of, .. } = &self.table;
        let group = &groups[group];
        let slots: Vec<u32> = points.iter().map(|&point| slot_of[point as usize]).collect();
        let head = TracingHead {
            blocks: blocks.len() as u32,
            points: size,
            stride: pair * group.count,
            lights: lights.len() as u32,
            lights_a_thread: LIGHTS_A_THREAD,
            pad: 0,
            head: met.head,
        };
        let mut tracing = bytemuck::bytes_of(&head).to_vec();
        tracing.extend_from_slice(bytemuck::cast_slice(lights));
        let buffers = [
            &met.bvh,
            &met.items,
            strand_points,
            &met.shapes,
            &storage(device, "blocks", bytemuck::cast_slice(blocks)),
            &storage(device, "members", bytemuck::cast_slice(&slots)),
            &group.words,
            &storage(device, "tracing", &tracing),
        ];
        let bound = bind(device, &pipeline.get_bind_group_layout(0), &buffers);
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = begin(&mut encoder, "transmittance", None);
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bound, &[]);
        let across = (blocks.len() as u32).div_ceil(64);
        pass.dispatch_workgroups(across, (lights.len() as u32).div_ceil(LIGHTS_A_THREAD), 1);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
    }

    /// What the device traces by, from `stage`.
    pub fn prepare(&mut self, gpu: &Gpu, stage: &Geometry) {
        if self.device.is_none() {
            let RayBvh { nodes, head, items, shapes } = RayBvh::new(stage);
            let device = &gpu.device;
            self.device = Some(Device {
                bvh: storage(device, "bvh", bytemuck::cast_slice(&nodes)),
                items: storage(device, "items", bytemuck::cast_slice(&items)),
                shapes: storage(device, "shapes", bytemuck::cast_slice(&shapes)),
                head,
            });
        }
    }

    /// Nodes, items and shapes on the device, and [`RayBvh::head`], once [`Self::prepare`]d.
    pub(super) fn met(&self) -> Option<([&wgpu::Buffer; 3], [u32; 2])> {
        let device = self.device.as_ref()?;
        Some(([&device.bvh, &device.items, &device.shapes], device.head))
    }

    fn pipeline(&mut self, gpu: &Gpu) -> wgpu::ComputePipeline {
        let counts = self.table.pair == 2;
        let pipeline = &mut self.pipelines[usize::from(counts)];
        let made = pipeline.get_or_insert_with(|| {
            let module = module(&gpu.device, "transmittance", &gpu.shaders.transmittance());
            let constants = [("COUNT_STRANDS", f64::from(counts))];
            compute_pipeline(&gpu.device, &module, "transmittance", &constants)
        });
        made.clone()
    }

    /// Blocks of `size` points of a strand that have some of `points`, which follow the strands.
    fn blocks(&self, points: &[u32], size: u32) -> Vec<Block> {
        let mut blocks: Vec<Block> = Vec::with_capacity(points.len());
        for (place, &point) in (0u32..).zip(points) {
            let own = self.strands[point as usize];
            let first = own[0] + (point - own[0]) / size * size;
            match blocks.last_mut() {
                Some(last) if last.point == first => last.members += 1,
                _ => blocks.push(Block { point: first, members: place << 5 | 1, own }),
            }
        }
        blocks
    }

    /// The words of each light, lamps first, at `points`; 0 where nothing was traced.
    ///
    /// # Errors
    /// The device was lost.
    pub fn read(&self, gpu: &Gpu, points: &[u32]) -> Result<Vec<Vec<Words>>> {
        let Table { groups, pair, slot_of, .. } = &self.table;
        let pair = *pair as usize;
        let mut all = vec![vec![[0; 2]; points.len()]; self.columns.len()];
        for group in groups {
            let words: Vec<u32> = gpu.read(&group.words)?;
            let stride = pair * group.count as usize;
            for column in group.first..(group.first + group.count).min(self.lights()) {
                if self.columns[column as usize].key.is_none() {
                    continue;
                }
                let of_light = &mut all[(self.lights() - 1 - column) as usize];
                for (words_of, &point) in of_light.iter_mut().zip(points) {
                    let slot = slot_of[point as usize];
                    if slot != NO_SLOT {
                        let at = slot as usize * stride + pair * (column - group.first) as usize;
                        words_of[..pair].copy_from_slice(&words[at..at + pair]);
                    }
                }
            }
        }
        Ok(all)
    }
}

/// Columns that one buffer holds of so many slots, `pair` words each.
fn columns_a_group(gpu: &Gpu, pair: u32, slots: u32) -> u32 {
    let limit = gpu.device.limits().max_storage_buffer_binding_size;
    let fit = limit / (4 * u64::from(pair) * u64::from(slots.max(1)));
    fit.clamp(1, COLUMNS_A_GROUP.into()) as u32
}

/// A table of words that are known: `words[j][k]` is light j of all at `points[k]`.
pub(super) fn known_table(
    gpu: &Gpu,
    points: &[u32],
    words: &[Vec<Words>],
    pair: u32,
    all: usize,
) -> Table {
    let mut table = Table::new(gpu, all);
    (0..).zip(points).for_each(|(slot, &point)| table.slot_of[point as usize] = slot);
    table.upload_slots(gpu);
    (table.count, table.pair) = (points.len() as u32, pair);
    let lights = words.len() as u32;
    let per_group = columns_a_group(gpu, pair, points.len() as u32);
    for first in (0..lights).step_by(per_group as usize) {
        let count = per_group.min(lights - first);
        let row = |k: usize| {
            (first..first + count).flat_map(move |column| {
                let of_light = &words[(lights - 1 - column) as usize];
                of_light.get(k).copied().unwrap_or_default().into_iter().take(pair as usize)
            })
        };
        let words: Vec<u32> = (0..points.len()).into_par_iter().flat_map_iter(row).collect();
        let words = storage(&gpu.device, "transmittance", bytemuck::cast_slice(&words));
        table.groups.push(Group { first, count, words, host: Vec::new() });
    }
    table
}

const WORDS_USAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE
    .union(wgpu::BufferUsages::COPY_SRC)
    .union(wgpu::BufferUsages::COPY_DST);

fn slot_buffer(gpu: &Gpu, slots: &[u32]) -> wgpu::Buffer {
    gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("slots"),
        contents: if slots.is_empty() { &[255; 16] } else { bytemuck::cast_slice(slots) },
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
    })
}
