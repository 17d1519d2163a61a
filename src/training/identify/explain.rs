//! What explains the motion: the parameters, from the measure of the positions, the names and the start that fit best.

use std::f64::consts::TAU;

use anyhow::Result;
use tch::{Kind, Tensor};

use super::Identify;
use super::encoded_positions::EncodedPositions;
use super::fit::{Fit, FitStart, Trust, fit};
use super::rank::{self, Unidentifiable};
use crate::network::System;
use crate::network::cells::{Bounds, Coordinates};
use crate::network::physics_models::PhysicsNet;
use crate::network::physics_models::naming::{self, Naming};
use crate::support::assignment::best_assignment;
use crate::support::statistics::{MEDIAN_TO_DEVIATION, is_smaller};

/// Names are taken from the paths where the encoder's change within more than this share of the clips.
const RENAMED_CLIPS: f64 = 0.15;
/// Rounds of naming by the fitted motion.
const NAMING_ROUNDS: usize = 4;
/// A usual residual of more than this, pixels, makes the fit try other starts: the unconstrained values of all learned
/// parameters changed by these, a factor of 4, a fourth and 16 of a positive one.
const TRY_OTHERS: f64 = 0.25;
const OTHER_STARTS: [f64; 3] = [1.4, -1.4, 2.8];
/// Where fewer of the positions are near the fitted motion, its walls are looked for anew.
const NEARLY_ALL: f64 = 0.9;
/// Offsets that the fit finds by itself are taken where they make the usual residual smaller than this share.
const OFFSETS_PAY: f64 = 0.85;
/// Residuals of two coordinates that go together more than this are weighted by how they do: a shaking camera moves all
/// objects alike. The least standard deviation, pixels, keeps the weights finite.
const TOGETHER: f64 = 0.5;
const LEAST_DEVIATION: f64 = 0.02;
/// Residuals beyond this many usual ones count as so many.
const OUTLIER: f64 = 4.0;

/// Positions further off than this many usual residuals, and than so many pixels, are left out at the end: there
/// a name is wrong, or the object was not seen. The rest must be this share of all.
const FAR: f64 = 8.0;
const LEAST_FAR: f64 = 0.3;
const LEAST_KEPT: f64 = 0.7;
/// Rounds of leaving out.
const KEEPING_ROUNDS: usize = 3;
/// At the end residuals beyond so many usual ones count linearly: 95 % as exact as least squares where the noise is normal
/// (Huber 1964), and the few that are not cannot pull the parameters. At least so many pixels.
const HUBER_OF_USUAL: f64 = 1.345;
pub(super) const LEAST_HUBER: f64 = 0.02;

/// The largest residual of a motion that is explained, pixels.
const LARGEST_RESIDUAL: f64 = 0.5;
/// The worse measure of the positions is still a witness while its residual is at most so many times the better one's.
const WITNESS: f64 = 1.5;

/// The best explanation.
#[derive(Debug)]
pub struct Explanation {
    pub fit: Fit,
    /// Encoded minus true position of each object, pixels.
    pub offsets: Vec<f64>,
    /// Where the objects are, in the encoder's order, pixels: `[clips, time, 2 * objects]`.
    pub positions: Tensor,
    /// Share of the positions that it explains.
    pub explained: f64,
    /// Share of the clips in which the encoder changes names.
    pub names_change: f64,
    /// Usual distance between the encoder's positions and the masks' centroids, pixels.
    pub disagreement: f64,
    /// Whether the encoder's positions fit better than the centroids.
    pub by_encoder: bool,
    /// The usual residual of what the objects do not do together: of their distance where a camera shakes.
    pub own_residual: f64,
    /// The largest of them that counts as explained, in their unit.
    pub largest_residual: f64,
    /// Raw numbers of the parameters by either measure of the positions, as far as it fits nearly as well as the better one.
    pub estimates: Vec<Vec<f64>>,
    /// What was fitted: coordinates in the order of names, without offsets, `[clips, time, coordinates]`.
    pub(super) fitted: Tensor,
    /// How far each of them is trusted.
    pub(super) trust: Trust,
}

