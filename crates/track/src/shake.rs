//! Translation of a hand-held camera, from the edges of the background.

use nalgebra::{Matrix2, Vector2};

use crate::background::Background;
use crate::exposure::Exposure;
use crate::plane::cubic;
use crate::statistics::{NORMAL_MAD, median, quantile};
use crate::video::Size;

/// Cells of a grid along the longer side; each gives its strongest edges.
const CELLS: usize = 24;
/// Edges of each cell.
const EDGES: usize = 6;
/// Least gradient of an edge, levels per pixel.
const LEAST_GRADIENT: f32 = 6.0;
/// Largest translation looked for, pixels.
const MOST: i64 = 10;
/// Translation of the 70th percentile of the sampled frames from which on frames are stabilised, pixels.
const SHAKES: f64 = 0.25;
/// Share of the edges that must agree on a translation.
const LEAST_AGREEING: f64 = 0.6;
/// Share of the cells that must have edges: those of a moving shadow lie in one place.
const LEAST_SPREAD: f64 = 0.15;
/// Edges skipped by the search over whole pixels.
const SPARSE: usize = 3;
const BIWEIGHT: f64 = 4.685;

/// Edges of the background against which frames are aligned.
pub(crate) struct Edges {
    size: Size,
    /// Column, row, level and gradient along x and y of the green channel.
    points: Vec<(usize, usize, f32, [f32; 2])>,
}

impl Edges {
    /// Strongest edges of each part of the background; `None` where too few exist to fix a translation.
    pub(crate) fn find(background: &Background) -> Option<Self> {
        let size = background.size();
        let levels = &background.levels;
        let cell = (size.width.max(size.height) / CELLS).max(8);
        let margin = MOST as usize + 2;
        let mut points = Vec::new();
        let (mut cells, mut with_edges) = (0_u32, 0_u32);
        for top in (margin..size.height.saturating_sub(margin)).step_by(cell) {
            for left in (margin..size.width.saturating_sub(margin)).step_by(cell) {
                let mut edges = Vec::new();
                for y in top..(top + cell).min(size.height - margin) {
                    for x in left..(left + cell).min(size.width - margin) {
                        let slope = [
                            0.5 * (levels[[y, x + 1, 1]] - levels[[y, x - 1, 1]]),
                            0.5 * (levels[[y + 1, x, 1]] - levels[[y - 1, x, 1]]),
                        ];
                        if slope[0].hypot(slope[1]) > LEAST_GRADIENT {
                            edges.push((x, y, levels[[y, x, 1]], slope));
                        }
                    }
                }
                edges.sort_by(|a, b| b.3[0].hypot(b.3[1]).total_cmp(&a.3[0].hypot(a.3[1])));
                edges.truncate(EDGES);
                cells += 1;
                with_edges += u32::from(!edges.is_empty());
                points.extend(edges);
            }
        }
        let normal = points.iter().fold(Matrix2::zeros(), |sum, p| {
            let row = Vector2::new(f64::from(p.3[0]), f64::from(p.3[1]));
            sum + row * row.transpose()
        });
        let eigenvalues = normal.symmetric_eigenvalues();
        // Both directions need edges, 100 of the least gradient, and they must not all lie in one place.
        let spread = f64::from(with_edges) >= LEAST_SPREAD * f64::from(cells);
        (spread && eigenvalues.min() > 100.0 * f64::from(LEAST_GRADIENT).powi(2)).then_some(Self { size, points })
    }

    /// Translation `[x, y]` of a frame's content against the background, pixels; zero where most edges disagree.
    pub(crate) fn translation(&self, frame: &[u8], exposure: &Exposure) -> [f64; 2] {
        let table = exposure.table(1);
        let level = |x: i64, y: i64| table[frame[(y as usize * self.size.width + x as usize) * 3 + 1] as usize];
        let cost = |dx: i64, dy: i64| -> f64 {
            let term = |p: &(usize, usize, f32, [f32; 2])| {
                let r = f64::from(level(p.0 as i64 + dx, p.1 as i64 + dy) - p.2);
                r * r / (r * r + 400.0)
            };
            self.points.iter().step_by(SPARSE).map(term).sum()
        };
        let mut best = (cost(0, 0), [0_i64; 2]);
        for dy in -MOST..=MOST {
            for dx in -MOST..=MOST {
                let found = cost(dx, dy);
                if found < best.0 {
                    best = (found, [dx, dy]);
                }
            }
        }
        self.refined(&level, best.1.map(|v| v as f64)).unwrap_or([0.0; 2])
    }

