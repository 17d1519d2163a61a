//! How much alike the errors of neighbouring frames were: `e[t] = r e[t-1] + n[t]` with independent n, one r for all
//! coordinates and videos.
//!
//! A fit follows the errors, and what it leaves looks more independent than they were. So r is where the residuals' restricted
//! likelihood is largest, which counts what the unknowns have taken (Patterson and Thompson 1971).

use nalgebra::{DMatrix, DVector};

use super::normal_equations::NormalEquations;

/// Correlations that are tried.
const MOST: f64 = 0.98;
const TRIED: usize = 50;
/// Spread of the correlation beforehand, of its inverse hyperbolic tangent (Fisher's transformation).
const USUAL: f64 = 0.9;

/// The errors of the frames that were learned from.
#[derive(Debug, Clone)]
pub struct Errors {
    /// Correlation of neighbouring frames, 0 to 1.
    correlation: f64,
    /// Of one coordinate of one frame.
    variance: f64,
    /// Frames of each video, and coordinates of a frame: rows stand coordinate by coordinate within a frame.
    videos: Vec<usize>,
    coordinates: usize,
}

impl Errors {
    /// The errors that are likeliest behind `residuals`, `[coordinates, frames]` of each video, after a fit with these
    /// derivatives.
    pub fn likely(jacobian: &DMatrix<f64>, residuals: &[DMatrix<f64>]) -> Self {
        let videos = residuals.iter().map(DMatrix::ncols).collect();
        let coordinates = residuals.first().map_or(1, DMatrix::nrows);
        let all = residuals.iter().flat_map(|of| of.iter().copied());
        let residuals = DMatrix::from_iterator(jacobian.nrows(), 1, all);
        let mut errors = Errors { correlation: 0.0, variance: 0.0, videos, coordinates };
        let mut best = f64::NEG_INFINITY;
        // Few residuals say little of their correlation: a small one is likelier beforehand.
        let beforehand = |correlation: f64| -0.5 * (correlation.atanh() / USUAL).powi(2);
        for step in 0..=TRIED {
            let tried = Errors { correlation: MOST * step as f64 / TRIED as f64, ..errors.clone() };
            if let Some((likelihood, variance)) = tried.likelihood(jacobian, &residuals)
                && likelihood + beforehand(tried.correlation) > best
            {
                best = likelihood + beforehand(tried.correlation);
                errors = Errors { variance, ..tried };
            }
        }
        errors
    }

    /// Frames that together hold as much as one independent one.
    pub fn frames_in_one(&self) -> f64 {
        (1.0 + self.correlation) / (1.0 - self.correlation)
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
        // Of the independent parts; the first frame of a video is scaled to their variance.
        let variance = squares / free;
        let firsts = (self.videos.len() * self.coordinates) as f64;
        let of_noise = -firsts * (1.0 - self.correlation.powi(2)).ln();
        let likelihood = -0.5 * (free * variance.ln() + of_noise + equations.log_determinant());
        Some((likelihood, variance / (1.0 - self.correlation.powi(2))))
    }

    /// First row and number of rows of each video.
    fn blocks(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let rows = self.videos.iter().map(|frames| frames * self.coordinates);
        rows.scan(0, |end, rows| {
            *end += rows;
            Some((*end - rows, rows))
        })
    }

    /// Rows made independent: each minus its share of the row of the frame before.
    fn whitened(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let mut white = rows.clone();
        for (begin, length) in self.blocks() {
            let later = length - self.coordinates;
            let mut after = white.rows_mut(begin + self.coordinates, later);
            after -= rows.rows(begin, later) * self.correlation;
            let mut first = white.rows_mut(begin, self.coordinates);
            first *= (1.0 - self.correlation.powi(2)).sqrt();
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
        let mut sums = rows.clone();
        for (begin, length) in self.blocks() {
            let frames = length / self.coordinates;
            for place in 1..frames {
                let (frame, other) = if backwards { (frames - 1 - place, frames - place) } else { (place, place - 1) };
                let [frame, other] = [frame, other].map(|frame| begin + frame * self.coordinates);
                let add = sums.rows(other, self.coordinates) * self.correlation;
                let mut row = sums.rows_mut(frame, self.coordinates);
                row += add;
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
            found += likely.correlation / 400.0;
        }
        // Means over sets; some sets look far more alike than they are, and the mean variance lies above what it should be.
        assert!((found - correlation).abs() < 0.08, "{found}");
        assert!((0.8..1.5).contains(&(expected / slopes)), "{expected} {slopes}");
    }
}
