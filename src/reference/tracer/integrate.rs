//! One sample of one pixel: a path from the camera, from fibre to fibre, lit at every place it meets.

use anyhow::{Context, Result, anyhow, ensure};
use glam::{DVec3, Vec3};

use super::skin::{Skin, SkinPoint};
use super::strands::{FibrePoint, PieceId, StrandRay};
use super::{Sampling, TraceScene};
use crate::reference::ModelThere;
use crate::reference::model::{Direction, Evaluation, Sample};

/// From this scattering event on a path may end by chance.
const ROULETTE_EVENT: u32 = 4;
/// A path that loses nothing still ends with this probability an event.
const ROULETTE_LEAST: f64 = 0.02;

/// What a sample saw.
#[derive(Clone, Copy, Default)]
pub(super) struct Seen {
    pub radiance: DVec3,
    pub covered: bool,
    pub hair: bool,
    /// Rays traced.
    pub rays: u32,
}

/// Owen-scrambled Sobol numbers of one sample of one pixel, in blocks of four dimensions.
struct Sampler {
    index: u32,
    seed: u32,
}

/// Points that a Sobol sequence of `sobol_burley` has; what is beyond starts another.
const SEQUENCE: u32 = 1 << 16;

impl Sampler {
    fn new(pixel: u32, index: u32, seed: u32) -> Self {
        let seed = mix(pixel ^ mix((index / SEQUENCE) ^ mix(seed)));
        Self { index: index % SEQUENCE, seed }
    }

    fn block(&self, block: u32) -> [f64; 4] {
        sobol_burley::sample_4d(self.index, 0, mix(self.seed ^ block)).map(f64::from)
    }
}

/// A bijection that scatters all bits (the finalizer of MurmurHash3), moved so that 0 scatters too.
fn mix(bits: u32) -> u32 {
    let mut h = bits.wrapping_add(0x9e37_79b9);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// What a ray meets first: a piece of a strand, or a triangle of the head and its distance.
#[derive(Clone, Copy)]
enum Hit<'a> {
    Fibre(PieceId),
    Skin(&'a Skin<'a>, usize, f32),
}

/// A place where light scatters.
enum Vertex<'a> {
    Fibre {
        at: FibrePoint,
        model: ModelThere<'a>,
        /// Towards the viewer, in the fibre's frame.
        o: Direction,
        /// The ray's own or a drawn one.
        h: f64,
    },
    Skin {
        at: SkinPoint,
        albedo: DVec3,
    },
}

/// A direction from which light may come, and what becomes of it.
struct Turn {
    omega: DVec3,
    f_cos: DVec3,
    /// Density with which the vertex draws `omega`.
    pdf: f64,
}

impl Vertex<'_> {
    fn turn(&self, omega: DVec3) -> Result<Turn> {
        let (f_cos, pdf) = match self {
            Vertex::Fibre { at, model, o, h } => {
                let i = Direction::of(at.frame.transpose() * omega);
                let Evaluation { f_cos, pdf } = model.model().evaluate(o, &i, *h);
                if !(is_light(f_cos.into()) && pdf.is_finite() && pdf >= 0.0) {
                    return Err(fault("value", o, &i, *h, f_cos, pdf));
                }
                (f_cos.into(), pdf)
            }
            Vertex::Skin { at, albedo } => {
                let pdf = at.cosine(omega);
                (albedo * pdf, pdf)
            }
        };
        Ok(Turn { omega, f_cos, pdf })
    }

    /// None where the draw carries no light.
    fn draw(&self, u: [f64; 4]) -> Result<Option<Turn>> {
        Ok(match self {
            Vertex::Fibre { at, model, o, h } => {
                let Some(Sample { direction, value }) = model.model().sample(o, *h, u) else {
                    return Ok(None);
                };
                let (f_cos, pdf) = (DVec3::from(value.f_cos), value.pdf);
                let omega = at.frame * direction.vector();
                if !(is_light(f_cos / pdf) && pdf > 0.0 && omega.is_finite()) {
                    return Err(fault("sample", o, &direction, *h, value.f_cos, pdf));
                }
                Some(Turn { omega: omega.normalize(), f_cos, pdf })
            }
            Vertex::Skin { at, .. } => {
                let turn = self.turn(at.sample([u[0], u[1]]))?;
                (turn.pdf > 0.0).then_some(turn)
            }
        })
    }

    /// Where lamps are seen from, whichever way light leaves.
    fn place(&self) -> DVec3 {
        match self {
            Vertex::Fibre { at, .. } => at.axis_point,
            Vertex::Skin { at, .. } => at.place(),
        }
    }

    fn leave(&self, omega: DVec3) -> StrandRay {
        match self {
            Vertex::Fibre { at, .. } => at.leave(omega),
            Vertex::Skin { at, .. } => at.leave(omega),
        }
    }
}