impl Explanation {
    /// Whether the equation explains what was seen.
    pub fn explains(&self) -> bool {
        self.explained >= LEAST_KEPT && self.own_residual <= self.largest_residual
    }

    /// Gives the model the parameters, if the equation explains what was seen.
    pub(super) fn apply(&self, model: &PhysicsNet) {
        let learned = model.parameters.iter().zip(&self.fit.unconstrained).filter(|(parameter, _)| parameter.learned);
        learned
            .filter(|_| self.explains())
            .for_each(|(parameter, unconstrained)| model.set_unconstrained(parameter, *unconstrained));
    }

    /// The learned parameters that the motion does not tell apart, if there are any.
    pub fn unidentifiable(&self, model: &PhysicsNet) -> Option<Unidentifiable> {
        let places: Vec<i64> =
            (0..).zip(&model.parameters).filter(|(_, it)| it.learned).map(|(place, _)| place).collect();
        let kinds: Vec<_> = model.learned().map(|parameter| &parameter.kind).collect();
        let places = Tensor::from_slice(&places);
        rank::unidentifiable(&self.fit.curvature.index_select(0, &places).index_select(1, &places), &kinds)
    }

    /// In a line, residuals in this unit.
    pub fn text(&self, unit: &str) -> String {
        let by = if self.by_encoder { "the encoder's positions" } else { "the masks' centroids" };
        let mut text = format!(
            "by {by}: usual residual {:.4} {unit}, {:.1} % of the positions explained, names change in {:.0} % of the clips",
            self.fit.usual_residual,
            100.0 * self.explained,
            100.0 * self.names_change
        );
        if !self.explains() {
            text += "; the equation does not explain them: nothing is applied";
        }
        text
    }
}

/// Explains what was seen of some clips, beginning at `start`.
///
/// # Errors
/// Positions that are not finite.
pub fn explain(
    config: &Identify,
    model: &PhysicsNet,
    seen: &EncodedPositions,
    start: &FitStart,
) -> Result<Explanation> {
    let fits = ModelFits { config, model, seen, start, pixel: seen.pixel(&model.system) };
    let naming = fits.naming();
    let clips = seen.centroids.size()[0] as f64;
    let names_change = naming.as_ref().map_or(0.0, |naming| naming.changed as f64 / clips);
    let mut order = naming.filter(|_| names_change > RENAMED_CLIPS).map(|naming| naming.order);

    let mut best = fits.best_of_starts(&fits.coordinates(&seen.centroids, order.as_ref()))?;
    if let Some(order) = &mut order {
        best = fits.named_by_motion(best, order)?;
    }
    let by_encoder = fits.go_on(&fits.coordinates(&seen.encoded, order.as_ref()), &best, false, &Trust::default())?;
    let encoder_wins = by_encoder.usual_residual < best.usual_residual;
    let (mut at, mut other_at) = (&seen.centroids, &seen.encoded);
    if encoder_wins {
        (best, at, other_at) = (by_encoder, &seen.encoded, &seen.centroids);
    }
    let named = fits.coordinates(at, order.as_ref());
    let mut free_offsets = false;
    // Objects that change names have no offsets of their own; and an angle's could not be given to the encoder.
    if order.is_none() && model.system.cell.coordinates == Coordinates::Position {
        let free = fits.go_on(&named, &best, true, &Trust::default())?;
        free_offsets = free.usual_residual < OFFSETS_PAY * best.usual_residual;
        if free_offsets {
            best = free;
        }
    }
    let weights = weights(&best.residuals, LEAST_DEVIATION * fits.pixel);
    let mut trust = Trust { weights, ..Trust::default() };
    let own_residual = own_residual(&model.system, &best, &trust);
    let (best, explained) = fits.without_outliers(&named, best, free_offsets, &mut trust)?;

    let mut estimates = vec![best.unconstrained.clone()];
    let other = fits.go_on(&fits.coordinates(other_at, order.as_ref()), &best, free_offsets, &trust)?;
    if other.usual_residual <= WITNESS * best.usual_residual {
        estimates.push(other.unconstrained);
    }
    let found = fits.offsets_in_pixels(&best);
    Ok(Explanation {
        offsets: seen.offsets.iter().zip(&found).map(|(measured, found)| measured + found).collect(),
        positions: at - Tensor::from_slice(&found).to_device(at.device()),
        fitted: named - Tensor::from_slice(&best.offsets).to_device(at.device()),
        fit: best,
        explained,
        names_change,
        disagreement: seen.disagreement(),
        by_encoder: encoder_wins,
        own_residual,
        largest_residual: LARGEST_RESIDUAL * fits.pixel,
        estimates,
        trust,
    })
}

