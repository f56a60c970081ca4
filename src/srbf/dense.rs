//! The small dense algebra of the fit: Cholesky and non-negative least squares.

use super::harmonics::dot;

/// Solves A x = b for a symmetric positive definite A (row-major, its lower triangle is read and
/// overwritten). None where A is not positive definite.
pub(super) fn solve_positive_definite(a: &mut [f64], b: &[f64]) -> Option<Vec<f64>> {
    let n = b.len();
    cholesky(a, n)?;
    let mut x = b.to_vec();
    for i in 0..n {
        let row = &a[i * n..i * n + i];
        x[i] = (x[i] - dot(row, &x[..i])) / a[i * n + i];
    }
    for i in (0..n).rev() {
        x[i] /= a[i * n + i];
        let value = x[i];
        for (x, a) in x[..i].iter_mut().zip(&a[i * n..i * n + i]) {
            *x -= value * a;
        }
    }
    Some(x)
}

/// The diagonal of A⁻¹ for a symmetric positive definite A (row-major, overwritten).
pub(super) fn inverse_diagonal(a: &mut [f64], n: usize) -> Option<Vec<f64>> {
    cholesky(a, n)?;
    // A⁻¹ = L⁻ᵀ L⁻¹, so its diagonal holds the squared norms of the columns of L⁻¹.
    let mut diagonal = vec![0.0; n];
    let mut column = vec![0.0; n];
    for j in 0..n {
        column.fill(0.0);
        for i in j..n {
            let unit = if i == j { 1.0 } else { 0.0 };
            column[i] = (unit - dot(&a[i * n + j..i * n + i], &column[j..i])) / a[i * n + i];
        }
        diagonal[j] = dot(&column[j..], &column[j..]);
    }
    Some(diagonal)
}

/// A = L Lᵀ; L replaces the lower triangle.
fn cholesky(a: &mut [f64], n: usize) -> Option<()> {
    for i in 0..n {
        let (above, below) = a.split_at_mut(i * n);
        let row = &mut below[..n];
        for j in 0..i {
            let other = &above[j * n..j * n + j + 1];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let pivot = row[i] - dot(&row[..i], &row[..i]);
        // A NaN pivot fails this as well.
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        row[i] = pivot.sqrt();
    }
    Some(())
}

/// Lowers xᵀ A x − 2 bᵀ x over x ≥ 0 by coordinate descent from `x`; A symmetric, row-major.
/// Coordinates whose diagonal vanishes become 0.
pub(super) fn non_negative_least_squares(a: &[f64], b: &[f64], x: &mut [f64], sweeps: usize) {
    let n = b.len();
    for _ in 0..sweeps {
        for j in 0..n {
            let diagonal = a[j * n + j];
            x[j] = if diagonal > 0.0 {
                (x[j] + (b[j] - dot(&a[j * n..(j + 1) * n], x)) / diagonal).max(0.0)
            } else {
                0.0
            };
        }
    }
}
