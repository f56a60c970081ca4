//! A BVH of eight children a node and four items a leaf, so that a ray meets boxes and its owner items four
//! at a time, as wide as the vectors of every CPU are.
//!
//! Its splits are those of [`crate::bvh`]. With `obvhs` in their place sintel takes 2.6 µs a ray as well.

use std::ops::Range;

use glam::{Vec3A, Vec4};
use obvhs::{aabb::Aabb, ray::Ray};
use rayon::prelude::*;

pub use crate::bvh::ITEMS;
use crate::bvh::{self, Item, split, union};

/// A place in a leaf that no item takes.
pub const NO_ITEM: u32 = u32::MAX;
/// Children of a node.
const CHILDREN: usize = 8;
/// Marks the index of a leaf among those of nodes.
const LEAF: u32 = 1 << 31;
/// From this depth on items are halved by number, so that no groom makes the tree deep.
const DEPTH: usize = 16;
/// Nodes and leaves that may wait while others are visited: 7 a level, and fewer than 30 halvings below DEPTH.
const STACK: usize = 7 * (DEPTH + 30) + 1;

/// Children and their boxes.
#[derive(Clone, Copy)]
#[repr(align(128))]
struct Node {
    /// Axis by axis, lower and upper sides of all boxes.
    sides: [[[Vec4; 2]; 2]; 3],
    children: [u32; CHILDREN],
}

/// What rays traverse.
pub struct WideBvh {
    nodes: Vec<Node>,
    /// Around all items.
    pub bounds: Aabb,
    /// The items of each leaf, or [`NO_ITEM`].
    pub leaves: Vec<[u32; ITEMS]>,
}

/// Items of one child.
struct Group {
    items: Range<usize>,
    aabb: Aabb,
}

impl Group {
    fn new(items: &[Item], range: Range<usize>) -> Group {
        Group { aabb: union(items[range.clone()].iter().map(|item| item.aabb)), items: range }
    }
}

/// Subtrees of more items are built on threads of their own.
const PARALLEL: usize = 8192;

impl WideBvh {
    pub fn new(boxes: &[Aabb]) -> WideBvh {
        let mut items = bvh::items(boxes);
        if boxes.is_empty() {
            return WideBvh { nodes: Vec::new(), bounds: Aabb::INVALID, leaves: Vec::new() };
        }
        Self::subtree(&mut items, 0)
    }

    /// Of these items, at a depth; its first node is the root. Depth first, so that what is near in space is near in memory.
    fn subtree(items: &mut [Item], depth: usize) -> WideBvh {
        let all = Group::new(items, 0..items.len());
        let bounds = all.aabb;
        let mut groups = vec![all];
        while groups.len() < CHILDREN {
            let area = |group: &Group| group.aabb.half_area();
            let widest = (0..groups.len())
                .filter(|&i| groups[i].items.len() > ITEMS)
                .max_by(|&i, &j| area(&groups[i]).total_cmp(&area(&groups[j])));
            let Some(i) = widest else { break };
            let range = groups[i].items.clone();
            let middle = range.start + split(&mut items[range.clone()], depth < DEPTH, ITEMS);
            groups[i] = Group::new(items, range.start..middle);
            groups.push(Group::new(items, middle..range.end));
        }
        groups.sort_by_key(|group| group.items.start);
        let parallel = items.len() > PARALLEL;
        let (mut rest, mut slices) = (items, Vec::new());
        for group in &groups {
            let (own, after) = rest.split_at_mut(group.items.len());
            slices.push(own);
            rest = after;
        }
        let below =
            |own: &mut &mut [Item]| (own.len() > ITEMS).then(|| Self::subtree(own, depth + 1));
        let below: Vec<Option<WideBvh>> = match parallel {
            true => slices.par_iter_mut().map(below).collect(),
            false => slices.iter_mut().map(below).collect(),
        };
        let mut wide = WideBvh { nodes: vec![Node::EMPTY], bounds, leaves: Vec::new() };
        for (lane, ((group, own), below)) in groups.iter().zip(&slices).zip(below).enumerate() {
            let (nodes, leaves) = (wide.nodes.len() as u32, wide.leaves.len() as u32);
            let child = match below {
                Some(below) => {
                    let moved = below.nodes.into_iter().map(|node| node.moved(nodes, leaves));
                    wide.nodes.extend(moved);
                    wide.leaves.extend(below.leaves);
                    nodes
                }
                None => {
                    let mut leaf = [NO_ITEM; ITEMS];
                    leaf.iter_mut().zip(own.iter()).for_each(|(place, item)| *place = item.index);
                    wide.leaves.push(leaf);
                    LEAF | leaves
                }
            };
            let root = &mut wide.nodes[0];
            root.children[lane] = child;
            for axis in 0..3 {
                root.sides[axis][0][lane / 4][lane % 4] = group.aabb.min[axis];
                root.sides[axis][1][lane / 4][lane % 4] = group.aabb.max[axis];
            }
        }
        wide
    }

    /// Visits the leaves whose boxes the ray meets before the bound, nearer boxes first. `visit` takes a leaf
    /// and the bound and gives the new one: the distance of a hit, or −∞ to end.
    #[inline(always)]
    pub fn traverse(&self, ray: &Ray, mut visit: impl FnMut(usize, f32) -> f32) {
        let mut bound = ray.tmax;
        if self.nodes.is_empty() {
            return;
        }
        let splat = |v: Vec3A| [Vec4::splat(v.x), Vec4::splat(v.y), Vec4::splat(v.z)];
        let (origin, inverse) = (splat(ray.origin), splat(ray.inv_direction));
        let near_side = [0, 1, 2].map(|axis| usize::from(ray.inv_direction[axis] < 0.0));
        let mut stack = [(0u32, 0f32); STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (at, t) = stack[top];
            if t > bound {
                continue;
            }
            if at & LEAF != 0 {
                bound = visit((at & !LEAF) as usize, bound);
                continue;
            }
            let node = &self.nodes[at as usize];
            let mut near = [Vec4::ZERO; 2];
            let mut far = [Vec4::splat(bound); 2];
            for axis in 0..3 {
                let sides = &node.sides[axis];
                let side = near_side[axis] & 1;
                for four in 0..2 {
                    let to = |side: usize| (sides[side][four] - origin[axis]) * inverse[axis];
                    near[four] = near[four].max(to(side));
                    far[four] = far[four].min(to(side ^ 1));
                }
            }
            let met = |four: usize| near[four].cmple(far[four]).bitmask();
            let mut met = met(0) | met(1) << 4;
            let near: [f32; CHILDREN] = bytemuck::cast(near);
            let base = top;
            while met != 0 {
                let lane = met.trailing_zeros() as usize % CHILDREN;
                met &= met - 1;
                // The nearest ends on top.
                let mut place = top;
                while place > base && stack[place - 1].1 < near[lane] {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = (node.children[lane], near[lane]);
                top += 1;
            }
        }
    }
}

impl Node {
    /// With so many nodes and leaves before its own.
    fn moved(mut self, nodes: u32, leaves: u32) -> Node {
        for child in &mut self.children {
            *child += if *child & LEAF == 0 { nodes } else { leaves };
        }
        self
    }

    /// No ray meets its boxes.
    const EMPTY: Node = Node {
        sides: [[[Vec4::INFINITY; 2], [Vec4::NEG_INFINITY; 2]]; 3],
        children: [0; CHILDREN],
    };
}
