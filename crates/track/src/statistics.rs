//! Robust statistics.

/// Ratio of the standard deviation to the median absolute deviation of a normal distribution.
pub(crate) const NORMAL_MAD: f64 = 1.482_602_218_505_602;

/// Quantile by rank, `share` in 0..=1. Reorders the values; `None` where there are none.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let rank = ((values.len() - 1) as f64 * share).round() as usize;
    Some(*values.select_nth_unstable_by(rank, f64::total_cmp).1)
}

/// Median by rank. Reorders the values; `None` where there are none.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// Standard deviation from the median of absolute values, for values around zero.
pub(crate) fn scale_about_zero(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sizes: Vec<f64> = values.map(f64::abs).collect();
    median(&mut sizes).map(|m| m * NORMAL_MAD)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_ramp_are_its_ranks() {
        let mut ramp: Vec<f64> = (0..=100).rev().map(f64::from).collect();
        assert_eq!(quantile(&mut ramp, 0.25), Some(25.0));
        assert_eq!(median(&mut ramp), Some(50.0));
        assert_eq!(median(&mut []), None);
    }

    #[test]
    fn one_outlier_in_five_hardly_moves_the_scale() {
        let values = [-1.0, 1.0, 1.0, -1.0, 1e6];
        assert!((scale_about_zero(values.into_iter()).unwrap() - NORMAL_MAD).abs() < 1e-12);
    }
}
