//! What a fit says in the units of the scene: its parameters, what is seen beside the state, period, length and amplitude of what
//! swings; each with the draws of the bootstrap.

use std::collections::BTreeMap;

use anyhow::Result;

use super::bootstrap::{BootstrapSample, Uncertainty, bootstrap};
use super::dynamics::Dynamics;
use super::explain::{Explained, positions_of};
use super::fit::Observations;
use super::identifiability::Identifiability;
use super::motion;
use super::recording::RecordedSystem;
use super::results::{Quantity, QuantityKind};
use super::scale::Scale;
use paig::network::cells::PhysicalParameter;

/// Draws of the bootstrap that are rolled out again: for what only a whole motion shows.
const ROLLED_OUT_DRAWS: usize = 200;
/// The acceleration of gravity for which the length of a simple pendulum is given, m/s^2.
const STANDARD_GRAVITY: f64 = 9.80665;

impl RecordedSystem {
    /// Quantities of a fit with the intervals of a bootstrap of their own.
    ///
    /// # Errors
    /// As [`bootstrap`].
    pub(super) fn quantities_alone(
        &self,
        tracks: &[Observations],
        explained: &Explained,
        seed: u64,
    ) -> Result<Vec<Quantity>> {
        let Explained { dynamics, learned, fitted, .. } = explained;
        Ok(self.quantities(tracks, explained, &bootstrap(dynamics, tracks, learned, fitted, seed)?))
    }

    pub(super) fn quantities(
        &self,
        tracks: &[Observations],
        explained: &Explained,
        uncertainty: &Uncertainty,
    ) -> Vec<Quantity> {
        let parameters = explained.dynamics.system.cell.parameters.iter().enumerate();
        let parameters = parameters.filter(|(place, _)| explained.learned[*place]).map(|(place, parameter)| {
            let powers = Scale::powers(parameter);
            let value = |unconstrained: &[f64]| parameter.bounds.value(unconstrained[place]);
            let in_frames = value(&explained.fitted.unconstrained);
            let factor = powers.map_or(1.0, |powers| self.scale.factor(powers));
            let draws = of_shown(uncertainty, place);
            let draws = draws
                .map(|draw| value(&draw.unconstrained) * powers.map_or(1.0, |powers| self.scale.drawn(powers, draw)));
            Quantity::new(&parameter.name, factor * in_frames, draws.collect())
                .in_unit(self.scale.unit_of(parameter))
                .of_kind(kind_of(parameter))
                .in_frames(in_frames)
        });
        let mut quantities: Vec<Quantity> = parameters.collect();
        quantities.extend(self.beside(explained, uncertainty));
        quantities.extend(self.of_the_swing(tracks, explained, uncertainty));
        quantities
    }

    /// By how much what is seen lies beside the state, if it does: the drift of the camera, pixels of the video in a second, or
    /// pixels of each object beside its middle, more than the first one.
    fn beside(&self, explained: &Explained, uncertainty: &Uncertainty) -> Vec<Quantity> {
        let Dynamics { system, .. } = &explained.dynamics;
        let (seconds, unit) = if system.objects == 1 { (self.scale.seconds, "px/s") } else { (1.0, "px") };
        let times = self.scale.video_pixels / seconds;
        let quantity = |place: usize| {
            let draws = of_shown(uncertainty, place).map(|draw| times * draw.unconstrained[place]);
            let value = times * explained.fitted.unconstrained[place];
            Quantity::new(&explained.dynamics.name(place), value, draws.collect())
                .in_unit(unit.into())
                .of_kind(QuantityKind::Place)
        };
        let learned = (system.cell.parameters.len()..explained.learned.len()).filter(|place| explained.learned[*place]);
        learned.map(quantity).collect()
    }

    /// Period, effective length and amplitude of a motion that swings, in the first video. What walls turn back is no simple
    /// pendulum, however evenly it swings.
    fn of_the_swing(&self, tracks: &[Observations], explained: &Explained, uncertainty: &Uncertainty) -> Vec<Quantity> {
        let coordinates = explained.dynamics.coordinates();
        let second = self.scale.seconds * explained.dynamics.dt;
        // At even times, whatever the video's are.
        let frames = (tracks[0].duration() / explained.dynamics.dt).round() as usize + 1;
        let times = explained.dynamics.even_times(frames);
        let swing = |unconstrained: &[f64], state: &[f64]| {
            let states = explained.dynamics.roll_out(unconstrained, state, &times);
            motion::along_the_way(&positions_of(&states, coordinates), coordinates)
        };
        let of =
            |explained: &Explained| swing(&explained.fitted.unconstrained, &explained.states[0][..2 * coordinates]);
        let along = of(explained);
        let Some(frames) = motion::period(&along) else { return Vec::new() };
        let drawn = uncertainty.draws.iter().take(ROLLED_OUT_DRAWS).map(|draw| {
            let along = swing(&draw.unconstrained, &draw.states[0]);
            (
                motion::period(&along).unwrap_or(f64::NAN) * self.scale.drawn([0, 1], draw) * explained.dynamics.dt,
                motion::amplitude(&along),
            )
        });
        let (periods, amplitudes): (Vec<f64>, Vec<f64>) = drawn.unzip();
        let length = |period: f64| STANDARD_GRAVITY * (period / std::f64::consts::TAU).powi(2);
        let lengths = periods.iter().map(|period| length(*period)).collect();
        let (pixels, unit) = self.per_coordinate();
        let hangs = !explained.dynamics.has_walls();
        let length = hangs.then(|| {
            Quantity::new("length_of_a_simple_pendulum", length(second * frames), lengths).in_unit("m".into())
        });
        let amplitude = Quantity::new(
            "amplitude",
            pixels * motion::amplitude(&along),
            amplitudes.into_iter().map(|amplitude| pixels * amplitude).collect(),
        );
        let mut quantities = vec![Quantity::new("period", second * frames, periods).in_unit("s".into())];
        quantities.extend(length);
        quantities.push(amplitude.in_unit(unit.into()).of_kind(QuantityKind::Place));
        quantities
    }
}

fn kind_of(parameter: &PhysicalParameter) -> QuantityKind {
    match Scale::powers(parameter) {
        Some([_, time]) if time <= -2 => QuantityKind::Force,
        Some([1, 0]) => QuantityKind::Place,
        // An angle may be negative.
        Some([0, 0]) if parameter.bounds.contain(-f64::MIN_POSITIVE) => QuantityKind::Place,
        None if parameter.unit_name.is_some() => QuantityKind::Force,
        _ => QuantityKind::Other,
    }
}

/// The draws in which an unconstrained parameter says something: none of what does not show by itself.
fn of_shown(uncertainty: &Uncertainty, place: usize) -> impl Iterator<Item = &BootstrapSample> {
    uncertainty.draws.iter().filter(move |_| uncertainty.shown[place] == Identifiability::ByItself)
}

impl Explained {
    /// The learned parameters in the units of the scene.
    pub(super) fn parameters(&self, scale: &Scale) -> BTreeMap<String, f64> {
        let parameters = self.dynamics.system.cell.parameters.iter().enumerate();
        let learned = parameters.filter(|(place, _)| self.learned[*place]);
        let value = |(place, kind): (usize, &PhysicalParameter)| {
            let factor = Scale::powers(kind).map_or(1.0, |powers| scale.factor(powers));
            (kind.name.to_string(), factor * kind.bounds.value(self.fitted.unconstrained[place]))
        };
        learned.map(value).collect()
    }
}
