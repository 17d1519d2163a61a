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

/// Rows of the result that are made at a time: the rows of the frame that they need stay in the processor's cache.
const STRIP: usize = 48;

/// Resamples a frame of size `from` to the size of `fill`, which shows where the frame does not. `map` takes places of the
/// result to places of the frame; it must not turn by more than about 45 degrees.
pub(crate) fn warped(frame: &[u8], from: Size, map: &Similarity, to: Size, fill: Vec<u8>) -> Warped {
    let spans: Vec<Range<usize>> = (0..to.height).map(|y| span(map, from, to.width, y)).collect();
    let left = spans.iter().filter(|s| !s.is_empty()).map(|s| s.start).min().unwrap_or(0);
    let right = spans.iter().map(|s| s.end).max().unwrap_or(0).max(left);
    let columns = left..right;
    let mut bytes = fill;
    // Neighbouring strips of a turned frame need the same rows: strips are as high as a row rises, so that each row is made twice
    // at most.
    let rows = STRIP.max((map.b.abs() * columns.len() as f64) as usize);
    let warp = Warp { frame, from, map, columns };
    bytes.par_chunks_mut(rows * to.width * 3).zip(spans.par_chunks(rows)).enumerate().for_each(
        |(strip, (out, spans))| {
            warp.strip(strip * rows, out, spans);
        },
    );
    Warped { bytes, spans }
}

/// Resampling of one frame.
struct Warp<'a> {
    frame: &'a [u8],
    from: Size,
    map: &'a Similarity,
    /// Columns of the result that the frame shows in any row.
    columns: Range<usize>,
}

impl Warp<'_> {
    /// Rows of the result from `top` on, with the columns of each that the frame shows.
    fn strip(&self, top: usize, out: &mut [u8], spans: &[Range<usize>]) {
        let Similarity { a, b, v, .. } = *self.map;
        let start = |row: usize, span: &Range<usize>| b * span.start as f64 + a * (top + row) as f64 + v;
        let shown = || spans.iter().enumerate().filter(|(_, span)| !span.is_empty());
        let ends = shown().flat_map(|(row, span)| {
            let first = start(row, span);
            [first, first + b * (span.len() - 1) as f64]
        });
        let (low, high) =
            ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)));
        if low > high {
            return;
        }
        // The filter reaches from one row before to two after; rounding may move a place by one more.
        let last_row = self.from.height as f64 - 1.0;
        let rows =
            (low.floor() - 2.0).clamp(0.0, last_row) as usize..=(high.floor() + 3.0).clamp(0.0, last_row) as usize;
        let first_row = *rows.start();
        let count = self.columns.len();
        let mut planes = vec![0.0_f32; rows.clone().count() * count * 3];
        let mut line: [Vec<f32>; 3] = Default::default();
        for (row, planes) in rows.clone().zip(planes.chunks_exact_mut(3 * count)) {
            self.row(row, &mut line, planes);
        }
        let mut values = vec![0.0_f32; 3 * count];
        let width = out.len() / spans.len();
        for ((row, span), out) in spans.iter().enumerate().zip(out.chunks_exact_mut(width)) {
            for FilterRun { range, first, part } in runs(start(row, span), b, 0, span.len()) {
                // A run of this pass keeps to its rows.
                let of_tap = [-1, 0, 1, 2].map(|tap| {
                    let row = ((first + tap).clamp(0, last_row as i64) as usize).clamp(first_row, *rows.end());
                    (row - first_row) * 3 * count + span.start + range.start - self.columns.start
                });
                for channel in 0..3 {
                    let taps = of_tap.map(|place| &planes[place + channel * count..][..range.len()]);
                    let values = &mut values[channel * count..][range.clone()];
                    filtered(values, taps, part, b as f32);
                }
            }
            for (k, pixel) in out[3 * span.start..3 * span.end].chunks_exact_mut(3).enumerate() {
                // The conversion saturates.
                (0..3).for_each(|channel| pixel[channel] = (values[channel * count + k] + 0.5) as u8);
            }
        }
    }

    /// One row of the frame at the columns of the result, `[3, columns]`; `line` is space for it.
    fn row(&self, row: usize, line: &mut [Vec<f32>; 3], planes: &mut [f32]) {
        let Similarity { a, b, u, v } = *self.map;
        let (width, count) = (self.from.width, self.columns.len());
        prolonged(&self.frame[row * width * 3..][..width * 3], line);
        // Along a row of the frame: x of the frame is linear in x of the result.
        let slope = a + b * b / a;
        let start = slope * self.columns.start as f64 - b / a * (row as f64 - v) + u;
        let pace = (slope - 1.0) as f32;
        for FilterRun { range, first, part } in runs(start, slope, 1, count) {
            // What no pixel of the result needs is left out.
            let (low, high) = (first - 1 + MARGIN as i64, (width + MARGIN) as i64 + MARGIN as i64);
            let skipped = (-(low + range.start as i64)).clamp(0, range.len() as i64) as usize;
            let end = (high - 3 - low - range.start as i64).clamp(0, range.len() as i64) as usize;
            if skipped < end {
                for (channel, line) in line.iter().enumerate() {
                    let taps = [0, 1, 2, 3].map(|tap| {
                        let begin = (low + tap) as usize + range.start + skipped;
                        &line[begin..begin + end - skipped]
                    });
                    let out = &mut planes[channel * count..][range.start + skipped..range.start + end];
                    filtered(out, taps, part + pace * skipped as f32, pace);
                }
            }
        }
    }
}

/// Channels of a row of a frame as numbers, prolonged by [`MARGIN`] pixels on both sides.
fn prolonged(row: &[u8], line: &mut [Vec<f32>; 3]) {
    for (channel, line) in line.iter_mut().enumerate() {
        let level = |pixel: &[u8]| f32::from(pixel[channel]);
        line.clear();
        line.resize(MARGIN, level(&row[..3]));
        line.extend(row.chunks_exact(3).map(level));
        line.resize(line.len() + MARGIN, level(&row[row.len() - 3..]));
    }
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

/// Cubic convolution of four lines of samples, at `part` between the second and the third for the first place and `pace` more for
/// each of the next.
fn filtered(out: &mut [f32], [p, q, r, s]: [&[f32]; 4], part: f32, pace: f32) {
    // Lines of one length, and an index of 32 bits: the loop is made of lanes.
    let count = out.len();
    let [p, q, r, s] = [&p[..count], &q[..count], &r[..count], &s[..count]];
    for k in 0..count {
        let [a, b, c, d] = cubic(part + pace * k as i32 as f32);
        out[k] = a * p[k] + b * q[k] + c * r[k] + d * s[k];
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
