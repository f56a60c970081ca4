//! The stage: what a scene names, loaded and placed in the world. The real-time frame and the reference both
//! stand on it.

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use glam::{DMat3, DVec3, Vec3};
use obvhs::ray::Ray;

use crate::environment::{self, LightMeter};
use crate::hair::groom::GroomOptions;
use crate::hair::{self, Frames, Hair, LoadOptions, LoadedHair, Mended, OnHead, Refined, refine};
use crate::head::{
    self, Fit, Head, HeadRays, LoadedHead, Placement, Surface, Up, Wanted, check_scale, fit_builtin,
};
use crate::lamp::Lamp;
use crate::paint::{Channel, Fibres, Layer, Paint};
use crate::progress::Clock;
use crate::scene::{Camera, EnvironmentSpec, Lens, Reverse, Scene};
use crate::srbf::{SrbfLight, sky_of, split_wide};
use crate::transport::volume::Volume;

/// Automatic exposure brings the meter's reading here: a third of a stop above what a camera would, since hair is darker
/// than a grey card.
const METERED: f64 = 1.25;

/// A head is somewhere else than its hair where less than this share of the roots lies on it, and the builtin head does not
/// fit where less than that share does.
const ELSEWHERE: f64 = 0.25;
const BUILTIN_FITS: f64 = 0.7;

/// Distance between points of refined hair, of the hair's radius: ARCHITECTURE.md has what others gave.
const SPACING: f32 = 0.02;

/// Points of refined hair at most: as many as a buffer of WebGPU's default limit, 128 MiB, holds.
const MOST_POINTS: usize = 4 << 20;

/// Strands and head.
#[derive(Clone)]
pub struct Geometry {
    /// What is lit, drawn and traced.
    pub hair: Hair,
    /// What it was refined from; None where it is the groom itself.
    pub refined: Option<Arc<Refined>>,
    pub head: Option<Head>,
    /// Diffuse reflectance of the head, linear RGB.
    pub head_albedo: Vec3,
    /// Diameter of a fibre at its thickest, world units.
    pub diameter: f32,
    /// Diameter at each point.
    pub diameters: Vec<f32>,
    pub frames: Frames,
    /// A sphere around the hair.
    pub center: Vec3,
    pub radius: f32,
    pub mended: Mended,
    /// What was assumed and mended, a line each.
    pub notes: Vec<String>,
}

impl Geometry {
    /// As thick as the scene and its paint say.
    pub fn load(scene: &Scene) -> Result<Geometry> {
        Self::load_under(None, scene)
    }

    /// The same with `paint` in place of what the scene names, if there is any.
    pub fn load_under(paint: Option<&Paint>, scene: &Scene) -> Result<Geometry> {
        let mut stage = Self::load_bare(scene)?;
        let named = if paint.is_none() { stage.paint(scene)? } else { None };
        let painted = paint.or(named.as_ref());
        stage.thicken(painted.and_then(|paint| paint.layer(Channel::Thickness)));
        Ok(stage)
    }

    /// Without what is painted.
    pub fn load_bare(scene: &Scene) -> Result<Geometry> {
        let ground = Ground::of(scene)?;
        let LoadedHair { hair, mended, assumed, .. } = load_hair_on(scene, ground.as_ref())?;
        let mut notes = Vec::new();
        let head = match ground {
            Some(ground) => Some(ground.place(&hair, &mut notes)?),
            None => None,
        };
        let diameter = match scene.fibre.diameter {
            0.0 => {
                let fitted = hair::fibre_diameter(&hair);
                notes.push(format!("fibre diameter {:.3e}: {}", fitted.diameter, fitted.reason));
                fitted.diameter
            }
            given => given as f32,
        };
        notes.extend(assumed.iter().chain(&mended.notes).cloned());
        let head_albedo = scene.head.albedo();
        let spacing = SPACING * hair.center_radius().1;
        let (hair, refined) = match refine(&hair, spacing, MOST_POINTS) {
            Some((hair, refined)) => (hair, Some(Arc::new(refined))),
            None => (hair, None),
        };
        let stage = Geometry { refined, ..Geometry::new(hair, head, diameter) };
        Ok(Geometry { mended, notes, head_albedo, ..stage })
    }

