//! What an episode looked like: returns, courses, and a film with truth, prediction and plan side by side.

use std::path::Path;

use anyhow::Result;
use plotters::chart::SeriesLabelPosition;
use plotters::style::RGBColor;
use plotters::style::text_anchor::HPos;
use tch::Tensor;

use super::controller::Controller;
use super::environment::{Environment, Rules};
use super::episode::{Episode, Planned};
use super::results::PlannerRow;
use super::reward::Reward;
use super::state::{ControlState, wrapped};
use paig::network::cells::Coordinates;
use paig::viz::CHART_HEIGHT;
use paig::viz::canvas::{Canvas, INK, picture};
use paig::viz::chart::{self, BLUE, Chart, GREEN, GREY, Line, ORANGE, RED, Span, Stroke};
use paig::viz::gif;

const COLOURS: [RGBColor; 5] = [BLUE, ORANGE, GREEN, GREY, RED];

/// Side of a panel of the film, pixels, and the room above it and between two.
const PANEL: u32 = 256;
const HEAD: u32 = 40;
const GAP: u32 = 12;
const FONT_SIZE: u32 = 20;
/// How many steps before it is shown the model foretells a frame.
const AHEAD: usize = 8;

/// True positions and actions of an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeCourse {
    /// The first coordinate, one more than steps.
    pub positions: Vec<f64>,
    pub actions: Vec<f64>,
}

impl EpisodeCourse {
    pub fn of(episode: &Episode) -> Self {
        let positions = episode.states.iter().map(|state| state.positions[0]).collect();
        EpisodeCourse { positions, actions: episode.actions.clone() }
    }
}

fn line(label: &'static str, colour: RGBColor, stroke: Stroke, points: Vec<(f64, f64)>) -> Line {
    Line { label: label.into(), colour, stroke, pieces: vec![points] }
}

fn chart_of(title: &'static str, axis: &'static str, end: f64, lines: Vec<Line>) -> Chart {
    Chart {
        title: title.into(),
        axis,
        values: title,
        spans: vec![Span { name: String::new(), first: 0.0, last: end }],
        lines,
        level: None,
        log: Some(false),
        legend: Some(SeriesLabelPosition::LowerRight),
    }
}

