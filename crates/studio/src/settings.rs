//! Settings of a measurement, made by pointing, and the commands that they stand for.

use std::borrow::Cow;
use std::path::Path;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};

use crate::equations::AUTO;

/// Largest number of a pixel or a length that is taken.
const LARGEST: f64 = 1e6;
/// Most points on objects and most regions that are left out.
const MOST_MARKS: usize = 100;
const MOST_OBJECTS: usize = 8;

/// A length in the video that is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stick {
    /// Ends, pixels of the video from its top left corner.
    pub from: [f64; 2],
    pub to: [f64; 2],
    pub metres: f64,
}

/// A point on an object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mark {
    pub frame: usize,
    /// Pixels of the video from its top left corner.
    pub at: [f64; 2],
}

/// What is measured of a video, and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProjectSettings {
    /// First frame and the one after the last; all frames if absent.
    pub frames: Option<[usize; 2]>,
    /// Frames a second, in place of the video's own times.
    pub fps: Option<f64>,
    /// Left, top, width and height of the equation's frame, pixels of the video; the whole picture if absent.
    pub crop: Option<[u32; 4]>,
    pub stick: Option<Stick>,
    /// Origin of the axes, pixels of the video.
    pub origin: Option<[f64; 2]>,
    /// Angle of the x axis, degrees, counter-clockwise.
    pub angle: f64,
    /// Key of an equation.
    pub equation: String,
    /// Number of the measurement whose equation with the missing term is taken in place of it.
    pub extended: Option<usize>,
    pub objects: usize,
    pub marks: Vec<Mark>,
    /// Regions in which nothing is looked for: left, top, width, height.
    pub ignore: Vec<[usize; 4]>,
}

impl Default for ProjectSettings {
    fn default() -> Self {
        ProjectSettings {
            frames: None,
            fps: None,
            crop: None,
            stick: None,
            origin: None,
            angle: 0.0,
            equation: AUTO.into(),
            extended: None,
            objects: 1,
            marks: Vec::new(),
            ignore: Vec::new(),
        }
    }
}

impl ProjectSettings {
    /// # Errors
    /// Numbers that are not finite or beyond all videos, a stick without length.
    pub fn check(&self) -> Result<()> {
        let fine = |number: f64| number.is_finite() && number.abs() <= LARGEST;
        let place = |at: [f64; 2]| at.into_iter().all(fine);
        ensure!(self.frames.is_none_or(|[start, end]| start < end), "frames: expected a first one before the last one");
        ensure!(self.fps.is_none_or(|fps| fine(fps) && fps > 0.0), "fps: expected a positive number");
        ensure!(self.crop.is_none_or(|[.., width, height]| width > 0 && height > 0), "crop: expected an area");
        if let Some(stick) = self.stick {
            ensure!(place(stick.from) && place(stick.to), "stick: expected points in the video");
            ensure!(stick.from != stick.to, "stick: its ends are at one point");
            ensure!(fine(stick.metres) && stick.metres > 0.0, "stick: expected a positive length");
        }
        ensure!(self.origin.is_none_or(place) && fine(self.angle), "axes: expected a point and an angle");
        ensure!((1..=MOST_OBJECTS).contains(&self.objects), "objects: expected 1 to {MOST_OBJECTS}");
        let marks = self.marks.len().max(self.ignore.len());
        ensure!(marks <= MOST_MARKS, "expected at most {MOST_MARKS} points or regions, found {marks}");
        ensure!(self.marks.iter().all(|mark| place(mark.at)), "marks: expected points in the video");
        Ok(())
    }

    /// Options of the scene, which `measure` and `import` share.
    fn scene(&self) -> Vec<String> {
        let mut options = Vec::new();
        let mut option = |name: &str, value: String| options.extend([format!("--{name}"), value]);
        if let Some([start, end]) = self.frames {
            option("frames", format!("{start}..{end}"));
        }
        if let Some(fps) = self.fps {
            option("fps", fps.to_string());
        }
        if let Some([x, y, width, height]) = self.crop {
            option("crop", format!("{x},{y},{width},{height}"));
        }
        if let Some(Stick { from, to, metres }) = self.stick {
            let ends = [from[0], from[1], to[0], to[1]].map(|number| tenths(number).to_string());
            option("scale", format!("{},{metres}", ends.join(",")));
        }
        if let Some([x, y]) = self.origin {
            option("origin", format!("{},{}", tenths(x), tenths(y)));
        }
        if self.angle != 0.0 {
            option("angle", tenths(self.angle).to_string());
        }
        if self.objects > 1 {
            option("objects", self.objects.to_string());
        }
        options.push("--y-up".into());
        options
    }