    /// The groom, on whose points paint is.
    pub fn groom(&self) -> &Hair {
        self.refined.as_ref().map_or(&self.hair, |refined| &refined.groom)
    }

    /// Paint of the groom at the points of [`Self::hair`].
    pub fn at_points<'a>(&self, paint: &'a Paint) -> Cow<'a, Paint> {
        match &self.refined {
            Some(refined) if paint.points() == refined.groom.points.len() => {
                Cow::Owned(paint.between(&refined.places))
            }
            _ => Cow::Borrowed(paint),
        }
    }

    /// Strands whose fibres are `diameter` wide at their thickest, and a head.
    pub fn new(hair: Hair, head: Option<Head>, diameter: f32) -> Geometry {
        let frames = Frames::new(&hair);
        let head = head.map(|mut head| {
            head.split_folds();
            head
        });
        let (center, radius) = hair.center_radius();
        let (diameters, mended, notes) = Default::default();
        let head_albedo = head::CLAY.into();
        let mut stage = Geometry {
            hair,
            refined: None,
            head,
            head_albedo,
            diameter,
            diameters,
            frames,
            center,
            radius,
            mended,
            notes,
        };
        stage.thicken(None);
        stage
    }

    /// Gives each point its diameter, under the groom's paint of [`Channel::Thickness`] in place of what was painted
    /// before; that of other hair does not count.
    pub fn thicken(&mut self, painted: Option<&Layer>) {
        let bare = [1.0, 0.0, 0.0];
        let painted = painted.filter(|layer| layer.points() == self.groom().points.len());
        let between = painted.zip(self.refined.as_ref());
        let between = between.map(|(layer, refined)| layer.between(&refined.places));
        let painted = between.as_ref().or(painted);
        let factor = |point: usize| painted.map_or(1.0, |layer| layer.over(point, bare)[0]);
        let profile = hair::width_profile(&self.hair);
        let diameters = profile.iter().enumerate().map(|(i, w)| w * self.diameter * factor(i));
        self.diameters = diameters.collect();
    }

    /// What the scene names to be painted on the hair.
    ///
    /// # Errors
    /// One line that names the paint: it is of other hair, or cannot be read, or the groom's file has no colours.
    pub fn paint(&self, scene: &Scene) -> Result<Option<Paint>> {
        Ok(match scene.hair.paint.as_deref() {
            None => None,
            Some("colors") => Some(Paint::of_colors(self.groom()).with_context(|| {
                let source = &scene.hair.source;
                format!("{source}: has no colours of its points: leave out --paint colors")
            })?),
            Some(path) => Some(Paint::read(Path::new(path), self.groom())?),
        })
    }

    /// The scene's fibre at each point, with what is painted over it; errors are those of [`Self::paint`].
    pub fn fibres(&self, scene: &Scene) -> Result<Fibres> {
        let paint = self.paint(scene)?;
        let paint = paint.as_ref().map(|paint| self.at_points(paint));
        Ok(Fibres::new(&scene.fibre, paint.as_deref()))
    }

    /// The same with `paint` in place of what the scene names, if there is any.
    ///
    /// # Errors
    /// One line: it is of other hair; or those of [`Self::paint`].
    pub fn fibres_under(&self, paint: Option<&Paint>, scene: &Scene) -> Result<Fibres> {
        match paint {
            Some(paint) if paint.points() != self.groom().points.len() => {
                bail!("the paint is of other hair: it comes back with it")
            }
            Some(paint) => Ok(Fibres::new(&scene.fibre, Some(&*self.at_points(paint)))),
            None => self.fibres(scene),
        }
    }

    /// The scene's camera, in the world.
    pub fn camera(&self, scene: &Scene) -> Result<Camera> {
        let [width, height] = scene.output.size.map(f64::from);
        scene.camera.resolve(self.center, self.radius, width / height)
    }

    /// The density volume of `cells` along its longest edge over the hair, but for what is far out.
    pub fn density(&self, cells: usize) -> Volume {
        let mut volume = self.empty_volume(cells);
        self.segments().for_each(|(a, b, diameter)| volume.splat(a, b, diameter));
        volume
    }

    /// The same without hair in it.
    pub fn empty_volume(&self, cells: usize) -> Volume {
        let (low, high) = self.hair.fitted_bounds();
        let (low, high) = (low.max(self.center - self.radius), high.min(self.center + self.radius));
        Volume::empty(low, high, cells)
    }

    /// Start, end and diameter of every segment, world units.
    fn segments(&self) -> impl Iterator<Item = (Vec3, Vec3, f32)> {
        self.hair.strands().flat_map(|strand| self.segments_of(strand))
    }

    /// The same of the strand with these points.
    pub fn segments_of(&self, strand: Range<usize>) -> impl Iterator<Item = (Vec3, Vec3, f32)> {
        let Geometry { hair, diameters, .. } = self;
        strand.skip(1).map(move |i| {
            (hair.points[i - 1], hair.points[i], 0.5 * (diameters[i - 1] + diameters[i]))
        })
    }

    /// All lamps of a scene, in the world.
    pub fn lamps(&self, scene: &Scene) -> Vec<Lamp> {
        Lamp::all(scene, self.center, self.radius).collect()
    }

    /// Those near the hair: suns are among [`shaded_lights`].
    pub fn near_lamps(&self, scene: &Scene) -> Vec<Lamp> {
        self.lamps(scene).into_iter().filter(Lamp::is_near).collect()
    }

    /// Pixels of a strand at its thickest, as far away as what the camera looks at.
    pub fn width_px(&self, lens: &Lens) -> f64 {
        f64::from(self.diameter) * lens.pixels_per_unit() / lens.distance
    }

    /// Samples that strands should cover in a frame of `samples` a pixel, each by itself: their projected area in
    /// pixels, of what is in the frame and not behind the head, times `samples`.
    pub fn expected_samples(&self, lens: &Lens, samples: u32) -> f64 {
        let head = self.head.as_ref().map(|head| HeadRays::new(head, self.center));
        let [x, y, w] = lens.image_axes();
        let pixels = [lens.right, lens.up].map(|axis| axis.length() * lens.pixels_per_unit());
        let area = |(a, b, diameter): (Vec3, Vec3, f32)| {
            let [a, b] = [a, b].map(|p| (p - self.center).as_dvec3() - lens.eye);
            let middle = 0.5 * (a + b);
            let depth = [a, b, middle].map(|p| w.dot(p));
            let inside = |axis: DVec3| axis.dot(middle).abs() < depth[2];
            if !(depth.iter().all(|&d| d > 0.0) && inside(x) && inside(y)) {
                return 0.0;
            }
            let hidden = head.as_ref().is_some_and(|head| {
                let (eye, to) = (lens.eye.as_vec3().into(), middle.as_vec3().into());
                head.occluded(&Ray::new(eye, to, 0.0, 1.0 - 1e-3))
            });
            if hidden {
                return 0.0;
            }
            let across = |axis: DVec3, pixels: f64| {
                pixels * (axis.dot(b) / depth[1] - axis.dot(a) / depth[0])
            };
            let length = across(x, pixels[0]).hypot(across(y, pixels[1]));
            length * f64::from(diameter) * lens.pixels_per_unit() / depth[2]
        };
        f64::from(samples) * self.segments().map(area).sum::<f64>()
    }

    /// Straight pieces that each segment is drawn in for this view.
    pub fn pieces(&self, lens: &Lens) -> u32 {
        let eye = lens.eye + self.center.as_dvec3();
        hair::pieces(&self.hair, &self.frames.tangents, eye, lens.pixels_per_unit())
    }
}

