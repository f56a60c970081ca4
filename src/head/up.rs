//! Which way is up in a file and how long its unit is: from its frame to the world's (right-handed, y up).

use anyhow::{Error, Result, bail, ensure};
use glam::{Vec3, vec3};
use std::fmt;
use std::str::FromStr;

/// Factors from a file's unit to the world's that coordinates survive in f32.
const SCALE_RANGE: [f32; 2] = [1e-9, 1e9];

/// Fails, in one line, where `scale` is NaN or outside 1e-9 to 1e9.
pub fn check_scale(scale: f32) -> Result<()> {
    let [smallest, largest] = SCALE_RANGE;
    ensure!(
        (smallest..=largest).contains(&scale),
        "scale {scale} is out of range: {smallest:e} to {largest:e}"
    );
    Ok(())
}

/// The axis of a file that points up; written `x`, `-x`, `y`, `-y`, `z` or `-z`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    X,
    NegX,
    #[default]
    Y,
    NegY,
    Z,
    NegZ,
}

impl Up {
    /// Every axis, for help texts and tests.
    pub const ALL: [Up; 6] = [Up::X, Up::NegX, Up::Y, Up::NegY, Up::Z, Up::NegZ];

    /// Turns a vector of the file into the world, so that this axis becomes +y: a proper rotation about x
    /// (z up) or about z (x up, y down), by quarter turns, hence exact.
    pub fn to_world(self, v: Vec3) -> Vec3 {
        match self {
            Up::X => vec3(-v.y, v.x, v.z),
            Up::NegX => vec3(v.y, -v.x, v.z),
            Up::Y => v,
            Up::NegY => vec3(-v.x, -v.y, v.z),
            Up::Z => vec3(v.x, v.z, -v.y),
            Up::NegZ => vec3(v.x, -v.z, v.y),
        }
    }
}

impl Up {
    /// Turns a vector of the world back into the file.
    pub fn from_world(self, v: Vec3) -> Vec3 {
        Vec3::from(Vec3::AXES.map(|axis| self.to_world(axis).dot(v)))
    }
}

impl fmt::Display for Up {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Up::X => "x",
            Up::NegX => "-x",
            Up::Y => "y",
            Up::NegY => "-y",
            Up::Z => "z",
            Up::NegZ => "-z",
        })
    }
}

impl FromStr for Up {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let name = name.trim().to_ascii_lowercase();
        let plain = name.strip_prefix('+').unwrap_or(&name);
        match Up::ALL.into_iter().find(|up| up.to_string() == plain) {
            Some(up) => Ok(up),
            None => bail!("up axis '{name}' is unknown: say x, y, z, -x, -y or -z"),
        }
    }
}
