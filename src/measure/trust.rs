//! How far a fit can be trusted: how well it predicts what was held out, what it leaves of the positions, and what people
//! should know of it.

use tch::Tensor;

use super::bootstrap::Uncertainty;
use super::explain::{Errors, Explained, positions_of};
use super::fit::Track;
use super::motion;
use super::results::{HeldOut, Residuals};
use super::subject::{Subject, trained_ticks};
use crate::training::identify::rank;

impl Subject<'_> {
    pub(super) fn held_out(
        &self,
        tracks: &[Track],
        explained: &Explained,
        steady: &[Vec<f64>],
        tracker: Option<&Explained>,
    ) -> HeldOut {
        let (times, unit) = self.per_coordinate();
        let coordinates = explained.dynamics.coordinates();
        let along = motion::along_the_way(&positions_of(&explained.states[0], coordinates), coordinates);
        HeldOut {
            frames: tracks.iter().map(|it| it.positions.len() / coordinates - it.trained).sum(),
            unit: unit.into(),
            error: times * explained.errors.held_out,
            constant_velocity: times * Errors::of(tracks, steady, &explained.dynamics).held_out,
            tracker_fit: tracker.map(|fit| times * fit.errors.held_out),
            percent_of_amplitude: 100.0 * explained.errors.held_out
                / motion::amplitude(&along[..trained_ticks(&tracks[0])]),
            metres_per_unit: (unit == "px" && self.scale.length_unit() == "m")
                .then(|| self.scale.length() / self.scale.video_pixels),
        }
    }

    pub(super) fn residuals(&self, explained: &Explained, uncertainty: &Uncertainty) -> Residuals {
        let (times, unit) = self.per_coordinate();
        Residuals {
            unit: unit.into(),
            usual: times * explained.fitted.usual_residual,
            usual_in_pieces: times * explained.fitted.piecewise_residual,
            distance: times * explained.errors.learned,
            autocorrelation: uncertainty.autocorrelation.clone(),
            frames_in_one: uncertainty.frames_in_one,
            block: uncertainty.block,
        }
    }

    pub(super) fn notes(&self, explained: &Explained, uncertainty: &Uncertainty) -> Vec<String> {
        let mut notes = Vec::new();
        for (clock, name) in self.clocks.iter().zip(self.record.source_names()) {
            let said = clock.text();
            notes.extend(said.map(|said| format!("{name}: by the steps of what moves, {said}")));
        }
        notes.extend(of_parameters(explained, uncertainty));
        if explained.learned.len() > explained.dynamics.system.cell.parameters.len() {
            notes.push(match explained.dynamics.system.objects {
                1 => "all that is seen drifts evenly: the camera or what holds the object moves (taken into account)"
                    .into(),
                _ => "the objects are seen beside their middles, each by another way (taken into account)".into(),
            });
        }
        let (whole, pieces) = (explained.fitted.usual_residual, explained.fitted.piecewise_residual);
        if whole > 2.0 * pieces {
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
                "the scale is not known (--scale, --pixels-per-metre): lengths are in pixels of the video".into(),
            );
        }
        notes
    }
}

/// Which of the parameters that are learned do not show in the motion, and which of the others cannot be told apart.
fn of_parameters(explained: &Explained, uncertainty: &Uncertainty) -> Vec<String> {
    let parameters = explained.dynamics.system.cell.parameters.iter().enumerate();
    let learned = parameters.filter(|(place, _)| explained.learned[*place]);
    // Rows and columns of the curvature; what is seen beside the state comes last.
    let (shown, hidden): (Vec<_>, Vec<_>) = learned.zip(0_i64..).partition(|((place, _), _)| uncertainty.shown[*place]);
    let (kinds, rows): (Vec<_>, Vec<_>) = shown.into_iter().map(|((_, kind), row)| (kind, row)).unzip();
    let rows = Tensor::from_slice(&rows);
    let curvature = uncertainty.curvature.index_select(0, &rows).index_select(1, &rows);
    let of_hidden = hidden.iter().map(|((_, kind), _)| {
        format!("{} does not show in the motion: its value says nothing; fix it (model.fixed)", kind.name)
    });
    of_hidden.chain(rank::indistinct(&curvature, &kinds).map(|indistinct| indistinct.text())).collect()
}
