//! Generated videos with a known answer, to try the page without a camera.

use anyhow::Result;
use image::{Rgb, RgbImage};
use paig_track::Size;
use paig_track::synthetic::{MovingEllipse, Shadow, SyntheticScene};
use serde::Serialize;

use crate::film::RenderedVideo;
use crate::settings::{ProjectSettings, Stick};

/// Of the videos, pixels.
const SIZE: Size = Size { width: 480, height: 360 };
const FPS: u32 = 30;
/// Gravity, m/s^2.
const GRAVITY: f64 = 9.81;
/// Steps of an integration within a frame.
const SUBSTEPS: usize = 40;
/// Of the balls, pixels.
const RADIUS: f64 = 13.0;
/// Light that a floor and a string leave.
const FLOOR: f64 = 0.7;
const STRING: f64 = 0.78;
/// Column of the axes' origin.
const ORIGIN: f64 = 30.0;
/// Bands of a ruler.
const BANDS: usize = 10;

/// A generated video, for people.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Example {
    pub key: &'static str,
    pub title: &'static str,
    pub summary: &'static str,
}

pub const EXAMPLES: [Example; 3] = [
    Example {
        key: "throw",
        title: "A thrown ball",
        summary: "Thrown past a ruler of one metre. Its acceleration should be 9.81 m/s².",
    },
    Example {
        key: "pendulum",
        title: "A pendulum",
        summary: "A ball on a string that slowly comes to rest, beside a ruler of half a metre.",
    },
    Example {
        key: "bounce",
        title: "A bouncing ball",
        summary: "Dropped on a floor. It should keep 80 % of its speed at each bounce.",
    },
];

/// A ruler that stands in the picture.
struct Ruler {
    /// Middle of its top, pixels.
    top: [f64; 2],
    pixels: f64,
    metres: f64,
}

/// An example's video before it is rendered.
pub struct ExampleScene {
    scene: SyntheticScene,
    ruler: Ruler,
    equation: &'static str,
    /// Row of a floor, where there is one.
    floor: Option<u32>,
    /// Where a string is fastened, pixels.
    pivot: Option<[f64; 2]>,
}

/// The example of this key.
pub fn made(key: &str) -> Option<ExampleScene> {
    match key {
        "throw" => Some(throw()),
        "pendulum" => Some(pendulum()),
        "bounce" => Some(bounce()),
        _ => None,
    }
}

impl ExampleScene {
    /// The video file.
    ///
    /// # Errors
    /// A frame that cannot be compressed.
    pub fn film(&self) -> Result<Vec<u8>> {
        let (width, height) = (SIZE.width as u32, SIZE.height as u32);
        let mut film = RenderedVideo::new((width, height), FPS);
        for (frame, ball) in self.scene.render().outer_iter().zip(&self.scene.movers[0].positions) {
            let mut picture = RgbImage::from_fn(width, height, |x, y| {
                Rgb([0, 1, 2].map(|channel| frame[[y as usize, x as usize, channel]]))
            });
            if let Some(row) = self.floor {
                let below = (row..height).flat_map(|y| (0..width).map(move |x| (x, y)));
                below.for_each(|(x, y)| shade(&mut picture, x, y, FLOOR));
            }
            if let Some(pivot) = self.pivot {
                string(&mut picture, pivot, *ball);
            }
            self.ruler.draw(&mut picture);
            film.add(&picture)?;
        }
        Ok(film.bytes())
    }

    /// What its author would set: the ruler is known, the equation too.
    pub fn settings(&self) -> ProjectSettings {
        let Ruler { top: [x, y], pixels, metres } = self.ruler;
        let floor = self.floor.map_or(y + pixels, f64::from);
        ProjectSettings {
            stick: Some(Stick { from: [x, y], to: [x, y + pixels], metres }),
            equation: self.equation.into(),
            origin: Some([ORIGIN, floor]),
            ..ProjectSettings::default()
        }
    }
}

impl Ruler {
    /// Bands of two colours.
    fn draw(&self, picture: &mut RgbImage) {
        let [x, y] = self.top.map(|place| place as u32);
        for row in 0..self.pixels as u32 {
            let band = (f64::from(row) * BANDS as f64 / self.pixels) as usize;
            let colour = if band.is_multiple_of(2) { [238, 236, 228] } else { [52, 60, 72] };
            (x - 4..x + 4).for_each(|column| picture.put_pixel(column, y + row, Rgb(colour)));
        }
    }
}

