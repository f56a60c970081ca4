//! Hair colours to start from: pigment, roughness, tilt and the width of the glint.
//!
//! Concentrations follow pbrt-v4 §9.9.8; β_R = 5…10° and α_R = −5…−10° are Marschner's ranges
//! (2003, Table 1). α_R is negative: the scales point to the tip, so highlights move to the root.

use super::{FibreSpec, Pigment};

/// The key whose value is a preset's name.
pub(super) const KEY: &str = "fibre.preset";

/// A named hair colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    pub name: &'static str,
    /// Why these values, in one line.
    pub rationale: &'static str,
    pub pigment: Pigment,
    pub beta_r_deg: f64,
    pub alpha_r_deg: f64,
    pub w_c: f64,
}

/// All presets; the first is the default.
pub const PRESETS: &[Preset] = &[
    Preset {
        name: "brown",
        rationale: "eumelanin alone at pbrt's brown, of ordinary gloss",
        pigment: melanin(1.3, 0.0),
        beta_r_deg: 7.0,
        alpha_r_deg: -7.0,
        w_c: 0.15,
    },
    Preset {
        name: "black",
        rationale: "eumelanin at pbrt's black; a smooth, thick cuticle, so the gloss is narrow",
        pigment: melanin(8.0, 0.0),
        beta_r_deg: 5.5,
        alpha_r_deg: -6.0,
        w_c: 0.12,
    },
    Preset {
        name: "blond",
        rationale: "little eumelanin, warmed by as little pheomelanin; fine hair with clear glints",
        pigment: melanin(0.2, 0.15),
        beta_r_deg: 7.5,
        alpha_r_deg: -7.5,
        w_c: 0.12,
    },
    Preset {
        name: "red",
        rationale: "mostly pheomelanin, which passes red and stops blue",
        pigment: melanin(0.25, 1.5),
        beta_r_deg: 7.0,
        alpha_r_deg: -7.0,
        w_c: 0.13,
    },
    Preset {
        name: "white",
        rationale: "no melanin at all; aged hair is coarse, so the gloss is wide",
        pigment: Pigment::Absorption([0.0; 3]),
        beta_r_deg: 9.0,
        alpha_r_deg: -8.0,
        w_c: 0.2,
    },
    Preset {
        name: "dyed",
        rationale: "a magenta dye on bleached hair, whose lifted scales are rough and steep",
        pigment: Pigment::Absorption([0.05, 1.1, 0.3]),
        beta_r_deg: 9.0,
        alpha_r_deg: -9.0,
        w_c: 0.18,
    },
];

/// The names of [`PRESETS`], in order.
pub(super) const NAMES: &[&str] = &{
    let mut names = [""; PRESETS.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = PRESETS[i].name;
        i += 1;
    }
    names
};

const fn melanin(eumelanin: f64, pheomelanin: f64) -> Pigment {
    Pigment::Melanin { eumelanin, pheomelanin }
}

impl FibreSpec {
    /// Takes the preset's colour, roughness, tilt and glint; TT and TRT are linked again, and no lobe is tinted, so that
    /// it looks like its picture.
    pub fn set_preset(&mut self, preset: &Preset) {
        self.preset = preset.name.to_owned();
        self.pigment = preset.pigment;
        self.beta_r_deg = preset.beta_r_deg;
        self.alpha_r_deg = preset.alpha_r_deg;
        self.w_c = preset.w_c;
        (self.beta_tt_deg, self.beta_trt_deg) = (None, None);
        (self.alpha_tt_deg, self.alpha_trt_deg) = (None, None);
        (self.tint_r, self.tint_tt, self.tint_trt) = ([1.0; 3], [1.0; 3], [1.0; 3]);
        (self.intensity_r, self.intensity_tt, self.intensity_trt) = (1.0, 1.0, 1.0);
    }
}
