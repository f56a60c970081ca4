//! Lists of lights in, as `hairlight fit` writes them: the map that is their sum.

use anyhow::{Context, Result};

use super::{Environment, SourceInfo};
use crate::{file_kind, srbf};

/// Width and height of the map. Lights narrower than its pixels are widened to them there, not where they shine on hair.
const SIZE: [usize; 2] = [1024, 512];

/// # Errors
/// One line without the file's name: it is no list of lights.
pub fn read(bytes: &[u8]) -> Result<(Environment, SourceInfo)> {
    let text = file_kind::text(bytes).context("is not text in UTF-8")?;
    let lights = srbf::from_json(&text).context("is no list of lights")?;
    let [width, height] = SIZE;
    let map = srbf::preview(&lights, width, height);
    let info = SourceInfo {
        format: "lights",
        channels: format!("{} lights, taken as they are", lights.len()),
        compression: "none",
        ..SourceInfo::default()
    };
    Ok((Environment { lights, ..map }, info))
}
