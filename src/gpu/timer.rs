//! Time per pass: GPU timestamps where the adapter has them, nothing where it has not.

use std::collections::BTreeMap;

use anyhow::Result;

use super::Gpu;

/// Most passes that one frame can time; later ones go untimed.
const CAPACITY: u32 = 1024;

/// Collects a begin and an end for each named pass of a frame.
pub struct PassTimer {
    queries: Option<wgpu::QuerySet>,
    names: Vec<&'static str>,
}

impl PassTimer {
    pub fn new(gpu: &Gpu) -> PassTimer {
        let timed = gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let queries = timed.then(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * CAPACITY,
            })
        });
        PassTimer { queries, names: Vec::new() }
    }

    fn slot(&mut self, name: &'static str) -> Option<(&wgpu::QuerySet, u32)> {
        let queries = self.queries.as_ref()?;
        let slot = self.names.len() as u32;
        if slot == CAPACITY {
            return None;
        }
        self.names.push(name);
        Some((queries, 2 * slot))
    }

    pub fn compute(&mut self, name: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.slot(name).map(|(query_set, first)| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    pub fn render(&mut self, name: &'static str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        self.slot(name).map(|(query_set, first)| wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// Milliseconds by pass, summed over passes of the same name; empty without timestamps.
    pub fn read(self, gpu: &Gpu) -> Result<BTreeMap<&'static str, f64>> {
        let mut passes = BTreeMap::new();
        let (Some(queries), false) = (&self.queries, self.names.is_empty()) else {
            return Ok(passes);
        };
        let count = 2 * self.names.len() as u32;
        let resolved = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("pass times"),
            size: 8 * u64::from(count),
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.resolve_query_set(queries, 0..count, &resolved, 0);
        gpu.queue.submit([encoder.finish()]);
        let ticks: Vec<u64> = gpu.read(&resolved)?;
        let ms_per_tick = f64::from(gpu.queue.get_timestamp_period()) * 1e-6;
        for (name, pair) in self.names.iter().zip(ticks.chunks_exact(2)) {
            *passes.entry(*name).or_insert(0.0) +=
                pair[1].saturating_sub(pair[0]) as f64 * ms_per_tick;
        }
        Ok(passes)
    }
}