/// The return of each episode, for each planner with the mean (a line) and its 95 % interval (a band). No file without
/// planners.
///
/// # Errors
/// A file that cannot be written.
pub fn write_returns(path: &Path, planners: &[(&'static str, &[f64], [f64; 3])]) -> Result<bool> {
    let count = planners.iter().map(|(_, returns, _)| returns.len()).max().unwrap_or(0) as f64;
    let mut lines = Vec::new();
    for ((name, returns, [mean, low, high]), colour) in planners.iter().zip(COLOURS) {
        let band = vec![(0.0, *low), (count, *low), (count, *high), (0.0, *high)];
        lines.push(Line { label: String::new(), colour, stroke: Stroke::Filled, pieces: vec![band] });
        let episodes = returns.iter().enumerate().map(|(place, worth)| vec![(place as f64 + 0.5, *worth)]);
        lines.push(Line { label: name.to_string(), colour, stroke: Stroke::Dotted, pieces: episodes.collect() });
        lines.push(line("", colour, Stroke::Plain, vec![(0.0, *mean), (count, *mean)]));
    }
    chart::write(path, 2 * CHART_HEIGHT, vec![chart_of("return of each episode", "episode", count, lines)])
}

/// Angle or place, and action, over the steps of an episode, with the goal.
///
/// # Errors
/// A file that cannot be written.
pub fn write_courses(
    path: &Path,
    coordinates: Coordinates,
    rules: &Rules,
    courses: &[(&'static str, &EpisodeCourse)],
) -> Result<bool> {
    let angle = coordinates == Coordinates::Angle;
    let shown = |x: f64| if angle { wrapped(x).to_degrees() } else { x };
    let (mut places, mut actions) = (Vec::new(), Vec::new());
    for ((name, course), colour) in courses.iter().zip(COLOURS) {
        places.push(Line {
            label: name.to_string(),
            colour,
            stroke: Stroke::Plain,
            pieces: unbroken(&course.positions, shown, angle),
        });
        let held = course.actions.iter().enumerate();
        let steps = held.flat_map(|(step, action)| [(step as f64, *action), (step as f64 + 1.0, *action)]);
        actions.push(line(name, colour, Stroke::Plain, steps.collect()));
    }
    if let Reward::Goal(goal) = &rules.reward {
        let path: Vec<f64> = (0..=rules.steps).map(|step| goal.at(0, step)).collect();
        let pieces = unbroken(&path, shown, angle);
        places.push(Line { label: "goal".into(), colour: INK, stroke: Stroke::Dashed, pieces });
    }
    let title = if angle { "angle, degrees from upright" } else { "place, pixels from the left" };
    let end = rules.steps as f64;
    let charts = vec![chart_of(title, "step", end, places), chart_of("action", "step", end, actions)];
    chart::write(path, CHART_HEIGHT, charts)
}

/// Points over steps, in pieces where an angle goes through the bottom.
fn unbroken(values: &[f64], shown: impl Fn(f64) -> f64, angle: bool) -> Vec<Vec<(f64, f64)>> {
    let mut pieces: Vec<Vec<(f64, f64)>> = vec![Vec::new()];
    for (step, value) in values.iter().enumerate() {
        let value = shown(*value);
        let last = pieces.last().and_then(|piece| piece.last()).map(|(_, last)| *last);
        if angle && last.is_some_and(|last| (value - last).abs() > 180.0) {
            pieces.push(Vec::new());
        }
        pieces.last_mut().into_iter().for_each(|piece| piece.push((step as f64, value)));
    }
    pieces
}

/// Share of the upper bound's return against the number of training clips, of the planners that were trained on clips of
/// different numbers in the same setting. No file where there are none.
///
/// # Errors
/// A file that cannot be written.
pub fn write_clips(path: &Path, rows: &[PlannerRow]) -> Result<bool> {
    let usual = |row: &&PlannerRow| {
        row.clips.is_some() && row.setting.is_empty() && row.goal == Some(0.0) && row.gravity == Some(10.0)
    };
    let mut names: Vec<&str> = Vec::new();
    for row in rows.iter().filter(usual) {
        if !names.contains(&row.planner.as_str()) {
            names.push(&row.planner);
        }
    }
    let (mut lines, mut most) = (Vec::new(), 0);
    for name in names {
        let mut of_name: Vec<&PlannerRow> = rows.iter().filter(usual).filter(|row| row.planner == name).collect();
        of_name.sort_by_key(|row| row.clips);
        if of_name.windows(2).all(|pair| pair[0].clips == pair[1].clips) {
            continue;
        }
        let at = |part: fn(&PlannerRow) -> f64| -> Vec<(f64, f64)> {
            let share = |row: &&PlannerRow| (row.clips.unwrap_or(0) as f64, 100.0 * part(row) / row.upper_bound);
            of_name.iter().map(share).collect()
        };
        let colour = COLOURS[lines.len() / 2 % COLOURS.len()];
        let band = at(|row| row.return_low).into_iter().chain(at(|row| row.return_high).into_iter().rev());
        lines.push(line("", colour, Stroke::Filled, band.collect()));
        let pieces = vec![at(|row| row.return_mean)];
        lines.push(Line { label: name.into(), colour, stroke: Stroke::Dotted, pieces });
        most = most.max(of_name.iter().filter_map(|row| row.clips).max().unwrap_or(0));
    }
    let title = "return, per cent of the upper bound's";
    chart::write(path, CHART_HEIGHT, vec![chart_of(title, "training clips", most as f64, lines)])
}

/// An episode in motion. What is seen; what the model, eight steps before, foretold to be seen now, given what has acted
/// since; and the plan: what it leads to (above) and its actions (below), both with the parameters that the model had when
/// it planned. Of a controller that does not see or plan only what there is.
///
/// # Errors
/// A file that cannot be written, frames that cannot be drawn.
pub fn write_film(
    path: &Path,
    episode: &Episode,
    controller: &mut Controller,
    environment: &dyn Environment,
) -> Result<()> {
    let before = environment.rules().frames_before;
    let frames = &episode.frames[before..];
    let panels = if episode.plans.is_empty() { 1 } else { 3 };
    let mut canvases = Vec::new();
    let missing = environment.empty_frame();
    for (step, frame) in frames.iter().enumerate() {
        let mut canvas = Canvas::new(panels * (PANEL + GAP) + GAP, HEAD + PANEL + GAP);
        let name = if frame.is_some() { "camera" } else { "no frame" };
        panel(&mut canvas, 0, name, frame.as_ref().unwrap_or(&missing))?;
        if panels > 1 {
            let drawn = foretold(episode, controller, step).and_then(|state| controller.drawn(&[&state]));
            if let Some(drawn) = drawn {
                panel(&mut canvas, 1, "foretold", &drawn.get(0))?;
            }
            if let Some(plan) = episode.plans.iter().rev().find(|plan| plan.step <= step) {
                draw_plan(&mut canvas, plan, controller, environment.rules())?;
            }
        }
        canvases.push(canvas);
    }
    gif::write(path, canvases.len(), |frame| Ok(canvases[frame].clone()))
}

/// Writes a frame, pixel by pixel.
///
/// # Errors
/// A file that cannot be written.
pub fn write_frame(path: &Path, frame: &Tensor) -> Result<()> {
    let side = frame.size()[1] as u32;
    let mut canvas = Canvas::new(side, side);
    canvas.paste(&picture(frame, 1)?, (0, 0));
    canvas.write_png(path)
}

/// The state at a step as the model foretold it from the last plan that is old enough, under what then acted.
fn foretold(episode: &Episode, controller: &mut Controller, step: usize) -> Option<ControlState> {
    let plan = episode.plans.iter().rev().find(|plan| plan.step + AHEAD <= step)?;
    let acted: Vec<f32> = episode.actions[plan.step..step].iter().map(|action| *action as f32).collect();
    controller.foretell(&plan.parameters, &plan.from, &acted).pop().filter(ControlState::is_finite)
}

fn corner(panel: u32) -> (u32, u32) {
    (GAP + panel * (PANEL + GAP), HEAD)
}

fn panel(canvas: &mut Canvas, place: u32, name: &str, frame: &Tensor) -> Result<()> {
    let (x, y) = corner(place);
    canvas.text(name, (x, HEAD / 2), FONT_SIZE, HPos::Left, INK)?;
    let times = (PANEL / frame.size()[1] as u32).max(1);
    canvas.paste(&picture(frame, times)?, (x, y));
    Ok(())
}

/// Where the plan leads as dots from left to right (an angle from half a turn to the left, below, to half a turn to the
/// right; a place from the left edge, below, to the right one), and below it its actions as bars.
fn draw_plan(canvas: &mut Canvas, plan: &Planned, controller: &mut Controller, rules: &Rules) -> Result<()> {
    let (x, y) = corner(2);
    canvas.text("plan", (x, HEAD / 2), FONT_SIZE, HPos::Left, INK)?;
    canvas.fill((x, y), (PANEL, PANEL), RGBColor(243, 245, 248));
    let held: Vec<f32> = plan.actions.iter().flat_map(|action| vec![*action; rules.hold]).collect();
    let path = controller.foretell(&plan.parameters, &plan.from, &held);
    let (above, below) = (PANEL * 2 / 3, PANEL / 3);
    let share = |state: &ControlState| match (&rules.reward, state.positions.len()) {
        (Reward::Goal(goal), 2..) => state.positions[0] / goal.scale,
        _ => 0.5 + wrapped(state.positions[0]) / std::f64::consts::TAU,
    };
    if let Reward::Goal(goal) = &rules.reward {
        for step in 0..path.len() {
            let place = (0..goal.place.len()).map(|axis| goal.at(axis, plan.step + step + 1)).collect();
            let place = ControlState::new(place, Vec::new());
            dot(canvas, (x, y), (step, path.len()), share(&place), above, GREY);
        }
    }
    for (step, state) in path.iter().enumerate() {
        dot(canvas, (x, y), (step, path.len()), share(state), above, BLUE);
    }
    let width = PANEL / plan.actions.len().max(1) as u32;
    let middle = y + above + below / 2;
    for (place, action) in (0..).zip(&plan.actions) {
        let size = (f64::from(*action).abs() / rules.largest_action * f64::from(below / 2 - 4)) as u32;
        let top = if *action > 0.0 { middle - size } else { middle };
        canvas.fill((x + place * width + 2, top), (width.saturating_sub(4).max(1), size.max(1)), ORANGE);
    }
    Ok(())
}

fn dot(
    canvas: &mut Canvas,
    (x, y): (u32, u32),
    (step, steps): (usize, usize),
    share: f64,
    height: u32,
    colour: RGBColor,
) {
    let across = x + (PANEL - 6) * step as u32 / steps.max(1) as u32;
    let up = ((1.0 - share.clamp(0.0, 1.0)) * f64::from(height - 6)) as u32;
    canvas.fill((across, y + up), (5, 5), colour);
}
