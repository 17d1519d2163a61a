//! The same thing measured several times: mean and interval of the takes, whose scatter is part of the interval.

use statrs::distribution::{ContinuousCDF, StudentsT};

use super::results::{Measurement, Outcome, Quantity, TakeEstimate};

/// Normal deviates of half of a 95 % interval.
const HALF: f64 = 1.96;
/// Fewest takes that show a scatter.
const LEAST_TAKES: usize = 2;

/// Puts into each quantity the mean over takes that were measured apart, with the interval of Hartung and Knapp (2001)
/// for random effects: it holds the scatter between the takes as well as each one's own error. Takes that say nothing of a
/// quantity do not count.
pub(super) fn pool(quantities: &mut [Quantity], apart: &[Measurement]) {
    for quantity in quantities {
        let takes: Vec<TakeEstimate> = apart.iter().filter_map(|it| take(it, &quantity.name)).collect();
        let values: Vec<[f64; 2]> = takes.iter().map(|it| [it.value, (it.high - it.low) / (2.0 * HALF)]).collect();
        if let Some([mean, half]) = pooled(&values) {
            (quantity.value, quantity.low, quantity.high) = (mean, Some(mean - half), Some(mean + half));
            quantity.in_frames = None;
            (quantity.by_tracker, quantity.tracker_low, quantity.tracker_high) = (None, None, None);
            quantity.takes = takes;
        }
    }
}

fn take(measurement: &Measurement, name: &str) -> Option<TakeEstimate> {
    let Quantity { value, low, high, outcome, .. } = measurement.quantities.iter().find(|it| it.name == name)?;
    let said = outcome.is_none_or(|outcome| outcome != Outcome::NotFound);
    let video = measurement.videos.join(", ");
    said.then_some(TakeEstimate { video, value: *value, low: (*low)?, high: (*high)? })
}

/// Mean of `[value, standard deviation]` and half of its 95 % interval; none of fewer than two.
fn pooled(takes: &[[f64; 2]]) -> Option<[f64; 2]> {
    let count = takes.len() as f64;
    if takes.len() < LEAST_TAKES {
        return None;
    }
    let mean = |weights: &[f64]| {
        let sum: f64 = weights.iter().sum();
        takes.iter().zip(weights).map(|([value, _], weight)| value * weight).sum::<f64>() / sum
    };
    let variance = |deviation: f64| deviation.powi(2).max(f64::MIN_POSITIVE);
    // Variance between the takes by the method of moments (DerSimonian and Laird 1986).
    let own: Vec<f64> = takes.iter().map(|[_, deviation]| 1.0 / variance(*deviation)).collect();
    let middle = mean(&own);
    let scatter: f64 = takes.iter().zip(&own).map(|([value, _], weight)| weight * (value - middle).powi(2)).sum();
    let (sum, squares) = (own.iter().sum::<f64>(), own.iter().map(|weight| weight * weight).sum::<f64>());
    let between = ((scatter - (count - 1.0)) / (sum - squares / sum)).max(0.0);
    let weights: Vec<f64> = takes.iter().map(|[_, deviation]| 1.0 / (variance(*deviation) + between)).collect();
    let (value, sum) = (mean(&weights), weights.iter().sum::<f64>());
    let spread = takes.iter().zip(&weights).map(|([one, _], weight)| weight * (one - value).powi(2)).sum::<f64>();
    // Takes that agree by chance say no more than their own errors allow.
    let error = (spread / (count - 1.0)).max(1.0) / sum;
    let deviates = StudentsT::new(0.0, 1.0, count - 1.0).ok()?.inverse_cdf(0.975);
    Some([value, deviates * error.sqrt()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scatter_between_takes_widens_the_interval() {
        // Three values 1 apart with errors of a hundredth: mean 10, t(0.975, 2) = 4.303, standard error 1 / sqrt(3).
        let [value, half] = pooled(&[[9.0, 0.01], [10.0, 0.01], [11.0, 0.01]]).unwrap();
        assert!((value - 10.0).abs() < 1e-3 && (half - 4.303 / 3.0_f64.sqrt()).abs() < 0.01, "{value} {half}");
    }

    #[test]
    fn takes_that_agree_keep_their_own_errors_and_the_better_ones_count_more() {
        let [value, half] = pooled(&[[10.0, 0.1], [10.0, 0.1], [10.0, 0.1]]).unwrap();
        assert!((value - 10.0).abs() < 1e-12 && (half - 4.303 * 0.1 / 3.0_f64.sqrt()).abs() < 1e-3, "{value} {half}");
        let [value, _] = pooled(&[[10.0, 0.01], [10.5, 1.0]]).unwrap();
        assert!((value - 10.0).abs() < 0.01, "{value}");
        assert_eq!(pooled(&[[10.0, 0.1]]), None);
    }
}
