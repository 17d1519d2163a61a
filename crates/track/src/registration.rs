//! Registration of a window to the template by robust Gauss-Newton on its pixels.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use crate::plane::Plane;
use crate::statistics::{NORMAL_MAD, median};
use crate::template::Template;
use crate::window::{Layout, Window};

/// Most Gauss-Newton steps.
const STEPS: usize = 12;
/// Step, cells, at which the iteration ends.
const TOLERANCE: f64 = 0.002;
/// Longest step, cells.
const LONGEST: f64 = 2.0;
/// Residual, in standard deviations, at which a pixel has half its weight.
const HALF_WEIGHT: f64 = 2.5;
/// Prior standard deviation of the object's contrast relative to the template.
const CONTRAST_DEVIATION: f64 = 0.2;
/// Side of the blocks, cells, over which residuals are taken as correlated.
const BLOCK: usize = 6;

/// Position of the template in a window and how well it fits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Registration {
    /// Cell coordinates of the template's centre.
    pub(crate) position: [f64; 2],
    /// Covariance for uncorrelated residuals, cells^2.
    pub(crate) covariance: Matrix2<f64>,
    /// Covariance from sums over blocks of residuals, over the former: trace ratio.
    pub(crate) correlation: f64,
    /// Contrast relative to the template.
    pub(crate) contrast: f64,
    /// Residual energy over the template's energy, weighted by its precision.
    pub(crate) misfit: f64,
    /// Share of the template's energy that lies inside the frame.
    pub(crate) inside: f64,
}

/// Prediction of a window at one position of the template.
struct Render {
    /// Column and row of the window at the planes' first cell.
    first: [i64; 2],
    cover: Plane,
    paint: [Plane; 3],
    precision: Plane,
}

impl Render {
    fn new(template: &Template, layout: Layout, position: [f64; 2]) -> Self {
        let corner = [0, 1].map(|axis| position[axis] - layout.half[axis] as f64);
        let whole = corner.map(f64::ceil);
        // Window cell `whole + k` shows template cell `k + whole - corner`.
        let offset = [whole[0] - corner[0], whole[1] - corner[1]];
        let [width, height] = layout.template().map(|side| side - 1);
        let shift = |plane: &Plane| plane.sampled(offset, width, height);
        Self {
            first: whole.map(|v| v as i64),
            cover: shift(&template.cover),
            paint: [0, 1, 2].map(|c| shift(&template.paint[c])),
            precision: shift(&template.precision),
        }
    }

    /// Visits the inner cells: index in the planes, index in the window, precision.
    fn visit(&self, window: &Window, mut each: impl FnMut(usize, usize, f64)) {
        let (width, height) = (self.cover.width, self.cover.height);
        let sides = [window.valid.width as i64, window.valid.height as i64];
        for y in 1..height - 1 {
            let row = self.first[1] + y as i64;
            if !(0..sides[1]).contains(&row) {
                continue;
            }
            for x in 1..width - 1 {
                let column = self.first[0] + x as i64;
                if !(0..sides[0]).contains(&column) {
                    continue;
                }
                let place = (row * sides[0] + column) as usize;
                if window.valid.values[place] > 0.0 {
                    let cell = y * width + x;
                    each(cell, place, f64::from(self.precision.values[cell].max(0.0)));
                }
            }
        }
    }

    fn predicted(&self, channel: usize, cell: usize, background: f32) -> f32 {
        self.paint[channel].values[cell] - self.cover.values[cell] * background
    }

    /// Change of the prediction with the position along x and y.
    fn gradient(&self, channel: usize, cell: usize, background: f32) -> [f64; 2] {
        let width = self.cover.width;
        let slope = |before: usize, after: usize| {
            let change = |plane: &Plane| plane.values[after] - plane.values[before];
            // Moving the template forwards brings the value before to this cell.
            f64::from(-0.5 * (change(&self.paint[channel]) - background * change(&self.cover)))
        };
        [slope(cell - 1, cell + 1), slope(cell - width, cell + width)]
    }
}

