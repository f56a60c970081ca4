//! Adapter and device: a GPU where there is one, else the CPU through lavapipe.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail, ensure};

use super::shaders::Shaders;
use crate::file::catch_panic;

/// An open device: WebGPU's default limits, but for how large buffers and textures may be, which is what the adapter
/// offers, and no optional feature but timestamps.
pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub info: wgpu::AdapterInfo,
    pub shaders: Shaders,
    lost: Arc<AtomicBool>,
}

/// Backends that hair is drawn on. OpenGL's adapters open, but their frames lack the hair (Mesa 22.3).
const BACKENDS: wgpu::Backends = wgpu::Backends::PRIMARY;

const INSTALL: &str = "install a Vulkan driver (on Debian and Ubuntu the CPU one is \
                       `apt-get install -y mesa-vulkan-drivers`)";

impl Gpu {
    /// Opens an adapter: `auto` prefers discrete, then integrated, then virtual, then CPU;
    /// `cpu` takes the CPU's; anything else is part of the adapter's name, in any case.
    pub fn new(adapter: &str) -> Result<Gpu> {
        pollster::block_on(Self::open(adapter))
    }

    async fn open(wanted: &str) -> Result<Gpu> {
        let adapters = adapters().await?;
        let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
        let chosen = adapters.into_iter().find(|a| {
            let info = a.get_info();
            match wanted {
                "auto" => true,
                "cpu" => info.device_type == wgpu::DeviceType::Cpu,
                name => info.name.to_lowercase().contains(&name.to_lowercase()),
            }
        });
        let Some(adapter) = chosen else {
            let remedy = if wanted == "cpu" { INSTALL } else { "choose one of them" };
            bail!("no adapter matches `{wanted}`; here are: {}; {remedy}", names.join(", "));
        };
        let info = adapter.get_info();
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor {
                label: Some("hairlight"),
                required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
                required_limits: limits(adapter.limits()),
                ..Default::default()
            })
            .await
            .with_context(|| {
                format!("adapter `{}` cannot open a device with default limits", info.name)
            })?;
        let lost = Arc::new(AtomicBool::new(false));
        let told = lost.clone();
        device.set_device_lost_callback(move |_, _| told.store(true, Ordering::Relaxed));
        Ok(Gpu { device, queue, info, shaders: Shaders::default(), lost })
    }

    /// Whether there is an adapter at all.
    ///
    /// # Errors
    /// One line that says what to install.
    pub fn check() -> Result<()> {
        pollster::block_on(adapters()).map(drop)
    }

    /// Whether the device is gone: its driver was reset or updated, or the adapter taken out. Nothing works on it again.
    pub fn lost(&self) -> bool {
        // The device is asked, since it says so by itself only when it is used; what is gone may panic.
        let asked = catch_panic(|| self.device.poll(wgpu::PollType::Poll));
        asked.is_err() || self.lost.load(Ordering::Relaxed)
    }

    /// Waits until all submitted work is done.
    pub fn wait(&self) -> Result<()> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .context("the graphics device was lost")?;
        Ok(())
    }

    /// Reads a whole buffer back; it needs `COPY_SRC`.
    pub fn read<T: bytemuck::AnyBitPattern>(&self, buffer: &wgpu::Buffer) -> Result<Vec<T>> {
        self.read_part(buffer, 0, buffer.size())
    }

    /// The same of `size` bytes from `offset` on.
    pub fn read_part<T: bytemuck::AnyBitPattern>(
        &self,
        buffer: &wgpu::Buffer,
        offset: u64,
        size: u64,
    ) -> Result<Vec<T>> {
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read-back"),
            size,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, offset, &staging, 0, size);
        self.queue.submit([encoder.finish()]);
        staging.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        self.wait()?;
        let view =
            staging.slice(..).get_mapped_range().context("a buffer could not be read back")?;
        Ok(bytemuck::cast_slice(&view).to_vec())
    }
}

/// All adapters that hair can be drawn on, the best one first; at least one.
async fn adapters() -> Result<Vec<wgpu::Adapter>> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    descriptor.backends &= BACKENDS;
    ensure!(
        !descriptor.backends.is_empty(),
        "WGPU_BACKEND allows no backend that can draw hair: unset it, or set it to vulkan, metal or dx12"
    );
    let backends = descriptor.backends;
    let mut adapters = wgpu::Instance::new(descriptor).enumerate_adapters(backends).await;
    ensure!(
        !adapters.is_empty(),
        "no Vulkan, Metal or Direct3D 12 adapter found (OpenGL does not do): {INSTALL}"
    );
    adapters.sort_by_key(|a| preference(a.get_info().device_type));
    Ok(adapters)
}

/// WebGPU's default limits, but for the sizes that grooms and pictures need, as the adapter offers them.
fn limits(offered: wgpu::Limits) -> wgpu::Limits {
    wgpu::Limits {
        max_buffer_size: offered.max_buffer_size,
        max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
        max_texture_dimension_2d: offered.max_texture_dimension_2d,
        ..wgpu::Limits::default()
    }
}

/// Lower is better.
fn preference(kind: wgpu::DeviceType) -> u8 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}
