//! The table of fields: every key of a scene, once.

use super::fibre::MOST_MELANIN;
use super::field::{Alternative, Field, Kind, Slot, Value};
use super::preset::{self, PRESETS};
use super::{
    Background, Bcsdf, Energies, LAMPS, LampKind, Method, Orbit, Pigment, Reverse, Scattering,
    Scene, UP_WORDS, View,
};
use crate::scattering::fibre::BETA_DEG;

/// A field that is a plain member of the scene's structs; `key` follows from where it is.
macro_rules! field {
    ($group:ident.$name:ident, $flag:literal, $kind:expr, $help:literal $(, $more:ident: $value:expr)*) => {
        Field {
            get: |scene| Some(scene.$group.$name.value()),
            set: |scene, value| scene.$group.$name.assign(value),
            $($more: $value,)*
            ..field(concat!(stringify!($group), ".", stringify!($name)), $flag, $kind, $help)
        }
    };
}

/// A field of `fibre.chiang`.
macro_rules! chiang_field {
    ($name:ident, $flag:literal, $kind:expr, $help:literal $(, $more:ident: $value:expr)*) => {
        Field {
            get: |scene| Some(scene.fibre.chiang.$name.value()),
            set: |scene, value| scene.fibre.chiang.$name.assign(value),
            unset: Some("linked"),
            $($more: $value,)*
            ..field(concat!("fibre.chiang.", stringify!($name)), $flag, $kind, $help)
        }
    };
}

/// A field of a lamp.
macro_rules! lamp_field {
    ($place:literal, $lamp:literal, $name:ident, $flag:literal, $kind:expr, $unit:literal, $help:literal) => {
        Field {
            get: |scene| Some(scene.lamps[$place].$name.value()),
            set: |scene, value| scene.lamps[$place].$name.assign(value),
            unit: $unit,
            ..field(concat!($lamp, ".", stringify!($name)), concat!($lamp, $flag), $kind, $help)
        }
    };
}

/// The fields of one of [`LAMPS`].
macro_rules! lamp_fields {
    ($place:literal, $lamp:literal) => {
        &[
            lamp_field!(
                $place,
                $lamp,
                kind,
                "",
                LAMP_KIND,
                "",
                "a light placed by hand; a softbox is a square that faces the hair"
            ),
            lamp_field!(
                $place,
                $lamp,
                azimuth_deg,
                "-azimuth",
                ANGLE,
                "degrees",
                "its angle from the face to +x"
            ),
            lamp_field!(
                $place,
                $lamp,
                elevation_deg,
                "-elevation",
                ELEVATION,
                "degrees",
                "its angle above the horizon"
            ),
            lamp_field!(
                $place,
                $lamp,
                distance,
                "-distance",
                LAMP_DISTANCE,
                "",
                "from the middle of the hair, in radii of the hair; of no sun"
            ),
            lamp_field!(
                $place,
                $lamp,
                size,
                "-size",
                LAMP_SIZE,
                "",
                "radius or half a side in radii of the hair; of a sun the angular radius in degrees"
            ),
            lamp_field!($place, $lamp, color, "-color", LAMP_COLOR, "", "colour of its light"),
            lamp_field!(
                $place,
                $lamp,
                irradiance,
                "-irradiance",
                IRRADIANCE,
                "",
                "what faces it in the middle of the hair receives: radiance of the map times sr"
            ),
        ]
    };
}

const fn field(key: &'static str, flag: &'static str, kind: Kind, help: &'static str) -> Field {
    Field {
        key,
        flag,
        short: None,
        kind,
        unit: "",
        unset: None,
        alternative: None,
        help,
        get: |_| None,
        set: |_, _| {},
    }
}

const fn color_by(way: &'static str) -> Option<Alternative> {
    Some(Alternative { of: "the colour of the fibre", way })
}

const fn view_by(way: &'static str) -> Option<Alternative> {
    Some(Alternative { of: "where the camera stands", way })
}

