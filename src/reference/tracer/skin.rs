//! Rays against the head: triangles under a BVH, smooth normals, diffuse reflection alike from both sides.

use glam::{DVec3, Vec3, Vec3A};
use obvhs::ray::Ray;

use super::strands::StrandRay;
use crate::head::{Head, HeadRays, SurfacePlace};

/// Rays leave the head from so far above it, over the size of its box.
const LIFT: f32 = 1e-5;

/// A head relative to a centre, ready to be hit by rays.
pub struct Skin<'a> {
    head: &'a Head,
    /// Diffuse reflectance, linear RGB in [0, 1].
    pub albedo: DVec3,
    rays: HeadRays,
    center: Vec3,
    lift: f32,
}

/// Where a ray met the head.
#[derive(Clone, Copy, Debug)]
pub struct SkinPoint {
    /// Just above the smooth surface (see `SurfacePlace::lifted`), relative to the centre.
    origin: Vec3,
    /// Unit normal of the smooth surface, on the viewer's side.
    pub normal: DVec3,
}

impl SkinPoint {
    /// Just above the smooth surface, relative to the centre.
    pub fn place(&self) -> DVec3 {
        self.origin.as_dvec3()
    }

    /// cosθ/π, which is both what diffuse reflection sends along unit `omega` for an albedo of 1 and the
    /// density of [`Self::sample`].
    pub fn cosine(&self, omega: DVec3) -> f64 {
        self.normal.dot(omega).max(0.0) / std::f64::consts::PI
    }

    /// A direction with density cosθ/π from two uniform numbers.
    pub fn sample(&self, u: [f64; 2]) -> DVec3 {
        let (x, y) = self.normal.any_orthonormal_pair();
        let (sin, cos) = (std::f64::consts::TAU * u[1]).sin_cos();
        u[0].sqrt() * (x * cos + y * sin) + (1.0 - u[0]).sqrt() * self.normal
    }

    /// The ray that leaves the head along unit `omega`.
    pub fn leave(&self, omega: DVec3) -> StrandRay {
        StrandRay::free(self.origin, omega.as_vec3())
    }
}

impl<'a> Skin<'a> {
    /// `center` becomes the origin.
    pub fn new(head: &'a Head, albedo: Vec3, center: Vec3) -> Skin<'a> {
        let rays = HeadRays::new(head, center);
        let lift = LIFT * rays.size().max_element().max(0.0);
        Skin { head, albedo: albedo.as_dvec3(), rays, center, lift }
    }

    /// Corners of the box around the head.
    pub fn bounds(&self) -> (Vec3A, Vec3A) {
        self.rays.bounds()
    }

    /// The nearest triangle before `ray.tmax`, and the distance to it.
    pub fn closest(&self, ray: &Ray) -> Option<(usize, f32)> {
        self.rays.closest(ray)
    }

    /// Whether anything lies before `ray.tmax`.
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.rays.occluded(ray)
    }

    /// The surface where `ray` meets triangle `id` at distance `t`.
    pub fn skin_point(&self, id: usize, t: f32, ray: &Ray) -> SkinPoint {
        let (triangle, place) = self.rays.triangle(id);
        let corners = self.head.triangles[place];
        let weights = self.rays.weights(id, Vec3::from(ray.origin + t * ray.direction));
        let facing = |n: DVec3, d: DVec3| if n.dot(d) > 0.0 { -n } else { n };
        let d = DVec3::from(Vec3::from(ray.direction));
        let facet = facing(DVec3::from(Vec3::from(triangle.compute_normal())), d);
        let at = SurfacePlace::on(corners, weights);
        let smooth = at.of(&self.head.normals).as_dvec3().try_normalize().unwrap_or(facet);
        let normal = facing(smooth, -facet);
        let side = if normal.dot(smooth) < 0.0 { -1.0 } else { 1.0 };
        let lifted = at.lifted(self.head, side) - self.center;
        SkinPoint { origin: lifted + self.lift * facet.as_vec3(), normal }
    }
}
