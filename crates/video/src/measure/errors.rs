//! Correlation of the errors of neighbouring frames: `e[t] = r e[t-1] + n[t]` with independent n; r belongs to a coordinate and is
//! the same for all videos. What an equation lacks often shows in one coordinate alone, whose errors then hang together while
//! those of the others stay independent.
//!
//! A fit follows the errors, and its residuals are less correlated than they were. So r is where the residuals' restricted
//! likelihood is largest, which counts what the unknowns have taken (Patterson and Thompson 1971).

use nalgebra::{DMatrix, DVector};

use super::normal_equations::NormalEquations;

/// Correlations that are tried.
const MOST: f64 = 0.98;
const TRIED: usize = 50;
/// Rounds in which one coordinate's correlation after the other is improved.
const ROUNDS: usize = 2;
/// Prior standard deviation of the correlation's inverse hyperbolic tangent (Fisher's transformation).
const USUAL: f64 = 0.9;

/// The errors of the frames that were learned from.
#[derive(Debug, Clone)]
pub struct Errors {
    /// Correlation of neighbouring frames, 0 to 1, of each coordinate.
    correlations: Vec<f64>,
    /// Of one coordinate of one frame.
    variance: f64,
    /// Frames of each video; rows stand coordinate by coordinate within a frame.
    videos: Vec<usize>,
}

impl Errors {
    /// The errors that are likeliest behind `residuals`, `[coordinates, frames]` of each video, after a fit with these
    /// derivatives: one correlation for all coordinates first, then one for each.
    pub fn likely(jacobian: &DMatrix<f64>, residuals: &[DMatrix<f64>]) -> Self {
        let videos = residuals.iter().map(DMatrix::ncols).collect();
        let coordinates = residuals.first().map_or(1, DMatrix::nrows);
        let all = residuals.iter().flat_map(|of| of.iter().copied());
        let residuals = DMatrix::from_iterator(jacobian.nrows(), 1, all);
        let mut best = (f64::NEG_INFINITY, Errors { correlations: vec![0.0; coordinates], variance: 0.0, videos });
        let common: Vec<Vec<usize>> = vec![(0..coordinates).collect()];
        let each = || (0..coordinates).map(|coordinate| vec![coordinate]);
        let rounds = (0..if coordinates > 1 { ROUNDS } else { 0 }).flat_map(|_| each());
        for changed in common.into_iter().chain(rounds) {
            for step in 0..=TRIED {
                let mut tried = best.1.clone();
                changed.iter().for_each(|place| tried.correlations[*place] = MOST * step as f64 / TRIED as f64);
                let Some((likelihood, variance)) = tried.likelihood(jacobian, &residuals) else { continue };
                let likelihood = likelihood + tried.log_prior();
                if likelihood > best.0 {
                    best = (likelihood, Errors { variance, ..tried });
                }
            }
        }
        best.1
    }

    /// Few residuals say little of their correlation: a small one is likelier beforehand.
    fn log_prior(&self) -> f64 {
        self.correlations.iter().map(|correlation| -0.5 * (correlation.atanh() / USUAL).powi(2)).sum()
    }