/// The fits of one model to what was seen.
struct ModelFits<'a> {
    config: &'a Identify,
    model: &'a PhysicsNet,
    seen: &'a EncodedPositions,
    start: &'a FitStart,
    /// A pixel in the unit of the equation's coordinates.
    pixel: f64,
}

impl ModelFits<'_> {
    /// Names by the paths of the objects, whatever they look like; none where there is nothing to name.
    fn naming(&self) -> Option<Naming> {
        let system = &self.model.system;
        let unlike = vec![vec![0.0; system.objects]; system.objects];
        let several = system.cell.coordinates == Coordinates::Position && system.objects > 1;
        let time = self.seen.centroids.size()[1] as usize;
        several.then(|| naming::follow(&self.seen.centroids, &unlike, time))
    }

    /// Positions in pixels as coordinates of the equation, in the order of names, if there is one. Angles of a clip begin within
    /// half a turn of its centroids', so that one measure's fit can begin where the other's ended.
    fn coordinates(&self, at: &Tensor, order: Option<&Tensor>) -> Tensor {
        let coordinates = |at: &Tensor| match order {
            Some(order) => self.model.clip_coordinates(&naming::renamed(at, order)),
            None => self.model.clip_coordinates(at),
        };
        match self.model.system.cell.coordinates {
            Coordinates::Position => coordinates(at),
            Coordinates::Angle => on_branch_of(coordinates(at), &coordinates(&self.seen.centroids)),
        }
    }

    fn fit(&self, at: &Tensor, start: &FitStart, trust: &Trust) -> Result<Fit> {
        fit(self.config, &self.model.system, at, &self.seen.actions, start, trust)
    }

    /// A fit that begins where another ended.
    fn go_on(&self, at: &Tensor, from: &Fit, free_offsets: bool, trust: &Trust) -> Result<Fit> {
        let (unconstrained, states) = (from.unconstrained.clone(), Some(from.states.shallow_clone()));
        self.fit(at, &FitStart { unconstrained, learned: self.start.learned.clone(), free_offsets, states }, trust)
    }

    /// The fit from the given start, or from one of the others where that leaves much.
    fn best_of_starts(&self, at: &Tensor) -> Result<Fit> {
        let FitStart { unconstrained, learned, .. } = self.start;
        let from = |unconstrained: Vec<f64>| {
            let start = FitStart { unconstrained, learned: learned.clone(), free_offsets: false, states: None };
            self.fit(at, &start, &Trust::default())
        };
        let mut best = from(unconstrained.clone())?;
        let changes = if learned.contains(&true) { &OTHER_STARTS[..] } else { &[] };
        for change in changes {
            if best.usual_residual <= TRY_OTHERS * self.pixel {
                break;
            }
            let other = from(
                unconstrained
                    .iter()
                    .zip(learned)
                    .map(|(unconstrained, &it)| if it { unconstrained + change } else { *unconstrained })
                    .collect(),
            )?;
            if is_smaller(other.usual_residual, best.usual_residual) {
                best = other;
            }
        }
        let near = |fit: &Fit| self.near(fit, false).mean(Kind::Double).double_value(&[]);
        let share = near(&best);
        if share < NEARLY_ALL
            && let Some(unconstrained) = self.walls_anew(&best.unconstrained)
        {
            let other = from(unconstrained)?;
            if near(&other) > share {
                best = other;
            }
        }
        Ok(best)
    }

    /// What was found, but what is learned between two bounds, such as a wall or what it leaves of the speed, as the equation
    /// begins: while the others were wrong, it was moved to where it does harm or nothing. None where there is no such thing.
    fn walls_anew(&self, found: &[f64]) -> Option<Vec<f64>> {
        let mut unconstrained = found.to_vec();
        let mut any = false;
        for ((unconstrained, parameter), learned) in
            unconstrained.iter_mut().zip(&self.model.parameters).zip(&self.start.learned)
        {
            if *learned && matches!(parameter.kind.bounds, Bounds::Between(..)) {
                *unconstrained = parameter.usual_start;
                any = true;
            }
        }
        any.then_some(unconstrained)
    }

    /// Which positions are near where a fit has them; of frames all or none if `whole_frames`.
    fn near(&self, fit: &Fit, whole_frames: bool) -> Tensor {
        near(fit, self.model.system.objects, whole_frames, LEAST_FAR * self.pixel)
    }

    /// Names each object by the motion that was fitted, and fits again, as long as names change.
    fn named_by_motion(&self, mut best: Fit, order: &mut Tensor) -> Result<Fit> {
        let centroids = &self.seen.centroids;
        for _ in 0..NAMING_ROUNDS {
            let frames = best.residuals.size()[1];
            let rolled_out = naming::renamed(centroids, order).narrow(1, 0, frames) + &best.residuals;
            if rename_by_motion(order, &centroids.narrow(1, 0, frames), &rolled_out)? == 0 {
                break;
            }
            best = self.go_on(&self.coordinates(centroids, Some(order)), &best, false, &Trust::default())?;
        }
        Ok(best)
    }

    /// Fits again, without the positions that are far from the motion and with a loss that bounds what is beyond the noise;
    /// returns the share of those that stay.
    fn without_outliers(
        &self,
        at: &Tensor,
        mut best: Fit,
        free_offsets: bool,
        trust: &mut Trust,
    ) -> Result<(Fit, f64)> {
        let mut explained = 1.0;
        for _ in 0..KEEPING_ROUNDS {
            let mask = self.near(&best, trust.weights.is_some());
            explained = mask.mean(Kind::Double).double_value(&[]);
            if explained < LEAST_KEPT {
                break;
            }
            trust.mask = Some(mask);
            trust.huber =
                Some((HUBER_OF_USUAL * best.usual_residual).clamp(LEAST_HUBER * self.pixel, self.config.huber));
            best = self.go_on(at, &best, free_offsets, trust)?;
        }
        Ok((best, explained))
    }

    /// An angle is tied to where the rod is seen: it has no offset in pixels.
    fn offsets_in_pixels(&self, fit: &Fit) -> Vec<f64> {
        match self.model.system.cell.coordinates {
            Coordinates::Position => fit.offsets.clone(),
            Coordinates::Angle => vec![0.0; self.seen.offsets.len()],
        }
    }
}

