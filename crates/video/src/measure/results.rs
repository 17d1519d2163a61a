//! measurement.json: what was measured. The one writer and the one reader of that file.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use paig::network::system::SystemTable;
use paig::support::output::has_keys;
use paig::support::{atomic, storage};
use paig::tasks::video::Video;

/// File of an equation with the term that it lacks.
pub const EXTENDED: &str = "extended-equation.toml";
/// Version of the file's form.
pub const FORMAT: u32 = 1;
pub const MEASUREMENT: &str = "measurement.json";

/// A measured run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    pub format: u32,
    pub task: String,
    /// Names of the videos' files.
    pub videos: Vec<String>,
    /// Frames that were looked at, and of them those that were learned from.
    pub frames: usize,
    pub learned_frames: usize,
    pub seconds_between_frames: f64,
    /// For people: where the equation stands.
    pub equation: String,
    /// Which measure of the positions was taken.
    pub by: String,
    pub quantities: Vec<Quantity>,
    pub held_out: HeldOut,
    pub residuals: Residuals,
    /// The equation and those it was compared with; empty where there was none.
    #[serde(default)]
    pub alternatives: Vec<Alternative>,
    /// The term that the equation lacks; none where no term explains clearly more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missing: Option<MissingTerm>,
    /// What a person should know.
    pub notes: Vec<String>,
    /// Geometry, scale and equation; none in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<SceneRecord>,
    /// Diameters of the objects, pixels of the video, where they were tracked.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub diameters: Vec<f64>,
    /// Whether the numbers can be quoted; none in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Judgement>,
    /// Of the run, and of the measurement.
    pub training_seconds: Option<f64>,
    pub seconds: f64,
}

/// What a fit to other positions of the same video needs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneRecord {
    pub system: SystemTable,
    /// Without the places of its files.
    pub video: Video,
}

/// A parameter, or what the motion shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Quantity {
    pub name: String,
    /// In its unit. Parameters and times come in metres, if the scale is known, and seconds; an amplitude and what is seen beside
    /// the state always in pixels of the video. `?`: as in the equation, whose unit is not known.
    pub value: f64,
    /// 95 % interval; none of what does not show in the motion.
    pub low: Option<f64>,
    pub high: Option<f64>,
    pub unit: String,
    /// In pixels of a frame and the unit of `dt`, as the equation has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_frames: Option<f64>,
    /// What the fit to the other observation says, of a tracker or of a model, with its 95 % interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_tracker: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracker_low: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracker_high: Option<f64>,
    /// By each take alone, where the scatter of several is part of the interval.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub takes: Vec<TakeEstimate>,
    /// Whether the value can be quoted with its interval; none in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<Outcome>,
    #[serde(skip)]
    pub kind: QuantityKind,
}

/// What a quantity is about. The verdict rests on the first kind that there is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum QuantityKind {
    /// What drives the motion: `time^-2` in its unit, or a length beside gravity in an equation that states its unit.
    Force,
    /// Friction, restitution, ratios of masses, times. A friction is known of anything that moves evenly.
    #[default]
    Other,
    /// Where something is, how long, how it is turned: known of any motion.
    Place,
}

/// A quantity by one take alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TakeEstimate {
    /// Name of its video, with its frames.
    pub video: String,
    pub value: f64,
    pub low: f64,
    pub high: f64,
}

/// How well the held-out part of the videos is predicted from the rest: root mean square distances.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// In which the objects are seen.
    pub frames: usize,
    /// `px` of the video, or `rad`.
    pub unit: String,
    pub error: f64,
    /// Of the two baselines.
    pub constant_velocity: f64,
    pub tracker_fit: Option<f64>,
    pub percent_of_amplitude: f64,
    /// Metres to a pixel of the video, if known.
    pub metres_per_unit: Option<f64>,
}

/// How far a number can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It can be quoted with its interval.
    Found,
    /// Something speaks against it.
    Doubtful,
    /// It says nothing.
    NotFound,
}

/// A verdict with its reasons.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    pub outcome: Outcome,
    /// What speaks against the numbers, the gravest first; empty where nothing does.
    pub reasons: Vec<String>,
}

impl Display for Outcome {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        f.write_str(match self {
            Outcome::Found => "found",
            Outcome::Doubtful => "doubtful",
            Outcome::NotFound => "not found",
        })
    }
}

/// What the fit leaves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Residuals {
    /// `px` of the video, or `rad`.
    pub unit: String,
    /// What a residual of one coordinate usually is, over the whole video and over short parts with a state of their own; none of
    /// videos too short for parts.
    pub usual: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usual_in_pieces: Option<f64>,
    /// Root mean square distance, of the frames that were learned from.
    pub distance: f64,
    /// From 1 frame apart on.
    pub autocorrelation: Vec<f64>,
    /// Frames that together hold as much as one independent one.
    pub frames_in_one: f64,
    /// Frames of a block of the bootstrap.
    pub block: usize,
}

