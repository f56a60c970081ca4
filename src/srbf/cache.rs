//! Fits remembered by content: one small file each, named by the hash of the map, n and the
//! algorithm.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Result;
use glam::DVec3;

use super::{Fit, MAX_LIGHTS, SrbfLight, fit};
use crate::environment::Environment;
use crate::file::{folder_of, user_folder, write_whole};

/// Raise this whenever the same map would get other lights, or the file another layout.
const VERSION: u32 = 4;

/// Numbers before the lights (errors at 0, 0.15 and 0.3, energy ratio, seconds) and in each light.
const HEAD: usize = 5;
const PER_LIGHT: usize = 7;

/// Like [`fit`], but a fit made before is read from the cache folder (see [`cache_folder`]).
/// A cache that is missing, damaged or not writable costs the time of a fit and is no error.
pub fn fit_cached(
    env: &Environment,
    n: usize,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Result<Fit> {
    match cache_folder() {
        Some(folder) => fit_cached_in(&folder, env, n, progress),
        None => fit(env, n, progress),
    }
}

/// `$HAIRLIGHT_CACHE`, else `$XDG_CACHE_HOME/hairlight`, else `~/.cache/hairlight`; None without a
/// home.
pub fn cache_folder() -> Option<PathBuf> {
    folder_of("HAIRLIGHT_CACHE").or_else(|| user_folder("XDG_CACHE_HOME", ".cache"))
}

/// Like [`fit_cached`], with the cache in `folder`, which is made where it is missing.
pub fn fit_cached_in(
    folder: &Path,
    env: &Environment,
    n: usize,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Result<Fit> {
    if !env.lights.is_empty() {
        return fit(env, n, progress);
    }
    let key = blake3::hash(format!("{} {n} {VERSION}", env.content_hash()).as_bytes());
    let path = folder.join(format!("{}.fit", key.to_hex()));
    if let Some(fit) = std::fs::read(&path).ok().and_then(|bytes| decode(&bytes)) {
        progress(1.0);
        return Ok(fit);
    }
    let fit = fit(env, n, progress)?;
    // The fit is as good without its copy, so a full disk or a read-only home says nothing.
    let _ = store(&path, folder, &encode(&fit));
    Ok(fit)
}

fn store(path: &Path, folder: &Path, bytes: &[u8]) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    write_whole(path, |file| Ok(file.write_all(bytes)?))
}

/// Little-endian f64s behind their own hash, so that every bit comes back and damage is seen.
fn encode(fit: &Fit) -> Vec<u8> {
    let head = [
        fit.relative_l2,
        fit.relative_l2_blurred_0_15,
        fit.relative_l2_blurred_0_30,
        fit.energy_ratio,
        fit.seconds,
    ];
    let lights = fit.lights.iter().flat_map(|light| {
        let [x, y, z] = light.direction.to_array();
        let [r, g, b] = light.rgb;
        [x, y, z, light.lambda, r, g, b]
    });
    let body: Vec<u8> = head.into_iter().chain(lights).flat_map(f64::to_le_bytes).collect();
    [blake3::hash(&body).as_bytes(), &body[..]].concat()
}

/// Whether the bytes are those of a fit in the cache.
pub fn is_cached_fit(bytes: &[u8]) -> bool {
    decode(bytes).is_some()
}

fn decode(bytes: &[u8]) -> Option<Fit> {
    let (hash, body) = bytes.split_first_chunk::<32>()?;
    if blake3::hash(body).as_bytes() != hash {
        return None;
    }
    let (numbers, rest) = body.as_chunks::<8>();
    let numbers: Vec<f64> = numbers.iter().map(|&bytes| f64::from_le_bytes(bytes)).collect();
    let (&[relative_l2, blurred_0_15, blurred_0_30, energy_ratio, seconds], lights) =
        numbers.split_first_chunk::<HEAD>()?;
    let (lights, left) = lights.as_chunks::<PER_LIGHT>();
    if !rest.is_empty() || !left.is_empty() || !(1..=MAX_LIGHTS).contains(&lights.len()) {
        return None;
    }
    let light = |&[x, y, z, lambda, r, g, b]: &[f64; PER_LIGHT]| SrbfLight {
        direction: DVec3::new(x, y, z),
        lambda,
        rgb: [r, g, b],
    };
    Some(Fit {
        lights: lights.iter().map(light).collect(),
        relative_l2,
        relative_l2_blurred_0_15: blurred_0_15,
        relative_l2_blurred_0_30: blurred_0_30,
        energy_ratio,
        seconds,
        cached: true,
    })
}
