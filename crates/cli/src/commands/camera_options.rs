//! How videos were filmed: speed, fields, shutter, plane of the motion.

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use paig_video::import::sources::{Filming, ReferenceRectangle};

/// Speed at which a video plays.
#[derive(Debug, Args)]
pub struct SpeedOption {
    /// How many times as slow as it was filmed the video plays, 8 for 240 frames a second stored as 30 [default: by its tags]
    #[arg(long, value_name = "FACTOR", help_heading = "Camera")]
    slow_motion: Option<f64>,
}

impl SpeedOption {
    /// # Errors
    /// A factor that is not positive, or one beside frames a second.
    pub fn read(&self, fps: Option<f64>) -> Result<Option<f64>> {
        ensure!(
            fps.is_none() || self.slow_motion.is_none(),
            "--slow-motion: not with --fps, which already says how fast it was filmed"
        );
        let positive = |factor: f64| factor.is_finite() && factor > 0.0;
        ensure!(self.slow_motion.is_none_or(positive), "--slow-motion: must be a positive number");
        Ok(self.slow_motion)
    }
}

/// Options of commands that track.
#[derive(Debug, Args)]
pub struct CameraOptions {
    #[command(flatten)]
    speed: SpeedOption,
    /// Split each frame of an interlaced video into its two fields, filmed one after the other
    #[arg(long, help_heading = "Camera")]
    fields: bool,
    /// Time from the first to the last row of a frame, milliseconds, of a camera with a rolling shutter: fast objects are put
    /// where they were at the time of their frame
    #[arg(long, value_name = "MS", allow_negative_numbers = true, help_heading = "Camera")]
    readout: Option<f64>,
    /// The plane of the motion by a rectangle in it: its corners in pixels (bottom left, bottom right, top right, top left),
    /// then its width and height in metres
    #[arg(long, value_name = "X,Y,X,Y,X,Y,X,Y,WIDTH,HEIGHT", allow_hyphen_values = true, help_heading = "Camera")]
    plane: Option<String>,
    /// Radial distortion of the lens for --plane: r becomes r / (1 + K r^2), in half diagonals; negative for a wide lens
    #[arg(long, value_name = "K", allow_negative_numbers = true, requires = "plane", help_heading = "Camera")]
    distortion: Option<f64>,
}

impl CameraOptions {
    /// What a person knows of the filming; `fps` replaces the times of the file.
    ///
    /// # Errors
    /// Text that is not of the form that its option's help gives, numbers that cannot be.
    pub fn read(&self, fps: Option<f64>) -> Result<Filming> {
        ensure!(self.readout.is_none_or(f64::is_finite), "--readout: must be a finite number of milliseconds");
        ensure!(self.distortion.is_none_or(f64::is_finite), "--distortion: must be a finite number");
        let plane = self.plane.as_deref().map(|text| plane(text, self.distortion)).transpose()?;
        let readout = self.readout.map(|milliseconds| 1e-3 * milliseconds);
        Ok(Filming { fps, slow_motion: self.speed.read(fps)?, fields: self.fields, readout, plane })
    }
}

fn plane(text: &str, distortion: Option<f64>) -> Result<ReferenceRectangle> {
    let finite = |number: &str| number.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let numbers: Option<Vec<f64>> = text.split(',').map(finite).collect();
    let wrong = || format!("--plane {text:?}: expected four corners x,y, then width,height in metres: ten numbers");
    let [a, b, c, d, e, f, g, h, width, height] = numbers.with_context(wrong)?[..] else { bail!(wrong()) };
    Ok(ReferenceRectangle { corners: [[a, b], [c, d], [e, f], [g, h]], sides: [width, height], distortion })
}
