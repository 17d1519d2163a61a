//! Frames resampled into the frame of the background, by cubic convolution along rows, then along columns.

use std::ops::Range;

use rayon::prelude::*;

use crate::plane::cubic;
use crate::similarity::Similarity;
use crate::video::Size;

/// Pixels at the border of a frame that are left out: the filter reaches beyond it.
const INSET: f64 = 1.0;

/// Pixels by which the rows of a frame are prolonged on both sides, with the outermost one.
const MARGIN: usize = 4;

/// Frame in the frame of the background.
pub(crate) struct Warped {
    /// `[height, width, 3]`.
    pub(crate) bytes: Vec<u8>,
    /// Columns of each row that the frame shows.
    pub(crate) spans: Vec<Range<usize>>,
}

/// Resamples a frame of size `from` to the size of `fill`, which shows where the frame does not. `map` takes places of the
/// result to places of the frame; it must not turn by more than about 45 degrees.
pub(crate) fn warped(frame: &[u8], from: Size, map: &Similarity, to: Size, fill: Vec<u8>) -> Warped {
    let spans: Vec<Range<usize>> = (0..to.height).map(|y| span(map, from, to.width, y)).collect();
    let left = spans.iter().filter(|s| !s.is_empty()).map(|s| s.start).min().unwrap_or(0);
    let right = spans.iter().map(|s| s.end).max().unwrap_or(0).max(left);
    let columns = right - left;
    let mut bytes = fill;
    if columns == 0 {
        return Warped { bytes, spans };
    }
    let Similarity { a, b, u, v } = *map;
    // Along a row of the frame: x of the frame is linear in x of the result.
    let slope = a + b * b / a;
    let mut rows = vec![0.0_f32; columns * from.height * 3];
    rows.par_chunks_mut(columns * 3).enumerate().for_each(|(row, out)| {
        let line = prolonged(&frame[row * from.width * 3..][..from.width * 3]);
        let start = slope * left as f64 - b / a * (row as f64 - v) + u;
        for FilterRun { range, first, part } in runs(start, slope, 1, columns) {
            // What no pixel of the result needs is left out.
            let (low, high) = (first - 1 + MARGIN as i64, (from.width + MARGIN) as i64 + MARGIN as i64);
            let skipped = (-(low + range.start as i64)).clamp(0, range.len() as i64) as usize;
            let count = (high - 3 - low - range.start as i64).clamp(0, range.len() as i64) as usize;
            if skipped < count {
                let at = |tap: i64| {
                    let begin = (low + tap) as usize + range.start + skipped;
                    &line[3 * begin..3 * (begin + count - skipped)]
                };
                let out = &mut out[3 * (range.start + skipped)..3 * (range.start + count)];
                let pace = (slope - 1.0) as f32;
                filtered(out, [at(0), at(1), at(2), at(3)], part + pace * skipped as f32, pace);
            }
        }
    });
    bytes.par_chunks_mut(to.width * 3).zip(&spans).enumerate().for_each(|(y, (out, span))| {
        let mut values = vec![0.0; 3 * span.len()];
        let start = b * span.start as f64 + a * y as f64 + v;
        for FilterRun { range, first, part } in runs(start, b, 0, span.len()) {
            // A run of this pass keeps to its rows.
            let taps = [-1, 0, 1, 2].map(|tap| {
                let row = (first + tap).clamp(0, from.height as i64 - 1) as usize;
                &rows[(row * columns + span.start + range.start - left) * 3..][..3 * range.len()]
            });
            filtered(&mut values[3 * range.start..3 * range.end], taps, part, b as f32);
        }
        for (byte, value) in out[3 * span.start..3 * span.end].iter_mut().zip(values) {
            // The conversion saturates.
            *byte = (value + 0.5) as u8;
        }
    });
    Warped { bytes, spans }
}

/// A row of a frame as numbers, prolonged by [`MARGIN`] pixels on both sides.
fn prolonged(row: &[u8]) -> Vec<f32> {
    let (first, last) = (&row[..3], &row[row.len() - 3..]);
    let before = std::iter::repeat_n(first, MARGIN).flatten();
    let after = std::iter::repeat_n(last, MARGIN).flatten();
    before.chain(row).chain(after).map(|&level| f32::from(level)).collect()
}

