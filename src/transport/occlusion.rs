//! What stands in a ray's way on the device: strands and head under one hierarchy, for shaders/occlusion.wgsl.
//!
//! A strand is straight, round, tapered pieces from point to point, as the tracer's `Strands` has them with one piece a
//! segment, which is the twin on the CPU.

use glam::{Vec3, Vec3A, Vec4};
use obvhs::aabb::Aabb;
use rayon::prelude::*;

use crate::bvh::{Node, Tree};
use crate::stage::Geometry;

/// An item of strands: the first point of a segment, and whether the strand begins or ends with it.
const ROOT: u32 = 1 << 30;
const TIP: u32 = 1 << 31;

/// The hierarchy as it lies on the device.
pub struct RayBvh {
    /// Of the strands' tree, then of the head's.
    pub nodes: Vec<Node>,
    /// Root of the head's tree among the nodes, and the first of its shapes; 0 without one.
    pub head: [u32; 2],
    /// Segments in the order of the nodes.
    pub items: Vec<u32>,
    /// Relative to the centre, in the order of the nodes: two ends of each segment with their radii, then three corners
    /// of each triangle of the head with its place there.
    pub shapes: Vec<Vec4>,
}

impl RayBvh {
    pub fn new(stage: &Geometry) -> RayBvh {
        let Geometry { hair, head, diameters, center, .. } = stage;
        let mut items = Vec::with_capacity(hair.points.len());
        for strand in hair.strands() {
            let last = strand.end.saturating_sub(1).max(strand.start);
            for first in strand.start..last {
                let root = if first == strand.start { ROOT } else { 0 };
                let tip = if first + 1 == last { TIP } else { 0 };
                items.push(first as u32 | root | tip);
            }
        }
        let around_segment = |&item: &u32| {
            let first = (item & (ROOT - 1)) as usize;
            let end = |point: usize| {
                let place = Vec3A::from(hair.points[point] - *center);
                let radius = Vec3A::splat(0.5 * diameters[point]);
                Aabb { min: place - radius, max: place + radius }
            };
            end(first).union(&end(first + 1))
        };
        let boxes: Vec<Aabb> = items.par_iter().map(around_segment).collect();
        let Tree { mut nodes, items: order } = Tree::new(&boxes);
        let items: Vec<u32> = order.iter().map(|&i| items[i as usize]).collect();
        let end = |point: usize| (hair.points[point] - *center).extend(0.5 * diameters[point]);
        let ends = |&item: &u32| {
            let first = (item & (ROOT - 1)) as usize;
            [end(first), end(first + 1)]
        };
        let mut shapes: Vec<Vec4> = items.par_iter().flat_map_iter(ends).collect();
        let mut root = [0; 2];
        if let Some(head) = head {
            root = [nodes.len() as u32, shapes.len() as u32];
            let corners = |t: &[u32; 3]| t.map(|i| head.positions[i as usize] - *center);
            let triangles: Vec<[Vec3; 3]> = head.triangles.iter().map(corners).collect();
            let around = |t: &[Vec3; 3]| Aabb::from_points(&t.map(Vec3A::from));
            let tree = Tree::new(&triangles.iter().map(around).collect::<Vec<_>>());
            nodes.extend(tree.nodes.iter().map(|node| node.moved(root[0])));
            // With each corner the triangle's place among the head's.
            let ordered = tree
                .items
                .iter()
                .flat_map(|&i| triangles[i as usize].map(|corner| corner.extend(i as f32)));
            shapes.extend(ordered);
        }
        RayBvh { nodes, head: root, items, shapes }
    }
}
