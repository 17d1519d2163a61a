//! A measurement, printed.

use paig::support::significant::significant;
use paig_terminal::say;
use paig_video::measure::results::EXTENDED;
use paig_video::measure::results::Measurement;

/// Prints the quantities with their intervals, the prediction of what was held out, and the comparison of equations.
pub fn print_measurement(it: &Measurement) {
    say!();
    say!("{:<30}{:>12}   {:<26}{:<8}{:>12}  {}", "measured", "", "95 % interval", "", "cross-check", "");
    for quantity in &it.quantities {
        let tracker = quantity.by_tracker.map_or("-".into(), |value| significant(value, 6));
        let interval = quantity.interval(|end| significant(end, 6)).unwrap_or("-".into());
        let name = quantity.name.replace('_', " ");
        let value = significant(quantity.value, 6);
        let outcome = quantity.outcome.map_or(String::new(), |outcome| outcome.to_string());
        say!("{name:<30}{value:>12}   {interval:<26}{:<8}{tracker:>12}  {outcome}", quantity.unit);
    }
    for quantity in it.quantities.iter().filter(|quantity| !quantity.takes.is_empty()) {
        let takes = quantity.takes.iter().map(|take| {
            let [low, high] = [take.low, take.high].map(|end| significant(end, 5));
            format!("{} ({low} to {high}) in {}", significant(take.value, 5), take.video)
        });
        say!("{} by take: {}", quantity.name.replace('_', " "), takes.collect::<Vec<_>>().join("; "));
    }
    let held_out = &it.held_out;
    let unit = &held_out.unit;
    say!();
    say!("the last {} of {} frames, predicted from the rest ({})", held_out.frames, it.frames, it.by);
    say!("  distance {:.4} {unit}, {:.2} % of the amplitude", held_out.error, held_out.percent_of_amplitude);
    say!("  by constant velocity {:.4} {unit}", held_out.constant_velocity);
    if let Some(error) = held_out.tracker_fit {
        say!("  by the equation fitted to the other observation {error:.4} {unit}");
    }
    let left = &it.residuals;
    let first = left.autocorrelation.first().copied().unwrap_or(0.0);
    say!("residual {:.4} {unit}; residuals of neighbouring frames correlate by {first:.2}", left.usual);
    if !it.alternatives.is_empty() {
        say!();
        say!("{:<44}{:>9}{:>10}{:>10}{:>12}{:>12}", "equation", "unknowns", "residual", "held out", "AIC", "BIC");
    }
    for other in &it.alternatives {
        let name = &other.equation;
        let (left, held_out) = (other.residual, other.held_out_error);
        say!("{name:<44}{:>9}{left:>10.4}{held_out:>10.4}{:>12.1}{:>12.1}", other.unknowns, other.aic, other.bic);
    }
    if let Some(missing) = &it.missing {
        say!();
        say!("missing term: {} (BIC better by {:.0})", missing.name, missing.gain);
        for quantity in &missing.quantities {
            let interval = quantity.interval(|end| significant(end, 4)).unwrap_or("-".into());
            say!("  {} {} {} [{interval}]", quantity.name, significant(quantity.value, 4), quantity.unit);
        }
        let [before, after] = missing.held_out_error;
        say!(
            "  held-out error {before:.4} -> {after:.4} {unit}; measure with it: --equation {EXTENDED}, beside these results"
        );
    }
    it.notes.iter().for_each(|note| say!("note: {note}"));
    if let Some(verdict) = &it.verdict {
        say!();
        say!("verdict: {}", verdict.outcome);
        verdict.reasons.iter().for_each(|reason| say!("  {reason}"));
    }
}