/// Places whose neighbouring samples advance evenly.
struct FilterRun {
    range: Range<usize>,
    /// Sample before place 0, by the run's pace; and the way from there to the first place of the run.
    first: i64,
    part: f32,
}

/// Runs of the places `start + slope * k` for `k` in `0..count`, whose whole part advances by `pace` from one to the next.
fn runs(start: f64, slope: f64, pace: i64, count: usize) -> impl Iterator<Item = FilterRun> {
    let rate = slope - pace as f64;
    let place = move |k: usize| start + rate * k as f64;
    let mut next = 0;
    std::iter::from_fn(move || {
        (next < count).then(|| {
            let begin = next;
            let whole = place(begin).floor();
            // First place beyond the whole part.
            let end = match rate {
                rate if rate > 0.0 => ((whole + 1.0 - start) / rate).ceil(),
                rate if rate < 0.0 => ((whole - start) / rate).floor() + 1.0,
                _ => f64::INFINITY,
            };
            next = (end.min(count as f64) as usize).clamp(begin + 1, count);
            FilterRun { range: begin..next, first: whole as i64, part: (place(begin) - whole) as f32 }
        })
    })
}

/// Cubic convolution of four lines of pixels, at `part` between the second and the third for the first pixel and `pace` more for
/// each of the next.
fn filtered(out: &mut [f32], [p, q, r, s]: [&[f32]; 4], part: f32, pace: f32) {
    let lines = p.chunks_exact(3).zip(q.chunks_exact(3)).zip(r.chunks_exact(3)).zip(s.chunks_exact(3));
    for (k, (pixel, (((p, q), r), s))) in out.chunks_exact_mut(3).zip(lines).enumerate() {
        let [a, b, c, d] = cubic(part + pace * k as f32);
        for channel in 0..3 {
            pixel[channel] = a * p[channel] + b * q[channel] + c * r[channel] + d * s[channel];
        }
    }
}

/// Columns of a row of the result that lie within the frame.
fn span(map: &Similarity, from: Size, width: usize, y: usize) -> Range<usize> {
    let (mut first, mut last) = (0.0_f64, width as f64 - 1.0);
    let y = y as f64;
    // Both coordinates are linear in x: slope * x + offset between INSET and the border.
    for (slope, offset, end) in [
        (map.a, -map.b * y + map.u, from.width as f64 - 1.0 - INSET),
        (map.b, map.a * y + map.v, from.height as f64 - 1.0 - INSET),
    ] {
        if slope.abs() < 1e-12 {
            if !(INSET..=end).contains(&offset) {
                return 0..0;
            }
            continue;
        }
        let (p, q) = ((INSET - offset) / slope, (end - offset) / slope);
        first = first.max(p.min(q));
        last = last.min(p.max(q));
    }
    let (first, end) = (first.ceil().max(0.0) as usize, (last.floor() + 1.0).max(0.0) as usize);
    if first < end { first..end } else { 0..0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(x: f64, y: f64) -> f64 {
        120.0 + 60.0 * (x * 0.11).sin() * (y * 0.08).cos()
    }

    #[test]
    fn a_turned_frame_is_turned_back() {
        let from = Size { width: 160, height: 120 };
        // The frame shows the scene through this map.
        let map = Similarity { a: 1.02 * 0.05_f64.cos(), b: 1.02 * 0.05_f64.sin(), u: -7.3, v: 4.6 };
        let scene = map.inverse();
        let frame: Vec<u8> = (0..160 * 120 * 3)
            .map(|i| {
                let [x, y] = scene.apply([(i / 3 % 160) as f64, (i / 480) as f64]);
                level(x, y).round() as u8
            })
            .collect();
        let to = Size { width: 200, height: 130 };
        let Warped { bytes, spans } = warped(&frame, from, &map, to, vec![7; 200 * 130 * 3]);
        let mut seen = 0;
        for y in 0..130 {
            for x in 0..200 {
                let value = f64::from(bytes[(y * 200 + x) * 3]);
                if spans[y].contains(&x) {
                    // Rounding twice.
                    assert!((value - level(x as f64, y as f64)).abs() < 1.6, "{x} {y}: {value}");
                    seen += 1;
                } else {
                    assert_eq!(value, 7.0);
                }
            }
        }
        assert!(seen > 150 * 110, "{seen}");
    }
}
