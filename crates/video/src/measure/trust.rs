//! How far a fit can be trusted: how well it predicts what was held out, what it leaves of the positions, and what people
//! should know of it.

use tch::Tensor;

use super::bootstrap::Uncertainty;
use super::explain::{Explained, RollOutErrors, positions_of};
use super::fit::Observations;
use super::identifiability::{Identifiability, shown};
use super::motion;
use super::recording::RecordedSystem;
use super::results::{HeldOut, Residuals};
use paig::training::identify::rank::{self, Unidentifiable};

impl RecordedSystem {
    pub(super) fn held_out(
        &self,
        tracks: &[Observations],
        explained: &Explained,
        steady: &[Vec<f64>],
        tracker: Option<&Explained>,
    ) -> HeldOut {
        let (times, unit) = self.per_coordinate();
        let coordinates = explained.dynamics.coordinates();
        let along = motion::along_the_way(&positions_of(&explained.states[0], coordinates), coordinates);
        HeldOut {
            frames: tracks.iter().map(|it| it.seen(coordinates).skip(it.trained).filter(|seen| *seen).count()).sum(),
            unit: unit.into(),
            error: times * explained.errors.held_out,
            constant_velocity: times * RollOutErrors::of(tracks, steady, &explained.dynamics).held_out,
            tracker_fit: tracker.map(|fit| times * fit.errors.held_out),
            percent_of_amplitude: 100.0 * explained.errors.held_out / motion::amplitude(&along[..tracks[0].trained]),
            metres_per_unit: (unit == "px" && self.scale.length_unit() == "m")
                .then(|| self.scale.length() / self.scale.video_pixels),
        }
    }

    pub(super) fn residuals(&self, explained: &Explained, uncertainty: &Uncertainty) -> Residuals {
        let (times, unit) = self.per_coordinate();
        Residuals {
            unit: unit.into(),
            usual: times * explained.fitted.usual_residual,
            usual_in_pieces: explained.fitted.piecewise_residual.map(|usual| times * usual),
            distance: times * explained.errors.learned,
            autocorrelation: uncertainty.autocorrelation.clone(),
            frames_in_one: uncertainty.frames_in_one,
            block: uncertainty.block,
        }
    }

    pub(super) fn notes(
        &self,
        tracks: &[Observations],
        explained: &Explained,
        uncertainty: &Uncertainty,
    ) -> Vec<String> {
        let mut notes = Vec::new();
        notes.extend(of_unknowns(explained, uncertainty));
        notes.extend(of_what_is_beside(tracks, explained));
        let parameters = explained.dynamics.system.cell.parameters.iter().zip(&explained.learned);
        let learned = parameters.filter(|(_, learned)| **learned).map(|(parameter, _)| parameter);
        notes.extend(self.scale.unsaid(learned));
        let whole = explained.fitted.usual_residual;
        if let Some(pieces) = explained.fitted.piecewise_residual
            && whole > 2.0 * pieces
        {
            let (times, unit) = self.per_coordinate();
            notes.push(format!(
                "over the whole video the equation leaves {:.3} {unit} of the positions, over short parts only {:.3} {unit}: \
                 something is missing in it",
                times * whole,
                times * pieces
            ));
        }
        if self.scale.length_unit() == "px" {
            notes.push(
                "the scale was not known when the video was imported (--scale, --pixels-per-metre): lengths are in pixels of \
                 the video"
                    .into(),
            );
        }
        notes
    }
}

/// What is seen beside the state, if it is, and what that hides.
fn of_what_is_beside(tracks: &[Observations], explained: &Explained) -> Vec<String> {
    let Explained { dynamics, learned, fitted, .. } = explained;
    let first = dynamics.system.cell.parameters.len();
    if learned.len() <= first {
        return Vec::new();
    }
    let mut notes = vec![match dynamics.system.objects {
        1 => {
            "all that is seen drifts evenly: the camera or what holds the object moves (taken into account)".to_string()
        }
        _ => "the objects are seen beside their middles, each by another way (taken into account)".to_string(),
    }];
    let left = (first..learned.len()).filter(|place| !learned[*place]).map(|place| dynamics.name(place));
    let left: Vec<_> = left.collect();
    let all = [&learned[..first], &vec![true; learned.len() - first]].concat();
    let shown = shown(dynamics, tracks, &all, fitted).unwrap_or_default();
    let hidden = shown.iter().take(first).enumerate().filter(|(_, shown)| **shown == Identifiability::OnlyWithOthers);
    let hidden: Vec<_> = hidden.map(|(place, _)| dynamics.name(place)).collect();
    if !left.is_empty() && !hidden.is_empty() {
        notes.push(format!(
            "{} cannot be told from {hidden} and is taken as 0: if it is not, {hidden} is off, by more than the interval says",
            left.join(", "),
            hidden = hidden.join(", ")
        ));
    }
    notes
}

