//! Planes of samples and their shift by a fraction of a pixel.

/// Samples on a grid, row by row.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Plane {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

impl Plane {
    /// Plane of zeros.
    pub(crate) fn zeros(width: usize, height: usize) -> Self {
        Self { width, height, values: vec![0.0; width * height] }
    }

    /// Value at a grid point.
    pub(crate) fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Samples at `first + [x, y]` for a grid of `width` by `height`, by cubic convolution. Beyond the border the
    /// nearest sample is repeated.
    pub(crate) fn sampled(&self, first: [f64; 2], width: usize, height: usize) -> Self {
        let whole = first.map(f64::floor);
        let [across, down] = [0, 1].map(|axis| cubic((first[axis] - whole[axis]) as f32));
        let [left, top] = whole.map(|v| v as i64);
        let column = |x: i64| x.clamp(0, self.width as i64 - 1) as usize;
        let row = |y: i64| y.clamp(0, self.height as i64 - 1) as usize;
        let inside = left >= 1 && left + width as i64 + 2 <= self.width as i64;
        let mut rows = vec![0.0_f32; width * (height + 3)];
        for (k, out) in rows.chunks_exact_mut(width).enumerate() {
            let start = row(top + k as i64 - 1) * self.width;
            let line = &self.values[start..start + self.width];
            if inside {
                let line = &line[left as usize - 1..];
                for (x, value) in out.iter_mut().enumerate() {
                    *value = across[0] * line[x]
                        + across[1] * line[x + 1]
                        + across[2] * line[x + 2]
                        + across[3] * line[x + 3];
                }
            } else {
                for (x, value) in out.iter_mut().enumerate() {
                    *value = (0..4).map(|tap| across[tap] * line[column(left + (x + tap) as i64 - 1)]).sum();
                }
            }
        }
        let mut values = vec![0.0_f32; width * height];
        for (y, out) in values.chunks_exact_mut(width).enumerate() {
            let taps = &rows[y * width..(y + 4) * width];
            for (x, value) in out.iter_mut().enumerate() {
                *value = down[0] * taps[x]
                    + down[1] * taps[width + x]
                    + down[2] * taps[2 * width + x]
                    + down[3] * taps[3 * width + x];
            }
        }
        Self { width, height, values }
    }

    /// Mean of each sample and its eight neighbours.
    pub(crate) fn smoothed(&self) -> Self {
        let values = (0..self.values.len())
            .map(|place| {
                let (x, y) = (place % self.width, place / self.width);
                let (mut total, mut count) = (0.0, 0.0);
                for row in y.saturating_sub(1)..=(y + 1).min(self.height - 1) {
                    for column in x.saturating_sub(1)..=(x + 1).min(self.width - 1) {
                        total += self.at(column, row);
                        count += 1.0;
                    }
                }
                total / count
            })
            .collect();
        Self { width: self.width, height: self.height, values }
    }
}

/// Weights of the four samples around a point that lies `t` in 0..1 after the second (Catmull-Rom; Keys 1981).
pub(crate) fn cubic(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quadratic_is_sampled_exactly() {
        let f = |x: f64, y: f64| 3.0 + 0.5 * x - 0.25 * y + 0.125 * x * x + 0.0625 * x * y;
        let mut plane = Plane::zeros(12, 10);
        for y in 0..10 {
            for x in 0..12 {
                plane.values[y * 12 + x] = f(x as f64, y as f64) as f32;
            }
        }
        let sampled = plane.sampled([2.3, 1.6], 5, 4);
        for y in 0..4 {
            for x in 0..5 {
                assert!((f64::from(sampled.at(x, y)) - f(2.3 + x as f64, 1.6 + y as f64)).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn whole_shifts_copy_and_the_border_repeats() {
        let plane = Plane { width: 3, height: 2, values: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] };
        assert_eq!(plane.sampled([-2.0, 0.0], 4, 2).values, [1.0, 1.0, 1.0, 2.0, 4.0, 4.0, 4.0, 5.0]);
    }
}