/// The strands that a scene names.
pub fn load_hair(scene: &Scene) -> Result<LoadedHair> {
    load_hair_on(scene, Ground::of(scene)?.as_ref())
}

fn load_hair_on(scene: &Scene, ground: Option<&Ground>) -> Result<LoadedHair> {
    let spec = &scene.hair;
    let groom = GroomOptions {
        strands: spec.strands as usize,
        seed: u64::from(spec.seed),
        length: spec.length as f32,
        curl: spec.curl as f32,
        clump: spec.clump.map(|v| v as f32),
        flyaway: spec.flyaway.map(|v| v as f32),
    };
    let reverse = match spec.reverse {
        Reverse::Auto => None,
        Reverse::Yes => Some(true),
        Reverse::No => Some(false),
    };
    let options = LoadOptions { up: spec.up, scale: spec.scale as f32, reverse, groom };
    // The builtin head fits beneath much that is no root.
    let ground = ground.filter(|ground| ground.surface.is_some());
    let on_head = ground.map(|ground| |points: &[Vec3]| ground.fit(points).share);
    hair::load_on(&spec.source, &options, on_head.as_ref().map(|on_head| on_head as OnHead))
}

/// A head that waits for the roots of the hair, to be put beneath them.
struct Ground<'a> {
    scene: &'a Scene,
    source: &'a str,
    loaded: LoadedHead,
    /// Of a head from a file.
    surface: Option<Surface>,
    wanted: Wanted,
}

