//! How a dataset file was made: all that decides its content. Stands beside the true states, as JSON.

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};

use crate::network::System;
use crate::network::physics_models::losses::Loss;
use crate::tasks::scene::{Background, Look, Scene};

/// Version of the form in the file.
pub const FORMAT: u32 = 1;
/// To be raised whenever the same settings would make other clips.
pub const GENERATOR_VERSION: u32 = 1;

/// Clips in each split.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    pub train: usize,
    pub valid: usize,
    pub test: usize,
}

/// The settings of a file that was generated here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GeneratorSettings {
    pub format: u32,
    pub generator: u32,
    /// Name of the task that it was made for.
    pub task: String,
    pub seed: u64,
    pub clips: Counts,
    /// Frames of a clip.
    pub frames: usize,
    /// Side of a frame, pixels.
    pub side: usize,
    pub channels: usize,
    pub objects: usize,
    /// Time between two frames.
    pub dt: f64,
    /// Euler steps a frame.
    pub substeps: usize,
    pub scene: Scene,
    pub background: Background,
    /// Checksum of the equation and its numbers, where the objects move by those of the task, not by the scene's. None in
    /// files of before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub equation: Option<u64>,
    /// Checksum of the pictures that were drawn; none of plain balls and bars.
    pub source_images: Option<u64>,
    /// None of clips in which nothing but the motion is drawn at random.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_floor: Option<NoiseFloor>,
}

/// What is left of the losses of a model that knows the motion and draws the mean over all that is not motion: noise,
/// light, another background or distractor in each clip. Squared differences of 0..1, summed over the pixels and
/// channels of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NoiseFloor {
    /// Of L_rec. The model sees by how much the camera shook.
    pub reconstruction: f64,
    /// Of L_pred and L_extrap. How the camera will shake nobody knows.
    pub prediction: f64,
    /// Of a model that must tell the motion from the input frames. None in files of before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forecast: Option<Forecast>,
}

impl NoiseFloor {
    /// The least that is to be expected of a loss: of L_pred and L_extrap that of a forecast, where it was measured.
    pub fn of(&self, loss: Loss) -> f64 {
        match loss {
            Loss::Recons => self.reconstruction,
            Loss::Pred => self.forecast.map_or(self.prediction, |forecast| forecast.prediction),
            Loss::Extrap => self.forecast.map_or(self.prediction, |forecast| forecast.extrapolation),
        }
    }
}

/// What is left of the losses of a model that knows the law, the looks and the noise, and reads the start of the motion
/// from the input frames as exactly as the noise permits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Forecast {
    /// Of L_pred.
    pub prediction: f64,
    /// Of L_extrap.
    pub extrapolation: f64,
}

impl GeneratorSettings {
    /// All but what follows from the rest, in a line. Files of earlier versions hold this line instead of the settings, so
    /// it must not change.
    pub fn text(&self) -> String {
        let GeneratorSettings { generator, task, seed, frames, side, dt, substeps, scene, .. } = self;
        let Counts { train, valid, test } = self.clips;
        let mut text = format!(
            "generator {generator}, task {task}, seed {seed}, clips {train}+{valid}+{test} of {frames} frames, side \
             {side}, dt {dt}, substeps {substeps}, {scene:?}"
        );
        // An undamped spring's line leaves the damping out.
        text = text.replace(", damping: 0.0 }", " }");
        if self.background != scene.background() {
            text += &format!(", background {:?}", self.background);
        }
        if let Some(checksum) = self.source_images {
            text += &format!(", source images {checksum:016x}");
        }
        text
    }

    /// Whether pictures are drawn in such clips.
    pub(crate) fn draws_pictures(look: Look, background: Background) -> bool {
        let from_files = matches!(background, Background::Cifar | Background::RandomCifar | Background::Picture);
        from_files || look == Look::Digits
    }
}

/// What is known of how a file was made.
#[derive(Debug, Clone, PartialEq)]
pub enum Provenance {
    Settings(Box<GeneratorSettings>),
    /// The line of an earlier version.
    Earlier(String),
}

impl Provenance {
    /// From what stands in a file.
    ///
    /// # Errors
    /// Damaged or newer settings.
    pub fn parse(text: &str) -> Result<Self> {
        if !text.starts_with('{') {
            return Ok(Provenance::Earlier(text.into()));
        }
        let settings: GeneratorSettings = serde_json::from_str(text).context("the settings are damaged")?;
        if settings.format > FORMAT {
            bail!("the settings have form {}; this program knows forms up to {FORMAT}", settings.format);
        }
        Ok(Provenance::Settings(Box::new(settings)))
    }

    /// What noise leaves of the losses, if any was measured.
    pub fn noise_floor(&self) -> Option<NoiseFloor> {
        match self {
            Provenance::Settings(settings) => settings.noise_floor,
            Provenance::Earlier(_) => None,
        }
    }

    /// As it stands in a file.
    pub fn to_file(&self) -> String {
        match self {
            Provenance::Settings(settings) => serde_json::to_string(settings).expect("settings are plain data"),
            Provenance::Earlier(text) => text.clone(),
        }
    }

