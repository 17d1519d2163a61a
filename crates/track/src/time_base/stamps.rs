//! What time stamps and headers show by themselves.

use super::finding::{FactorSource, Finding};
use super::{StatedTime, TimeBase};
use crate::statistics::{median, quantile};

/// Rates at which cameras film, frames a second.
const USUAL: [f64; 22] = [
    10.0, 12.0, 12.5, 15.0, 20.0, 23.976, 24.0, 25.0, 29.97, 30.0, 48.0, 50.0, 59.94, 60.0, 90.0, 100.0, 119.88, 120.0,
    240.0, 300.0, 480.0, 960.0,
];
const SAME_RATE: f64 = 0.01;
/// Rate from which on only a tag or a person is believed, frames a second.
const IMPOSSIBLE: f64 = 499.0;
/// Frames a second beyond which a statement is rather a mistake: only few cameras film faster.
pub const FASTEST: f64 = 1e5;
/// Distance of a stamp from a regular clock, as a share of the interval, up to which stamps are regular.
const REGULAR: f64 = 0.25;
/// Distance of a gap from a whole number of intervals, as a share of one.
const WHOLE: f64 = 0.2;
/// Factor of the capture rate over the stamps' rate from which on a file plays slower than filmed.
const SLOWER: f64 = 1.05;
/// Frames on either side that fix a rate, and the factor by which a change for good exceeds one.
const SIDE: usize = 12;
const CHANGES: f64 = 1.3;

pub(super) fn read(base: &mut TimeBase, clock: &StatedTime, slow_motion: Option<f64>) {
    let Some(times) = &clock.times else {
        base.findings.push(Finding::NoTimes);
        return;
    };
    let steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let Some(typical) = median(&mut steps.clone()) else { return };
    if let Some(place) = steps.iter().position(|&step| step <= 0.0) {
        base.findings.push(Finding::NotAscending { frame: place + 1 });
        if typical <= 0.0 {
            return;
        }
    }
    let rate = mean_rate(&steps, typical);
    let tag = clock.capture_rate.map(|captured| captured / rate).filter(|factor| *factor > SLOWER);
    let factor =
        slow_motion.map(|factor| (factor, FactorSource::Given)).or(tag.map(|factor| (factor, FactorSource::Tag)));
    if let Some((factor, source)) = factor.filter(|(factor, _)| factor.is_finite() && *factor > 0.0) {
        base.slow_motion = factor;
        base.times = Some(times.iter().map(|time| time / factor).collect());
        if factor != 1.0 {
            base.findings.push(Finding::SlowMotion { factor, source });
        }
    }
    let filmed = rate * base.slow_motion;
    let stated = clock.capture_rate.is_some() || slow_motion.is_some();
    if filmed > FASTEST && stated {
        base.findings.push(Finding::TooFast { rate: filmed });
    } else if filmed >= IMPOSSIBLE && !stated {
        base.findings.push(Finding::Impossible { rate: filmed });
    } else if !USUAL.iter().any(|usual| (filmed / usual - 1.0).abs() <= SAME_RATE) {
        base.findings.push(Finding::Unusual { rate: filmed });
    }
    if let Some(claimed) = clock.claimed_rate.filter(|claimed| (claimed / rate - 1.0).abs() > 0.05) {
        base.findings.push(Finding::Claimed { claimed, stamps: rate });
    }
    let pieces: Vec<f64> = clock.pieces.iter().map(|piece| piece.1).collect();
    if pieces.iter().any(|speed| (speed - 1.0).abs() > 1e-3) {
        base.findings.push(Finding::EditedSpeed { rates: pieces });
    }
    for (begin, _) in clock.pieces.iter().skip(1) {
        let frame = times.partition_point(|time| time < begin);
        if (1..times.len()).contains(&frame) {
            base.breaks.push(frame);
        }
    }
    regularity(base, times, &steps, typical);
}

/// Frames a second without the gaps: coarse stamps are right in their mean.
fn mean_rate(steps: &[f64], typical: f64) -> f64 {
    let single: Vec<f64> = steps.iter().copied().filter(|step| (step / typical - 1.0).abs() <= 0.6).collect();
    single.len() as f64 / single.iter().sum::<f64>()
}

fn regularity(base: &mut TimeBase, times: &[f64], steps: &[f64], typical: f64) {
    let interval = 1.0 / mean_rate(steps, typical);
    // Where stamps are on one clock, but for gaps of whole intervals.
    let (mut tick, mut furthest, mut missing, mut before) = (0.0_f64, 0.0_f64, 0, Vec::new());
    for (place, pair) in times.windows(2).enumerate() {
        let gap = (pair[1] - pair[0]) / interval;
        let whole = gap.round().max(1.0);
        if whole >= 2.0 && (gap - whole).abs() < WHOLE {
            missing += whole as usize - 1;
            before.push(place + 1);
            tick += whole;
        } else {
            tick += 1.0;
        }
        furthest = furthest.max(((pair[1] - times[0]) / interval - tick).abs());
    }
    let few = before.len() * 10 <= steps.len().max(10);
    if few && furthest <= REGULAR {
        if missing > 0 {
            base.findings.push(Finding::Gaps { frames: before, missing });
        }
        return;
    }
    if let Some((frame, rates)) = change(steps) {
        let [before, after] = rates;
        base.findings.push(Finding::RateChange { frame, before, after });
        return;
    }
    let mut sorted = steps.to_vec();
    let at = |share: f64, values: &mut [f64]| 1000.0 * quantile(values, share).unwrap_or(0.0);
    base.findings.push(Finding::Variable {
        shortest: at(0.0, &mut sorted),
        median: 1000.0 * typical,
        longest: at(1.0, &mut sorted),
    });
}

