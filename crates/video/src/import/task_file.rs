//! The text of the task file: what a person reads and changes next.

use anyhow::{Context, Result};
use serde::Serialize;
use toml::Table;

use super::hold_out::Cut;
use super::request::ImportRequest;
use paig::network::cells::Equations;
use paig::network::cells::text::EquationTable;
use paig::network::system::EquationEntry;
use paig::support::significant::significant;
use paig::support::toml_values::quoted;
use paig::tasks::Task;
use paig::tasks::video::Video;

/// Side up to which a frame is small, and single frames and clips in a step of the recipe where it is larger: a step takes
/// as long as the frames have pixels, and the frames of one video are much alike.
const SMALL_SIDE: usize = 48;
const LARGE_STEP: [usize; 2] = [16, 10];
/// Beginning of the file.
pub(super) const MADE_BY: &str = "# Made by `paig import`";
/// Steps on whole frames, of such.
const FINE_STEPS: u64 = 400;

/// The table of the videos, its keys in their order.
#[derive(Serialize)]
struct VideosTable<'a> {
    video: &'a Video,
}

/// The file of a task whose clips were cut from these videos. `dt` is in the unit of `video.time_unit`.
///
/// # Errors
/// What a task refuses: see [`Task::from_toml`].
pub(super) fn text(request: &ImportRequest, name: &str, dt: f64, cut: &Cut, video: &Video) -> Result<String> {
    let kind = request.kind()?;
    let equations = Equations::default().names();
    let unit = match video.time_unit.as_str() {
        "s" => "seconds between two frames: parameters are in seconds",
        "ms" => "milliseconds between two frames: parameters are in milliseconds",
        _ => "frames of the video from one frame to the next: parameters are in frames",
    };
    let scale = match video.metres_per_pixel(request.side) {
        Some(metres) => format!("# A pixel of a frame is {} m.\n", significant(metres, 5)),
        None => {
            "# The scale is not known: lengths are learned in pixels of a frame, and measured in pixels of the video.\n"
                .into()
        }
    };
    let summary = video.source_names().join(", ");
    let walls = if kind.walls {
        "wall_margin = 0.0                # radius of an object, pixels of a frame: its centre turns so far from the edge\n"
    } else {
        ""
    };
    let recipe = if request.side <= SMALL_SIDE {
        String::new()
    } else {
        let [frames, clips] = LARGE_STEP;
        format!(
            "# Large frames, for small objects: fewer of them in a step.\n\
             [recipe.fast.model]\n\
             subtract_background = true       # what moves shows by itself before what stands still\n\n\
             [recipe.fast.discover]\n\
             frames = {frames}\n\
             fine_steps = {FINE_STEPS}                 # a measurement wants positions as good as they get\n\
             end_at_best = false              # validation sees later frames, maybe places where nothing was before\n\n\
             [recipe.fast.discover.guide]\n\
             waits = false                    # shadows and strings move, too, and are never drawn\n\n\
             [recipe.fast.join]\n\
             batch = {clips}\n\n"
        )
    };
    let (named, written) = match &request.equation {
        EquationEntry::Name(name) => (
            format!(
                "# What the objects obey: {equations}; or a table with accelerations\nequation = {}\n",
                quoted(name)
            ),
            String::new(),
        ),
        EquationEntry::Text(table) => (
            String::new(),
            format!("\n# What the objects obey, in pixels of a frame and the unit of dt.\n{}", as_table(table)?),
        ),
    };
    let text = format!(
        "{MADE_BY}; change what you know better.\n\
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
         {named}\
         {walls}\
         {written}\
         \n\
         [data]\n\
         folder = \".\"                     # the files lie beside this one\n\
         train_frames = {train:<17} # frames of a training clip\n\
         test_frames = {test:<18} # frames of a test clip\n\
         \n\
         {recipe}\
         # Where the clips come from. Nothing that learns reads it.\n\
         {scale}",
        name = quoted(name),
        summary = quoted(&format!("filmed: {summary}")),
        side = request.side,
        channels = request.channels(),
        objects = request.objects.or(kind.objects).unwrap_or(1),
        input = request.input_steps,
        pred = request.pred_steps,
        train = cut.train_frames,
        test = cut.test_frames,
    );
    let text = text + &toml::to_string(&VideosTable { video })?;
    Task::from_toml(&text).context("these options make no task")?;
    Ok(text)
}

/// As `[system.equation]`.
fn as_table(equation: &EquationTable) -> Result<String> {
    let named = |name: &str, value: toml::Value| toml::Value::Table(Table::from_iter([(name.to_string(), value)]));
    Ok(toml::to_string(&named("system", named("equation", toml::Value::try_from(equation)?)))?)
}