/// The usual residual; where residuals are weighted by how they go together, without what all objects of a frame share: a camera
/// moves them alike, but a wrong force between two of them does not.
pub(super) fn own_residual(system: &System, fit: &Fit, trust: &Trust) -> f64 {
    let System { objects, cell, .. } = system;
    if trust.weights.is_none() || *objects < 2 || cell.coordinates == Coordinates::Angle {
        return fit.usual_residual;
    }
    let each = fit.residuals.flatten(0, 1).reshape([-1, *objects as i64, 2]);
    let own = &each - each.mean_dim([1i64].as_slice(), true, None);
    // The mean takes away its share of each object's noise, too.
    let share = 1.0 - 1.0 / *objects as f64;
    own.abs().median().double_value(&[]) * MEDIAN_TO_DEVIATION / share.sqrt()
}

/// Angles `[clips, time, objects]`, by whole turns for a whole clip, so that each begins within half a turn of the others.
fn on_branch_of(angles: Tensor, others: &Tensor) -> Tensor {
    let first = |angles: &Tensor| angles.narrow(1, 0, 1);
    let turns = ((first(&angles) - first(others)) / TAU).round();
    angles - turns * TAU
}

/// 1 for the positions that are not far from where the fit has them, which at `least` are not, `[clips, frames * coordinates]`;
/// if `whole_frames`, of a frame all or none.
fn near(fit: &Fit, objects: usize, whole_frames: bool, least: f64) -> Tensor {
    let size = fit.residuals.size();
    let objects = if whole_frames { 1 } else { objects as i64 };
    let of_object = fit.residuals.abs().reshape([size[0], size[1], objects, -1]);
    let largest = of_object.amax([3i64].as_slice(), true);
    let near = largest.le((FAR * fit.usual_residual).max(least)).to_kind(Kind::Double);
    near.expand_as(&of_object).reshape([size[0], -1])
}

