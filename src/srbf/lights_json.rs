//! lights.json: `{"lights":[{"direction":[x,y,z],"lambda":λ,"rgb":[r,g,b]},…]}`, unrotated.

use std::io::Write;
use std::path::Path;

use anyhow::{Result, anyhow, ensure};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{MAX_LIGHTS, SrbfLight};
use crate::file::write_whole;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightsJson {
    lights: Vec<LightJson>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightJson {
    direction: [f64; 3],
    lambda: f64,
    rgb: [f64; 3],
}

/// The lights as JSON, one light a line.
pub fn to_json(lights: &[SrbfLight]) -> String {
    let lines: Vec<String> = lights
        .iter()
        .map(|light| {
            let light = LightJson {
                direction: light.direction.to_array(),
                lambda: light.lambda,
                rgb: light.rgb,
            };
            serde_json::to_string(&light).expect("numbers become JSON")
        })
        .collect();
    format!("{{\"lights\":[\n{}\n]}}\n", lines.join(",\n"))
}

/// The greatest radiance of a light's peak: what the fit may make of the brightest map, and finite in f32.
const BRIGHTEST: f64 = 1e35;

/// Lights from JSON, after a byte order mark or none: 1 to 256 of them, directions of any length but 0, λ from 0.001
/// to 1000, rgb from 0 to 1e35. Errors are one line.
pub fn from_json(json: &str) -> Result<Vec<SrbfLight>> {
    let json = json.trim_start_matches('\u{feff}');
    let read: LightsJson = serde_json::from_str(json)
        .map_err(|error| anyhow!("{}", error.to_string().replace(char::is_control, " ")))?;
    let count = read.lights.len();
    ensure!((1..=MAX_LIGHTS).contains(&count), "{count} lights: give 1 to {MAX_LIGHTS}");
    let convert = |(i, light): (usize, LightJson)| {
        let direction = DVec3::from_array(light.direction);
        let length = direction.length();
        ensure!(length > 0.0 && length.is_finite(), "light {i}: direction must not be zero");
        ensure!((1e-3..=1e3).contains(&light.lambda), "light {i}: lambda must be 0.001 to 1000");
        ensure!(
            light.rgb.iter().all(|v| (0.0..=BRIGHTEST).contains(v)),
            "light {i}: rgb must be 0 to {BRIGHTEST:e}"
        );
        // What is a unit vector already keeps its bits.
        let direction = if (length - 1.0).abs() < 1e-12 { direction } else { direction / length };
        Ok(SrbfLight { direction, lambda: light.lambda, rgb: light.rgb })
    };
    read.lights.into_iter().enumerate().map(convert).collect()
}

/// Writes `to_json` to `path`, whole or not at all.
pub fn write_json(lights: &[SrbfLight], path: &Path) -> Result<()> {
    write_whole(path, |file| Ok(file.write_all(to_json(lights).as_bytes())?))
}
