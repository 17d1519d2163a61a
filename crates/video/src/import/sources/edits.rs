//! Edit lists of mp4 and mov: which frames of a film are shown. A film that was trimmed without being encoded anew still holds
//! the frames since the key frame before, and hides them by its list.

use std::ops::Range;

use anyhow::{Result, ensure};
use re_mp4::{ElstBox, Mp4, Track, TrakBox};

const EVERYTHING: Range<i128> = i128::MIN..i128::MAX;

/// One entry of a list.
#[derive(Debug, Clone, Copy)]
struct Edit {
    /// For how long it is shown, ticks of the movie's clock; 0 where that was not known: to the end.
    ticks: u64,
    /// The composition time with which it begins, ticks of the film's clock; negative where nothing is shown for a while.
    begin: i64,
}

/// The composition times that are shown, in ticks of the film's clock as the parser counts them.
///
/// # Errors
/// A list of several pieces.
pub(super) fn shown(mp4: &Mp4, described: &TrakBox, film: &Track) -> Result<Range<i128>> {
    let list = described.edts.as_ref().and_then(|edits| edits.elst.as_ref());
    // The list of a film in fragments was written before most of them.
    let (Some(list), Some(first), true) = (list, film.samples.first(), mp4.moofs.is_empty()) else {
        return Ok(EVERYTHING);
    };
    let piece = piece(&edits(list), film.timescale, mp4.moov.mvhd.timescale)?;
    // The list counts as the file does: the first sample is decoded at 0 and shown by its offset later. The parser counts
    // from the frame that is shown first.
    let offsets = described.mdia.minf.stbl.ctts.as_ref();
    let offset = offsets.and_then(|offsets| offsets.entries.first()).map_or(0, |entry| entry.sample_offset);
    let moved = i128::from(offset) - i128::from(first.composition_timestamp);
    Ok(piece.start.saturating_sub(moved)..piece.end.saturating_sub(moved))
}

fn edits(list: &ElstBox) -> Vec<Edit> {
    // The parser reads times without their sign.
    let signed = |time: u64| if list.version == 0 { i64::from(time as u32 as i32) } else { time as i64 };
    list.entries.iter().map(|it| Edit { ticks: it.segment_duration, begin: signed(it.media_time) }).collect()
}

/// The only piece of a list, in ticks of the film's clock; each clock has so many ticks a second.
fn piece(edits: &[Edit], film_ticks: u64, movie_ticks: u32) -> Result<Range<i128>> {
    let mut pieces = edits.iter().skip_while(|edit| edit.begin < 0);
    let Some(Edit { ticks, begin }) = pieces.next() else { return Ok(EVERYTHING) };
    let more = pieces.count();
    ensure!(
        more == 0,
        "its edit list shows {} pieces of it one after the other; make one film of them: ffmpeg -i VIDEO whole.mp4",
        more + 1
    );
    let begin = i128::from(*begin);
    if *ticks == 0 || movie_ticks == 0 {
        return Ok(begin..EVERYTHING.end);
    }
    Ok(begin..begin + i128::from(*ticks) * i128::from(film_ticks) / i128::from(movie_ticks))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_shows_one_piece() {
        let edit = |ticks, begin| Edit { ticks, begin };
        let of = |edits: &[Edit]| piece(edits, 12_800, 1000);
        assert_eq!(of(&[]).unwrap(), EVERYTHING);
        assert_eq!(of(&[edit(2400, 1024)]).unwrap(), 1024..31_744);
        // Nothing is shown before it; it goes on to the end.
        assert_eq!(of(&[edit(500, -1), edit(0, 512)]).unwrap(), 512..i128::MAX);
        let refused = of(&[edit(400, 0), edit(400, 9000)]).unwrap_err().to_string();
        assert!(refused.contains("2 pieces"), "{refused}");
        assert!(of(&[edit(400, 0), edit(400, -1)]).is_err());
        // As large as they can be.
        assert!(piece(&[edit(u64::MAX, i64::MAX)], u64::from(u32::MAX), 1).is_ok());
    }

    #[test]
    fn times_without_their_sign_are_read_with_it() {
        for (version, time) in [(0, u64::from(u32::MAX)), (1, u64::MAX)] {
            let mut list = ElstBox { version, flags: 0, entries: vec![Default::default()] };
            list.entries[0].media_time = time;
            assert_eq!(edits(&list)[0].begin, -1);
        }
    }
}
