//! Appearance of an object: template and soft mask, averaged over aligned frames.
//!
//! Pixel model: frame = cover * object + (1 - cover) * background, so that
//! frame - background = paint - cover * background with paint = cover * object.
//! On a plain background only the difference is identifiable; a prior then chooses the cover.

use rayon::prelude::*;

use crate::plane::Plane;
use crate::statistics::quantile;
use crate::window::{Layout, Window};

/// Prior standard deviation of the cover.
const COVER_DEVIATION: f64 = 0.3;
/// Tuning constant of the biweight.
const BIWEIGHT: f64 = 4.685;
/// Least deviation of a template cell from frame to frame, levels: rounding.
const LEAST_DEVIATION: f64 = 0.5;

/// Appearance of an object on the cells of its template.
#[derive(Debug, Clone)]
pub(crate) struct Template {
    /// Soft mask, 0..=1.
    pub(crate) cover: Plane,
    /// Object times mask by channel, levels.
    pub(crate) paint: [Plane; 3],
    /// Mean difference from the background by channel, levels.
    pub(crate) contrast: [Plane; 3],
    /// Reciprocal variance over the frames, 1/levels^2: low where the object is not rigid.
    pub(crate) precision: Plane,
}

/// Difference and background of one frame in the object's coordinates.
struct Aligned {
    difference: [Plane; 3],
    background: [Plane; 3],
    valid: Plane,
}

impl Template {
    /// Averages windows aligned at `positions` (cell coordinates of the template's centre).
    pub(crate) fn learn(windows: &[(&Window, [f64; 2])], layout: Layout, noise: f64) -> Self {
        let [width, height] = layout.template();
        let aligned: Vec<Aligned> = windows
            .par_iter()
            .map(|(window, position)| {
                let first = [0, 1].map(|axis| position[axis] - layout.half[axis] as f64);
                let shift = |plane: &Plane| plane.sampled(first, width, height);
                Aligned {
                    difference: [0, 1, 2].map(|c| shift(&window.difference[c])),
                    background: [0, 1, 2].map(|c| shift(&window.background[c])),
                    valid: shift(&window.valid),
                }
            })
            .collect();
        let floor = (0.5 * noise / layout.bin as f64).max(LEAST_DEVIATION / layout.bin as f64);
        let medians: Vec<[f64; 3]> = (0..width * height).into_par_iter().map(|cell| medians(&aligned, cell)).collect();
        let size = |contrast: &[f64; 3]| contrast.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
        let mut sizes: Vec<f64> = medians.iter().map(size).collect();
        let strong = quantile(&mut sizes, 0.9).unwrap_or(0.0).max(4.0 * floor);
        let cells: Vec<TemplateCell> = medians
            .into_par_iter()
            .enumerate()
            .map(|(cell, start)| {
                TemplateCell::fit(&aligned, cell, start, (size(&start) / (0.5 * strong)).min(1.0), floor)
            })
            .collect();
        let plane = |value: &dyn Fn(&TemplateCell) -> f64| Plane {
            width,
            height,
            values: cells.iter().map(|cell| value(cell) as f32).collect(),
        };
        let variance = plane(&|cell| cell.variance).smoothed();
        Self {
            cover: plane(&|cell| cell.cover),
            paint: [0, 1, 2].map(|c| plane(&|cell| cell.paint[c])),
            contrast: [0, 1, 2].map(|c| plane(&|cell| cell.contrast[c])),
            precision: Plane { width, height, values: variance.values.iter().map(|v| 1.0 / v).collect() },
        }
    }

    /// Weight of a cell in the centroid: mean contrast against the deviation, where the contrast is significant.
    fn significance(&self, cell: usize) -> f64 {
        let size = self.contrast.iter().fold(0.0_f32, |m, plane| m.max(plane.values[cell].abs()));
        let z = f64::from(size * self.precision.values[cell].sqrt());
        if z > 3.0 { f64::from(size) } else { 0.0 }
    }

    /// Centroid of the contrast, cells from the template's centre.
    pub(crate) fn centroid(&self) -> [f64; 2] {
        let (mut total, mut moment) = (0.0, [0.0; 2]);
        let middle = [self.cover.width / 2, self.cover.height / 2];
        for cell in 0..self.cover.values.len() {
            let weight = self.significance(cell);
            total += weight;
            moment[0] += weight * ((cell % self.cover.width) as f64 - middle[0] as f64);
            moment[1] += weight * ((cell / self.cover.width) as f64 - middle[1] as f64);
        }
        if total > 0.0 { moment.map(|m| m / total) } else { [0.0; 2] }
    }
}

/// Model of one cell.
struct TemplateCell {
    cover: f64,
    paint: [f64; 3],
    contrast: [f64; 3],
    variance: f64,
}

fn medians(aligned: &[Aligned], cell: usize) -> [f64; 3] {
    [0, 1, 2].map(|channel| {
        let mut values: Vec<f64> = aligned
            .iter()
            .filter(|frame| frame.valid.values[cell] > 0.99)
            .map(|frame| f64::from(frame.difference[channel].values[cell]))
            .collect();
        crate::statistics::median(&mut values).unwrap_or(0.0)
    })
}

