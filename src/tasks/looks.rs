//! How the objects of a scene look, what lies behind them and what else is there. Pure data, part of a task file.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};

use crate::support::toml_values::exact_if_given;

/// Greatest level of a texture, 0 to 1, where nothing is said.
const TEXTURE_BRIGHTNESS: f64 = 0.5;
/// Pixels a frame by which a drifting background moves, where nothing is said.
const DRIFT: f64 = 0.25;

/// `[scene.objects]`: how each ball looks. The default is discs of one size, each of another plain colour.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObjectLooks {
    /// Of each ball, 0 to 1 in each channel; empty for the usual ones.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub colours: Vec<Vec<f64>>,
    /// Of each ball as it is drawn, pixels; empty for the scene's, which in any case says where a ball meets a wall.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub radii: Vec<f64>,
    /// How much darker a ball is at its lower right edge than at its upper left one, 0 to 1.
    pub shading: f64,
    /// The half of each ball that has another colour; empty for none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub halves: Vec<Half>,
    /// A later ball covers the earlier ones in all channels. Otherwise balls on black are like lights: in each channel
    /// the brighter one shows. Before a background or a distractor they always cover each other.
    pub occlude: bool,
}

/// Half of a ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Half {
    pub colour: Vec<f64>,
    /// The side on which it lies, degrees: 0 right, 90 down.
    pub towards: f64,
}

impl ObjectLooks {
    /// Whether nothing is said.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// # Errors
    /// A list that is not as long as there are objects, or a number out of range; the message names it.
    pub(super) fn check(&self, objects: usize, channels: usize, side: usize) -> Result<()> {
        let ObjectLooks { colours, radii, shading, halves, occlude: _ } = self;
        for (key, length) in [("colours", colours.len()), ("radii", radii.len()), ("halves", halves.len())] {
            ensure!(
                length == 0 || length == objects,
                "objects.{key}: {length} of them for {objects} objects; one for each is needed"
            );
        }
        colours.iter().try_for_each(|colour| check_colour("objects.colours", colour, channels))?;
        halves.iter().try_for_each(|half| check_colour("objects.halves", &half.colour, channels))?;
        for radius in radii {
            check_radius("objects.radii", *radius, side)?;
        }
        ensure!((0.0..=1.0).contains(shading), "objects.shading = {shading}: must be 0 to 1");
        for Half { towards, .. } in halves {
            ensure!(towards.is_finite(), "objects.halves: towards = {towards}: must be an angle in degrees");
        }
        Ok(())
    }
}

/// What kind of thing lies behind the objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Background {
    /// One grey level, black by default; white behind a bar.
    Plain,
    /// The same darkened CIFAR-10 image in all clips.
    Cifar,
    /// A darkened CIFAR-10 image drawn for each clip.
    RandomCifar,
    /// Overlapping discs of many sizes and colours, the same in all clips.
    Texture,
    /// Others in each clip.
    RandomTexture,
    /// Smooth coloured clouds that change slowly; each clip begins at another time.
    Drifting,
    /// A picture from a file, the same in all clips.
    Picture,
}

impl Background {
    /// All kinds with their names as an option of a program.
    pub const NAMED: [(&str, Background); 7] = [
        ("plain", Background::Plain),
        ("cifar", Background::Cifar),
        ("random-cifar", Background::RandomCifar),
        ("texture", Background::Texture),
        ("random-texture", Background::RandomTexture),
        ("drifting", Background::Drifting),
        ("picture", Background::Picture),
    ];
}

/// `[scene.background]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BackgroundLook {
    pub kind: Background,
    /// Level of a plain background; greatest level of textures and clouds; what the levels of a picture are multiplied
    /// by. 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub brightness: Option<f64>,
    /// Pixels a frame by which each wave of drifting clouds moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drift: Option<f64>,
    /// PNG or JPEG of a picture, from the folder in which the program runs; it is scaled to the frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
}

impl BackgroundLook {
    /// A kind of which nothing else is said.
    pub fn of(kind: Background) -> Self {
        BackgroundLook { kind, brightness: None, drift: None, file: None }
    }