/// Best of the positions on a coarse grid around `start` within the slack, by squared residuals over sparse cells.
pub(crate) fn search(window: &Window, template: &Template, layout: Layout, start: [f64; 2]) -> [f64; 2] {
    let pitch = (layout.half[0].min(layout.half[1]) as f64 / 4.0).max(1.0);
    let count = (layout.slack as f64 / pitch).floor() as i64;
    let stride = (layout.half[0].min(layout.half[1]) / 8).max(1);
    let mut best = (f64::INFINITY, start);
    for down in -count..=count {
        for across in -count..=count {
            let position = [start[0] + across as f64 * pitch, start[1] + down as f64 * pitch];
            let cost = coarse_cost(window, template, layout, position, stride);
            if cost < best.0 {
                best = (cost, position);
            }
        }
    }
    best.1
}

/// Mean squared residual at whole cells, each at most that of the background alone plus the template's.
fn coarse_cost(window: &Window, template: &Template, layout: Layout, position: [f64; 2], stride: usize) -> f64 {
    let corner = [0, 1].map(|axis| (position[axis] - layout.half[axis] as f64).round() as i64);
    let [width, height] = layout.template();
    let (wide, high) = (window.valid.width as i64, window.valid.height as i64);
    let (mut total, mut count) = (0.0, 0.0);
    for y in (0..height).step_by(stride) {
        for x in (0..width).step_by(stride) {
            let (column, row) = (corner[0] + x as i64, corner[1] + y as i64);
            if !(0..wide).contains(&column) || !(0..high).contains(&row) {
                continue;
            }
            let (place, cell) = ((row * wide + column) as usize, y * width + x);
            if window.valid.values[place] == 0.0 {
                continue;
            }
            let precision = f64::from(template.precision.values[cell]);
            for c in 0..3 {
                let predicted =
                    template.paint[c].values[cell] - template.cover.values[cell] * window.background[c].values[place];
                let square = f64::from((window.difference[c].values[place] - predicted).powi(2)) * precision;
                // Bounded, so that a hand or a shadow inside the template does not decide.
                total += square / (1.0 + square / 100.0);
                count += 1.0;
            }
        }
    }
    if count > 0.0 { total / count } else { f64::INFINITY }
}

/// Registers a window from `start`. `None` where the template lies outside the frame or the normal matrix is singular.
pub(crate) fn register(window: &Window, template: &Template, layout: Layout, start: [f64; 2]) -> Option<Registration> {
    let mut position = start;
    let mut contrast = 1.0;
    for _ in 0..STEPS {
        let render = Render::new(template, layout, position);
        let scale = scale(&render, window, contrast)?;
        let (normal, right) = normal_equations(&render, window, contrast, scale);
        let step = normal.lu().solve(&right)?;
        let length = step[0].hypot(step[1]);
        let shrink = (LONGEST / length).min(1.0);
        position = [position[0] + shrink * step[0], position[1] + shrink * step[1]];
        contrast = (contrast + shrink * step[2]).clamp(0.1, 3.0);
        let away = [0, 1].map(|axis| (position[axis] - start[axis]).abs());
        if !length.is_finite() || away.iter().any(|&a| a > 2.0 * layout.slack as f64) {
            return None;
        }
        if length < TOLERANCE {
            break;
        }
    }
    assess(template, window, layout, position, contrast)
}

/// Robust standard deviation of the residuals in units of the template's deviation; at least 1.
fn scale(render: &Render, window: &Window, contrast: f64) -> Option<f64> {
    let mut sizes = Vec::with_capacity(render.cover.values.len());
    render.visit(window, |cell, place, precision| {
        let size: f64 = (0..3).map(|c| residual(render, window, contrast, c, cell, place).powi(2)).sum::<f64>();
        sizes.push((size / 3.0 * precision).sqrt());
    });
    if sizes.len() < 12 {
        return None;
    }
    median(&mut sizes).map(|m| (m * NORMAL_MAD).max(1.0))
}

fn residual(render: &Render, window: &Window, contrast: f64, channel: usize, cell: usize, place: usize) -> f64 {
    let predicted = render.predicted(channel, cell, window.background[channel].values[place]);
    f64::from(window.difference[channel].values[place]) - contrast * f64::from(predicted)
}

