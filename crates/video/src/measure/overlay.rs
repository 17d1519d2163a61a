//! overlay.gif: where the objects were seen and where the equation has them, drawn on the frames.

use std::path::Path;

use anyhow::Result;
use plotters::element::{Circle, Cross, PathElement};
use plotters::style::text_anchor::HPos;
use plotters::style::{Color, RGBColor};

use super::measured::MeasuredSubject;
use paig::viz::canvas::{Canvas, drawn};
use paig::viz::chart::{BLUE, GREEN, ORANGE};
use paig::viz::gif;

/// Frames of the equation's path that are shown, before and after the present one.
const PATH: usize = 12;
const PATH_COLOUR: RGBColor = RGBColor(255, 255, 255);
/// Least width of a picture, pixels: small frames are enlarged.
const LEAST_WIDTH: u32 = 320;
const TEXT: u32 = 18;

/// Green circles: seen. Crosses: fitted (blue), or predicted in the held-out part (orange).
pub(super) fn write(path: &Path, measured: &MeasuredSubject) -> Result<()> {
    let places: Vec<_> = (0..measured.pictures.len()).map(|video| measured.places(video)).collect();
    let pictures: Vec<_> = (0..measured.pictures.len())
        .flat_map(|video| (0..measured.pictures[video].pictures.len()).map(move |picture| (video, picture)))
        .collect();
    let objects = measured.explained.dynamics.system.objects;
    gif::write(path, pictures.len(), |number| {
        let (video, picture) = pictures[number];
        let (recording, passed) = (&measured.scene.recordings[video], &measured.pictures[video]);
        let pixels = measured.pixels[video];
        let (frame, picture) = &passed.pictures[picture];
        let times = LEAST_WIDTH.div_ceil(picture.width()).max(1);
        let (width, height) = (picture.width() * times, picture.height() * times);
        let picture = image::imageops::resize(picture, width, height, image::imageops::FilterType::Nearest);
        let mut canvas = Canvas::new(width, height);
        canvas.paste(&picture, (0, 0));
        let on = |[x, y]: [f64; 2]| {
            let at = |part: usize, place: f64| f64::from(times) * (passed.corner[part] + passed.pixels * place);
            (at(0, x).round() as i32, at(1, y).round() as i32)
        };
        let held_out = *frame >= recording.trained;
        let colour = if held_out { ORANGE } else { BLUE };
        let radius = (width / 60).max(4) as i32;
        {
            let area = canvas.area();
            for object in 0..objects {
                let at = |frame: usize| on(places[video][frame * objects + object].at);
                let last = (frame + PATH).min(places[video].len() / objects - 1);
                let way: Vec<_> = (frame.saturating_sub(PATH)..=last).map(at).collect();
                drawn(area.draw(&PathElement::new(way, PATH_COLOUR.mix(0.7).stroke_width(2))))?;
                let row = 2 * (frame * objects + object);
                let circle = Circle::new(on([pixels[row], pixels[row + 1]]), radius, GREEN.stroke_width(3));
                drawn(area.draw(&circle))?;
                drawn(area.draw(&Cross::new(at(*frame), radius, colour.stroke_width(3))))?;
            }
            drawn(area.present())?;
        }
        let seconds = recording.first_seconds + measured.scene.scale.seconds * recording.times[*frame];
        let text = format!("{seconds:.2} s  {}", if held_out { "predicted" } else { "fitted" });
        canvas.fill((0, 0), (11 * TEXT, TEXT + 8), RGBColor(255, 255, 255));
        canvas.text(&text, (8, TEXT / 2 + 4), TEXT, HPos::Left, colour)?;
        Ok(canvas)
    })
}
