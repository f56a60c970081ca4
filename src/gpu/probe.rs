//! Runs one function of the shader library over many inputs, for tests and for `hairlight probe`.

use anyhow::{Result, ensure};
use wgpu::util::DeviceExt;

use super::{Gpu, method::MethodData};

/// Numbers of one input and of one output (shaders/probe/probe.wgsl).
pub const INPUTS: usize = 8;
/// See [`INPUTS`].
pub const OUTPUTS: usize = 12;

/// What the output holds before the shader runs: a value never written is no zero.
const UNWRITTEN: f32 = -1.234_567_8e30;

/// Inputs of one dispatch at most.
const ITEMS_MAX: usize = 65_535 * 64;

/// Runs `statement`, WGSL that reads `x: array<vec4f, 2>` and sets `y: array<vec4f, 3>`, for each input.
pub fn run(
    gpu: &Gpu,
    statement: &str,
    method: &MethodData,
    inputs: &[[f32; INPUTS]],
) -> Result<Vec<[f32; OUTPUTS]>> {
    let probe = Probe::new(gpu, statement, method, inputs)?;
    probe.dispatch();
    probe.read()
}

/// A statement compiled, with its inputs on the GPU: to be run again and again.
pub struct Probe<'a> {
    gpu: &'a Gpu,
    pipeline: wgpu::ComputePipeline,
    groups: [wgpu::BindGroup; 2],
    output: wgpu::Buffer,
    items: u32,
}

impl<'a> Probe<'a> {
    /// See [`run`].
    pub fn new(
        gpu: &'a Gpu,
        statement: &str,
        method: &MethodData,
        inputs: &[[f32; INPUTS]],
    ) -> Result<Probe<'a>> {
        ensure!(
            !inputs.is_empty() && inputs.len() <= ITEMS_MAX,
            "a probe takes 1 to {ITEMS_MAX} inputs"
        );
        let device = &gpu.device;
        let source =
            method.specialised(&gpu.shaders, gpu.shaders.probe(method.integrator, statement));
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("probe"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let layout = |entries: &[_]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("probe"),
                entries,
            })
        };
        let layouts = [
            layout(&[
                entry(0, wgpu::BufferBindingType::Uniform),
                entry(1, storage(true)),
                entry(2, storage(true)),
            ]),
            layout(&[entry(0, storage(true)), entry(1, storage(false))]),
        ];
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("probe"),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("probe"),
                bind_group_layouts: &[Some(&layouts[0]), Some(&layouts[1])],
                ..Default::default()
            })),
            module: &module,
            entry_point: Some("probe"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &method.constants(),
                ..Default::default()
            },
            cache: None,
        });

        let buffer = |contents: &[u8], usage| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("probe"),
                contents,
                usage,
            })
        };
        let buffers = [
            buffer(bytemuck::bytes_of(&method.fibre), wgpu::BufferUsages::UNIFORM),
            buffer(&method.tables[0], wgpu::BufferUsages::STORAGE),
            buffer(&method.tables[1], wgpu::BufferUsages::STORAGE),
            buffer(bytemuck::cast_slice(inputs), wgpu::BufferUsages::STORAGE),
        ];
        let output = buffer(
            bytemuck::cast_slice(&vec![[UNWRITTEN; OUTPUTS]; inputs.len()]),
            wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        );
        let group = |layout: &wgpu::BindGroupLayout, buffers: &[&wgpu::Buffer]| {
            let entries: Vec<_> = (0..)
                .zip(buffers)
                .map(|(binding, buffer)| wgpu::BindGroupEntry {
                    binding,
                    resource: buffer.as_entire_binding(),
                })
                .collect();
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("probe"),
                layout,
                entries: &entries,
            })
        };
        let groups = [
            group(&layouts[0], &[&buffers[0], &buffers[1], &buffers[2]]),
            group(&layouts[1], &[&buffers[3], &output]),
        ];
        Ok(Probe { gpu, pipeline, groups, output, items: inputs.len() as u32 })
    }

    /// Submits one run over all inputs; [`Gpu::wait`] waits for it.
    pub fn dispatch(&self) {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.groups[0], &[]);
            pass.set_bind_group(1, &self.groups[1], &[]);
            pass.dispatch_workgroups(self.items.div_ceil(64), 1, 1);
        }
        self.gpu.queue.submit([encoder.finish()]);
    }

    /// The outputs of the last run.
    pub fn read(&self) -> Result<Vec<[f32; OUTPUTS]>> {
        let outputs: Vec<[f32; OUTPUTS]> = self.gpu.read(&self.output)?;
        ensure!(
            outputs.iter().flatten().all(|&y| y != UNWRITTEN),
            "the probe left outputs unwritten"
        );
        Ok(outputs)
    }
}