    /// Arguments of the command that measures the video into a folder. The equation is a name or a file.
    pub fn measure(&self, video: &Path, equation: &str, out: &Path) -> Vec<String> {
        let mut arguments = vec!["measure".into(), video.display().to_string(), "--equation".into(), equation.into()];
        arguments.extend(self.scene());
        for Mark { frame, at: [x, y] } in &self.marks {
            arguments.extend(["--at".into(), format!("{frame}:{},{}", tenths(*x), tenths(*y))]);
        }
        for [x, y, width, height] in &self.ignore {
            arguments.extend(["--ignore".into(), format!("{x},{y},{width},{height}")]);
        }
        arguments.extend(["--out".into(), out.display().to_string()]);
        arguments
    }

    /// Arguments of the command that makes a task of the video.
    pub fn import(&self, video: &Path, equation: &str, out: &Path) -> Vec<String> {
        let mut arguments = vec!["import".into(), video.display().to_string(), "--equation".into(), equation.into()];
        arguments.extend(self.scene());
        arguments.extend(["--force".into(), "--out".into(), out.display().to_string()]);
        arguments
    }
}

/// A line for a shell.
pub fn command_line(arguments: &[String]) -> String {
    let words = std::iter::once("paig").chain(arguments.iter().map(String::as_str));
    words.map(quoted).collect::<Vec<_>>().join(" ")
}

/// A word for a shell, in quotes only where it needs them.
fn quoted(word: &str) -> Cow<'_, str> {
    let is_plain = !word.is_empty() && word.bytes().all(|c| c.is_ascii_alphanumeric() || b"-_./:,=".contains(&c));
    // No argument has a NUL, the one character that cannot be quoted.
    if is_plain { word.into() } else { shlex::try_quote(word).unwrap_or_default() }
}

/// To a tenth: finer than a hand on a mouse.
fn tenths(number: f64) -> f64 {
    (10.0 * number).round() / 10.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_become_options_of_the_command() {
        let settings = ProjectSettings {
            frames: Some([3, 90]),
            stick: Some(Stick { from: [10.04, 20.0], to: [10.0, 220.0], metres: 1.5 }),
            origin: Some([5.0, 6.55]),
            marks: vec![Mark { frame: 4, at: [1.0, 2.0] }],
            ..ProjectSettings::default()
        };
        settings.check().unwrap();
        let line = command_line(&settings.measure("my videos/a.mp4".as_ref(), "falling", "out".as_ref()));
        let expected = "paig measure 'my videos/a.mp4' --equation falling --frames 3..90 --scale 10,20,10,220,1.5 --origin 5,6.6 \
                        --y-up --at 4:1,2 --out out";
        assert_eq!(line, expected);
    }

    #[test]
    fn settings_that_lead_nowhere_are_refused() {
        let stick = |to, metres| Some(Stick { from: [0.0; 2], to, metres });
        let wrong = [
            ProjectSettings { frames: Some([9, 9]), ..ProjectSettings::default() },
            ProjectSettings { stick: stick([0.0; 2], 1.0), ..ProjectSettings::default() },
            ProjectSettings { stick: stick([9.0; 2], 0.0), ..ProjectSettings::default() },
            ProjectSettings { stick: stick([f64::NAN; 2], 1.0), ..ProjectSettings::default() },
            ProjectSettings { objects: 0, ..ProjectSettings::default() },
            ProjectSettings { fps: Some(-1.0), ..ProjectSettings::default() },
            ProjectSettings { crop: Some([0, 0, 0, 9]), ..ProjectSettings::default() },
        ];
        for settings in wrong {
            assert!(settings.check().is_err(), "{settings:?}");
        }
        assert!(serde_json::from_str::<ProjectSettings>("{\"equations\": \"falling\"}").is_err());
    }
}