    fn refined(&self, level: &dyn Fn(i64, i64) -> f32, start: [f64; 2]) -> Option<[f64; 2]> {
        let mut shift = start;
        let mut share = 0.0;
        for _ in 0..8 {
            let [left, top] = shift.map(|v| v.clamp(-(MOST as f64) - 0.5, MOST as f64 + 0.5).floor());
            let part = [(shift[0] - left) as f32, (shift[1] - top) as f32];
            let sample = |x: usize, y: usize| {
                let (x, y) = (x as i64 + left as i64, y as i64 + top as i64);
                let row = |y: i64| (1.0 - part[0]) * level(x, y) + part[0] * level(x + 1, y);
                (1.0 - part[1]) * row(y) + part[1] * row(y + 1)
            };
            let residuals: Vec<f64> = self.points.iter().map(|p| f64::from(sample(p.0, p.1) - p.2)).collect();
            let scale = median(&mut residuals.iter().map(|r| r.abs()).collect::<Vec<_>>())? * NORMAL_MAD;
            let limit = BIWEIGHT * scale.max(2.0);
            let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
            let mut near = 0;
            for (residual, point) in residuals.iter().zip(&self.points) {
                let z = residual / limit;
                if z.abs() < 1.0 {
                    let weight = (1.0 - z * z).powi(2);
                    let row = Vector2::new(f64::from(point.3[0]), f64::from(point.3[1]));
                    normal += weight * row * row.transpose();
                    right -= weight * *residual * row;
                    near += 1;
                }
            }
            share = f64::from(near) / residuals.len() as f64;
            let step = normal.lu().solve(&right)?;
            shift = [shift[0] + step[0].clamp(-1.0, 1.0), shift[1] + step[1].clamp(-1.0, 1.0)];
        }
        (share > LEAST_AGREEING && shift.iter().all(|s| s.abs() < MOST as f64)).then_some(shift)
    }
}

/// Whether translations show a camera that shakes.
pub(crate) fn shakes(translations: &[[f64; 2]]) -> bool {
    let mut lengths: Vec<f64> = translations.iter().map(|t| t[0].hypot(t[1])).collect();
    quantile(&mut lengths, 0.7).is_some_and(|length| length > SHAKES)
}

/// Frame with its content moved by `-translation`, by cubic convolution; `[height, width, 3]`. The border is repeated.
pub(crate) fn moved_back(frame: &[u8], size: Size, translation: [f64; 2]) -> Vec<u8> {
    let Size { width, height } = size;
    let whole = translation.map(|t| t.floor() as i64);
    let [across, down] = [0, 1].map(|axis| cubic((translation[axis] - translation[axis].floor()) as f32));
    let stride = 3 * width;
    let column = |x: i64| x.clamp(0, width as i64 - 1) as usize;
    let mut filtered = vec![0.0_f32; frame.len()];
    let mut line = vec![0.0_f32; stride + 9];
    for (row, out) in frame.chunks_exact(stride).zip(filtered.chunks_exact_mut(stride)) {
        for (k, pixel) in line.chunks_exact_mut(3).enumerate() {
            let from = 3 * column(k as i64 - 1 + whole[0]);
            (0..3).for_each(|c| pixel[c] = f32::from(row[from + c]));
        }
        let taps = line.iter().zip(&line[3..]).zip(&line[6..]).zip(&line[9..]);
        for (value, (((a, b), c), d)) in out.iter_mut().zip(taps) {
            *value = across[0] * a + across[1] * b + across[2] * c + across[3] * d;
        }
    }
    let mut result = vec![0; frame.len()];
    for (y, out) in result.chunks_exact_mut(stride).enumerate() {
        let row = |tap: i64| {
            let from = (y as i64 + whole[1] + tap).clamp(0, height as i64 - 1) as usize * stride;
            &filtered[from..from + stride]
        };
        let taps = row(-1).iter().zip(row(0)).zip(row(1)).zip(row(2));
        for (value, (((a, b), c), d)) in out.iter_mut().zip(taps) {
            // The conversion saturates.
            *value = (down[0] * a + down[1] * b + down[2] * c + down[3] * d + 0.5) as u8;
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, Array3};

    fn level(x: f64, y: f64) -> f64 {
        120.0 + 50.0 * (x * 0.31).sin() * (y * 0.23).cos() + 30.0 * (x * 0.11 + y * 0.17).sin()
    }

    #[test]
    fn a_known_translation_is_found_behind_an_object_and_removed() {
        let size = Size { width: 160, height: 120 };
        let levels = Array3::from_shape_fn((120, 160, 3), |(y, x, _)| level(x as f64, y as f64) as f32);
        let background = Background { levels, precision: Array2::ones((120, 160)), noise: 1.0 };
        let edges = Edges::find(&background).unwrap();
        let frame: Vec<u8> = (0..120 * 160 * 3)
            .map(|i| {
                let (x, y) = (i / 3 % 160, i / 480);
                let hidden = (40..80).contains(&x) && (30..90).contains(&y);
                if hidden { 255 } else { level(x as f64 - 3.3, y as f64 + 1.6).round() as u8 }
            })
            .collect();
        let found = edges.translation(&frame, &Exposure::default());
        // Bilinear sampling of a wave of 20 pixels and rounding leave a few hundredths of a pixel.
        assert!((found[0] - 3.3).abs() < 0.05 && (found[1] + 1.6).abs() < 0.05, "{found:?}");
        let back = moved_back(&frame, size, found);
        let place = (100 * 160 + 120) * 3;
        assert!((f64::from(back[place]) - level(120.0, 100.0)).abs() < 3.0);
    }

    #[test]
    fn a_plain_wall_has_no_edges() {
        let background =
            Background { levels: Array3::from_elem((60, 80, 3), 90.0), precision: Array2::ones((60, 80)), noise: 1.0 };
        assert!(Edges::find(&background).is_none());
    }
}
