//! Results, printed.

use crate::say;
use paig::evaluation::ScoredClips;
use paig::network::System;
use paig::network::physics_models::PhysicsNet;
use paig::network::physics_models::losses::{Loss, MeanLosses};
use paig::runs::scores::Scores;
use paig::runs::summary::LearnedParameter;
use paig::tasks::Task;
use paig::tasks::published::published;

/// Parameters whose symbol says less than it seems: equation, symbol, meaning.
const MEANINGS: [(&str, &str, &str); 2] =
    [("spring", "l", "half the rest length, pixels"), ("damped_spring", "l", "half the rest length, pixels")];

/// Prints the learned parameters beside the truth, and the losses beside the paper's.
pub fn print_results(task: &Task, model: &PhysicsNet, test: &ScoredClips, losses: &MeanLosses) {
    say!();
    say!("{:<28}{:>12}{:>12}{:>10}", task.name, "learned", "true", "error");
    for (name, learned) in model.parameter_values() {
        match test.truth_of(name) {
            Some(truth) => {
                let error = LearnedParameter { learned, truth: Some(truth) }.error_percent();
                let error = error.map_or_else(|| "-".into(), |error| format!("{error:.2}%"));
                say!("{name:<28}{learned:>12.4}{truth:>12.4}{error:>10}");
            }
            None => say!("{name:<28}{learned:>12.4}"),
        }
    }
    for (cell, name, meaning) in MEANINGS {
        if task.system.cell.name == cell {
            say!("{name} is {meaning}");
        }
    }
    test.notes.iter().for_each(|note| say!("note: {note}"));
    say!();
    say!("{:<28}{:>12}{:>12}", "test loss (squared error)", "here", "paper");
    let row = |name: &str, value: f64, loss: Loss| {
        let paper = published().paper_loss(&task.name, loss).map_or("-".to_string(), |paper| format!("{paper:.2}"));
        say!("{name:<28}{value:>12.4}{paper:>12}");
    };
    row("reconstruction L_rec", losses.recons_loss, Loss::Recons);
    row("prediction L_pred", losses.pred_loss, Loss::Pred);
    if let Some(loss) = losses.extrap_loss {
        row("extrapolation L_extrap", loss, Loss::Extrap);
    }
    say!();
}

/// Prints squared error and SSIM of every predicted frame, and the errors of positions and velocities where known.
pub fn print_frames_and_states(system: &System, scores: &Scores) {
    say!("{:>5}  {:<6}{:>14}{:>10}", "frame", "", "squared error", "SSIM");
    let mut extrapolated = false;
    for frame in &scores.predicted_frames {
        if frame.extrapolated && !extrapolated {
            extrapolated = true;
            say!("------ end of T_pred, T_ext begins");
        }
        let part = if frame.extrapolated { "T_ext" } else { "T_pred" };
        say!("{:>5}  {part:<6}{:>14.4}{:>10.4}", frame.frame, frame.squared_error, frame.ssim);
    }
    let Some(states) = &scores.states else { return };
    let unit = system.cell.coordinates.unit();
    say!();
    say!("{:<38}{:>10}{:>22}", format!("root mean square error, {unit}"), "", "without the offset");
    let row = |name: &str, error: f64, without: f64| say!("{name:<38}{error:>10.4}{without:>22.4}");
    row("encoded positions", states.encoded, states.encoded_without_offset);
    row("predicted positions, T_pred", states.predicted, states.predicted_without_offset);
    if let (Some(error), Some(without)) = (states.extrapolated, states.extrapolated_without_offset) {
        row("predicted positions, T_ext", error, without);
    }
    say!("velocity at the last input frame      {:>10.4} {unit} per time unit", states.initial_velocity);
    if let Some(slope) = states.initial_velocity_slope {
        say!("  the true one times                  {slope:>10.4}");
    }
    say!("velocity, T_pred                      {:>10.4} {unit} per time unit", states.predicted_velocity);
}