impl<'a> Ground<'a> {
    fn of(scene: &'a Scene) -> Result<Option<Self>> {
        let Some(source) = scene.head_source() else { return Ok(None) };
        let loaded = head::load(source)?;
        let spec = &scene.head;
        let wanted = Wanted {
            up: spec.up,
            scale: spec.scale.map(|scale| scale as f32),
            offset: spec.offset.map(|offset| DVec3::from(offset).as_vec3()),
        };
        let surface = (source != "builtin").then(|| Surface::new(&loaded.head));
        Ok(Some(Ground { scene, source, loaded, surface, wanted }))
    }

    /// Where the transform of the hair puts it.
    fn own(&self) -> Placement {
        let hair = &self.scene.hair;
        let Wanted { up, scale, offset } = self.wanted;
        // The builtin head is y up, as builtin hair is.
        let own_up = if self.surface.is_some() { hair.up } else { Up::Y };
        Placement {
            up: up.unwrap_or(own_up),
            scale: scale.unwrap_or(hair.scale as f32),
            offset: offset.unwrap_or_default(),
        }
    }

    /// The place beneath `roots` (world).
    fn fit(&self, roots: &[Vec3]) -> Fit {
        match &self.surface {
            Some(surface) => surface.fit(roots, &self.own(), &self.wanted),
            None => fit_builtin(roots, &self.wanted),
        }
    }

