//! Medians with their spread, and the Pareto front.

use serde::Serialize;

/// Quartiles of repeated measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    pub lower: f64,
    pub median: f64,
    pub upper: f64,
}

impl Spread {
    /// Of at least one value; all 0 for none.
    pub fn of(values: &[f64]) -> Spread {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let place = share * sorted.len().saturating_sub(1) as f64;
            let (low, high) = (place.floor() as usize, place.ceil() as usize);
            let value = |i: usize| sorted.get(i).copied().unwrap_or_default();
            value(low) + (place - low as f64) * (value(high) - value(low))
        };
        Spread { lower: at(0.25), median: at(0.5), upper: at(0.75) }
    }
}

/// Which of the points (cost, error) no other beats: none is at most as dear and as wrong, and better in one.
pub fn pareto(points: &[[f64; 2]]) -> Vec<bool> {
    let beats = |a: &[f64; 2], b: &[f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
    points.iter().map(|point| !points.iter().any(|other| beats(other, point))).collect()
}

/// Root of the mean square; 0 of nothing.
pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u32), |(s, n), v| (s + v * v, n + 1));
    (sum / f64::from(count.max(1))).sqrt()
}
