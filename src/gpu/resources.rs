//! Pipelines, buffers and bindings in few words.

use bytemuck::Zeroable as _;
use wgpu::util::DeviceExt as _;

use super::Gpu;
use crate::paint::PointFibre;

/// The multisampling that every WebGPU adapter has.
pub(super) const SAMPLES_PER_TEXEL: u32 = 4;
pub(super) const VISIBILITY: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Uint;
pub(super) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

pub(super) fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    label: &'static str,
    timestamp_writes: Option<wgpu::ComputePassTimestampWrites>,
) -> wgpu::ComputePass<'a> {
    encoder
        .begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(label), timestamp_writes })
}

pub(super) fn module(device: &wgpu::Device, label: &str, source: &str) -> wgpu::ShaderModule {
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    })
}

pub(super) fn compute_pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    entry: &str,
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: None,
        module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    })
}

/// What a shader finds at a binding.
#[derive(Clone, Copy)]
pub(super) enum Bound {
    Uniform,
    /// Storage, read only.
    Read,
    /// Storage.
    Write,
    /// A texture of integers.
    Uint2d,
    /// A texture of whole texels.
    Float2d,
    /// A texture that is read between its texels.
    Float3d,
    Sampler,
}

/// For shaders of which one leaves out bindings that another has.
pub(super) fn layout(device: &wgpu::Device, bindings: &[(u32, Bound)]) -> wgpu::BindGroupLayout {
    let of_buffer =
        |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let of_texture = |sample_type, view_dimension| wgpu::BindingType::Texture {
        sample_type,
        view_dimension,
        multisampled: false,
    };
    let entry = |&(binding, bound): &(u32, Bound)| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: match bound {
            Bound::Uniform => of_buffer(wgpu::BufferBindingType::Uniform),
            Bound::Read => of_buffer(wgpu::BufferBindingType::Storage { read_only: true }),
            Bound::Write => of_buffer(wgpu::BufferBindingType::Storage { read_only: false }),
            Bound::Uint2d => {
                of_texture(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2)
            }
            Bound::Float2d => of_texture(
                wgpu::TextureSampleType::Float { filterable: false },
                wgpu::TextureViewDimension::D2,
            ),
            Bound::Float3d => of_texture(
                wgpu::TextureSampleType::Float { filterable: true },
                wgpu::TextureViewDimension::D3,
            ),
            Bound::Sampler => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
        },
        count: None,
    };
    let entries: Vec<_> = bindings.iter().map(entry).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &entries,
    })
}

/// [`compute_pipeline`] with layouts that are given.
pub(super) fn pipeline_over(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    entry: &str,
    groups: &[&wgpu::BindGroupLayout],
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    let groups: Vec<_> = groups.iter().map(|&group| Some(group)).collect();
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &groups,
        immediate_size: 0,
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&layout),
        module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    })
}

pub(super) fn group(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    entries: &[wgpu::BindGroupEntry],
) -> wgpu::BindGroup {
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries })
}

/// Entry points `{name}_vertex` and `{name}_fragment`.
pub(super) fn raster_pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    name: &str,
) -> wgpu::RenderPipeline {
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(name),
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(&format!("{name}_vertex")),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: wgpu::MultisampleState { count: SAMPLES_PER_TEXEL, ..Default::default() },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(&format!("{name}_fragment")),
            compilation_options: Default::default(),
            targets: &[Some(VISIBILITY.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

pub(super) fn uniform_buffer(device: &wgpu::Device, label: &str, contents: &[u8]) -> wgpu::Buffer {
    device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some(label),
        contents,
        usage: wgpu::BufferUsages::UNIFORM,
    })
}

/// A read-only storage buffer; an empty one still needs a few bytes to be bound.
pub(super) fn storage(device: &wgpu::Device, label: &str, contents: &[u8]) -> wgpu::Buffer {
    device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some(label),
        contents: if contents.is_empty() { &[0; 64] } else { contents },
        usage: wgpu::BufferUsages::STORAGE,
    })
}

pub(super) fn buffer(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}

pub(super) fn texture(binding: u32, view: &wgpu::TextureView) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) }
}

/// A texture with its texels, to be read by shaders.
pub(super) fn texture_of(
    gpu: &Gpu,
    label: &str,
    [width, height, depth_or_array_layers]: [u32; 3],
    dimension: wgpu::TextureDimension,
    format: wgpu::TextureFormat,
    texels: &[u8],
) -> wgpu::TextureView {
    let texture = gpu.device.create_texture_with_data(
        &gpu.queue,
        &wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        },
        wgpu::util::TextureDataOrder::LayerMajor,
        texels,
    );
    texture.create_view(&Default::default())
}

/// A texture of halves (16-bit floats) that is read between its texels, never beyond its edge.
pub(super) fn volume_texture(
    gpu: &Gpu,
    label: &str,
    size: [usize; 3],
    texels: &[[u16; 4]],
) -> wgpu::TextureView {
    let (size, texels) = (size.map(|n| n as u32), bytemuck::cast_slice(texels));
    let format = wgpu::TextureFormat::Rgba16Float;
    texture_of(gpu, label, size, wgpu::TextureDimension::D3, format, texels)
}

/// Points in a row of a texture that holds something of each.
pub(super) const POINTS_A_ROW: usize = 4096;

/// A texture of 16 bytes a point, row by row.
pub(super) fn point_texture(gpu: &Gpu, points: &[PointFibre]) -> wgpu::TextureView {
    let width = points.len().clamp(1, POINTS_A_ROW);
    let height = points.len().div_ceil(width).max(1);
    let mut texels = points.to_vec();
    texels.resize(width * height, PointFibre::zeroed());
    let size = [width as u32, height as u32, 1];
    let (format, texels) = (wgpu::TextureFormat::Rgba32Uint, bytemuck::cast_slice(&texels));
    texture_of(gpu, "painted", size, wgpu::TextureDimension::D2, format, texels)
}

/// Writes those rows of a [`point_texture`] of `before` again that `points` change.
pub(super) fn repaint_texture(
    gpu: &Gpu,
    texture: &wgpu::TextureView,
    before: &[PointFibre],
    points: &[PointFibre],
) {
    let width = points.len().clamp(1, POINTS_A_ROW);
    let rows = before.chunks(width).zip(points.chunks(width)).enumerate();
    for (y, (_, row)) in rows.filter(|(_, (before, row))| before != row) {
        let mut texels = row.to_vec();
        texels.resize(width, PointFibre::zeroed());
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: texture.texture(),
                mip_level: 0,
                origin: wgpu::Origin3d { x: 0, y: y as u32, z: 0 },
                aspect: wgpu::TextureAspect::All,
            },
            bytemuck::cast_slice(&texels),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some((width * size_of::<PointFibre>()) as u32),
                rows_per_image: None,
            },
            wgpu::Extent3d { width: width as u32, height: 1, depth_or_array_layers: 1 },
        );
    }
}

pub(super) fn linear_sampler(device: &wgpu::Device) -> wgpu::Sampler {
    device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    })
}

pub(super) fn sampler(binding: u32, sampler: &wgpu::Sampler) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::Sampler(sampler) }
}

/// Binds buffers to bindings 0, 1, 2, …
pub(super) fn bind(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    buffers: &[&wgpu::Buffer],
) -> wgpu::BindGroup {
    let entries: Vec<_> = buffers.iter().enumerate().map(|(i, b)| buffer(i as u32, b)).collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}
