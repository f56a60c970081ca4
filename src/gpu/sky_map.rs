//! What a path that escapes sees of the sky, as a table over directions (`sky_map` of shaders/gather.wgsl).

use glam::{DVec2, DVec3, Vec4};
use rayon::prelude::*;

use crate::srbf::SrbfLight;

/// Texels of an edge, 1.6° each at the middle: within 0.5 % of the mean radiance for lobes of λ ≥ 0.5 (tests/gather.rs).
pub const SIDE: usize = 128;

/// Texels, row by row, of the octahedral map of all directions about +y (Meyer et al. 2010): radiance of `sky`, linear RGB, and
/// the place of the nearest of `ordinates`.
pub fn sky_texels(sky: &[SrbfLight], ordinates: &[SrbfLight]) -> Vec<Vec4> {
    let texel = |place: usize| {
        let at = DVec2::new((place % SIDE) as f64 + 0.5, (place / SIDE) as f64 + 0.5);
        let direction = direction_at(at / SIDE as f64);
        let mut radiance = DVec3::ZERO;
        for light in sky {
            let apart = direction - light.direction;
            let share = (-apart.length_squared() / (light.lambda * light.lambda)).exp();
            radiance += share * DVec3::from(light.rgb);
        }
        let cosines = ordinates.iter().map(|one| one.direction.dot(direction)).enumerate();
        let nearest = cosines.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |nearest| nearest.0);
        radiance.as_vec3().extend(nearest as f32)
    };
    (0..SIDE * SIDE).into_par_iter().with_min_len(SIDE).map(texel).collect()
}

/// The direction at a place of the octahedral map, in [0, 1]².
pub fn direction_at(place: DVec2) -> DVec3 {
    let mut p = 2.0 * place - 1.0;
    let y = 1.0 - p.x.abs() - p.y.abs();
    if y < 0.0 {
        p = (1.0 - DVec2::new(p.y.abs(), p.x.abs())) * DVec2::new(p.x.signum(), p.y.signum());
    }
    DVec3::new(p.x, y, p.y).normalize()
}

/// The place of a unit direction on the map, in [0, 1]²: [`direction_at`] turned round.
pub fn place_of(direction: DVec3) -> DVec2 {
    let n = direction / direction.to_array().iter().map(|x| x.abs()).sum::<f64>();
    let p = match n.y < 0.0 {
        true => (1.0 - DVec2::new(n.z.abs(), n.x.abs())) * DVec2::new(n.x.signum(), n.z.signum()),
        false => DVec2::new(n.x, n.z),
    };
    0.5 * (p + 1.0)
}
