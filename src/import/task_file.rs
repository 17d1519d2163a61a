//! The text of the task file: what a person reads and changes next.

use anyhow::{Context, Result};
use serde::Serialize;

use super::hold_out::Cut;
use super::request::Request;
use crate::network::cells;
use crate::tasks::Task;
use crate::tasks::video::Video;

/// The table of the videos, its keys in their order.
#[derive(Serialize)]
struct Record<'a> {
    video: &'a Video,
}

/// The file of a task whose clips were cut from these videos. `dt` is in the unit of `video.time_unit`.
///
/// # Errors
/// What a task refuses: see [`Task::from_toml`].
pub(super) fn text(request: &Request, name: &str, dt: f64, cut: &Cut, video: &Video) -> Result<String> {
    let kind = cells::find(&request.equation)?;
    let equations = cells::kinds().iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
    let unit = match video.time_unit.as_str() {
        "s" => "seconds between two frames: parameters are in seconds",
        "ms" => "milliseconds between two frames: parameters are in milliseconds",
        _ => "frames of the video from one frame to the next: parameters are in frames",
    };
    let scale = match video.metres_per_pixel(request.side) {
        Some(metres) => format!("# A pixel of a frame is {metres:.6} m.\n"),
        None => "# The scale is not known: lengths come out in pixels of a frame.\n".into(),
    };
    let summary = video.sources.iter().map(|source| file_name(&source.file)).collect::<Vec<_>>().join(", ");
    let walls = if kind.walls {
        "wall_margin = 0.0                # radius of an object, pixels of a frame: its centre turns so far from the edge\n"
    } else {
        ""
    };
    let text = format!(
        "# Made by `import`; change what you know better.\n\
         name = {name}\n\
         summary = {summary}\n\
         \n\
         [system]\n\
         side = {side:<25} # pixels; frames are square\n\
         channels = {channels:<21} # 1 grey, 3 colour\n\
         objects = {objects:<22} # how many things move\n\
         input_steps = {input:<18} # frames that the encoder sees before the roll-out\n\
         pred_steps = {pred:<19} # predicted frames that are trained on\n\
         dt = {dt:<27?} # {unit}\n\
         # What the objects obey: {equations}\n\
         equation = {equation}\n\
         {walls}\
         \n\
         [data]\n\
         folder = \".\"                     # the files lie beside this one\n\
         train_frames = {train:<17} # frames of a training clip\n\
         test_frames = {test:<18} # frames of a test clip\n\
         \n\
         # Where the clips come from. Nothing that learns reads it.\n\
         {scale}",
        name = quoted(name),
        summary = quoted(&format!("filmed: {summary}")),
        side = request.side,
        channels = request.channels(),
        objects = request.objects.or(kind.objects).unwrap_or(1),
        input = request.input_steps,
        pred = request.pred_steps,
        equation = quoted(&request.equation),
        train = cut.train_frames,
        test = cut.test_frames,
    );
    let text = text + &toml::to_string(&Record { video })?;
    Task::from_toml(&text).context("these options make no task")?;
    Ok(text)
}

fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}

fn file_name(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}
