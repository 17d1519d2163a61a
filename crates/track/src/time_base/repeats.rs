//! Repeated and blended pictures.

use super::TimeBase;
use super::finding::Finding;
use crate::pictures::Change;
use crate::statistics::median;

/// Largest change of a repeated picture: levels, and a share of the largest change around it.
const STILL: f64 = 0.5;
const SHARE: f64 = 0.05;
/// Least change of the nearest new pictures, as a share of the largest around: an object that turns slows down before.
const AROUND: f64 = 0.3;
/// Frames around a picture.
const REACH: usize = 6;
/// Longest pattern of a converted rate.
const LONGEST: usize = 30;
/// Share of the patterns that must agree.
const AGREE: f64 = 0.85;
/// Fewest patterns.
const LEAST_PATTERNS: usize = 3;
/// Blend of mixed frames at most, and of the others at least.
const MIXED: f64 = 0.3;
const PURE: f64 = 0.55;

pub(super) fn find(base: &mut TimeBase, changes: &[Change]) {
    let repeated = repeated(changes);
    if !repeated.is_empty() {
        match pattern(changes, &repeated) {
            Some((repeats, of)) => {
                let rate = retimed(base, changes, &repeated, (repeats, of));
                base.findings.push(Finding::RepeatedRegularly { repeats, of, rate });
            }
            None => base.findings.push(Finding::Repeated { frames: repeated.clone() }),
        }
        base.stale.extend(repeated);
    } else if let Some((of, frames)) = blended(changes) {
        base.findings.push(Finding::Blended { of });
        base.stale.extend(frames);
    }
    base.stale.sort_unstable();
}

/// Frames that repeat the picture before while the object moves.
fn repeated(changes: &[Change]) -> Vec<usize> {
    let top = |place: usize| changes[place].top.unwrap_or(0.0);
    let new = |place: usize| top(place) > STILL;
    (1..changes.len())
        .filter(|&place| {
            let (first, end) = (place.saturating_sub(REACH).max(1), (place + REACH + 1).min(changes.len()));
            let largest = (first..end).map(top).fold(0.0, f64::max);
            let before = (first..place).rev().find(|&k| new(k));
            let after = (place + 1..end).find(|&k| new(k));
            let moves = |k: Option<usize>| k.is_some_and(|k| top(k) > AROUND * largest);
            top(place) < STILL && top(place) < SHARE * largest && moves(before) && moves(after)
        })
        .map(|place| changes[place].frame)
        .collect()
}

/// Repeats in every so many frames, where they follow a pattern.
fn pattern(changes: &[Change], repeated: &[usize]) -> Option<(usize, usize)> {
    let (first, last) = (repeated[0], repeated[repeated.len() - 1]);
    let is_repeated = |frame: usize| repeated.binary_search(&frame).is_ok();
    let moving = |frame: usize| {
        let place = frame - changes[0].frame;
        is_repeated(frame) || changes[place].top.is_some_and(|top| top > STILL)
    };
    (2..=LONGEST).find_map(|of| {
        if last + 1 - first < LEAST_PATTERNS * of {
            return None;
        }
        let agrees = |frame: usize| is_repeated(frame) == is_repeated(frame + of);
        let compared: Vec<usize> = (first..=last.saturating_sub(of)).filter(|&f| moving(f) && moving(f + of)).collect();
        let same = compared.iter().filter(|&&frame| agrees(frame)).count() as f64;
        let repeats = (repeated.iter().filter(|&&f| f < first + (last + 1 - first) / of * of).count() as f64
            / ((last + 1 - first) / of) as f64)
            .round() as usize;
        let fits = compared.len() >= LEAST_PATTERNS && same >= AGREE * compared.len() as f64;
        (fits && (1..of).contains(&repeats)).then_some((repeats, of))
    })
}

/// Times new pictures evenly, where the stamps are even, and returns their rate, frames a second.
fn retimed(base: &mut TimeBase, changes: &[Change], repeated: &[usize], (repeats, of): (usize, usize)) -> Option<f64> {
    let times = base.times.as_mut()?;
    let (first, end) = (changes[0].frame, changes[0].frame + changes.len());
    let span = times.get(end - 1)? - times[first];
    let interval = span / (changes.len() - 1) as f64;
    let new = interval * of as f64 / (of - repeats) as f64;
    let uneven = |f: usize| (times[f] - times[first] - interval * (f - first) as f64).abs() > 0.25 * interval;
    if (first..end).any(uneven) {
        return Some(1.0 / new);
    }
    // The phase of the new pictures is unknown to a frame; only their distances matter.
    let mut tick = times[first];
    let mut before = tick;
    for (frame, time) in times.iter_mut().enumerate().take(end).skip(first + 1) {
        let stamp = *time;
        if repeated.binary_search(&frame).is_ok() {
            // It has no position: any time between those of its neighbours will do.
            before += 0.5 * (tick + new - before);
        } else {
            tick += new;
            // Where the object rests, repetitions do not show: stay close to the stamps, but never go back.
            if (tick - stamp).abs() > 1.01 * new {
                tick = stamp.max(before + 0.5 * new);
            }
            before = tick;
        }
        *time = before;
    }
    Some(1.0 / new)
}