/// Finite and nowhere negative.
fn is_light(rgb: DVec3) -> bool {
    rgb.is_finite() && rgb.min_element() >= 0.0
}

fn fault(
    what: &str,
    o: &Direction,
    i: &Direction,
    h: f64,
    f_cos: [f64; 3],
    pdf: f64,
) -> anyhow::Error {
    anyhow!(
        "the fibre model's {what} is no light: f_cos {f_cos:?}, pdf {pdf} at theta_o {}, phi_o {}, \
         theta_i {}, phi_i {}, h {h}: this is a fault of the model",
        o.theta(),
        o.phi,
        i.theta(),
        i.phi
    )
}

/// `weight` of `radiance`, looked at before it is added to anything.
fn contribution(weight: DVec3, radiance: DVec3, turn: &Turn) -> Result<DVec3> {
    let value = weight * radiance;
    ensure!(
        is_light(value),
        "a contribution of {value} came of radiance {radiance} along {}, f_cos {}, pdf {}, weight {weight}: \
         mend the light, or report this fault of the tracer",
        turn.omega,
        turn.f_cos,
        turn.pdf
    );
    Ok(value)
}

/// A ray that ends at a distance.
fn up_to(distance: f64, mut ray: StrandRay) -> StrandRay {
    ray.ray.tmax = ray.ray.tmax.min(distance as f32);
    ray
}

pub(super) struct Integrator<'a> {
    scene: &'a TraceScene<'a>,
    /// A sphere around all geometry.
    center: DVec3,
    radius: f64,
}

impl<'a> Integrator<'a> {
    pub fn new(scene: &'a TraceScene<'a>) -> Self {
        let (mut low, mut high) = scene.strands.bounds();
        if let Some(skin) = scene.skin {
            let (a, b) = skin.bounds();
            (low, high) = (low.min(a), high.max(b));
        }
        let (low, high) = (low.as_dvec3(), high.as_dvec3());
        Self { scene, center: low.midpoint(high), radius: 0.5 * low.distance(high) }
    }

    /// Sample `index` of the pixel at (x, y), rows from the top, of an image of `size`.
    ///
    /// # Errors
    /// One line, where the model or the light gave what is not finite and ≥ 0.
    pub fn sample(&self, [x, y]: [u32; 2], size: [u32; 2], index: u32) -> Result<Seen> {
        let sampler = Sampler::new(y * size[0] + x, index, self.scene.seed);
        let [dx, dy, ..] = sampler.block(0);
        let across = (f64::from(x) + dx) / f64::from(size[0]);
        let down = (f64::from(y) + dy) / f64::from(size[1]);
        let ray = self.camera_ray(2.0 * across - 1.0, 1.0 - 2.0 * down);
        self.path(ray, &sampler).with_context(|| format!("pixel ({x}, {y}), sample {index}"))
    }

    /// Through the image's point (x, y) in [−1, 1]². It starts at the sphere around the geometry, so that f32
    /// keeps its digits however far the eye is.
    fn camera_ray(&self, x: f64, y: f64) -> StrandRay {
        let lens = &self.scene.lens;
        let direction = (lens.forward + x * lens.right + y * lens.up).normalize();
        let skip = ((self.center - lens.eye).dot(direction) - self.radius).max(0.0);
        StrandRay::free((lens.eye + skip * direction).as_vec3(), direction.as_vec3())
    }

