//! Rays against a head: triangles under a BVH.

use glam::{Vec3, Vec3A};
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::ray::{Ray, RayHit};
use obvhs::{BvhBuildParams, triangle::Triangle};

use super::Head;

/// A head relative to a centre, ready to be hit by rays.
pub struct HeadRays {
    /// In the BVH's order.
    triangles: Vec<Triangle>,
    bvh: CwBvh,
}

impl HeadRays {
    /// `center` becomes the origin.
    pub fn new(head: &Head, center: Vec3) -> HeadRays {
        let corner = |i: u32| Vec3A::from(head.positions[i as usize] - center);
        let triangle =
            |t: &[u32; 3]| Triangle { v0: corner(t[0]), v1: corner(t[1]), v2: corner(t[2]) };
        let triangles: Vec<Triangle> = head.triangles.iter().map(triangle).collect();
        let bvh = build_cwbvh(&triangles, BvhBuildParams::medium_build(), &mut Default::default());
        let triangles = bvh.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        HeadRays { triangles, bvh }
    }

    /// Corners of the box around the head.
    pub fn bounds(&self) -> (Vec3A, Vec3A) {
        (self.bvh.total_aabb.min, self.bvh.total_aabb.max)
    }

    /// Sides of that box.
    pub fn size(&self) -> Vec3A {
        self.bvh.total_aabb.diagonal()
    }

    /// The nearest triangle before `ray.tmax`, and the distance to it.
    pub fn closest(&self, ray: &Ray) -> Option<(usize, f32)> {
        let mut hit = RayHit::none();
        self.bvh
            .ray_traverse(*ray, &mut hit, |ray, id| self.triangles[id].intersect(ray))
            .then_some((hit.primitive_id as usize, hit.t))
    }

    /// Whether anything lies before `ray.tmax`.
    pub fn occluded(&self, ray: &Ray) -> bool {
        !self.bvh.ray_traverse_miss(*ray, |ray, id| self.triangles[id].intersect(ray))
    }

    /// Weights of the corners of a triangle at a place on it. (`obvhs` has them off by the triangle's size.)
    pub fn weights(&self, id: usize, place: Vec3) -> [f32; 3] {
        let Triangle { v0, v1, v2 } = self.triangles[id];
        let [a, b, c] = [v0, v1, v2].map(|corner| (Vec3::from(corner) - place).as_dvec3());
        let normal = (b - a).cross(c - a);
        let whole = normal.length_squared().max(f64::MIN_POSITIVE);
        let [v, w] =
            [c.cross(a), a.cross(b)].map(|part| (part.dot(normal) / whole).clamp(0.0, 1.0));
        [(1.0 - v - w).max(0.0) as f32, v as f32, w as f32]
    }

    /// Of a triangle that was hit: itself, and its place among the head's.
    pub fn triangle(&self, id: usize) -> (&Triangle, usize) {
        (&self.triangles[id], self.bvh.primitive_indices[id] as usize)
    }
}
