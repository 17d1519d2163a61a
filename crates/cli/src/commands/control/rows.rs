//! What stands in the results.

use std::path::Path;

use super::playing::Played;
use super::setting::Setting;
use super::{Arguments, Method, Who};
use paig::runs::run::Run;
use paig_experiments::baselines::whole_models::scores::WholeScores;
use paig_experiments::control::environment::Rules;
use paig_experiments::control::pendulum::PendulumSettings;
use paig_experiments::control::results::Row;
use paig_experiments::control::reward::{Goal, Reward};

impl Arguments {
    pub(super) fn row(&self, setting: &Setting, played: &Played, upper_bound: f64) -> Row {
        let run = self.run.as_ref().filter(|_| played.who.has_run());
        let degrees = |angle: f64| if setting.pendulum.is_some() { angle.to_degrees() } else { angle };
        let goal = match &setting.rules.reward {
            Reward::Goal(goal) => Some(degrees(goal.place[0])),
            Reward::Gymnasium => None,
        };
        Row {
            task: setting.task.name.clone(),
            planner: played.name.into(),
            model: run.map(|run| run.display().to_string()),
            clips: run.and_then(|run| training_clips(run)),
            goal,
            gravity: setting.pendulum.map(|pendulum| pendulum.gravity),
            setting: self.unusual(setting, played.who),
            episodes: self.episodes,
            return_mean: played.mean[0],
            return_low: played.mean[1],
            return_high: played.mean[2],
            upper_bound,
            ms_per_decision: played.ms_per_decision,
        }
    }

    /// What of the setting is not as usual, beyond goal and gravity.
    pub(super) fn unusual(&self, setting: &Setting, who: Who) -> String {
        let mut parts = Vec::new();
        let mut say = |shown: bool, text: String| parts.extend(shown.then_some(text));
        say(self.gymnasium, "Gymnasium's cost".into());
        say(self.search == Method::PathIntegral, "path integrals".into());
        say(self.goal_image.is_some(), "goal by image".into());
        // The row's goal is the first coordinate.
        if let Reward::Goal(Goal { place, .. }) = &setting.rules.reward
            && let [_, y] = place[..]
        {
            say(true, format!("goal at y {y}"));
        }
        say(self.goal_swing != 0.0, format!("goal swings by {} in {} steps", self.goal_swing, self.goal_period));
        say(self.frames_before != 3, format!("{} frames before", self.frames_before));
        let Rules { steps, .. } = setting.rules;
        say(steps != setting.usual_steps, format!("{steps} steps"));
        if let Some(PendulumSettings { length, mass, .. }) = setting.pendulum {
            say(length != 1.0, format!("length {length}"));
            say(mass != 1.0, format!("mass {mass}"));
        }
        say(self.start_rate.is_some(), format!("first rate {}", self.start_rate.unwrap_or_default()));
        say(self.dropped > 0.0, format!("{:.0} % of the frames dropped", 100.0 * self.dropped));
        say(self.hidden > 0.0, format!("{:.0} % of the frames hidden", 100.0 * self.hidden));
        let learned = who == Who::Learned;
        say(learned && !self.model_set.is_empty(), format!("model's {}", self.model_set.join(", ")));
        let again = format!("{} learned again from {} frames", self.relearn.join(", "), self.relearn_frames);
        say(learned && !self.relearn.is_empty(), again);
        parts.join("; ")
    }
}

/// Clips that a run was trained on, if it says so.
fn training_clips(run: &Path) -> Option<usize> {
    let whole = WholeScores::read(run).ok().flatten().map(|scores| scores.training_clips);
    whole.or_else(|| Run::read(run).ok()?.data.map(|data| data.clips[0]))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::super::Line;
    use super::*;

    #[test]
    fn steps_and_the_whole_goal_stand_in_the_results() {
        let unusual = |words: &str| {
            let arguments = Line::try_parse_from(words.split(' ')).unwrap().arguments;
            arguments.unusual(&arguments.setting().unwrap(), Who::Zero)
        };
        assert_eq!(
            unusual(concat!(
                "control --task ",
                env!("CARGO_MANIFEST_DIR"),
                "/../../configs/control/puck.toml --goal 22,16.5 --steps 7"
            )),
            "goal at y 16.5; 7 steps"
        );
        assert_eq!(unusual("control --steps 50 --goal 20"), "");
        assert_eq!(unusual("control --gymnasium --steps 50"), "Gymnasium's cost; 50 steps");
    }
}
