//! The ways in which the pendulum is recorded.

use super::pendulum::Pendulum;

/// Width and height of the pictures, pixels, and pixels to a metre at the pendulum.
pub const SIZE: [usize; 2] = [320, 240];
const SCALE: f64 = 260.0;
/// Where the string hangs, pixels.
const PIVOT: [f64; 2] = [160.0, 30.0];
/// Radius of the bob, pixels.
const RADIUS: f64 = 12.0;
/// Seconds and frames a second of an ordinary recording.
const SECONDS: f64 = 7.0;
const RATE: f64 = 30.0;
/// Distance of the camera that looks at the plane of the swing from one side, m, and its angle, degrees.
const DISTANCE: f64 = 1.6;
const ASIDE: f64 = 30.0;
/// Sides of the rectangle that calibrates it, m.
const RECTANGLE: [f64; 2] = [0.7, 0.6];
/// Time from the first to the last row of the rolling shutter, s.
const READOUT: f64 = 0.025;

const X264: &str = "-c:v libx264 -crf 16 -pix_fmt yuv420p";
const X265: &str = "-c:v libx265 -crf 16 -x265-params log-level=none";

/// Expected end of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExpectedOutcome {
    /// Period and length nearer to the truth than their intervals are wide, which is four standard deviations of a normal error.
    Measured,
    /// Refused, or a verdict other than `found`.
    Rejected,
}

/// One way of recording.
#[derive(Debug, Clone)]
pub struct Way {
    pub name: &'static str,
    /// When each picture was filmed, s.
    pub times: Vec<f64>,
    /// Place and angle of the scene in each picture, pixels and radians; the camera stands where there are none.
    pub camera: Vec<[f64; 3]>,
    /// How much the foreground in the lower half moves more than the rest.
    pub depth: f64,
    /// Whether the camera looks from one side.
    pub aside: bool,
    pub readout: f64,
    /// Whether two pictures are woven into one frame, line by line.
    pub interlaced: bool,
    /// Frames a second that the encoder is told, its options and the file's ending.
    pub rate: f64,
    pub encoder: String,
    pub extension: &'static str,
    /// Options of `paig measure`.
    pub options: String,
    pub expected: ExpectedOutcome,
}

impl Way {
    fn plain(name: &'static str) -> Self {
        Way {
            name,
            times: even(SECONDS, RATE),
            camera: Vec::new(),
            depth: 0.0,
            aside: false,
            readout: 0.0,
            interlaced: false,
            rate: RATE,
            encoder: X264.into(),
            extension: "mp4",
            options: String::new(),
            expected: ExpectedOutcome::Measured,
        }
    }

    /// Middle of the bob in each picture, pixels of the scene.
    pub fn positions(&self, pendulum: &Pendulum) -> Vec<[f64; 2]> {
        let of_time = |time: f64| {
            let at = |time: f64| {
                let [x, y] = pendulum.place(time);
                let front = [PIVOT[0] + SCALE * x, PIVOT[1] + SCALE * y];
                if self.aside { seen_aside(front) } else { front }
            };
            // The row at which it is filmed decides when: a few rounds settle it.
            (0..8).fold(at(time), |place, _| at(time + self.readout * (place[1] / SIZE[1] as f64 - 0.5)))
        };
        self.times.iter().map(|time| of_time(*time)).collect()
    }

    /// Semi-axes of the bob's image, pixels.
    pub fn axes(&self) -> [f64; 2] {
        let narrow = if self.aside { ASIDE.to_radians().cos() } else { 1.0 };
        [narrow * RADIUS, RADIUS]
    }

    /// Seconds from the first to the last picture.
    pub fn seconds(&self) -> f64 {
        self.times[self.times.len() - 1] - self.times[0]
    }
}

/// Times of a constant rate.
fn even(seconds: f64, rate: f64) -> Vec<f64> {
    (0..(seconds * rate) as usize).map(|frame| frame as f64 / rate).collect()
}

/// Place in a picture taken from one side of a place in one taken from the front, by central projection.
fn seen_aside([x, y]: [f64; 2]) -> [f64; 2] {
    let middle = SIZE.map(|side| 0.5 * side as f64);
    let (sin, cos) = ASIDE.to_radians().sin_cos();
    let [across, down] = [(x - middle[0]) / SCALE, (y - middle[1]) / SCALE];
    let enlarged = SCALE * DISTANCE / (DISTANCE + sin * across);
    [middle[0] + enlarged * cos * across, middle[1] + enlarged * down]
}

/// `--plane` of a rectangle around the middle of the picture.
fn plane() -> String {
    let [width, height] = RECTANGLE.map(|side| 0.5 * SCALE * side);
    let corners = [[-width, height], [width, height], [width, -height], [-width, -height]];
    // The tracker's pixels have their middles at whole numbers, a user's their corners.
    let place = |[x, y]: [f64; 2]| {
        let [u, v] = seen_aside([0.5 * SIZE[0] as f64 + x, 0.5 * SIZE[1] as f64 + y]);
        format!("{:.3},{:.3}", u + 0.5, v + 0.5)
    };
    format!("--plane {},{},{}", corners.map(place).join(","), RECTANGLE[0], RECTANGLE[1])
}