/// A string down to the edge of a ball.
fn string(picture: &mut RgbImage, from: [f64; 2], ball: [f64; 2]) {
    let length = (ball[0] - from[0]).hypot(ball[1] - from[1]);
    for step in 0..(length - RADIUS).max(0.0) as u32 {
        let share = f64::from(step) / length;
        let [x, y] = [0, 1].map(|axis| (from[axis] + share * (ball[axis] - from[axis])).round().max(0.0) as u32);
        shade(picture, x, y, STRING);
    }
}

/// Leaves a share of the light.
fn shade(picture: &mut RgbImage, x: u32, y: u32, share: f64) {
    if let Some(pixel) = picture.get_pixel_mut_checked(x, y) {
        pixel.0.iter_mut().for_each(|level| *level = (share * f64::from(*level)) as u8);
    }
}

fn scene(positions: Vec<[f64; 2]>, colour: [f64; 3], shadow: Shadow) -> SyntheticScene {
    // The renderer counts from the middle of a pixel.
    let positions = positions.into_iter().map(|place| place.map(|it| it - 0.5)).collect();
    let mover = MovingEllipse {
        axes: [RADIUS, RADIUS],
        colour,
        texture: 24.0,
        shadow: Some(shadow),
        ..MovingEllipse::at(positions)
    };
    SyntheticScene {
        size: SIZE,
        movers: vec![mover],
        background: [156.0, 160.0, 158.0],
        background_texture: 14.0,
        shutter: 0.2,
        noise: 2.5,
        flicker: 0.004,
        ..SyntheticScene::default()
    }
}

fn throw() -> ExampleScene {
    let metre = 130.0;
    let places = (0..34).map(|frame| {
        let t = f64::from(frame) / f64::from(FPS);
        [40.0 + metre * 2.55 * t, 292.0 + metre * (0.5 * GRAVITY * t - 5.4) * t]
    });
    ExampleScene {
        scene: scene(places.collect(), [206.0, 84.0, 44.0], shadow([16.0, 22.0], 0.72)),
        ruler: Ruler { top: [444.0, 190.0], pixels: metre, metres: 1.0 },
        equation: "falling",
        floor: None,
        pivot: None,
    }
}

fn pendulum() -> ExampleScene {
    let (metre, length, damping, pivot) = (330.0, 0.62, 0.12, [232.0, 64.0]);
    let (mut angle, mut speed) = (0.7_f64, 0.0);
    let step = 1.0 / f64::from(FPS) / SUBSTEPS as f64;
    let mut places = Vec::new();
    for _ in 0..150 {
        places.push([pivot[0] + metre * length * angle.sin(), pivot[1] + metre * length * angle.cos()]);
        for _ in 0..SUBSTEPS {
            speed -= step * (GRAVITY / length * angle.sin() + damping * speed);
            angle += step * speed;
        }
    }
    ExampleScene {
        scene: scene(places, [58.0, 96.0, 176.0], shadow([15.0, 12.0], 0.74)),
        ruler: Ruler { top: [448.0, 150.0], pixels: 0.5 * metre, metres: 0.5 },
        equation: "damped_pendulum",
        floor: None,
        pivot: Some(pivot),
    }
}

fn bounce() -> ExampleScene {
    let (metre, floor, kept) = (190.0, 318.0, 0.8);
    // The middle of a ball that lies on the floor.
    let (mut height, mut speed) = (1.25_f64, 0.0);
    let step = 1.0 / f64::from(FPS) / SUBSTEPS as f64;
    let mut places = Vec::new();
    for frame in 0..72 {
        places.push([70.0 + 4.0 * f64::from(frame), floor - RADIUS - metre * height]);
        for _ in 0..SUBSTEPS {
            speed -= step * GRAVITY;
            height += step * speed;
            if height < 0.0 {
                (height, speed) = (-kept * height, -kept * speed);
            }
        }
    }
    ExampleScene {
        scene: scene(places, [196.0, 170.0, 52.0], shadow([14.0, 16.0], 0.74)),
        ruler: Ruler { top: [448.0, floor - metre], pixels: metre, metres: 1.0 },
        equation: "bounce_on_a_floor",
        floor: Some(floor as u32),
        pivot: None,
    }
}

fn shadow(offset: [f64; 2], light: f64) -> Shadow {
    Shadow { offset, axes: [RADIUS, 9.0], light }
}