/// One of every so many frames that is a mixture of its neighbours, and all such frames.
fn blended(changes: &[Change]) -> Option<(usize, Vec<usize>)> {
    // The blend of a frame stands with the next one.
    let values: Vec<(usize, f64)> = changes.iter().filter_map(|c| c.blend.map(|b| (c.frame - 1, b))).collect();
    (2..=LONGEST).find_map(|of| {
        if values.len() < LEAST_PATTERNS * of {
            return None;
        }
        (0..of).find_map(|phase| {
            let here = |&(frame, _): &(usize, f64)| frame % of == phase;
            let mut mixed: Vec<f64> = values.iter().filter(|v| here(v)).map(|v| v.1).collect();
            let mut others: Vec<f64> = values.iter().filter(|v| !here(v)).map(|v| v.1).collect();
            let small = mixed.iter().filter(|&&blend| blend < MIXED).count();
            let fits = mixed.len() >= LEAST_PATTERNS
                && small as f64 >= AGREE * mixed.len() as f64
                && median(&mut mixed)? < MIXED
                && median(&mut others)? > PURE;
            let last = changes[0].frame + changes.len();
            fits.then(|| (of, (changes[0].frame..last).filter(|frame| frame % of == phase).collect()))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::StatedTime;
    use super::*;

    fn change(frame: usize, top: f64, blend: f64) -> Change {
        Change { frame, top: (frame > 0).then_some(top), share: 0.1, correlation: 0.9, blend: Some(blend) }
    }

    #[test]
    fn a_fifth_of_the_frames_repeated_gives_the_rate_before() {
        let changes: Vec<_> = (0..60).map(|f| change(f, if f % 5 == 4 { 0.1 } else { 30.0 }, 0.9)).collect();
        let clock = StatedTime { times: Some((0..60).map(|f| f as f64 / 30.0).collect()), ..StatedTime::default() };
        let mut base = TimeBase::new(&clock, None);
        base.look(&changes);
        let [Finding::RepeatedRegularly { repeats: 1, of: 5, rate: Some(rate) }] = base.findings[..] else {
            panic!("{:?}", base.findings)
        };
        assert!((rate - 24.0).abs() < 1e-9 && base.stale.len() >= 11);
        assert!(base.times.iter().flatten().is_sorted_by(|a, b| a < b), "{:?}", base.times);
        // New pictures follow each other after 1/24 s.
        assert!((base.time(5) - base.time(3) - 1.0 / 24.0).abs() < 1e-9, "{:?}", base.times);
    }

    /// Pictures repeat while the object moves and seem new while it rests, so that the even clock runs ahead of the stamps.
    #[test]
    fn times_ascend_where_repetitions_do_not_show() {
        let top = |f: usize| {
            if (f / 60) % 2 == 1 {
                0.2
            } else if f % 5 == 4 {
                0.1
            } else {
                30.0
            }
        };
        let changes: Vec<_> = (0..240).map(|f| change(f, top(f), 0.9)).collect();
        let clock = StatedTime { times: Some((0..240).map(|f| f as f64 / 30.0).collect()), ..StatedTime::default() };
        let mut base = TimeBase::new(&clock, None);
        base.look(&changes);
        assert!(base.findings.iter().any(|it| matches!(it, Finding::RepeatedRegularly { .. })), "{:?}", base.findings);
        assert!(base.times.iter().flatten().is_sorted_by(|a, b| a < b), "{:?}", base.times);
    }

    #[test]
    fn an_object_that_turns_is_not_repeated() {
        let turning: Vec<_> = (0..60).map(|f| change(f, 40.0 * (f as f64 * 0.1).sin().abs(), 0.9)).collect();
        let mut base = TimeBase::default();
        base.look(&turning);
        assert_eq!(base.findings, []);
        let mut stuck = turning;
        stuck[15].top = Some(0.0);
        base.look(&stuck);
        assert_eq!(base.findings, [Finding::Repeated { frames: vec![15] }]);
    }

    #[test]
    fn every_sixth_frame_blended_is_found() {
        let changes: Vec<_> = (0..60).map(|f| change(f, 30.0, if f % 6 == 3 { 0.1 } else { 0.9 })).collect();
        let mut base = TimeBase::default();
        base.look(&changes);
        assert_eq!(base.findings, [Finding::Blended { of: 6 }]);
        assert_eq!(base.stale[..2], [2, 8]);
    }
}
