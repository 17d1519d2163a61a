//! What stands in the results.

use std::path::Path;

use super::play::Played;
use super::scenario::Scenario;
use super::{Experiment, PlannerKind, SearchMethod};
use crate::baselines::end_to_end::scores::EndToEndScores;
use crate::control::environment::Rules;
use crate::control::pendulum::PendulumSettings;
use crate::control::results::PlannerRow;
use crate::control::reward::{GoalPath, Reward};
use paig::runs::run::StoredRun;

impl Experiment {
    pub(super) fn row(&self, scenario: &Scenario, played: &Played) -> PlannerRow {
        let run = self.run.as_ref().filter(|_| played.planner.has_run());
        let degrees = |angle: f64| if scenario.pendulum.is_some() { angle.to_degrees() } else { angle };
        let goal = match &scenario.rules.reward {
            Reward::Goal(goal) => Some(degrees(goal.place[0])),
            Reward::Gymnasium => None,
        };
        PlannerRow {
            task: scenario.task.name.clone(),
            planner: played.name.into(),
            model: run.map(|run| run.display().to_string()),
            clips: run.and_then(|run| training_clips(run)),
            goal,
            gravity: scenario.pendulum.map(|pendulum| pendulum.gravity),
            setting: self.unusual(scenario, played.planner),
            episodes: self.episodes,
            return_mean: played.mean[0],
            return_low: played.mean[1],
            return_high: played.mean[2],
            upper_bound: played.upper_bound,
            ms_per_decision: played.ms_per_decision,
        }
    }

    /// Settings that differ from the usual ones, beyond goal and gravity.
    pub(super) fn unusual(&self, scenario: &Scenario, kind: PlannerKind) -> String {
        let mut parts = Vec::new();
        let mut say = |shown: bool, text: String| parts.extend(shown.then_some(text));
        say(self.gymnasium, "Gymnasium's cost".into());
        say(self.search == SearchMethod::PathIntegral, "path integrals".into());
        say(self.goal_image.is_some(), "goal by image".into());
        // The row's goal is the first coordinate.
        if let Reward::Goal(GoalPath { place, .. }) = &scenario.rules.reward
            && let [_, y] = place[..]
        {
            say(true, format!("goal at y {y}"));
        }
        say(self.goal_swing != 0.0, format!("goal swings by {} in {} steps", self.goal_swing, self.goal_period));
        say(self.frames_before != 3, format!("{} frames before", self.frames_before));
        let Rules { steps, .. } = scenario.rules;
        say(steps != scenario.usual_steps, format!("{steps} steps"));
        if let Some(PendulumSettings { length, mass, .. }) = scenario.pendulum {
            say(length != 1.0, format!("length {length}"));
            say(mass != 1.0, format!("mass {mass}"));
        }
        say(self.start_rate.is_some(), format!("first rate {}", self.start_rate.unwrap_or_default()));
        say(self.dropped > 0.0, format!("{:.0} % of the frames dropped", 100.0 * self.dropped));
        say(self.hidden > 0.0, format!("{:.0} % of the frames hidden", 100.0 * self.hidden));
        let learned = kind == PlannerKind::Learned;
        say(learned && !self.model_set.is_empty(), format!("model's {}", self.model_set.join(", ")));
        let again = format!("{} learned again from {} frames", self.relearn.join(", "), self.relearn_frames);
        say(learned && !self.relearn.is_empty(), again);
        parts.join("; ")
    }
}

/// Clips that a run was trained on, if it says so.
fn training_clips(run: &Path) -> Option<usize> {
    let whole = EndToEndScores::read(run).ok().flatten().map(|scores| scores.training_clips);
    whole.or_else(|| StoredRun::read(run).ok()?.data.map(|data| data.clips[0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_and_the_whole_goal_stand_in_the_results() {
        let unusual = |experiment: Experiment| experiment.unusual(&experiment.scenario().unwrap(), PlannerKind::Zero);
        let puck = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/control/puck.toml");
        let of_puck = Experiment { task: puck.into(), goal: vec![22.0, 16.5], steps: Some(7), ..Experiment::default() };
        assert_eq!(unusual(of_puck), "goal at y 16.5; 7 steps");
        let usual = Experiment { steps: Some(50), goal: vec![20.0], ..Experiment::default() };
        assert_eq!(unusual(usual), "");
        let gymnasium = Experiment { gymnasium: true, steps: Some(50), ..Experiment::default() };
        assert_eq!(unusual(gymnasium), "Gymnasium's cost; 50 steps");
    }
}
