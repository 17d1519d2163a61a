//! Windows of the video around an object, one a frame.

use crate::background::StaticScene;
use crate::exposure::Exposure;
use crate::plane::Plane;

/// Layout of an object's windows, in cells of `bin` by `bin` pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Layout {
    /// Side of a cell, pixels.
    pub(crate) bin: usize,
    /// Cells of the template on each side of its centre, along x and y.
    pub(crate) half: [usize; 2],
    /// Cells around the template in which the object is searched for.
    pub(crate) slack: usize,
}

/// Most cells across a template.
const MOST_ACROSS: f64 = 72.0;

impl Layout {
    /// Layout for an object that reaches `reach` pixels from its centre, over `frames` frames within `bytes`.
    pub(crate) fn new(reach: [f64; 2], frames: usize, bytes: usize) -> Self {
        let room = reach.map(|r| 1.2 * r + 3.0);
        let slack = 0.25 * room[0].max(room[1]) + 4.0;
        let mut bin = (2.0 * room[0].max(room[1]) / MOST_ACROSS).ceil().max(1.0) as usize;
        loop {
            let half = room.map(|r| (r / bin as f64).ceil() as usize + 1);
            let layout = Self { bin, half, slack: (slack / bin as f64).ceil() as usize };
            let [width, height] = layout.sides();
            if width * height * 6 * 4 * frames <= bytes {
                return layout;
            }
            bin += 1;
        }
    }

    /// Cells of the template along x and y.
    pub(crate) fn template(&self) -> [usize; 2] {
        self.half.map(|h| 2 * h + 1)
    }

    /// Cells of a window along x and y.
    pub(crate) fn sides(&self) -> [usize; 2] {
        self.half.map(|h| 2 * (h + self.slack) + 1)
    }
}

/// Part of one frame around the expected position of an object.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    /// Pixel coordinates of the centre of cell (0, 0).
    pub(crate) origin: [f64; 2],
    /// Frame less background by channel, levels.
    pub(crate) difference: [Plane; 3],
    /// Background by channel, levels.
    pub(crate) background: [Plane; 3],
    /// 1 for cells inside the frame and outside ignored regions, otherwise 0.
    pub(crate) valid: Plane,
}

impl Window {
    /// Cuts the window around `centre`, pixels, out of a frame, `[height, width, 3]`.
    pub(crate) fn cut(
        frame: &[u8],
        background: &StaticScene,
        exposure: &Exposure,
        layout: Layout,
        centre: [f64; 2],
    ) -> Self {
        let tables = exposure.tables();
        let levels = background.levels.as_slice().expect("levels are contiguous");
        let size = background.size();
        let [width, height] = layout.sides();
        let bin = layout.bin as i64;
        let middle = (bin - 1) as f64 / 2.0;
        let corner = [0, 1].map(|axis| {
            let cells = (layout.half[axis] + layout.slack) as f64;
            (centre[axis] - middle - cells * bin as f64).round() as i64
        });
        let mut window = Self {
            origin: corner.map(|c| c as f64 + middle),
            difference: [0, 1, 2].map(|_| Plane::zeros(width, height)),
            background: [0, 1, 2].map(|_| Plane::zeros(width, height)),
            valid: Plane::zeros(width, height),
        };
        let share = 1.0 / (bin * bin) as f32;
        for cell in 0..width * height {
            let left = corner[0] + (cell % width) as i64 * bin;
            let top = corner[1] + (cell / width) as i64 * bin;
            let inside = left >= 0 && top >= 0 && left + bin <= size.width as i64 && top + bin <= size.height as i64;
            if !inside {
                continue;
            }
            let mut precise = true;
            for y in top as usize..(top + bin) as usize {
                for x in left as usize..(left + bin) as usize {
                    precise &= background.precision[[y, x]] > 0.0;
                    let place = (y * size.width + x) * 3;
                    for channel in 0..3 {
                        let below = levels[place + channel];
                        let level = tables[channel][frame[place + channel] as usize];
                        window.difference[channel].values[cell] += share * (level - below);
                        window.background[channel].values[cell] += share * below;
                    }
                }
            }
            window.valid.values[cell] = if precise { 1.0 } else { 0.0 };
        }
        window
    }

    /// Cell coordinates of a position in pixels.
    pub(crate) fn cells(&self, position: [f64; 2], bin: usize) -> [f64; 2] {
        [0, 1].map(|axis| (position[axis] - self.origin[axis]) / bin as f64)
    }

    /// Pixels of a position in cell coordinates.
    pub(crate) fn pixels(&self, cells: [f64; 2], bin: usize) -> [f64; 2] {
        [0, 1].map(|axis| self.origin[axis] + cells[axis] * bin as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, Array3};

    fn ramp() -> (StaticScene, Vec<u8>) {
        let levels = Array3::from_shape_fn((30, 40, 3), |(y, x, _)| (x + 2 * y) as f32);
        let frame = levels.iter().map(|&v| v as u8 + 10).collect();
        (StaticScene { levels, precision: Array2::ones((30, 40)), noise: 1.0 }, frame)
    }

    #[test]
    fn cells_are_means_and_their_centres_are_in_pixels() {
        let (background, frame) = ramp();
        let layout = Layout { bin: 2, half: [2, 2], slack: 1 };
        let window = Window::cut(&frame, &background, &Exposure::default(), layout, [20.0, 15.0]);
        for (cell, &value) in window.background[1].values.iter().enumerate() {
            let [x, y] = window.pixels([(cell % 7) as f64, (cell / 7) as f64], 2);
            assert!((f64::from(value) - (x + 2.0 * y)).abs() < 1e-4);
        }
        assert!(window.difference[2].values.iter().all(|v| (v - 10.0).abs() < 1e-4));
        let centre = window.cells([20.0, 15.0], 2);
        assert!(centre.iter().all(|c| (c - 3.0).abs() <= 0.5), "{centre:?}");
    }

    #[test]
    fn cells_outside_the_frame_are_invalid() {
        let (background, frame) = ramp();
        let layout = Layout { bin: 1, half: [3, 3], slack: 2 };
        let window = Window::cut(&frame, &background, &Exposure::default(), layout, [1.0, 15.0]);
        assert_eq!(window.valid.values.iter().filter(|&&v| v == 0.0).count(), 4 * 11);
    }

    #[test]
    fn large_objects_are_binned() {
        assert_eq!(Layout::new([10.0, 10.0], 100, usize::MAX).bin, 1);
        let large = Layout::new([100.0, 40.0], 100, usize::MAX);
        assert!(large.bin == 4 && large.template()[0] <= 75, "{large:?}");
        assert!(Layout::new([20.0, 20.0], 1000, 40 << 20).bin > 1);
    }
}
