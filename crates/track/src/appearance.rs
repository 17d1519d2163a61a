//! Registration of all frames of one mover: template and positions in turn.

use rayon::prelude::*;

use crate::registration::{Registration, register, search};
use crate::statistics::median;
use crate::template::Template;
use crate::window::{Layout, Window};

/// Rounds of learning and registering.
const ROUNDS: usize = 4;
/// Most frames that a template is averaged over.
const MOST_LEARNED: usize = 60;
/// Movement from which on a frame is preferred for learning, and the number of such frames that suffices.
const LEAST_MOVING: f64 = 0.3;
const LEAST_MOVERS: usize = 6;
/// Misfit, relative to the median, up to which a frame is learned from.
const LEARNED_MISFIT: f64 = 1.3;

/// Start of the registration in one frame.
pub(crate) struct RegistrationStart {
    pub(crate) window: Window,
    /// Expected position, pixels.
    pub(crate) position: [f64; 2],
    /// Whether the frame shows the object as most frames do, so that the first template may use it.
    pub(crate) typical: bool,
    /// How much the object moves, 0..=1.
    pub(crate) moving: f64,
}

/// Registers all frames. Returns a fit for each start, with positions in pixels and covariances in pixels^2, and the
/// final template.
pub(crate) fn registered(
    starts: &[RegistrationStart],
    layout: Layout,
    noise: f64,
) -> (Vec<Option<Registration>>, Template) {
    let bin = layout.bin;
    let mut positions: Vec<[f64; 2]> = starts.iter().map(|s| s.window.cells(s.position, bin)).collect();
    let mut learned = movers(starts, (0..starts.len()).filter(|&i| starts[i].typical).collect());
    let mut fits: Vec<Option<Registration>> = vec![None; starts.len()];
    let mut template = None;
    for round in 0..ROUNDS {
        let pairs: Vec<(&Window, [f64; 2])> =
            spread(&learned).into_iter().map(|i| (&starts[i].window, positions[i])).collect();
        let current = Template::learn(&pairs, layout, noise);
        fits = starts
            .par_iter()
            .zip(&positions)
            .zip(&fits)
            .map(|((start, &position), before)| {
                let from = match before {
                    Some(fit) if fit.misfit < 0.5 => position,
                    _ => search(&start.window, &current, layout, start.window.cells(start.position, bin)),
                };
                register(&start.window, &current, layout, from)
            })
            .collect();
        if round + 1 < ROUNDS {
            let shift = current.centroid();
            for (position, fit) in positions.iter_mut().zip(&fits) {
                if let Some(fit) = fit {
                    *position = [fit.position[0] + shift[0], fit.position[1] + shift[1]];
                }
            }
            let mut misfits: Vec<f64> = fits.iter().flatten().map(|fit| fit.misfit).collect();
            let limit = median(&mut misfits).unwrap_or(1.0) * LEARNED_MISFIT;
            let good = |i: &usize| fits[*i].is_some_and(|fit| fit.misfit <= limit && fit.inside > 0.95);
            let chosen: Vec<usize> = (0..starts.len()).filter(good).collect();
            if chosen.len() >= 4 {
                learned = movers(starts, chosen);
            }
        }
        template = Some(current);
    }
    let template = template.expect("there is at least one round");
    let area = (bin * bin) as f64;
    let fits = fits
        .into_iter()
        .zip(starts)
        .map(|(fit, start)| {
            fit.map(|fit| Registration {
                position: start.window.pixels(fit.position, bin),
                covariance: fit.covariance * area,
                ..fit
            })
        })
        .collect();
    (fits, template)
}

/// Those of the frames in which the object moves, or all where they are few.
fn movers(starts: &[RegistrationStart], frames: Vec<usize>) -> Vec<usize> {
    let moving: Vec<usize> = frames.iter().copied().filter(|&i| starts[i].moving > LEAST_MOVING).collect();
    if moving.len() >= LEAST_MOVERS { moving } else { frames }
}

/// At most [`MOST_LEARNED`] of the indices, evenly spread.
fn spread(indices: &[usize]) -> Vec<usize> {
    let count = indices.len().min(MOST_LEARNED);
    (0..count).map(|i| indices[(2 * i + 1) * indices.len() / (2 * count)]).collect()
}