    /// Of each coordinate, the frames that together hold as much as one independent one.
    pub fn frames_in_one(&self) -> impl Iterator<Item = f64> + '_ {
        self.correlations.iter().map(|correlation| (1.0 + correlation) / (1.0 - correlation))
    }

    /// The logarithm of the restricted likelihood but for what is the same for all, and the errors' variance.
    fn likelihood(&self, jacobian: &DMatrix<f64>, residuals: &DMatrix<f64>) -> Option<(f64, f64)> {
        let (white, left) = (self.whitened(jacobian), self.whitened(residuals));
        let equations = NormalEquations::new(&(white.transpose() * &white))?;
        let explained = white.transpose() * &left;
        let squares = left.norm_squared() - explained.dot(&equations.solve(&explained.column(0).into_owned()));
        let free = left.nrows() as f64 - white.ncols() as f64;
        if free < 1.0 || squares <= 0.0 {
            return None;
        }
        let variance = squares / free;
        // Frames whose independent part was scaled: all but the first of each video.
        let later = self.videos.iter().map(|frames| frames.saturating_sub(1)).sum::<usize>() as f64;
        let scaled: f64 = self.correlations.iter().map(|correlation| (1.0 - correlation.powi(2)).ln()).sum();
        Some((-0.5 * (free * variance.ln() + later * scaled + equations.log_determinant()), variance))
    }

    fn coordinates(&self) -> usize {
        self.correlations.len()
    }

    /// First row and number of rows of each video.
    fn blocks(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let rows = self.videos.iter().map(|frames| frames * self.coordinates());
        rows.scan(0, |end, rows| {
            *end += rows;
            Some((*end - rows, rows))
        })
    }

    /// Rows made independent and of one variance: each minus its share of the row of the frame before.
    fn whitened(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let mut white = rows.clone();
        for (begin, length) in self.blocks() {
            for place in (begin + self.coordinates()..begin + length).rev() {
                let correlation = self.correlations[(place - begin) % self.coordinates()];
                let own = (rows.row(place) - rows.row(place - self.coordinates()) * correlation)
                    / (1.0 - correlation.powi(2)).sqrt();
                white.set_row(place, &own);
            }
        }
        white
    }

    /// Variances of the unknowns of a least-squares fit with these derivatives, whose normal matrix has this inverse.
    pub fn variances(&self, jacobian: &DMatrix<f64>, inverse: &DMatrix<f64>) -> DVector<f64> {
        // Inverse J' V J inverse: V J is the sum of what comes from before and from after.
        let spread = self.summed(jacobian, false) + self.summed(jacobian, true) - jacobian;
        let middle = jacobian.transpose() * spread * self.variance;
        (inverse * middle * inverse).diagonal()
    }

    /// Each row plus its correlation times the sum at the frame before, or after it.
    fn summed(&self, rows: &DMatrix<f64>, backwards: bool) -> DMatrix<f64> {
        let coordinates = self.coordinates();
        let mut sums = rows.clone();
        for (begin, length) in self.blocks() {
            let frames = length / coordinates;
            for place in 1..frames {
                let (frame, other) = if backwards { (frames - 1 - place, frames - place) } else { (place, place - 1) };
                for (coordinate, correlation) in self.correlations.iter().enumerate() {
                    let [frame, other] = [frame, other].map(|frame| begin + frame * coordinates + coordinate);
                    let sum = sums.row(frame) + sums.row(other) * *correlation;
                    sums.set_row(frame, &sum);
                }
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use paig::support::random::{named_generator, normal};

    /// A line through errors of which neighbours are alike: their correlation is found, and the slope's variance is that
    /// of many repetitions.
    #[test]
    fn errors_behind_the_residuals_of_a_line() {
        let (frames, correlation) = (60, 0.6_f64);
        let line = DMatrix::from_fn(frames, 2, |t, power| (t as f64 / frames as f64).powi(power as i32));
        let inverse = (line.transpose() * &line).try_inverse().unwrap();
        let mut random = named_generator(4, "errors of a line");
        let (mut slopes, mut expected, mut found) = (0.0, 0.0, 0.0);
        for _ in 0..400 {
            let mut error = normal(&mut random);
            let errors = DVector::from_fn(frames, |_, _| {
                let now = error;
                error = correlation * error + (1.0 - correlation * correlation).sqrt() * normal(&mut random);
                now
            });
            let fit = &inverse * line.transpose() * &errors;
            let residuals = DMatrix::from_row_slice(1, frames, (&errors - &line * &fit).as_slice());
            let likely = Errors::likely(&line, &[residuals]);
            slopes += fit[1].powi(2) / 400.0;
            expected += likely.variances(&line, &inverse)[1] / 400.0;
            found += likely.correlations[0] / 400.0;
        }
        // Means over sets; some sets look far more alike than they are, and the mean variance lies above what it should be.
        assert!((found - correlation).abs() < 0.08, "{found}");
        assert!((0.8..1.5).contains(&(expected / slopes)), "{expected} {slopes}");
    }

    /// Errors of one coordinate hang together, those of the other do not: each has its own correlation, and so a slope that
    /// only the second coordinate shows is known as well as among independent errors.
    #[test]
    fn each_coordinate_has_a_correlation_of_its_own() {
        let frames = 80;
        let mut random = named_generator(5, "errors of two coordinates");
        // Unknowns: level and slope of each coordinate; rows x, y of a frame.
        let lines = DMatrix::from_fn(2 * frames, 4, |row, unknown| {
            let (t, coordinate) = ((row / 2) as f64 / frames as f64, row % 2);
            if unknown / 2 == coordinate { t.powi((unknown % 2) as i32) } else { 0.0 }
        });
        let inverse = (lines.transpose() * &lines).try_inverse().unwrap();
        let (mut found, mut ratio) = ([0.0; 2], 0.0);
        for _ in 0..40 {
            let mut error = normal(&mut random);
            let errors = DVector::from_fn(2 * frames, |row, _| {
                if row % 2 == 1 {
                    return normal(&mut random);
                }
                error = 0.9 * error + (1.0_f64 - 0.81).sqrt() * normal(&mut random);
                error
            });
            let left = &errors - &lines * (&inverse * lines.transpose() * &errors);
            let likely = Errors::likely(&lines, &[DMatrix::from_column_slice(2, frames, left.as_slice())]);
            (0..2).for_each(|coordinate| found[coordinate] += likely.correlations[coordinate] / 40.0);
            // The variance of the second slope among independent errors of variance 1.
            ratio += likely.variances(&lines, &inverse)[3] / inverse[(3, 3)] / 40.0;
        }
        // Means of 40 sets; those of short series lie below what they estimate.
        assert!((0.7..0.95).contains(&found[0]) && found[1] < 0.2, "{found:?}");
        assert!((0.7..1.6).contains(&ratio), "{ratio}");
    }
}
