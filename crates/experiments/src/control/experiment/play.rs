//! All planners play the same episodes.

use std::path::Path;

use anyhow::{Context, Result, ensure};

use super::scenario::Scenario;
use super::{Experiment, ExperimentEvent, ExperimentWatch, PlannerKind};
use crate::control::episode::{Episode, play};
use crate::control::figures::{self, EpisodeCourse};
use crate::control::results::{ControlResults, PlannerRow, mean_and_interval};
use crate::control::reward::Reward;
use paig::Error;

/// All episodes of a planner.
#[derive(Debug, Clone, PartialEq)]
pub struct Played {
    pub planner: PlannerKind,
    /// Its name in the results.
    pub name: &'static str,
    /// Mean return and the ends of its 95 % interval.
    pub mean: [f64; 3],
    /// Mean return of the planner that knows state and equation.
    pub upper_bound: f64,
    /// The return of each episode.
    pub returns: Vec<f64>,
    /// The first episode.
    pub first: EpisodeCourse,
    /// Processor time.
    pub ms_per_decision: f64,
    /// Decisions without a sight or a plan.
    pub notes: Vec<String>,
}

impl Experiment {
    /// Plays the episodes of all planners and draws them into `out`. Returns the rows of the results; none where it was
    /// stopped.
    ///
    /// # Errors
    /// Settings that contradict each other or the task, a run that is missing or of another model, files that cannot be
    /// written.
    pub fn run(&self, out: &Path, watch: ExperimentWatch) -> Result<Option<Vec<PlannerRow>>, Error> {
        let scenario = self.prepare(out)?;
        (watch.observe)(ExperimentEvent::Begins);
        self.rows(&scenario, out, watch).map_err(Error::of_work)
    }

    fn prepare(&self, out: &Path) -> Result<Scenario> {
        ensure!(self.episodes > 0, "--episodes must be at least 1");
        let scenario = self.scenario()?;
        ControlResults::claim(out)?;
        // What fails should do so before the first episode.
        for kind in self.planners.iter().copied() {
            let model = kind.sees().then(|| self.model_of(kind, &scenario)).transpose()?;
            self.controller(kind, &scenario, model.as_ref())?;
        }
        Ok(scenario)
    }

    fn rows(&self, scenario: &Scenario, out: &Path, watch: ExperimentWatch) -> Result<Option<Vec<PlannerRow>>> {
        if let Reward::Goal(goal) = &scenario.rules.reward
            && let Some(frame) = scenario.world()?.show(&goal.place)
        {
            figures::write_frame(&out.join("goal.png"), &frame)?;
        }
        let Some(all) = self.play_all(scenario, out, watch)? else { return Ok(None) };
        let returns: Vec<_> = all.iter().map(|it| (it.name, it.returns.as_slice(), it.mean)).collect();
        figures::write_returns(&out.join("returns.png"), &returns)?;
        let courses: Vec<_> = all.iter().map(|it| (it.name, &it.first)).collect();
        let coordinates = scenario.task.system.cell.coordinates;
        figures::write_courses(&out.join("course.png"), coordinates, &scenario.rules, &courses)?;
        Ok(Some(all.iter().map(|played| self.row(scenario, played)).collect()))
    }

    /// The planner that knows state and equation plays first: every row holds its return. It stands in the results only if
    /// it was asked for.
    fn play_all(&self, scenario: &Scenario, out: &Path, watch: ExperimentWatch) -> Result<Option<Vec<Played>>> {
        let Some(bound) = self.play(PlannerKind::TrueState, scenario, out, watch)? else { return Ok(None) };
        let upper_bound = bound.mean[0];
        (watch.observe)(ExperimentEvent::UpperBound(upper_bound));
        let mut all = Vec::new();
        let mut add = |played: Played| {
            let played = Played { upper_bound, ..played };
            (watch.observe)(ExperimentEvent::Played(&played));
            all.push(played);
        };
        if self.planners.contains(&PlannerKind::TrueState) {
            add(bound);
        }
        for kind in self.planners.iter().copied().filter(|kind| *kind != PlannerKind::TrueState) {
            let Some(played) = self.play(kind, scenario, out, watch)? else { return Ok(None) };
            add(played);
        }
        Ok(Some(all))
    }

    /// Plays all episodes of one planner and writes the animation of the first; none where it was stopped.
    fn play(
        &self,
        kind: PlannerKind,
        scenario: &Scenario,
        out: &Path,
        watch: ExperimentWatch,
    ) -> Result<Option<Played>> {
        let mut world = scenario.world()?;
        let model = kind.sees().then(|| self.model_of(kind, scenario)).transpose()?;
        let mut controller = self.controller(kind, scenario, model.as_ref())?;
        let name = kind.name(model.as_ref());
        let mut episodes: Vec<Episode> = Vec::new();
        for index in 0..self.episodes {
            if (watch.stop)() {
                return Ok(None);
            }
            let mut episode = play(world.as_mut(), &mut controller, self.seed.wrapping_add(index as u64), index == 0);
            if index == 0 {
                let film = out.join(format!("{}.gif", name.replace(' ', "_")));
                figures::write_film(&film, &episode, &mut controller, world.as_ref())?;
            }
            episode.frames.clear();
            let (done, of, reward) = (index + 1, self.episodes, episode.total);
            (watch.observe)(ExperimentEvent::Episode { planner: name, done, of, reward });
            episodes.push(episode);
        }
        let returns: Vec<f64> = episodes.iter().map(|episode| episode.total).collect();
        let seconds: f64 = episodes.iter().map(|episode| episode.deciding.as_secs_f64()).sum();
        let decisions: usize = episodes.iter().map(|episode| episode.decisions).sum();
        let notes = episodes.iter().enumerate();
        let mean = mean_and_interval(&returns, self.seed).context("no episodes")?;
        Ok(Some(Played {
            planner: kind,
            name,
            mean,
            upper_bound: mean[0],
            ms_per_decision: 1000.0 * seconds / decisions.max(1) as f64,
            notes: notes
                .flat_map(|(index, played)| played.notes.iter().map(move |note| format!("episode {index}, {note}")))
                .collect(),
            first: EpisodeCourse::of(&episodes[0]),
            returns,
        }))
    }
}