/// Weight of a pixel whose residual is `z` standard deviations.
fn weight(z: f64) -> f64 {
    1.0 / (1.0 + (z / HALF_WEIGHT).powi(2))
}

fn normal_equations(render: &Render, window: &Window, contrast: f64, scale: f64) -> (Matrix3<f64>, Vector3<f64>) {
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    normal[(2, 2)] = CONTRAST_DEVIATION.powi(-2);
    right[2] = (1.0 - contrast) * CONTRAST_DEVIATION.powi(-2);
    render.visit(window, |cell, place, precision| {
        let precision = precision / (scale * scale);
        for c in 0..3 {
            let background = window.background[c].values[place];
            let r = residual(render, window, contrast, c, cell, place);
            let [dx, dy] = render.gradient(c, cell, background);
            let row = Vector3::new(contrast * dx, contrast * dy, f64::from(render.predicted(c, cell, background)));
            let w = precision * weight(r * precision.sqrt());
            normal += w * row * row.transpose();
            right += w * r * row;
        }
    });
    (normal, right)
}

/// Covariance and quality at the final position.
fn assess(
    template: &Template,
    window: &Window,
    layout: Layout,
    position: [f64; 2],
    contrast: f64,
) -> Option<Registration> {
    let render = Render::new(template, layout, position);
    let across = render.cover.width.div_ceil(BLOCK);
    let mut blocks = vec![Vector2::<f64>::zeros(); across * render.cover.height.div_ceil(BLOCK)];
    let mut normal = Matrix2::zeros();
    let (mut energy, mut left, mut weights, mut squares) = (0.0, 0.0, 0.0, 0.0);
    let spread = scale(&render, window, contrast)?;
    render.visit(window, |cell, place, precision| {
        let block = cell / render.cover.width / BLOCK * across + cell % render.cover.width / BLOCK;
        for c in 0..3 {
            let background = window.background[c].values[place];
            let r = residual(&render, window, contrast, c, cell, place);
            let [dx, dy] = render.gradient(c, cell, background);
            let row = contrast * Vector2::new(dx, dy);
            let robust = weight(r * precision.sqrt() / spread);
            let w = precision * robust;
            normal += w * row * row.transpose();
            blocks[block] += w * r * row;
            let predicted = f64::from(render.predicted(c, cell, background));
            energy += precision * predicted * predicted;
            left += precision * r * r;
            weights += robust;
            squares += w * r * r;
        }
    });
    let whole: f64 = (0..template.precision.values.len())
        .map(|cell| {
            let size: f32 = template.contrast.iter().map(|plane| plane.values[cell].powi(2)).sum();
            f64::from(size * template.precision.values[cell])
        })
        .sum();
    let inverse = normal.try_inverse()?;
    // The residual variance is in units of the template's.
    let covariance = inverse * (squares / weights).max(1e-6);
    let meat = blocks.iter().fold(Matrix2::zeros(), |sum, g| sum + g * g.transpose());
    let correlation = (inverse * meat * inverse).trace() / covariance.trace();
    let inside = energy_share(template, &render, window) / whole.max(1e-12);
    Some(Registration { position, covariance, correlation, contrast, misfit: left / energy.max(1e-12), inside })
}

/// Energy of the template's contrast over the cells that lie inside the frame.
fn energy_share(template: &Template, render: &Render, window: &Window) -> f64 {
    let width = template.cover.width;
    let mut total = 0.0;
    let sides = [window.valid.width as i64, window.valid.height as i64];
    for cell in 0..template.precision.values.len() {
        let at = [render.first[0] + (cell % width) as i64, render.first[1] + (cell / width) as i64];
        // Beyond the window counts as inside: only the frame's border and ignored regions cut an object.
        let outside = (0..2).any(|axis| !(0..sides[axis]).contains(&at[axis]));
        if outside || window.valid.values[(at[1] * sides[0] + at[0]) as usize] > 0.0 {
            let size: f32 = template.contrast.iter().map(|plane| plane.values[cell].powi(2)).sum();
            total += f64::from(size * template.precision.values[cell]);
        }
    }
    total
}