/// All ways.
pub fn all() -> Vec<Way> {
    let plain = Way::plain;
    let dropped = |name| {
        let kept = |(frame, _): &(usize, f64)| ![40, 41, 77, 120, 121, 165].contains(frame);
        Way { times: even(SECONDS, RATE).into_iter().enumerate().filter(kept).map(|it| it.1).collect(), ..plain(name) }
    };
    let wave = |rate: f64, phase: f64| move |frame: usize| (frame as f64 * rate + phase).sin();
    let frames = even(SECONDS, RATE).len();
    let hand = (0..frames).map(|f| [2.6 * wave(0.31, 0.0)(f), 1.9 * wave(0.23, 1.0)(f), 0.004 * wave(0.17, 2.0)(f)]);
    let follows = |way: Way| {
        let turn = |time: &f64| [-30.0 * (time * 0.9).sin(), 0.0, 0.0];
        Way { camera: way.times.iter().map(turn).collect(), ..way }
    };
    // 30, 240 and 30 frames a second, stored as 30.
    let ramp = |frame: usize| match frame {
        frame if frame < 70 => frame as f64 / 30.0,
        frame if frame < 310 => 70.0 / 30.0 + (frame - 70) as f64 / 240.0,
        frame => 70.0 / 30.0 + 1.0 + (frame - 310) as f64 / 30.0,
    };
    let stamps = |expression: &str| {
        format!("-vf settb=1/90000,setpts={expression} -fps_mode passthrough -video_track_timescale 90000")
    };
    let jitter = |frame: usize| frame as f64 / RATE + 0.011 * (1.7 * frame as f64).sin();
    vec![
        plain("H.264, 30 frames a second"),
        Way { encoder: format!("{X265} -pix_fmt yuv420p"), ..plain("HEVC") },
        Way {
            encoder: format!(
                "{X265} -pix_fmt yuv420p10le -color_trc arib-std-b67 -colorspace bt2020nc -color_primaries bt2020"
            ),
            ..plain("HDR: HEVC of 10 bits, HLG")
        },
        Way {
            times: (0..frames).map(jitter).collect(),
            encoder: format!("{} {X264}", stamps("(N/30+0.011*sin(1.7*N))/TB")),
            ..plain("variable frame rate, 15 to 52 ms")
        },
        Way {
            encoder: format!("{} {X264}", stamps("(N+gt(N\\,39)*2+gt(N\\,74)+gt(N\\,116)*2+gt(N\\,159))/30/TB")),
            ..dropped("6 frames dropped, gaps in the stamps")
        },
        dropped("6 frames dropped, stamps regular"),
        Way {
            times: even(SECONDS, RATE).iter().map(|time| (time * 24.0 + 1e-6).floor() / 24.0).collect(),
            ..plain("24 frames a second stored as 30, every fifth repeated")
        },
        Way {
            times: even(SECONDS, 120.0),
            encoder: format!("{X264} -movflags use_metadata_tags -metadata com.android.capture.fps=120"),
            ..plain("120 frames a second stored as 30, with the capture rate as a tag")
        },
        Way {
            times: even(SECONDS, 120.0),
            options: "--slow-motion 4".into(),
            ..plain("120 frames a second stored as 30, without a tag")
        },
        Way {
            times: (0..400).map(ramp).collect(),
            expected: ExpectedOutcome::Rejected,
            ..plain("ramp: 30, 240, 30 frames a second stored as 30")
        },
        Way { encoder: format!("-vf scale=300:240,setsar=16/15 {X264}"), ..plain("pixels 16:15") },
        Way {
            times: even(SECONDS, 50.0),
            interlaced: true,
            rate: 25.0,
            encoder: "-vf setfield=tff -c:v mjpeg -q:v 2 -pix_fmt yuvj422p".into(),
            extension: "mov",
            options: "--fields".into(),
            ..plain("interlaced, 50 fields a second")
        },
        Way { camera: hand.collect(), ..plain("hand-held camera that trembles") },
        follows(plain("camera that turns to and fro by 30 pixels")),
        Way {
            depth: 1.5,
            camera: (0..frames).map(|frame| [-1.2 * frame as f64, 0.0, 0.0]).collect(),
            expected: ExpectedOutcome::Rejected,
            ..plain("camera that travels past things at two depths")
        },
        Way { readout: READOUT, options: "--readout 25".into(), ..plain("rolling shutter, read out in 25 ms") },
        Way { aside: true, options: plane(), ..plain("seen at 30 degrees, with --plane") },
        Way { aside: true, expected: ExpectedOutcome::Rejected, ..plain("seen at 30 degrees, without --plane") },
    ]
}
