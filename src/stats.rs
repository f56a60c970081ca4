//! The figures of a capture, as `--stats` writes them. Names and units are stable.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use serde::Serialize;

use crate::file::write_whole;
use crate::gpu::frame::Frame;
use crate::image::luminance;
use crate::quality::{Expected, Facts, Settings};

#[derive(Debug, Serialize)]
pub struct Stats {
    pub adapter: Adapter,
    pub hair: HairCounts,
    pub environment: EnvironmentCounts,
    pub fit: FitFigures,
    pub transport: TransportFigures,
    pub work: Work,
    pub quality: Quality,
    pub timing: Timing,
    pub memory: Memory,
    pub image: ImageFigures,
}

#[derive(Debug, Serialize)]
pub struct Adapter {
    pub name: String,
    pub backend: String,
    pub device_type: String,
}

#[derive(Debug, Serialize)]
pub struct HairCounts {
    pub strands: usize,
    pub points: usize,
    /// Of the last frame.
    pub points_shaded: usize,
    pub mended: usize,
    pub dropped: usize,
    /// World units.
    pub fibre_diameter: f32,
}

#[derive(Debug, Serialize)]
pub struct EnvironmentCounts {
    pub width: usize,
    pub height: usize,
    pub mended_nan: usize,
    pub mended_inf: usize,
    pub mended_negative: usize,
}

/// Relative L2 errors in linear radiance, as in `srbf::Fit`.
#[derive(Debug, Serialize)]
pub struct FitFigures {
    pub lights: usize,
    pub relative_l2: f64,
    pub relative_l2_blurred_0_15: f64,
    pub relative_l2_blurred_0_30: f64,
    pub energy_ratio: f64,
    pub seconds: f64,
    pub cached: bool,
}

#[derive(Debug, Default, Serialize)]
pub struct TransportFigures {
    /// T̃ of the frame less T̃ by rays through the real strands, over seen points and lights that shine: see
    /// [`crate::reference::transmittance::DeltaT`]. All are null unless asked for.
    pub mean_abs_delta_t: Option<f64>,
    pub mean_delta_t: Option<f64>,
    /// Null too where no light arrives.
    pub mean_delta_t_lit: Option<f64>,
    pub weighted_abs_delta_t: Option<f64>,
}

/// What the frame was made with, and the error that it is expected to have against path tracing.
#[derive(Debug, Serialize)]
pub struct Quality {
    #[serde(flatten)]
    pub settings: Settings,
    /// Relative L2 over hair, whole and by cause.
    #[serde(flatten)]
    pub expected: Expected,
    /// What that follows from.
    #[serde(flatten)]
    pub facts: Facts,
}

/// What the last frame took, in numbers that repeat exactly.
#[derive(Debug, Serialize)]
pub struct Work {
    /// That are shaded: wide ones are split. And those of them that are placed by hand.
    pub lights: usize,
    pub lamps: usize,
    pub points_shaded: u64,
    /// Points times lights, and those pairs that matter.
    pub pairs_asked: u64,
    pub pairs_lit: u64,
    /// Evaluations of the method's integrals.
    pub single_evaluations: u64,
    pub global_evaluations: u64,
    /// Modes joined with a light; 0 for `xu`, which does not count them.
    pub lobes: u64,
    /// That light is brought to.
    pub head_vertices: usize,
    /// Look-ups of optical depth for transport to the inside of the hair and to the head.
    pub transport_looks: u64,
    /// Rays for T̃ at the points.
    pub rays: u64,
    /// Paths that leave visible points for light of the sky and between strands.
    pub paths: u64,
    /// Rounds of sweeps along all ordinates until what strands make of each other's light stood still.
    pub field_rounds: usize,
    /// Tables, reach, lights, field and points that shading reads.
    pub bytes: u64,
}

#[derive(Debug, Serialize)]
pub struct Timing {
    /// Wall time of the last frame, with its read-back.
    pub frame_ms: f64,
    /// Wall time before the first frame.
    pub setup_ms: f64,
    /// Wall time of it all up to these figures.
    pub total_ms: f64,
    /// Set-up steps by wall time, and passes of the last frame by GPU timestamps where there are, else
    /// the frame's wall time as `frame`.
    pub passes: BTreeMap<&'static str, f64>,
}

#[derive(Debug, Serialize)]
pub struct Memory {
    /// Greatest resident size of the process; null where the system does not tell.
    pub peak_bytes: Option<u64>,
}

#[derive(Debug, Serialize)]
pub struct ImageFigures {
    pub width: u32,
    pub height: u32,
    pub non_finite_pixels: usize,
    /// Linear Rec. 709, background included.
    pub mean_luminance: f64,
    /// Mean share of a pixel that hair covers.
    pub hair_coverage: f64,
    /// What PNG pixels were multiplied by before tone mapping.
    pub exposure_scale: f32,
}

impl ImageFigures {
    pub fn of(frame: &Frame, exposure_scale: f32) -> ImageFigures {
        let count = frame.pixels.len().max(1) as f64;
        let finite = |p: &&[f32; 4]| p.iter().all(|v| v.is_finite());
        let luminances =
            frame.pixels.iter().filter(finite).map(|p| f64::from(luminance([p[0], p[1], p[2]])));
        ImageFigures {
            width: frame.size[0],
            height: frame.size[1],
            non_finite_pixels: frame.pixels.iter().filter(|p| !finite(p)).count(),
            mean_luminance: luminances.sum::<f64>() / count,
            hair_coverage: frame.hair_coverage.iter().map(|&c| f64::from(c)).sum::<f64>() / count,
            exposure_scale,
        }
    }
}

impl Memory {
    /// Reads `VmHWM` of /proc/self/status.
    pub fn now() -> Memory {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
        Memory { peak_bytes: kib.map(|kib| 1024 * kib) }
    }
}

impl Stats {
    pub fn write(&self, path: &Path) -> Result<()> {
        write_whole(path, |file| {
            serde_json::to_writer_pretty(&*file, self)?;
            std::io::Write::write_all(file, b"\n")?;
            Ok(())
        })
    }
}
