//! From pixels of a frame and the unit of `dt` to what people measure in: metres where the scale is known, pixels of the
//! filmed video where it is not, and seconds.

use paig::network::System;
use paig::network::cells::PhysicalParameter;
use paig::tasks::video::Video;

use super::bootstrap::BootstrapSample;

/// The units of one task's videos.
#[derive(Debug, Clone)]
pub struct Scale {
    video: Video,
    /// Pixels of the video to a pixel of a frame.
    pub video_pixels: f64,
    /// Metres to a pixel of a frame, if known.
    metres: Option<f64>,
    /// Seconds to a unit of `dt`.
    pub seconds: f64,
}

/// Powers of a length and of a time.
pub type Powers = [i32; 2];

impl Scale {
    pub fn new(video: &Video, system: &System) -> Self {
        Scale {
            video: video.clone(),
            video_pixels: video.crop[2] as f64 / system.side as f64,
            metres: video.metres_per_pixel(system.side),
            seconds: video.frame_seconds / system.dt,
        }
    }

    /// What a length of 1 pixel of a frame is: metres, or pixels of the video.
    pub fn length(&self) -> f64 {
        self.metres.unwrap_or(self.video_pixels)
    }

    pub fn length_unit(&self) -> &'static str {
        if self.metres.is_some() { "m" } else { "px" }
    }

    /// What a number with these powers in its unit is multiplied by.
    pub fn factor(&self, [length, time]: Powers) -> f64 {
        self.length().powi(length) * self.seconds.powi(time)
    }

    /// The same as one draw of scale and time has it.
    pub fn drawn(&self, powers: Powers, draw: &BootstrapSample) -> f64 {
        let off = |percent: f64, normal: f64| (1.0 + 0.01 * percent * normal).max(0.01);
        // More pixels to a metre make a length shorter.
        let scale = if self.metres.is_some() { off(self.video.scale_percent, draw.scale) } else { 1.0 };
        let time = off(self.video.time_percent, draw.time);
        self.factor(powers) * scale.powi(-powers[0]) * time.powi(powers[1])
    }

    /// For people: `m/s^2`.
    pub fn unit(&self, [length, time]: Powers) -> String {
        let part = |unit: &str, power: i32| match power.abs() {
            1 => unit.to_string(),
            power => format!("{unit}^{power}"),
        };
        let parts = [(self.length_unit(), length), ("s", time)];
        let above: Vec<_> =
            parts.iter().filter(|(_, power)| *power > 0).map(|(unit, power)| part(unit, *power)).collect();
        let below: Vec<_> =
            parts.iter().filter(|(_, power)| *power < 0).map(|(unit, power)| part(unit, *power)).collect();
        match (above.is_empty(), below.is_empty()) {
            (true, true) => String::new(),
            (_, true) => above.join(" "),
            (true, false) => format!("1/{}", below.join("/")),
            (false, false) => format!("{}/{}", above.join(" "), below.join("/")),
        }
    }

    /// Unit of a parameter's value, for people; `?` where the equation does not state it.
    pub fn unit_of(&self, parameter: &PhysicalParameter) -> String {
        let named = || parameter.unit_name.as_deref().unwrap_or("?").to_string();
        Self::powers(parameter).map_or_else(named, |powers| self.unit(powers))
    }

    /// The powers of a parameter, if its unit is known.
    pub fn powers(parameter: &PhysicalParameter) -> Option<Powers> {
        parameter.time_power.map(|time| [parameter.length_power, time])
    }

    /// That what is said of scale and time is in no draw of those that are learned and whose unit is not known, if something is
    /// said and there are some.
    pub fn unsaid<'a>(&self, learned: impl Iterator<Item = &'a PhysicalParameter>) -> Option<String> {
        let said = self.metres.is_some() && self.video.scale_percent > 0.0 || self.video.time_percent > 0.0;
        let unknown = learned.filter(|parameter| said && Self::powers(parameter).is_none());
        let names: Vec<_> = unknown.map(|parameter| &*parameter.name).collect();
        let text = || {
            format!(
                "{}: the interval holds nothing of the stated uncertainty of scale and time, since the equation states no powers of \
                 length and time for its unit",
                names.join(", ")
            )
        };
        (!names.is_empty()).then(text)
    }

    /// A place in a frame, pixels of it, as a place in the filmed video.
    pub fn in_video(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, top, _] = self.video.crop;
        [left as f64 + x * self.video_pixels, top as f64 + y * self.video_pixels]
    }

    /// A place in the filmed video as one in a frame.
    pub fn in_frame(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, top, _] = self.video.crop;
        [(x - left as f64) / self.video_pixels, (y - top as f64) / self.video_pixels]
    }

    /// A place in a frame on the scene's axes, metres or pixels of the video.
    pub fn on_axes(&self, place: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.in_video(place);
        let [left, top] = self.video.origin.unwrap_or_default();
        self.turned([x - left, y - top])
    }

    /// A velocity, pixels of a frame and units of `dt`, on the scene's axes, per second.
    pub fn velocity_on_axes(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        self.turned([x, y].map(|part| part * self.video_pixels)).map(|part| part / self.seconds)
    }

    /// Pixels of the video from its directions to those of the axes, and in their unit.
    fn turned(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.video.angle.to_radians().sin_cos();
        // The angle is counter-clockwise on the screen, where y points down.
        let along = [x * cos - y * sin, x * sin + y * cos];
        let upwards = if self.video.y_up { -along[1] } else { along[1] };
        let of_unit = self.length() / self.video_pixels;
        [along[0] * of_unit, upwards * of_unit]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scale(angle: f64, pixels_per_metre: Option<f64>) -> Scale {
        timed(angle, pixels_per_metre, "s", [0.1, 0.1])
    }

    /// Of a video whose frames are so many seconds and so many of this unit apart.
    fn timed(angle: f64, pixels_per_metre: Option<f64>, time_unit: &str, [frame_seconds, dt]: [f64; 2]) -> Scale {
        let task = paig::tasks::builtin("falling").unwrap();
        let video = Video {
            size: [640, 360],
            crop: [40, 20, 320],
            step: 4,
            film_step: Some(1),
            time_unit: time_unit.into(),
            frame_seconds,
            pixels_per_metre,
            scale_percent: 1.0,
            time_percent: 2.0,
            origin: Some([200.0, 300.0]),
            angle,
            y_up: true,
            sources: Vec::new(),
        };
        Scale::new(&video, &paig::network::System { side: 32, dt, ..task.system })
    }

    #[test]
    fn places_come_out_on_the_axes_of_the_scene() {
        let metres = scale(0.0, Some(100.0));
        // 10 pixels of the video to a pixel of a frame: (16, 8) is (200, 100) in the video, 2 m above the origin.
        let [x, y] = metres.on_axes([16.0, 8.0]);
        assert!(x.abs() < 1e-12 && (y - 2.0).abs() < 1e-12, "{x} {y}");
        assert_eq!(metres.in_frame(metres.in_video([16.0, 8.0])), [16.0, 8.0]);
        // With an x axis that points up, what is above lies along it.
        let [x, y] = scale(90.0, None).on_axes([16.0, 8.0]);
        assert!((x - 200.0).abs() < 1e-9 && y.abs() < 1e-9, "{x} {y}");
        let [_, falls] = metres.velocity_on_axes([0.0, 5.0]);
        assert!((falls + 0.5).abs() < 1e-12, "{falls}");
    }

    #[test]
    fn parameters_come_in_their_units() {
        let metres = scale(0.0, Some(100.0));
        assert_eq!(
            (metres.unit([1, -2]), metres.unit([0, -1]), metres.unit([0, 0])),
            ("m/s^2".into(), "1/s".into(), "".into())
        );
        assert!((metres.factor([1, -2]) - 0.1).abs() < 1e-12);
        let draw = BootstrapSample { unconstrained: Vec::new(), states: Vec::new(), scale: 1.0, time: 1.0 };
        assert!((metres.drawn([1, -2], &draw) - 0.1 / 1.01 / 1.02f64.powi(2)).abs() < 1e-12);
        assert_eq!(scale(0.0, None).unit([1, -1]), "px/s");
    }

    #[test]
    fn an_interval_without_the_errors_of_scale_and_time_is_told() {
        let (length, speed) =
            (PhysicalParameter::learned("l", "log_l", 0), PhysicalParameter::learned("v", "log_v", 1).with_time(-1));
        let mut metres = scale(0.0, Some(100.0));
        let said = metres.unsaid([&length, &speed].into_iter()).unwrap();
        assert!(said.starts_with("l: the interval holds nothing"), "{said}");
        assert_eq!(metres.unsaid([&speed].into_iter()), None);
        (metres.video.scale_percent, metres.video.time_percent) = (0.0, 0.0);
        assert_eq!(metres.unsaid([&length].into_iter()), None);
    }

    #[test]
    fn times_are_turned_into_seconds() {
        // Frames of 1/50 s, counted one by one; a pixel of a frame is 0.1 m.
        let frames = timed(0.0, Some(100.0), "frames", [0.02, 1.0]);
        assert!((frames.factor([1, -2]) / (0.1 * 50.0 * 50.0) - 1.0).abs() < 1e-12, "{}", frames.factor([1, -2]));
        let [fast, _] = frames.velocity_on_axes([1.0, 0.0]);
        assert!((fast / (0.1 * 50.0) - 1.0).abs() < 1e-12, "{fast}");
    }
}