/// One frame at one cell, by channel.
struct CellSample {
    difference: [f64; 3],
    background: [f64; 3],
}

impl TemplateCell {
    /// Fits difference = contrast - cover * (background - mean background) by reweighted least squares.
    fn fit(aligned: &[Aligned], cell: usize, start: [f64; 3], prior: f64, floor: f64) -> Self {
        let samples: Vec<CellSample> = aligned
            .iter()
            .filter(|frame| frame.valid.values[cell] > 0.99)
            .map(|frame| {
                let pick = |planes: &[Plane; 3]| [0, 1, 2].map(|c| f64::from(planes[c].values[cell]));
                CellSample { difference: pick(&frame.difference), background: pick(&frame.background) }
            })
            .collect();
        if samples.len() < 3 {
            return Self { cover: 0.0, paint: [0.0; 3], contrast: [0.0; 3], variance: 1e6 };
        }
        let mean = average(&samples, &vec![1.0; samples.len()], |s| s.background);
        let mut fitted = Self { cover: prior, paint: mean, contrast: start, variance: floor * floor };
        let mut weights = Vec::new();
        for _ in 0..4 {
            let sizes: Vec<f64> = samples.iter().map(|sample| fitted.residual(sample)).collect();
            let scale = quantile(&mut sizes.clone(), 0.5).unwrap_or(0.0).max(floor);
            weights = sizes.iter().map(|size| biweight(size / scale)).collect();
            fitted = Self::weighted(&samples, &weights, &sizes, prior, floor);
        }
        // Rejected frames count as large deviations: a cell that half of the frames contradict is not rigid.
        let rejected = 1.0 - weights.iter().sum::<f64>() / weights.len() as f64;
        let paint = [0, 1, 2].map(|c| fitted.contrast[c] + fitted.cover * fitted.paint[c]);
        Self { paint, variance: fitted.variance * (1.0 + 4.0 * rejected * rejected), ..fitted }
    }

    /// Weighted fit; `paint` holds the mean background.
    fn weighted(samples: &[CellSample], weights: &[f64], sizes: &[f64], prior: f64, floor: f64) -> Self {
        let total: f64 = weights.iter().sum::<f64>().max(1e-9);
        let squares: f64 = weights.iter().zip(sizes).map(|(w, s)| w * s * s).sum();
        let variance = (squares / total).max(floor * floor);
        let mean = average(samples, weights, |s| s.background);
        let contrast = average(samples, weights, |s| s.difference);
        let ridge = variance / COVER_DEVIATION.powi(2);
        let (mut square, mut product) = (ridge, ridge * prior);
        for (weight, sample) in weights.iter().zip(samples) {
            for c in 0..3 {
                let x = mean[c] - sample.background[c];
                square += weight * x * x;
                product += weight * x * (sample.difference[c] - contrast[c]);
            }
        }
        Self { cover: (product / square).clamp(0.0, 1.0), paint: mean, contrast, variance }
    }

    /// Root mean square residual of a sample over the channels; `paint` holds the mean background.
    fn residual(&self, sample: &CellSample) -> f64 {
        let residual = |c: usize| {
            let predicted = self.contrast[c] - self.cover * (sample.background[c] - self.paint[c]);
            sample.difference[c] - predicted
        };
        ((0..3).map(|c| residual(c).powi(2)).sum::<f64>() / 3.0).sqrt()
    }
}

fn average(samples: &[CellSample], weights: &[f64], of: impl Fn(&CellSample) -> [f64; 3]) -> [f64; 3] {
    let total: f64 = weights.iter().sum::<f64>().max(1e-9);
    [0, 1, 2].map(|c| samples.iter().zip(weights).map(|(sample, w)| w * of(sample)[c]).sum::<f64>() / total)
}

/// Biweight of a residual in standard deviations.
fn biweight(z: f64) -> f64 {
    let z = z / BIWEIGHT;
    if z < 1.0 { (1.0 - z * z).powi(2) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of one cell that follow the model on a background that changes from frame to frame, one of them hidden.
    #[test]
    fn mask_and_object_of_a_cell_are_recovered_behind_an_occlusion() {
        let (cover, object) = (0.6, [200.0, 90.0, 40.0]);
        let plane = |value: f64| Plane { width: 1, height: 1, values: vec![value as f32] };
        let aligned: Vec<Aligned> = (0..20)
            .map(|frame| {
                let background = [0, 1, 2].map(|c| 80.0 + 10.0 * f64::from(frame % 5) + 3.0 * f64::from(c));
                let seen = |c: usize| if frame == 7 { 90.0 } else { cover * (object[c] - background[c]) };
                Aligned {
                    difference: [0, 1, 2].map(|c| plane(seen(c))),
                    background: background.map(plane),
                    valid: plane(1.0),
                }
            })
            .collect();
        let cell = TemplateCell::fit(&aligned, 0, medians(&aligned, 0), 1.0, 0.5);
        // The prior of 0.3 around 1 weighs 0.5^2 / 0.3^2 = 2.8 against a sum of squares of 12000.
        assert!((cell.cover - cover).abs() < 1e-3, "{}", cell.cover);
        for (paint, level) in cell.paint.iter().zip(object) {
            assert!((paint - cover * level).abs() < 0.2, "{:?}", cell.paint);
        }
    }
}