const SCALE: Kind = Kind::Number { min: 1e-6, max: 1e6 };
const ANGLE: Kind = Kind::Number { min: -360.0, max: 360.0 };
const ELEVATION: Kind = Kind::Number { min: -90.0, max: 90.0 };
const LAMP_KIND: Kind = Kind::Choice(LampKind::WORDS);
const LAMP_DISTANCE: Kind = Kind::Number { min: 0.1, max: 1000.0 };
const LAMP_SIZE: Kind = Kind::Number { min: 0.01, max: 45.0 };
const LAMP_COLOR: Kind = Kind::Color { min: 0.0, max: 1.0, words: &[] };
const IRRADIANCE: Kind = Kind::Number { min: 0.0, max: 1e6 };
const STOPS: Kind = Kind::Number { min: -20.0, max: 20.0 };
const BETA: Kind = Kind::Number { min: BETA_DEG[0], max: BETA_DEG[1] };
const ALPHA: Kind = Kind::Number { min: -20.0, max: 20.0 };
const POINT: Kind = Kind::Vector { min: -1e9, max: 1e9 };
const ROUGHNESS: Kind = Kind::Number { min: 0.01, max: 1.0 };
const TINT: Kind = Kind::Color { min: 0.0, max: 1.0, words: &[] };
const INTENSITY: Kind = Kind::Number { min: 0.0, max: 4.0 };
const CONCENTRATION: Kind = Kind::Number { min: 0.0, max: MOST_MELANIN };

/// All fields, in the order of a scene file.
pub static FIELDS: &[Field] = &{
    let mut all = [PLACES[0]; PLACES.len() + LAMPS * LAMP_FIELDS[0].len() + LOOKS.len()];
    let mut parts = [PLACES; LAMPS + 2];
    parts[LAMPS + 1] = LOOKS;
    let (mut part, mut count) = (0, 0);
    while part < parts.len() {
        if 0 < part && part <= LAMPS {
            parts[part] = LAMP_FIELDS[part - 1];
        }
        let mut i = 0;
        while i < parts[part].len() {
            all[count] = parts[part][i];
            (i, count) = (i + 1, count + 1);
        }
        part += 1;
    }
    all
};

const LAMP_FIELDS: [&[Field]; LAMPS] = [
    lamp_fields!(0, "lamp1"),
    lamp_fields!(1, "lamp2"),
    lamp_fields!(2, "lamp3"),
    lamp_fields!(3, "lamp4"),
];

/// What is where: hair, head, environment.
const PLACES: &[Field] = &[
    field!(
        hair.source,
        "hair",
        Kind::Source { builtins: &crate::hair::groom::STYLES, words: &[] },
        "strands: .hair, .tfx, or a builtin groom"
    ),
    field!(hair.up, "up", Kind::Choice(UP_WORDS), "axis of the hair's file that points up"),
    field!(hair.scale, "scale", SCALE, "world lengths per length in the hair's file"),
    field!(
        hair.reverse,
        "reverse",
        Kind::Choice(Reverse::WORDS),
        "whether the hair's file has strands from tip to root; auto tells by where they lie"
    ),
    field!(
        hair.strands,
        "strands",
        Kind::Integer { min: 1e3, max: 2e5 },
        "strands of a builtin groom"
    ),
    field!(
        hair.seed,
        "seed",
        Kind::Integer { min: 0.0, max: u32::MAX as f64 },
        "random seed of a builtin groom"
    ),
    field!(
        hair.length,
        "length",
        Kind::Number { min: 0.2, max: 2.0 },
        "length of a builtin groom, times its own"
    ),
    field!(
        hair.curl,
        "curl",
        Kind::Number { min: 0.0, max: 2.0 },
        "curl of a builtin groom, times its own"
    ),
    field!(hair.clump, "clump", Kind::Number { min: 0.0, max: 1.0 }, "clumping of a builtin groom",
        unset: Some("auto")),
    field!(hair.flyaway, "flyaway", Kind::Number { min: 0.0, max: 1.0 },
        "stray strands of a builtin groom", unset: Some("auto")),
    field!(hair.paint, "paint", Kind::Source { builtins: &[], words: &["colors"] },
        "fibre parameters painted on the hair: .paint; colors are those that its file has",
        unset: Some("none")),
    field!(
        head.source,
        "head",
        Kind::Source { builtins: &[], words: &["auto", "builtin", "none"] },
        "head under the hair: .obj; auto is builtin for builtin hair, else none"
    ),
    field!(head.scale, "head-scale", SCALE,
        "world lengths per length in the head's file; auto fits it to the roots", unset: Some("auto")),
    field!(head.up, "head-up", Kind::Choice(UP_WORDS),
        "axis of the head's file that points up; auto fits it to the roots", unset: Some("auto")),
    field!(head.offset, "head-offset", POINT,
        "where the origin of the head's file goes; auto is 0, and under the roots for builtin",
        unset: Some("auto")),
    field!(
        head.color,
        "head-color",
        Kind::Color { min: 0.0, max: 1.0, words: &[] },
        "diffuse reflectance of the head"
    ),
    field!(
        environment.source,
        "env",
        Kind::Source { builtins: &["studio", "sunset", "overcast", "night"], words: &[] },
        "lat-long map that lights the scene: .exr, .hdr, or lights .json as fit writes them"
    ),
    field!(environment.layer, "env-layer", Kind::Text,
        "layer of an .exr with several; auto is its finished picture", unset: Some("auto")),
    field!(environment.rotation_deg, "env-rotation", ANGLE,
        "turn of the light about the vertical, counter-clockwise from above", unit: "degrees"),
    field!(environment.exposure, "env-exposure", STOPS, "exposure of the light", unit: "stops"),
    field!(
        environment.lights,
        "lights",
        Kind::Integer { min: 1.0, max: 256.0 },
        "lights fitted to the map; auto is 40, or what the quality needs",
        unset: Some("auto")
    ),
];