/// Which of the unknowns that are learned do not show in the motion, and which of the others cannot be told apart.
fn of_unknowns(explained: &Explained, uncertainty: &Uncertainty) -> Vec<String> {
    let parameters = explained.dynamics.system.cell.parameters.iter().enumerate();
    let learned = parameters.filter(|(place, _)| explained.learned[*place]);
    // Rows and columns of the curvature; what is seen beside the state comes last.
    let (shown, hidden): (Vec<_>, Vec<_>) =
        learned.zip(0_i64..).partition(|((place, _), _)| uncertainty.shown[*place] != Identifiability::Not);
    let (kinds, rows): (Vec<_>, Vec<_>) = shown.into_iter().map(|((_, kind), row)| (kind, row)).unzip();
    let rows = Tensor::from_slice(&rows);
    let curvature = uncertainty.curvature.index_select(0, &rows).index_select(1, &rows);
    let of_hidden = hidden.iter().map(|((_, kind), _)| {
        format!("{} does not show in the motion: its value says nothing; fix it (model.fixed)", kind.name)
    });
    let unidentifiable = rank::unidentifiable(&curvature, &kinds);
    // Those that go with what is seen beside the state, or with the first state, the parameters alone do not show.
    let named = |name: &String| unidentifiable.iter().any(|it| it.names.contains(name));
    let together = uncertainty.shown.iter().enumerate().filter(|(_, shown)| **shown == Identifiability::OnlyWithOthers);
    let together: Vec<_> = together.map(|(place, _)| explained.dynamics.name(place)).collect();
    let of_others = (!together.iter().all(named)).then(|| {
        format!(
            "the motion does not tell these apart, or not from how it begins, so that they have no interval: {}",
            together.join(", ")
        )
    });
    of_hidden.chain(unidentifiable.as_ref().map(Unidentifiable::text)).chain(of_others).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::bootstrap::bootstrap;
    use crate::measure::dynamics::Dynamics;
    use crate::measure::explain::explain;
    use crate::measure::fit::Start;
    use paig::network::System;
    use paig::network::cells::CellKind;
    use paig::support::random::{named_generator, normal};

    /// A fall through what resists, with these unconstrained parameters and more beside the state: which of them have an
    /// interval, and what is said of the others.
    fn fall(acceleration: &str, unconstrained: &[f64], beside: usize) -> (Vec<bool>, Vec<String>) {
        let parameters: String =
            ["c", "g", "m"][..unconstrained.len()].iter().map(|name| format!("\nparameters.{name} = {{}}")).collect();
        let equation = format!("acceleration = \"{acceleration}\"{parameters}");
        let cell = CellKind::of_text(&toml::from_str(&equation).unwrap(), 1).unwrap().into();
        let system = paig::tasks::builtin("falling").unwrap().system;
        let dynamics = Dynamics::new(System { objects: 1, cell, ..system }, 0.3).unwrap();
        let mut random = named_generator(1, "noise");
        let times = dynamics.even_times(48);
        let positions = dynamics.positions(unconstrained, &[10.0, 6.0, 2.0, 0.0], &times);
        let seen = positions.iter().map(|x| x + 0.1 * normal(&mut random)).collect();
        let tracks = [Observations::new(seen, times, 48)];
        let unconstrained = [unconstrained, &vec![0.0; beside]].concat();
        let learned = vec![true; unconstrained.len()];
        let explained =
            explain(&dynamics, &tracks, &[Start { unconstrained, learned: learned.clone(), piece: 12 }]).unwrap();
        let uncertainty = bootstrap(&dynamics, &tracks, &learned, &explained.fitted, 0).unwrap();
        let by_itself = uncertainty.shown.iter().map(|shown| *shown == Identifiability::ByItself).collect();
        (by_itself, of_unknowns(&explained, &uncertainty))
    }

    #[test]
    fn what_cannot_be_told_apart_has_no_interval_and_is_named() {
        let (c, g) = (0.3_f64.ln(), 1.5_f64.ln());
        assert_eq!(fall("vec(0, g) - c * v", &[c, g], 0), (vec![true; 2], Vec::new()));
        let (shown, notes) = fall("vec(0, g * m) - c * v", &[c, g, 0.0], 0);
        assert_eq!(shown, [true, false, false]);
        assert!(notes.len() == 1 && notes[0].contains("g and m cannot be told apart"), "{notes:?}");
        // A camera that drifts along y, with another speed at the beginning, looks as another g.
        let (shown, notes) = fall("vec(0, g) - c * v", &[c, g], 2);
        assert_eq!(shown, [true, false, true, false]);
        assert!(notes.len() == 1 && notes[0].ends_with(": g, drift_of_what_is_seen_y"), "{notes:?}");
    }
}