    /// The head beneath `hair`. Tells what was done to it.
    ///
    /// # Errors
    /// One line: no place of the builtin head is beneath the roots.
    fn place(mut self, hair: &Hair, notes: &mut Vec<String>) -> Result<Head> {
        notes.extend(self.loaded.notes());
        let made_for_it = self.surface.is_none() && self.scene.hair.source.starts_with("builtin:");
        let Wanted { up, scale, offset } = self.wanted;
        let mut placement = self.own();
        // The builtin head stands upright unless it is said otherwise.
        let up_known = up.is_some() || self.surface.is_none();
        let offset_known = offset.is_some() || self.surface.is_some();
        let known = made_for_it || up_known && scale.is_some() && offset_known;
        if !known {
            let roots: Vec<Vec3> =
                hair.polylines().filter_map(|points| points.first().copied()).collect();
            let found = self.fit(&roots);
            let share = format!("{:.0} % of the roots lie on it", 100.0 * found.share);
            let said = scale.is_some() || offset.is_some();
            if self.surface.is_none() && !said && found.share < BUILTIN_FITS {
                bail!(
                    "the builtin head does not fit beneath the roots of {}: {share} at best; give a head of its own \
                     with --head FILE.obj, or --head-scale and --head-offset",
                    self.scene.hair.source
                );
            }
            let Placement { up, scale, offset } = found.placement;
            let place = format!(
                "{up} is up, the scale {scale}, the offset {} {} {}",
                offset.x, offset.y, offset.z
            );
            if found.share < ELSEWHERE {
                notes.push(format!(
                    "head: {share} in no likely unit or axis of {}: set --head-scale, --head-up or --head-offset",
                    self.source
                ));
            } else if found.placement != placement {
                notes.push(format!(
                    "head: {place}: {share} (--head-up, --head-scale, --head-offset)"
                ));
            }
            placement = found.placement;
        }
        check_scale(placement.scale).context("head")?;
        self.loaded.head.place(&placement);
        Ok(self.loaded.head)
    }
}

/// The map that a scene names; what is unusual about it and what was mended in it is noted.
pub fn load_map(spec: &EnvironmentSpec, clock: &Clock) -> Result<environment::Loaded> {
    let EnvironmentSpec { source, layer, .. } = spec;
    let loaded = environment::load_layer(source, layer.as_deref())?;
    loaded.notes().iter().for_each(|note| clock.note(&format!("{source}: {note}")));
    Ok(loaded)
}

/// A light of the fit in the world: turned by the environment's rotation, with its exposure.
pub fn place_light(light: &SrbfLight, scene: &Scene) -> SrbfLight {
    let turn = DMat3::from_rotation_y(scene.environment.rotation_deg.to_radians());
    let gain = 2f64.powf(scene.environment.exposure);
    SrbfLight {
        direction: (turn * light.direction).normalize(),
        rgb: light.rgb.map(|c| c * gain),
        ..*light
    }
}

/// The fit's lights in the world, black ones left out.
pub fn place_lights(lights: &[SrbfLight], scene: &Scene) -> Vec<SrbfLight> {
    let lit = lights.iter().filter(|light| light.rgb.iter().any(|&c| c > 0.0));
    lit.map(|light| place_light(light, scene)).collect()
}

/// [`place_lights`] as frames shade them: suns first, then the fit's, wide ones split.
pub fn shaded_lights(lights: &[SrbfLight], scene: &Scene) -> Vec<SrbfLight> {
    [suns(scene), split_wide(&place_lights(lights, scene))].concat()
}

/// Those of [`place_lights`] that [`shaded_lights`] shares out among ordinates.
pub fn sky_lights(lights: &[SrbfLight], scene: &Scene) -> Vec<SrbfLight> {
    sky_of(&place_lights(lights, scene))
}

/// The scene's suns, which are lights like the fit's.
pub fn suns(scene: &Scene) -> Vec<SrbfLight> {
    let lamps = Lamp::all(scene, Vec3::ZERO, 1.0).filter(|lamp| !lamp.is_near());
    lamps.map(|sun| sun.lobe(DVec3::ZERO)).collect()
}

/// What radiance is multiplied by before tone mapping: 2^exposure, or by default what brings what the meter reads under
/// the turned map, seen from the unit direction `eye`, to a fixed level. The environment's own
/// exposure and lamps are not metered, and so keep their effect.
pub fn exposure_scale(scene: &Scene, meter: &LightMeter, eye: DVec3) -> f32 {
    let Some(stops) = scene.output.exposure else {
        let turn = DMat3::from_rotation_y(-scene.environment.rotation_deg.to_radians());
        let luminance = meter.luminance(turn * eye);
        return if luminance > 0.0 { (METERED / luminance) as f32 } else { 1.0 };
    };
    2f64.powf(stops) as f32
}
