//! From time stamps of samples to presentation times: edit lists.

use crate::error::{CONVERT, DecodeError, Result};

/// A piece of a recording that is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EditSegment {
    /// Presentation time at which it begins, seconds.
    pub shown_from: f64,
    /// Time in the recording at which it begins and ends, seconds; without an end infinite.
    pub recorded: [f64; 2],
    /// Speed at which it is played: 2 shows two seconds of the recording in one.
    pub rate: f64,
}

/// One entry of an edit list.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Edit {
    /// Duration in the presentation, ticks of the movie's clock; 0 where unknown.
    pub duration: u64,
    /// Time stamp of the sample with which it begins, ticks of the track's clock; negative for a pause.
    pub begin: i64,
    /// Speed, 16.16 fixed point.
    pub rate: i32,
}

/// A track's clock and the pieces that are shown of it.
#[derive(Debug, Clone)]
pub(crate) struct Timeline {
    ticks_per_second: f64,
    pieces: Vec<TimelinePiece>,
    pub segments: Vec<EditSegment>,
}

#[derive(Debug, Clone, Copy)]
struct TimelinePiece {
    /// Ticks of the track's clock.
    begin: i64,
    end: i64,
    shown_from: f64,
    rate: f64,
}

impl Timeline {
    /// Everything is shown.
    pub(crate) fn whole(ticks_per_second: f64) -> Self {
        let all = TimelinePiece { begin: i64::MIN, end: i64::MAX, shown_from: 0.0, rate: 1.0 };
        Timeline { ticks_per_second, pieces: vec![all], segments: Vec::new() }
    }

    /// Applies an edit list; the movie's clock has so many ticks a second.
    ///
    /// # Errors
    /// Stills (rate 0), reversed play, and pieces that repeat or reorder the recording.
    pub(crate) fn edited(ticks_per_second: u32, movie_ticks: u32, edits: &[Edit]) -> Result<Self> {
        let (track, movie) = (i128::from(ticks_per_second), i128::from(movie_ticks));
        if edits.iter().all(|edit| edit.begin < 0) || movie == 0 {
            return Ok(Timeline::whole(f64::from(ticks_per_second)));
        }
        let mut timeline =
            Timeline { ticks_per_second: f64::from(ticks_per_second), pieces: Vec::new(), segments: Vec::new() };
        let mut shown_from = 0.0;
        for edit in edits {
            let seconds = edit.duration as f64 / f64::from(movie_ticks);
            if edit.begin >= 0 {
                if edit.rate <= 0 {
                    return Err(refused("a piece played at rate 0 or backwards"));
                }
                // Rounded to the nearest tick, as other readers do.
                let rate = i128::from(edit.rate);
                let divisor = movie << 16;
                let ticks = (i128::from(edit.duration) * track * rate + divisor / 2) / divisor;
                let end = i128::from(edit.begin) + ticks;
                let end = if edit.duration == 0 { i64::MAX } else { i64::try_from(end).unwrap_or(i64::MAX) };
                if timeline.pieces.last().is_some_and(|last| edit.begin < last.end) {
                    return Err(refused("pieces that show a part twice or in another order"));
                }
                let rate = f64::from(edit.rate) / 65536.0;
                timeline.pieces.push(TimelinePiece { begin: edit.begin, end, shown_from, rate });
            }
            shown_from += seconds;
        }
        timeline.segments = timeline.pieces.iter().map(|piece| timeline.segment(piece)).collect();
        Ok(timeline)
    }

    fn segment(&self, piece: &TimelinePiece) -> EditSegment {
        let seconds = |ticks: i64| ticks as f64 / self.ticks_per_second;
        let end = if piece.end == i64::MAX { f64::INFINITY } else { seconds(piece.end) };
        EditSegment { shown_from: piece.shown_from, recorded: [seconds(piece.begin), end], rate: piece.rate }
    }

    /// Presentation time of a sample's stamp, seconds; none of a sample that is not shown.
    pub(crate) fn seconds(&self, stamp: i64) -> Option<f64> {
        // They are in ascending order, and may be as many as the frames.
        let begun = self.pieces.partition_point(|piece| piece.begin <= stamp);
        let piece = self.pieces[..begun].last().filter(|piece| stamp < piece.end)?;
        let begin = if piece.begin == i64::MIN { 0 } else { piece.begin };
        let ticks = i128::from(stamp) - i128::from(begin);
        Some(piece.shown_from + ticks as f64 / self.ticks_per_second / piece.rate)
    }
}

fn refused(what: &str) -> DecodeError {
    DecodeError::Unsupported { what: format!("an edit list with {what}"), remedy: CONVERT.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: i32 = 1 << 16;

    fn edit(duration: u64, begin: i64, rate: i32) -> Edit {
        Edit { duration, begin, rate }
    }

    #[test]
    fn an_edit_list_hides_shifts_and_stretches() {
        let of = |edits: &[Edit]| Timeline::edited(12_800, 1000, edits).unwrap();
        // 2.4 s from tick 1024 on.
        let cut = of(&[edit(2400, 1024, ONE)]);
        assert_eq!([1023, 1024, 31_743, 31_744].map(|stamp| cut.seconds(stamp).is_some()), [false, true, true, false]);
        // A pause of half a second before it; it goes on to the end.
        assert_eq!(of(&[edit(500, -1, ONE), edit(0, 512, ONE)]).seconds(512 + 12_800), Some(1.5));
        // Twice and half as fast: one second of presentation.
        assert_eq!(of(&[edit(1000, 0, 2 * ONE)]).seconds(12_800), Some(0.5));
        assert_eq!(of(&[edit(1000, 0, 2 * ONE)]).seconds(25_600), None);
        assert_eq!(of(&[edit(1000, 0, ONE / 2)]).seconds(3200), Some(0.5));
        assert_eq!(of(&[edit(1000, 0, ONE / 2)]).seconds(6400), None);
        // Two pieces follow each other in the presentation.
        let pieces = of(&[edit(1000, 0, ONE), edit(1000, 64_000, ONE)]);
        assert_eq!((pieces.seconds(12_800), pieces.seconds(64_000)), (None, Some(1.0)));
        assert_eq!(pieces.segments[1], EditSegment { shown_from: 1.0, recorded: [5.0, 6.0], rate: 1.0 });
        assert_eq!(of(&[]).seconds(-12_800), Some(-1.0));
    }

    /// Searched one after the other these would take 10^11 steps.
    #[test]
    fn a_long_edit_list_is_searched_quickly() {
        let edits: Vec<_> = (0..500_000).map(|number| edit(1, 2 * number, ONE)).collect();
        let timeline = Timeline::edited(1, 1, &edits).unwrap();
        for number in 0..500_000 {
            assert_eq!(timeline.seconds(2 * number), Some(number as f64));
            assert_eq!(timeline.seconds(2 * number + 1), None);
        }
    }

    #[test]
    fn stills_and_repetitions_are_refused_and_no_number_overflows() {
        for edits in [&[edit(1000, 0, 0)][..], &[edit(1000, 0, -ONE)], &[edit(1000, 0, ONE), edit(1000, 64, ONE)]] {
            assert!(Timeline::edited(12_800, 1000, edits).unwrap_err().is_unsupported());
        }
        let largest = Timeline::edited(u32::MAX, 1, &[edit(u64::MAX, i64::MAX, i32::MAX)]).unwrap();
        assert_eq!(largest.seconds(i64::MIN), None);
    }
}