/// A term that the recording asks for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MissingTerm {
    pub name: String,
    /// Of the term alone, in metres if the scale is known, else pixels of the video, and seconds.
    pub quantities: Vec<Quantity>,
    /// Gain of the Bayesian criterion.
    pub gain: f64,
    /// Root mean square distances before and after, in the unit of the residuals: of what is learned from and what is held out.
    pub residual: [f64; 2],
    pub held_out_error: [f64; 2],
    /// Value with the term over the value without it, of each parameter of the equation.
    #[serde(default)]
    pub factors: BTreeMap<String, f64>,
    /// The whole equation with the term, as a file for `--equation`; none of what the camera does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub equation: Option<String>,
}

/// An equation that was fitted to the same positions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alternative {
    pub equation: String,
    /// Parameters and initial states.
    pub unknowns: usize,
    /// Root mean square distances, in the unit of the residuals.
    pub residual: f64,
    pub held_out_error: f64,
    pub aic: f64,
    pub bic: f64,
    pub parameters: BTreeMap<String, f64>,
}

impl Quantity {
    /// With the 95 % interval of its draws, if there are any; those that are not finite count on neither side.
    pub fn new(name: &str, value: f64, draws: Vec<f64>) -> Self {
        let mut draws: Vec<f64> = draws.into_iter().filter(|x| x.is_finite()).collect();
        draws.sort_by(f64::total_cmp);
        let quantile = |share: f64| {
            let place = share * (draws.len().max(1) - 1) as f64;
            let (below, above) = (draws.get(place.floor() as usize), draws.get(place.ceil() as usize));
            below.zip(above).map(|(below, above)| below + (above - below) * place.fract())
        };
        let (low, high) = (quantile(0.025), quantile(0.975));
        Quantity {
            name: name.into(),
            value,
            low,
            high,
            unit: String::new(),
            in_frames: None,
            by_tracker: None,
            tracker_low: None,
            tracker_high: None,
            takes: Vec::new(),
            outcome: None,
            kind: QuantityKind::default(),
        }
    }

    /// The interval, its ends written so; none where there is none.
    pub fn interval(&self, digits: impl Fn(f64) -> String) -> Option<String> {
        Some(format!("{} to {}", digits(self.low?), digits(self.high?)))
    }

    #[must_use]
    pub fn in_unit(self, unit: String) -> Self {
        Quantity { unit, ..self }
    }

    #[must_use]
    pub fn in_frames(self, value: f64) -> Self {
        Quantity { in_frames: Some(value), ..self }
    }

    #[must_use]
    pub fn of_kind(self, kind: QuantityKind) -> Self {
        Quantity { kind, ..self }
    }

    /// The same with what another observation says of it.
    #[must_use]
    pub fn beside(self, other: Option<&Quantity>) -> Self {
        let Some(other) = other else { return self };
        Quantity { by_tracker: Some(other.value), tracker_low: other.low, tracker_high: other.high, ..self }
    }
}

impl Measurement {
    /// The file as one that the program recognizes.
    pub(super) fn is_in(json: &[u8]) -> bool {
        has_keys(json, &["format", "task", "videos", "quantities"])
    }

    pub fn quantity(&self, name: &str) -> Option<&Quantity> {
        self.quantities.iter().find(|quantity| quantity.name == name)
    }

    /// # Errors
    /// A missing or damaged file, or one of a newer form.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(MEASUREMENT);
        let text = storage::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let measurement: Self =
            serde_json::from_slice(&text).with_context(|| format!("{} is damaged", path.display()))?;
        ensure!(measurement.format <= FORMAT, "{} is of a newer form; use a newer program", path.display());
        Ok(measurement)
    }

    /// # Errors
    /// A full disk.
    pub fn write(&self, folder: &Path) -> Result<()> {
        atomic::write_file(&folder.join(MEASUREMENT), |file| Ok(serde_json::to_writer_pretty(file, self)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantity_without_draws_has_no_interval() {
        let draws = |count: u32| (0..count).map(f64::from).collect();
        for (count, interval) in [(0, None), (101, Some("2.5 to 97.5"))] {
            let quantity = Quantity::new("a", 50.0, draws(count));
            let read: Quantity = serde_json::from_str(&serde_json::to_string(&quantity).unwrap()).unwrap();
            assert_eq!((read.interval(|end| end.to_string()).as_deref(), read), (interval, quantity));
        }
    }
}