    fn path(&self, mut ray: StrandRay, sampler: &Sampler) -> Result<Seen> {
        let TraceScene { light, sampling, max_depth, .. } = *self.scene;
        let mut seen = Seen { rays: 1, ..Seen::default() };
        let Some(mut hit) = self.closest(&ray) else { return Ok(seen) };
        seen.covered = true;
        seen.hair = matches!(hit, Hit::Fibre(_));
        let mut throughput = DVec3::ONE;
        for event in 1..=max_depth {
            let [light_u, light_v, h, survival] = sampler.block(2 * event - 1);
            let vertex = self.vertex(&hit, &ray, h, event == 1);
            let place = vertex.place();
            let shares = light.shares(place);
            if sampling != Sampling::Fibre
                && let Some(lit) = light.draw(place, &shares, [light_u, light_v])
            {
                let turn = vertex.turn(lit.direction)?;
                if turn.f_cos != DVec3::ZERO {
                    seen.rays += 1;
                    if !self.occluded(&up_to(lit.distance, vertex.leave(turn.omega))) {
                        let weight = throughput * turn.f_cos / sampling.pdf(lit.pdf, turn.pdf);
                        seen.radiance += contribution(weight, lit.radiance, &turn)?;
                    }
                }
            }
            let last = event == max_depth;
            if last && sampling == Sampling::Light {
                break;
            }
            let Some(turn) = vertex.draw(sampler.block(2 * event))? else { break };
            throughput *= turn.f_cos / turn.pdf;
            if event >= ROULETTE_EVENT {
                let chance = throughput.max_element().min(1.0 - ROULETTE_LEAST);
                if survival >= chance {
                    break;
                }
                throughput /= chance;
            }
            ray = vertex.leave(turn.omega);
            if sampling != Sampling::Light {
                for lit in light.lamps_along(place, &shares, turn.omega) {
                    seen.rays += 1;
                    if !self.occluded(&up_to(lit.distance, ray)) {
                        let pdf = sampling.pdf(lit.pdf, turn.pdf);
                        let weight = throughput * (turn.pdf / pdf);
                        seen.radiance += contribution(weight, lit.radiance, &turn)?;
                    }
                }
            }
            seen.rays += 1;
            if !last && let Some(next) = self.closest(&ray) {
                hit = next;
                continue;
            }
            if sampling != Sampling::Light && !(last && self.occluded(&ray)) {
                let radiance = light.radiance(turn.omega);
                let pdf = sampling.pdf(light.far_pdf(&shares, radiance), turn.pdf);
                seen.radiance += contribution(throughput * (turn.pdf / pdf), radiance, &turn)?;
            }
            break;
        }
        Ok(seen)
    }

    fn closest(&self, ray: &StrandRay) -> Option<Hit<'a>> {
        let mut ray = *ray;
        let skin = self.scene.skin.and_then(|skin| {
            let (id, t) = skin.closest(&ray.ray)?;
            ray.ray.tmax = t;
            Some(Hit::Skin(skin, id, t))
        });
        self.scene.strands.closest(&ray).map(Hit::Fibre).or(skin)
    }

    fn occluded(&self, ray: &StrandRay) -> bool {
        self.scene.skin.is_some_and(|skin| skin.occluded(&ray.ray))
            || self.scene.strands.occluded(ray)
    }

    /// `u` becomes h where the model does not take the ray's own. `by_eye`: the camera's ray came here.
    fn vertex(&self, hit: &Hit, ray: &StrandRay, u: f64, by_eye: bool) -> Vertex<'a> {
        match *hit {
            Hit::Skin(skin, id, t) => {
                Vertex::Skin { at: skin.skin_point(id, t, &ray.ray), albedo: skin.albedo }
            }
            Hit::Fibre(id) => {
                let at = self.scene.strands.fibre_point(id, ray);
                let o = -DVec3::from(Vec3::from(ray.ray.direction));
                let o = Direction::of(at.frame.transpose() * o);
                let h = if self.scene.models.near_field() { at.h } else { 2.0 * u - 1.0 };
                let model = self.scene.models.there(at.point, at.along, o.theta(), by_eye);
                Vertex::Fibre { at, model, o, h }
            }
        }
    }
}
