//! The scores of predicted frames and of states, printed.

use crate::runs::scores::Scores;
use crate::say;
use crate::tasks::Task;

/// Prints squared error and SSIM of every predicted frame, and the errors of positions and velocities where known.
pub fn print_frames_and_states(task: &Task, scores: &Scores) {
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
    let unit = task.cell.coordinates.unit();
    say!("\n{:<38}{:>10}{:>22}", format!("root mean square error, {unit}"), "", "without the offset");
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