/// Gives each name the object nearest to where the fitted motion has it; returns in how many frames that changed names.
/// `order`: `[clips, time, objects]`; `seen` in the encoder's order, `rolled_out` in that of the names.
fn rename_by_motion(order: &mut Tensor, seen: &Tensor, rolled_out: &Tensor) -> Result<usize> {
    let size = seen.size();
    let (clips, frames, objects) = (size[0], size[1], size[2] as usize / 2);
    let flat = |x: &Tensor| -> Vec<f64> { x.to_kind(Kind::Double).flatten(0, 2).try_into().expect("numbers") };
    let (seen, rolled_out) = (flat(seen), flat(rolled_out));
    let mut names: Vec<i64> = order.narrow(1, 0, frames).contiguous().flatten(0, 2).try_into().expect("whole numbers");
    let mut changed = 0;
    for (frame, names) in names.chunks_mut(objects).enumerate() {
        let at = |from: &[f64], object: usize| {
            let place = 2 * (frame * objects + object);
            [from[place], from[place + 1]]
        };
        let cost = |name: usize, object: usize| {
            let (expected, seen) = (at(&rolled_out, name), at(&seen, object));
            (expected[0] - seen[0]).hypot(expected[1] - seen[1])
        };
        let costs: Vec<Vec<f64>> =
            (0..objects).map(|name| (0..objects).map(|object| cost(name, object)).collect()).collect();
        let best = best_assignment(&costs);
        if best.iter().zip(names.iter()).any(|(new, old)| *new as i64 != *old) {
            changed += 1;
            names.iter_mut().zip(best).for_each(|(name, object)| *name = object as i64);
        }
    }
    let named = Tensor::from_slice(&names).reshape([clips, frames, objects as i64]);
    order.narrow(1, 0, frames).copy_(&named);
    Ok(changed)
}

/// What makes the residuals of a frame independent, `[coordinates, coordinates]`; counts a residual in units of the usual one,
/// so that the same limits hold. None where they nearly are independent. `least`: a deviation in their unit.
fn weights(residuals: &Tensor, least: f64) -> Option<Tensor> {
    let flat = residuals.flatten(0, 1);
    if flat.size()[0] == 0 {
        return None;
    }
    let scale = flat.abs().median().double_value(&[]) * MEDIAN_TO_DEVIATION;
    // What is far off would decide everything.
    let flat = flat.clamp(-OUTLIER * scale, OUTLIER * scale);
    let covariance = flat.transpose(0, 1).matmul(&flat) / flat.size()[0] as f64;
    let deviations = covariance.diagonal(0, 0, 1).sqrt();
    let together = (&covariance / (deviations.unsqueeze(0) * deviations.unsqueeze(1))).triu(1).abs();
    let together = if covariance.size()[0] < 2 { 0.0 } else { together.max().double_value(&[]) };
    // Nor where one of them is not a number.
    if together.is_nan() || together < TOGETHER {
        return None;
    }
    let least = Tensor::eye(covariance.size()[0], (Kind::Double, covariance.device())) * least.powi(2);
    Some((covariance + least).linalg_cholesky(false).inverse() * scale)
}

#[cfg(test)]
mod tests {
    use tch::Device;

    use super::*;

    #[test]
    fn both_measures_of_a_rod_that_hangs_begin_alike() {
        let angles = |numbers: &[f64]| Tensor::from_slice(numbers).reshape([2, 3, 1]).to_device(Device::Cpu);
        let centroids = angles(&[3.13, 3.2, 3.3, -3.1, -3.0, -2.9]);
        let encoded = angles(&[-3.13, -3.08, -2.98, -3.12, -3.0, -2.9]);
        let apart = on_branch_of(encoded, &centroids) - centroids;
        // They differ by 2 pi - 6.26 at first.
        assert!(apart.abs().max().double_value(&[]) < 0.025, "{apart:?}");
    }
}