    /// [`Self::brightness`], or what it is by default.
    pub fn brightness(&self) -> f64 {
        self.brightness.unwrap_or(match self.kind {
            Background::Plain => 0.0,
            Background::Texture | Background::RandomTexture | Background::Drifting => TEXTURE_BRIGHTNESS,
            Background::Cifar | Background::RandomCifar | Background::Picture => 1.0,
        })
    }

    /// [`Self::drift`], or what it is by default.
    pub fn drift(&self) -> f64 {
        self.drift.unwrap_or(DRIFT)
    }

    /// Whether nothing is seen of it.
    pub(crate) fn is_black(&self) -> bool {
        self.kind == Background::Plain && self.brightness() == 0.0
    }

    /// Whether it differs from clip to clip.
    pub(crate) fn is_random(&self) -> bool {
        matches!(self.kind, Background::RandomCifar | Background::RandomTexture | Background::Drifting)
    }

    /// # Errors
    /// A number out of range, or a key that this kind does not have; the message names it.
    pub(super) fn check(&self) -> Result<()> {
        let BackgroundLook { kind, brightness, drift, file } = self;
        let as_in_file = || toml::Value::try_from(kind).map(|kind| kind.to_string()).unwrap_or_default();
        let only = |key: &str, given: bool, kinds: &[Background]| -> Result<()> {
            ensure!(!given || kinds.contains(kind), "background.{key} means nothing with kind = {}", as_in_file());
            Ok(())
        };
        use Background::{Drifting, Picture, Plain, RandomTexture, Texture};
        only("brightness", brightness.is_some(), &[Plain, Texture, RandomTexture, Drifting, Picture])?;
        only("drift", drift.is_some(), &[Drifting])?;
        only("file", file.is_some(), &[Picture])?;
        ensure!(file.is_some() || *kind != Picture, "background.file is missing: the PNG or JPEG of the picture");
        let brightness = self.brightness();
        ensure!((0.0..=1.0).contains(&brightness), "background.brightness = {brightness}: must be 0 to 1");
        let drift = self.drift();
        ensure!(drift.is_finite() && drift >= 0.0, "background.drift = {drift}: must be 0 or a positive number");
        Ok(())
    }
}

/// One of `[[scene.distractors]]`: a disc behind the objects that has no part in their physics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Distractor {
    /// 0 to 1 in each channel.
    pub colour: Vec<f64>,
    /// Pixels.
    pub radius: f64,
    /// Where it stands, pixels, the same in all clips. Without it each clip draws a place, or the place where a moving
    /// one begins.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "exact_if_given")]
    pub position: Option<[f64; 2]>,
    /// Pixels per time unit, in a direction drawn for each clip; the walls turn it back at its edge. 0 for a thing that
    /// stands still.
    #[serde(default)]
    pub speed: f64,
}

impl Distractor {
    /// Whether it differs from clip to clip.
    pub(crate) fn is_random(&self) -> bool {
        self.position.is_none()
    }

    /// # Errors
    /// A number out of range; the message names it.
    pub(super) fn check(&self, channels: usize, side: usize) -> Result<()> {
        let Distractor { colour, radius, position, speed } = self;
        check_colour("distractors.colour", colour, channels)?;
        check_radius("distractors.radius", *radius, side)?;
        ensure!(speed.is_finite() && *speed >= 0.0, "distractors.speed = {speed}: must be 0 or a positive number");
        if let Some(position) = position {
            ensure!(
                *speed == 0.0,
                "distractors.position is that of a thing that stands still; leave out position or speed"
            );
            let inside = 0.0..=side as f64;
            ensure!(position.iter().all(|x| inside.contains(x)), "distractors.position = {position:?}: lies outside");
        }
        Ok(())
    }
}

fn check_colour(key: &str, colour: &[f64], channels: usize) -> Result<()> {
    ensure!(
        colour.len() == channels && colour.iter().all(|level| (0.0..=1.0).contains(level)),
        "{key}: {colour:?} is no colour here; {channels} levels of 0 to 1 are needed"
    );
    Ok(())
}

pub(super) fn check_radius(key: &str, radius: f64, side: usize) -> Result<()> {
    let largest = side as f64 / 2.0;
    ensure!(radius >= 0.5 && radius < largest, "{key}: {radius} px: must be at least 0.5 and less than {largest}");
    Ok(())
}