/// First frame at which the rate changes for good, and the rates around it.
fn change(steps: &[f64]) -> Option<(usize, [f64; 2])> {
    let spread = |part: &[f64]| {
        let middle = median(&mut part.to_vec()).unwrap_or(0.0);
        let near = part.iter().filter(|step| (*step / middle - 1.0).abs() < 0.1).count();
        (middle, near * 10 >= part.len() * 9)
    };
    for place in SIDE..steps.len().saturating_sub(SIDE) {
        let ((before, even), (after, also)) =
            (spread(&steps[place - SIDE..place]), spread(&steps[place..place + SIDE]));
        if even && also && (before / after > CHANGES || after / before > CHANGES) {
            return Some((place, [1.0 / before, 1.0 / after]));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(times: Vec<f64>, clock: StatedTime, slow_motion: Option<f64>) -> TimeBase {
        TimeBase::new(&StatedTime { times: Some(times), ..clock }, slow_motion)
    }

    fn regular(frames: usize, rate: f64) -> Vec<f64> {
        (0..frames).map(|frame| frame as f64 / rate).collect()
    }

    #[test]
    fn regular_and_rounded_stamps_give_no_finding() {
        let none = |times| of(times, StatedTime::default(), None).findings;
        assert_eq!(none(regular(50, 30.0)), []);
        assert_eq!(none(regular(300, 60.0).iter().map(|t| (1000.0 * t).round() / 1000.0).collect()), []);
        // A gif of 30 frames a second in hundredths: 3, 3, 4, ..
        assert_eq!(none(regular(90, 30.0).iter().map(|t| (100.0 * t).round() / 100.0).collect()), []);
    }

    #[test]
    fn gaps_are_told_from_a_variable_rate() {
        let mut times = regular(60, 30.0);
        times.remove(20);
        assert_eq!(of(times, StatedTime::default(), None).findings, [Finding::Gaps { frames: vec![20], missing: 1 }]);
        let mut time = 0.0;
        let uneven = (0..60).map(|frame| {
            time += [0.016, 0.030, 0.021, 0.050, 0.040][frame % 5];
            time
        });
        let found = of(uneven.collect(), StatedTime::default(), None).findings;
        assert!(
            matches!(found[..], [Finding::Unusual { .. }, Finding::Variable { .. }] | [Finding::Variable { .. }]),
            "{found:?}"
        );
    }

    #[test]
    fn a_rate_that_changes_for_good_is_found() {
        let times = (0..100).map(|f| if f < 40 { f as f64 / 30.0 } else { 40.0 / 30.0 + (f - 40) as f64 / 240.0 });
        let found = of(times.collect(), StatedTime::default(), None).findings;
        let [.., Finding::RateChange { frame, before, after }] = found[..] else { panic!("{found:?}") };
        assert!((39..=41).contains(&frame) && (before - 30.0).abs() < 0.1 && (after - 240.0).abs() < 1.0, "{found:?}");
    }

    #[test]
    fn slow_motion_divides_the_times() {
        let tagged = of(regular(20, 30.0), StatedTime { capture_rate: Some(240.0), ..StatedTime::default() }, None);
        assert_eq!(tagged.findings, [Finding::SlowMotion { factor: tagged.slow_motion, source: FactorSource::Tag }]);
        assert!((tagged.slow_motion - 8.0).abs() < 1e-9 && (tagged.time(8) - 8.0 / 240.0).abs() < 1e-9);
        // A person knows better; a tag that repeats the rate changes nothing.
        assert_eq!(
            of(regular(20, 30.0), StatedTime { capture_rate: Some(240.0), ..StatedTime::default() }, Some(4.0))
                .slow_motion,
            4.0
        );
        assert_eq!(
            of(regular(20, 30.0), StatedTime { capture_rate: Some(30.0), ..StatedTime::default() }, None).slow_motion,
            1.0
        );
    }

    #[test]
    fn impossible_rates_are_named() {
        for (factor, too_fast) in [(8.0, false), (1000.0, false), (1e6, true)] {
            let found = of(regular(20, 30.0), StatedTime::default(), Some(factor)).findings;
            let rates = found
                .iter()
                .filter(|it| matches!(it, Finding::TooFast { rate } if (rate / 30.0 / factor - 1.0).abs() < 1e-6));
            assert_eq!(rates.count(), usize::from(too_fast), "{found:?}");
        }
        let given =
            |rate: f64| of(regular(20, rate), StatedTime { capture_rate: Some(rate), ..StatedTime::default() }, None);
        assert!(matches!(given(1e7).findings[..], [Finding::TooFast { .. }]));
        assert!(!given(1000.0).findings.iter().any(|it| matches!(it, Finding::Impossible { .. })));
        assert_eq!(
            of(regular(20, 1000.0), StatedTime::default(), None).findings,
            [Finding::Impossible { rate: 1000.0 }]
        );
        assert!(matches!(of(regular(20, 187.35), StatedTime::default(), None).findings[..], [Finding::Unusual { .. }]));
    }
}
