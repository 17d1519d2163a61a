//! The scores of predicted frames and of states, printed.

use super::Evaluation;
use crate::tasks::Task;

/// Prints squared error and SSIM of every predicted frame, and the errors of positions and velocities where known.
pub fn print_frames_and_states(task: &Task, scores: &Evaluation) {
    println!("{:>5}  {:<6}{:>14}{:>10}", "frame", "", "squared error", "SSIM");
    let mut extrapolated = false;
    for frame in &scores.predicted_frames {
        if frame.extrapolated && !extrapolated {
            extrapolated = true;
            println!("------ end of T_pred, T_ext begins");
        }
        let part = if frame.extrapolated { "T_ext" } else { "T_pred" };
        println!("{:>5}  {part:<6}{:>14.4}{:>10.4}", frame.frame, frame.squared_error, frame.ssim);
    }
    let Some(states) = &scores.states else { return };
    let unit = task.cell.coordinates.unit();
    println!("\n{:<38}{:>10}{:>22}", format!("root mean square error, {unit}"), "", "without the offset");
    let row = |name: &str, error: f64, without: f64| println!("{name:<38}{error:>10.4}{without:>22.4}");
    row("encoded positions", states.encoded, states.encoded_without_offset);
    row("predicted positions, T_pred", states.predicted, states.predicted_without_offset);
    if let (Some(error), Some(without)) = (states.extrapolated, states.extrapolated_without_offset) {
        row("predicted positions, T_ext", error, without);
    }
    println!("velocity at the last input frame      {:>10.4} {unit} per time unit", states.initial_velocity);
    println!("velocity, T_pred                      {:>10.4} {unit} per time unit", states.predicted_velocity);
}