    /// In a line, the same for the same settings in whatever version they were written.
    pub fn text(&self) -> String {
        match self {
            Provenance::Settings(settings) => settings.text(),
            Provenance::Earlier(text) => text.clone(),
        }
    }

    /// What differs from the clips that these settings would make, in lines; none if nothing does, as far as the file says.
    pub fn difference(&self, asked: &GeneratorSettings) -> Option<String> {
        let differ = |there: &str, asked: &str| Some(format!("there: {there}, asked: {asked}"));
        if self.text() != asked.text() {
            return differ(&self.text(), &asked.text());
        }
        let Provenance::Settings(there) = self else { return None };
        if there.objects != asked.objects {
            return differ(&format!("{} objects", there.objects), &asked.objects.to_string());
        }
        let other = there.equation.zip(asked.equation).is_some_and(|(there, asked)| there != asked);
        other.then(|| "the equation is another, or a true value of its parameters".into())
    }

    /// A value of the line of an earlier version: what stands behind the word.
    fn earlier<'a>(text: &'a str, word: &str) -> Option<&'a str> {
        text.split(", ").find_map(|part| part.strip_prefix(word)?.strip_prefix(' '))
    }

    /// Name of the task that the clips were made for.
    pub fn task(&self) -> Option<&str> {
        match self {
            Provenance::Settings(settings) => Some(&settings.task),
            Provenance::Earlier(text) => Self::earlier(text, "task"),
        }
    }

    /// Time between two frames.
    fn dt(&self) -> Option<f64> {
        match self {
            Provenance::Settings(settings) => Some(settings.dt),
            Provenance::Earlier(text) => Self::earlier(text, "dt")?.parse().ok(),
        }
    }

    /// Distance of an object's centre from a wall at which it touches, pixels.
    fn wall_margin(&self) -> Option<f64> {
        match self {
            Provenance::Settings(settings) => Some(settings.scene.wall_margin()),
            Provenance::Earlier(_) => None,
        }
    }

    /// Refuses clips whose time between frames, number of objects or walls are not the system's: a model would learn
    /// wrong numbers from them.
    ///
    /// # Errors
    /// What differs, and how to take it.
    pub fn check(&self, system: &System) -> Result<()> {
        if let Some(dt) = self.dt() {
            ensure!(
                dt == system.dt,
                "it was made with dt {dt}, the task has {}; take the data's with --set task.system.dt={dt:?}",
                system.dt
            );
        }
        if let Provenance::Settings(settings) = self {
            ensure!(
                settings.objects == system.objects,
                "it shows {} objects, the task has {}; take another file or another task",
                settings.objects,
                system.objects
            );
        }
        match self.wall_margin().filter(|_| system.cell.walls) {
            Some(margin) if margin != system.walls.near => bail!(
                "its walls turn objects {margin} px from the edge, the task's {} px; take the data's with \
                 --set task.system.wall_margin={margin:?}",
                system.walls.near
            ),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks;

    fn settings() -> GeneratorSettings {
        let task = tasks::builtin("bouncing_balls").unwrap();
        let scene = task.scene.unwrap();
        GeneratorSettings {
            format: FORMAT,
            generator: 1,
            task: task.name,
            seed: 3,
            clips: Counts { train: 5, valid: 2, test: 4 },
            frames: 12,
            side: 32,
            channels: 3,
            objects: 2,
            dt: 0.3,
            substeps: 10,
            background: scene.background(),
            scene,
            equation: None,
            source_images: None,
            noise_floor: None,
        }
    }

    #[test]
    fn settings_read_back_and_their_line_is_that_of_earlier_versions() {
        let here = Provenance::Settings(Box::new(settings()));
        assert_eq!(Provenance::parse(&here.to_file()).unwrap(), here);
        let line = "generator 1, task bouncing_balls, seed 3, clips 5+2+4 of 12 frames, side 32, dt 0.3, substeps 10, \
                    Scene { motion: Bouncing, speed: [8.0, 8.0], radius: 2.0, look: Balls }";
        assert_eq!(here.text(), line);
        let earlier = Provenance::parse(line).unwrap();
        assert_eq!((earlier.text().as_str(), earlier.task(), earlier.dt()), (line, Some("bouncing_balls"), Some(0.3)));
        let newer = here.to_file().replace("\"format\":1", "\"format\":2");
        assert!(Provenance::parse(&newer).unwrap_err().to_string().contains("forms up to 1"));
    }

    #[test]
    fn clips_of_another_system_are_refused_with_the_way_out() {
        let system = tasks::builtin("bouncing_balls").unwrap().system;
        let said = |change: fn(&mut GeneratorSettings)| {
            let mut settings = settings();
            change(&mut settings);
            Provenance::Settings(Box::new(settings)).check(&system).unwrap_err().to_string()
        };
        assert!(said(|it| it.dt = 0.2).contains("--set task.system.dt=0.2"));
        assert!(said(|it| it.scene.radius = 4.0).contains("--set task.system.wall_margin=4.0"));
        assert!(said(|it| it.objects = 3).contains("3 objects"));
        Provenance::Settings(Box::new(settings())).check(&system).unwrap();
    }
}
