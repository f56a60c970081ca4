//! ∫f over an interval to a stated error: Gauss–Kronrod 10/21 on the worst piece, halved until the whole is good
//! enough (Piessens et al. 1983, QUADPACK's QAGP). Its error estimate is taken over too; over peaks, kinks, steps,
//! poles and waves it says 20 times the true error or more (tests/reference_integral.rs).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Nodes of the 21-point Kronrod rule on [0, 1]; every second one, from the second on, is Gauss's.
const NODES: [f64; 11] = [
    0.995_657_163_025_808_1,
    0.973_906_528_517_171_7,
    0.930_157_491_355_708_2,
    0.865_063_366_688_984_5,
    0.780_817_726_586_416_9,
    0.679_409_568_299_024_4,
    0.562_757_134_668_604_7,
    0.433_395_394_129_247_2,
    0.294_392_862_701_460_2,
    0.148_874_338_981_631_22,
    0.0,
];

/// Kronrod's weights.
const WEIGHTS: [f64; 11] = [
    0.011_694_638_867_371_874,
    0.032_558_162_307_964_725,
    0.054_755_896_574_351_995,
    0.075_039_674_810_919_96,
    0.093_125_454_583_697_6,
    0.109_387_158_802_297_64,
    0.123_491_976_262_065_84,
    0.134_709_217_311_473_34,
    0.142_775_938_577_060_09,
    0.147_739_104_901_338_49,
    0.149_445_554_002_916_9,
];

/// Gauss's weights at nodes 1, 3, 5, 7, 9.
const GAUSS_WEIGHTS: [f64; 5] = [
    0.066_671_344_308_688_14,
    0.149_451_349_150_580_6,
    0.219_086_362_515_982_04,
    0.269_266_719_309_996_35,
    0.295_524_224_714_752_87,
];

/// Pieces at most: an integrand that needs more has its error told instead.
const PIECES_MAX: usize = 2000;

/// Halvings at most that leave a piece's error where it was: beyond, f is noise or has no integral.
const STALLS_MAX: usize = 40;

/// An integral of `N` values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integral<const N: usize> {
    pub value: [f64; N],
    /// What the rule believes the absolute errors to be.
    pub error: [f64; N],
    /// The worst error as a multiple of what was asked for: above 1 it was not reached.
    pub excess: f64,
}

/// How exact an integral shall be: error ≤ max(relative·|value|, absolute), each value for itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    pub relative: f64,
    pub absolute: f64,
}

impl Tolerance {
    fn excess(&self, value: f64, error: f64) -> f64 {
        let excess = error / self.absolute.max(self.relative * value.abs());
        match error {
            0.0 => 0.0,
            _ if excess.is_nan() => f64::INFINITY,
            _ => excess,
        }
    }
}

/// A piece of the interval.
struct Piece<const N: usize> {
    low: f64,
    high: f64,
    integral: ([f64; N], [f64; N]),
    /// The worst of its errors as a share of the first estimate of the whole.
    rank: f64,
}

impl<const N: usize> PartialEq for Piece<N> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<const N: usize> Eq for Piece<N> {}

impl<const N: usize> PartialOrd for Piece<N> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<const N: usize> Ord for Piece<N> {
    fn cmp(&self, other: &Self) -> Ordering {
        self.rank.total_cmp(&other.rank)
    }
}

/// ∫f from the first of `breaks` to the last, which ascend; the inner ones are where f has a peak, a kink
/// or an end of its support. Fewer than two breaks are an empty interval. Where `tolerance` cannot be
/// reached (2000 pieces, noise, an f that is not finite) `excess` says so.
pub fn integrate<const N: usize>(
    breaks: &[f64],
    tolerance: Tolerance,
    mut f: impl FnMut(f64) -> [f64; N],
) -> Integral<N> {
    let first: Vec<_> = breaks
        .windows(2)
        .filter(|pair| pair[1] > pair[0])
        .map(|pair| (pair[0], pair[1], rule(pair[0], pair[1], &mut f)))
        .collect();
    let mut whole = sum(first.iter().map(|(_, _, integral)| integral), tolerance);
    let scale = whole.value.map(|v| v.abs().max(tolerance.absolute).max(f64::MIN_POSITIVE));
    let piece = |low, high, integral: ([f64; N], [f64; N])| {
        let rank = (0..N).map(|k| integral.1[k] / scale[k]).fold(0.0, f64::max);
        Piece { low, high, integral, rank }
    };
    let mut pieces: BinaryHeap<_> = first.into_iter().map(|(a, b, i)| piece(a, b, i)).collect();
    let mut stalls = 0;
    while whole.excess > 1.0
        && whole.excess.is_finite()
        && pieces.len() < PIECES_MAX
        && stalls < STALLS_MAX
    {
        let Some(worst) = pieces.pop() else { break };
        let middle = 0.5 * (worst.low + worst.high);
        if worst.rank == 0.0 || middle <= worst.low || middle >= worst.high {
            pieces.push(worst);
            break;
        }
        let halves = [(worst.low, middle), (middle, worst.high)]
            .map(|(low, high)| piece(low, high, rule(low, high, &mut f)));
        if halves[0].rank + halves[1].rank > 0.99 * worst.rank {
            stalls += 1;
        }
        pieces.extend(halves);
        whole = sum(pieces.iter().map(|piece| &piece.integral), tolerance);
    }
    whole
}

/// The whole of pieces' values and errors.
fn sum<'a, const N: usize>(
    pieces: impl Iterator<Item = &'a ([f64; N], [f64; N])>,
    tolerance: Tolerance,
) -> Integral<N> {
    let (mut value, mut error) = ([0.0; N], [0.0; N]);
    for piece in pieces {
        for k in 0..N {
            value[k] += piece.0[k];
            error[k] += piece.1[k];
        }
    }
    let excess = (0..N).map(|k| tolerance.excess(value[k], error[k])).fold(0.0, f64::max);
    Integral { value, error, excess }
}

/// One application of the rule: values and errors.
fn rule<const N: usize>(
    low: f64,
    high: f64,
    f: &mut impl FnMut(f64) -> [f64; N],
) -> ([f64; N], [f64; N]) {
    let (centre, half) = (0.5 * (low + high), 0.5 * (high - low));
    let mut values = [[0.0; N]; 21];
    for (i, x) in NODES.iter().enumerate() {
        values[i] = f(centre - half * x);
        values[20 - i] = if i == 10 { values[10] } else { f(centre + half * x) };
    }
    let weight = |i: usize| WEIGHTS[i.min(20 - i)];
    let (mut value, mut error) = ([0.0; N], [0.0; N]);
    for k in 0..N {
        let kronrod: f64 = (0..21).map(|i| weight(i) * values[i][k]).sum();
        let gauss: f64 =
            (0..5).map(|i| GAUSS_WEIGHTS[i] * (values[2 * i + 1][k] + values[19 - 2 * i][k])).sum();
        let size: f64 = (0..21).map(|i| weight(i) * values[i][k].abs()).sum();
        let swing: f64 = (0..21).map(|i| weight(i) * (values[i][k] - 0.5 * kronrod).abs()).sum();
        let apart = (kronrod - gauss).abs();
        let estimate =
            if swing > 0.0 { swing * (200.0 * apart / swing).powf(1.5).min(1.0) } else { apart };
        value[k] = half * kronrod;
        error[k] = half * if apart > f64::EPSILON * size { estimate } else { 0.0 };
    }
    (value, error)
}
