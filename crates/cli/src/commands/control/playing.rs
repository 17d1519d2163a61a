//! All planners play, and a table says what they reached.

use std::path::Path;

use anyhow::{Context, Result, ensure};

use super::setting::Setting;
use super::{Arguments, Who};
use paig::support::storage::storage;
use paig_experiments::control::episode::{Episode, play};
use paig_experiments::control::figures::{self, Course};
use paig_experiments::control::results::{Row, mean_and_interval};
use paig_experiments::control::reward::Reward;
use paig_terminal::ending::begin_work;
use paig_terminal::say;

/// Notes of a planner that are printed; how many there are is said in any case.
const NOTES: usize = 3;

/// What a planner did in all episodes.
pub(super) struct Played {
    pub(super) who: Who,
    pub(super) name: &'static str,
    /// Mean return and its interval.
    pub(super) mean: [f64; 3],
    pub(super) returns: Vec<f64>,
    pub(super) first: Course,
    pub(super) ms_per_decision: f64,
    pub(super) notes: Vec<String>,
}

impl Arguments {
    /// Plays all planners, prints a table, draws what they did, and returns the rows of the results.
    pub(super) fn play_all(&self, out: &Path) -> Result<Vec<Row>> {
        ensure!(self.study.is_none(), "a study's lines cannot hold a study");
        ensure!(self.episodes > 0, "--episodes must be at least 1");
        let setting = self.setting()?;
        storage().create_folder(out).with_context(|| format!("cannot create {}", out.display()))?;
        // What fails should do so before the first episode.
        for who in self.planner.iter().copied() {
            let model = who.sees().then(|| self.model_of(who, &setting)).transpose()?;
            self.controller(who, &setting, model.as_ref())?;
        }
        begin_work();
        if let Reward::Goal(goal) = &setting.rules.reward
            && let Some(frame) = setting.world()?.show(&goal.place)
        {
            figures::write_frame(&out.join("goal.png"), &frame)?;
        }
        // What the bound reached is needed for every row.
        let bound = self.play(Who::TrueState, &setting, out)?;
        let upper_bound = bound.mean[0];
        let mut all = Vec::new();
        say!("{:<14}{:>10}{:>20}{:>14}{:>14}", "planner", "return", "95 %", "upper bound", "ms/decision");
        let others = self.planner.iter().filter(|who| **who != Who::TrueState);
        all.extend(self.planner.contains(&Who::TrueState).then_some(Ok(bound)));
        all.extend(others.map(|who| self.play(*who, &setting, out)));
        let all =
            all.into_iter().map(|played| played.inspect(|it| it.print(upper_bound))).collect::<Result<Vec<_>>>()?;
        let returns: Vec<_> = all.iter().map(|it| (it.name, it.returns.as_slice(), it.mean)).collect();
        figures::write_returns(&out.join("returns.png"), &returns)?;
        let courses: Vec<_> = all.iter().map(|it| (it.name, &it.first)).collect();
        figures::write_courses(
            &out.join("course.png"),
            setting.task.system.cell.coordinates,
            &setting.rules,
            &courses,
        )?;
        Ok(all.iter().map(|played| self.row(&setting, played, upper_bound)).collect())
    }

    /// Plays all episodes of one planner and writes the animation of the first.
    pub(super) fn play(&self, who: Who, setting: &Setting, out: &Path) -> Result<Played> {
        let mut world = setting.world()?;
        let model = who.sees().then(|| self.model_of(who, setting)).transpose()?;
        let mut controller = self.controller(who, setting, model.as_ref())?;
        let mut episodes: Vec<Episode> = Vec::new();
        for index in 0..self.episodes {
            let mut episode = play(world.as_mut(), &mut controller, self.seed.wrapping_add(index as u64), index == 0);
            if index == 0 {
                let film = out.join(format!("{}.gif", who.name(model.as_ref()).replace(' ', "_")));
                figures::write_film(&film, &episode, &mut controller, world.as_ref())?;
            }
            episode.frames.clear();
            episodes.push(episode);
        }
        let returns: Vec<f64> = episodes.iter().map(|episode| episode.total).collect();
        let seconds: f64 = episodes.iter().map(|episode| episode.deciding.as_secs_f64()).sum();
        let decisions: usize = episodes.iter().map(|episode| episode.decisions).sum();
        let notes = episodes.iter().enumerate();
        Ok(Played {
            who,
            name: who.name(model.as_ref()),
            mean: mean_and_interval(&returns, self.seed).context("no episodes")?,
            ms_per_decision: 1000.0 * seconds / decisions.max(1) as f64,
            notes: notes
                .flat_map(|(index, played)| played.notes.iter().map(move |note| format!("episode {index}, {note}")))
                .collect(),
            first: Course::of(&episodes[0]),
            returns,
        })
    }
}

impl Played {
    fn print(&self, upper_bound: f64) {
        let [mean, low, high] = self.mean;
        let interval = format!("{low:.2} to {high:.2}");
        let ms = self.ms_per_decision;
        say!("{:<14}{mean:>10.2}{interval:>20}{upper_bound:>14.2}{ms:>14.1}", self.name);
        self.notes.iter().take(NOTES).for_each(|note| say!("  note: {note}"));
        if self.notes.len() > NOTES {
            say!("  and {} more notes like these", self.notes.len() - NOTES);
        }
    }
}