/// How it looks: fibre, camera, rendering, output.
const LOOKS: &[Field] = &[
    field!(
        fibre.model,
        "bcsdf",
        Kind::Choice(Bcsdf::WORDS),
        "how a fibre scatters; deon keeps all light, chiang is for the reference"
    ),
    Field {
        get: |scene| Some(scene.fibre.preset.value()),
        set: |scene, value| {
            let named = |p: &&preset::Preset| Value::Text(p.name.to_owned()) == value;
            if let Some(preset) = PRESETS.iter().find(named) {
                scene.fibre.set_preset(preset);
            }
        },
        ..field(
            preset::KEY,
            "preset",
            Kind::Choice(preset::NAMES),
            "colour, roughness and tilt to start from, lobes untinted",
        )
    },
    field!(fibre.eta, "eta", Kind::Number { min: 1.0, max: 3.0 }, "index of refraction"),
    Field {
        alternative: color_by("absorption"),
        get: |scene| match scene.fibre.pigment {
            Pigment::Absorption(sigma_a) => Some(sigma_a.value()),
            _ => None,
        },
        set: |scene, value| {
            let mut sigma_a = [0.0; 3];
            sigma_a.assign(value);
            scene.fibre.pigment = Pigment::Absorption(sigma_a);
        },
        ..field(
            "fibre.sigma_a",
            "sigma-a",
            Kind::Vector { min: 0.0, max: 1000.0 },
            "absorption per fibre radius, linear RGB",
        )
    },
    Field {
        alternative: color_by("melanin"),
        get: |scene| match scene.fibre.pigment {
            Pigment::Melanin { eumelanin, .. } => Some(eumelanin.value()),
            _ => None,
        },
        set: |scene, value| {
            let [mut eumelanin, pheomelanin] = scene.fibre.melanin();
            eumelanin.assign(value);
            scene.fibre.pigment = Pigment::Melanin { eumelanin, pheomelanin };
        },
        ..field(
            "fibre.eumelanin",
            "eumelanin",
            CONCENTRATION,
            "concentration of brown pigment; blond 0.3, brown 1.3, black 8",
        )
    },
    Field {
        alternative: color_by("melanin"),
        get: |scene| match scene.fibre.pigment {
            Pigment::Melanin { pheomelanin, .. } => Some(pheomelanin.value()),
            _ => None,
        },
        set: |scene, value| {
            let [eumelanin, mut pheomelanin] = scene.fibre.melanin();
            pheomelanin.assign(value);
            scene.fibre.pigment = Pigment::Melanin { eumelanin, pheomelanin };
        },
        ..field("fibre.pheomelanin", "pheomelanin", CONCENTRATION, "concentration of red pigment")
    },
    Field {
        alternative: color_by("color"),
        get: |scene| match scene.fibre.pigment {
            Pigment::Color(color) => Some(color.value()),
            _ => None,
        },
        set: |scene, value| {
            let mut color = [0.0; 3];
            color.assign(value);
            scene.fibre.pigment = Pigment::Color(color);
        },
        ..field(
            "fibre.color",
            "color",
            Kind::Color { min: 0.001, max: 0.999, words: &[] },
            "wanted colour of the hair as a whole, of untinted lobes (approximate)",
        )
    },
    field!(fibre.beta_r_deg, "beta-r", BETA, "longitudinal width of R", unit: "degrees"),
    field!(fibre.beta_tt_deg, "beta-tt", BETA, "longitudinal width of TT; linked is half of R's",
        unit: "degrees", unset: Some("linked")),
    field!(fibre.beta_trt_deg, "beta-trt", BETA, "longitudinal width of TRT; linked is twice R's",
        unit: "degrees", unset: Some("linked")),
    field!(fibre.alpha_r_deg, "alpha-r", ALPHA, "longitudinal shift of R, negative to the root",
        unit: "degrees"),
    field!(fibre.alpha_tt_deg, "alpha-tt", ALPHA, "longitudinal shift of TT; linked is -1/2 of R's",
        unit: "degrees", unset: Some("linked")),
    field!(fibre.alpha_trt_deg, "alpha-trt", ALPHA,
        "longitudinal shift of TRT; linked is -3/2 of R's", unit: "degrees", unset: Some("linked")),
    field!(
        fibre.tint_r,
        "tint-r",
        TINT,
        "colour of R, light that the surface reflects; 1,1,1 is physical"
    ),
    field!(
        fibre.tint_tt,
        "tint-tt",
        TINT,
        "colour of TT, light that comes through the fibre; 1,1,1 is physical"
    ),
    field!(
        fibre.tint_trt,
        "tint-trt",
        TINT,
        "colour of TRT, light reflected once inside, and of longer paths; 1,1,1 is physical"
    ),
    field!(
        fibre.intensity_r,
        "intensity-r",
        INTENSITY,
        "brightness of R; 1 is physical, what is above meets the eye alone, not other strands"
    ),
    field!(fibre.intensity_tt, "intensity-tt", INTENSITY, "brightness of TT, as of R"),
    field!(
        fibre.intensity_trt,
        "intensity-trt",
        INTENSITY,
        "brightness of TRT and longer paths, as of R"
    ),
    field!(fibre.w_c, "w-c", Kind::Number { min: 0.01, max: 1.0 }, "azimuthal width of the glints",
        unit: "radians"),
    field!(
        fibre.eccentricity,
        "eccentricity",
        Kind::Number { min: 0.5, max: 2.0 },
        "ratio of the cross section's axes; 1 is round"
    ),
    field!(
        fibre.diameter,
        "diameter",
        Kind::Number { min: 0.0, max: 1e6 },
        "diameter of a fibre, in the hair's unit; 0 fits it to the hair"
    ),
    chiang_field!(
        beta_m,
        "chiang-beta-m",
        ROUGHNESS,
        "pbrt's longitudinal roughness, for the reference; linked follows beta_r_deg"
    ),
    chiang_field!(
        beta_n,
        "chiang-beta-n",
        ROUGHNESS,
        "pbrt's azimuthal roughness, for the reference; linked follows w_c"
    ),
    chiang_field!(alpha_deg, "chiang-alpha", ALPHA,
        "pbrt's tilt of the scales, for the reference; linked is alpha_r_deg", unit: "degrees"),
    Field {
        alternative: view_by("position"),
        get: |scene| match scene.camera.view {
            View::Position(position) => Some(position.value()),
            View::Orbit(_) => None,
        },
        set: |scene, value| {
            let mut position = [0.0; 3];
            position.assign(value);
            scene.camera.view = View::Position(position);
        },
        ..field("camera.position", "position", POINT, "where the camera stands, in the world")
    },
    field!(camera.target, "target", POINT, "what it looks at; auto is the middle of the hair",
        unset: Some("auto")),
    field!(camera.fov_deg, "fov", Kind::Number { min: 1.0, max: 120.0 }, "vertical field of view",
        unit: "degrees"),
    Field {
        unit: "degrees",
        get: |scene| orbit_of(scene).map(|orbit| orbit.azimuth_deg.value()),
        set: |scene, value| edit_orbit(scene, |orbit| orbit.azimuth_deg.assign(value)),
        ..orbit_field("camera.azimuth_deg", "azimuth", ANGLE, "camera's angle from the face to +x")
    },
    Field {
        unit: "degrees",
        get: |scene| orbit_of(scene).map(|orbit| orbit.elevation_deg.value()),
        set: |scene, value| edit_orbit(scene, |orbit| orbit.elevation_deg.assign(value)),
        ..orbit_field(
            "camera.elevation_deg",
            "elevation",
            ELEVATION,
            "camera's angle above the horizon",
        )
    },
    Field {
        unset: Some("auto"),
        get: |scene| orbit_of(scene).map(|orbit| orbit.distance.value()),
        set: |scene, value| edit_orbit(scene, |orbit| orbit.distance.assign(value)),
        ..orbit_field(
            "camera.distance",
            "distance",
            Kind::Number { min: 0.01, max: 1000.0 },
            "camera's distance in radii of the hair; auto frames it",
        )
    },
    field!(
        render.method,
        "method",
        Kind::Choice(Method::WORDS),
        "how light is integrated; xu is Xu et al. 2011, the baseline"
    ),
    field!(
        render.nodes,
        "nodes",
        Kind::Integer { min: 2.0, max: 4.0 },
        "nodes over the inclination of fast: error for time; auto is 2, of deon 3",
        unset: Some("auto")
    ),
    field!(
        render.segments,
        "segments",
        Kind::Integer { min: 2.0, max: 16.0 },
        "segments over the inclination of xu"
    ),
    field!(
        render.samples,
        "samples",
        Kind::Integer { min: 1.0, max: 1024.0 },
        "samples a pixel; auto is 64, or what the quality needs",
        unset: Some("auto")
    ),
    field!(
        render.quality,
        "quality",
        Kind::Target,
        "picks what is auto for an error against path tracing or a frame time",
        unset: Some("auto")
    ),
    field!(
        render.scattering,
        "scattering",
        Kind::Choice(Scattering::WORDS),
        "which scattering is shown; all but both are for study"
    ),
    field!(
        render.energies,
        "energies",
        Kind::Choice(Energies::WORDS),
        "energies of TT and TRT in xu; taylor is as printed, for absorptions up to 1"
    ),
    field!(render.adapter, "adapter", Kind::Text, "auto, cpu, or part of an adapter's name"),
    field!(output.path, "output", Kind::Output(&["png", "exr"]), "image to write",
        short: Some('o')),
    field!(
        output.size,
        "size",
        Kind::Size { min: 1.0, max: 8192.0 },
        "width and height of the image"
    ),
    Field {
        get: |scene| {
            Some(match scene.output.background {
                Background::Environment => Value::Text("environment".to_owned()),
                Background::Transparent => Value::Text("transparent".to_owned()),
                Background::Color(color) => color.value(),
            })
        },
        set: |scene, value| {
            scene.output.background = match value {
                Value::Text(word) if word == "transparent" => Background::Transparent,
                Value::Text(_) => Background::Environment,
                value => {
                    let mut color = [0.0; 3];
                    color.assign(value);
                    Background::Color(color)
                }
            }
        },
        ..field(
            "output.background",
            "background",
            Kind::Color { min: 0.0, max: 1000.0, words: &["environment", "transparent"] },
            "what is seen past the hair",
        )
    },
    field!(output.exposure, "exposure", STOPS, "exposure before tone mapping", unit: "stops",
        unset: Some("auto")),
    field!(output.stats, "stats", Kind::Output(&["json"]), "figures to write",
        unset: Some("none")),
    field!(
        output.turntable,
        "turntable",
        Kind::Integer { min: 0.0, max: 3600.0 },
        "frames of a turn around the hair, numbered; 0 is a still"
    ),
];

const fn orbit_field(
    key: &'static str,
    flag: &'static str,
    kind: Kind,
    help: &'static str,
) -> Field {
    Field { alternative: view_by("orbit"), ..field(key, flag, kind, help) }
}

fn orbit_of(scene: &Scene) -> Option<Orbit> {
    match scene.camera.view {
        View::Orbit(orbit) => Some(orbit),
        View::Position(_) => None,
    }
}

/// Changes the orbit; a camera with a position goes to the default orbit first.
fn edit_orbit(scene: &mut Scene, edit: impl FnOnce(&mut Orbit)) {
    let mut orbit = orbit_of(scene).unwrap_or_default();
    edit(&mut orbit);
    scene.camera.view = View::Orbit(orbit);
}
