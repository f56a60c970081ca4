//! Few fibres that stand for many.

use super::Numbers;

const COUNT: usize = 7;
/// By what √σ_a, β_R, α_R, η and eccentricity are multiplied, that 1 is a step that is seen.
const STEPS: Numbers = [8.0, 8.0, 8.0, 0.2, 0.2, 10.0, 3.0];

fn apart(a: &Numbers, b: &Numbers) -> f32 {
    (0..COUNT).map(|k| (STEPS[k] * (a[k] - b[k])).powi(2)).sum()
}

/// At most `most` that stand for all, less than a step from them where so few can be, and which each has: the
/// farthest from all others in turn (Gonzalez 1985), then three rounds of means.
pub fn cluster(all: &[Numbers], most: usize) -> (Vec<Numbers>, Vec<u32>) {
    let Some(&first) = all.first() else { return Default::default() };
    let mut usual = vec![first];
    let mut distance = vec![f32::INFINITY; all.len()];
    loop {
        let newest = usual[usual.len() - 1];
        let mut farthest = (0, 0.0);
        for (i, own) in all.iter().enumerate() {
            distance[i] = distance[i].min(apart(own, &newest));
            if distance[i] > farthest.1 {
                farthest = (i, distance[i]);
            }
        }
        if usual.len() >= most || farthest.1 < 1.0 {
            break;
        }
        usual.push(all[farthest.0]);
    }
    let mut of = vec![0; all.len()];
    for round in 0..4 {
        for (of, own) in of.iter_mut().zip(all) {
            let nearer =
                |a: &usize, b: &usize| apart(own, &usual[*a]).total_cmp(&apart(own, &usual[*b]));
            *of = (0..usual.len()).min_by(nearer).unwrap_or(0) as u32;
        }
        if round == 3 {
            break;
        }
        let mut sums = vec![([0.0f64; COUNT], 0.0f64); usual.len()];
        for (&of, own) in of.iter().zip(all) {
            let (sum, count) = &mut sums[of as usize];
            sum.iter_mut().zip(own).for_each(|(sum, &v)| *sum += f64::from(v));
            *count += 1.0;
        }
        for (usual, (sum, count)) in usual.iter_mut().zip(sums) {
            if count > 0.0 {
                *usual = sum.map(|v| (v / count) as f32);
            }
        }
    }
    (usual, of)
}
