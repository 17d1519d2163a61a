//! Every number of a config and of an imported task at its extremes: refused in one short line, or taken.

use std::panic::{AssertUnwindSafe, catch_unwind};

use paig::tasks::Task;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use toml::{Table, Value};

/// In place of whole numbers and of others.
const WHOLE: [&str; 8] = [
    "9223372036854775807",
    "9223372036854775808",
    "18446744073709551615",
    "-9223372036854775808",
    "-1",
    "0",
    "4294967296",
    "0.5",
];
const REAL: [&str; 9] = ["nan", "-nan", "inf", "-inf", "1e300", "-1e300", "1e-300", "-1.0", "0.0"];
/// A line for people, without the text that a parser shows.
const LONGEST: usize = 1500;

/// The places of all numbers: keys, and numbers of list entries.
fn numbers(value: &Value, place: &mut Vec<String>, found: &mut Vec<(Vec<String>, bool)>) {
    match value {
        Value::Integer(_) => found.push((place.clone(), true)),
        Value::Float(_) => found.push((place.clone(), false)),
        Value::Table(table) => table.iter().for_each(|(key, value)| {
            place.push(key.clone());
            numbers(value, place, found);
            place.pop();
        }),
        Value::Array(list) => list.iter().enumerate().for_each(|(number, value)| {
            place.push(number.to_string());
            numbers(value, place, found);
            place.pop();
        }),
        _ => {}
    }
}

fn entry<'a>(value: &'a mut Value, place: &[String]) -> &'a mut Value {
    let Some((key, rest)) = place.split_first() else { return value };
    let below = match value {
        Value::Table(table) => &mut table[key.as_str()],
        Value::Array(list) => &mut list[key.parse::<usize>().unwrap()],
        _ => unreachable!("a place leads through tables and lists"),
    };
    entry(below, rest)
}

/// Texts in which one number is an extreme one: also those that are no number of TOML.
fn extremes(text: &str) -> Vec<(String, String)> {
    const MARK: &str = "@@";
    let whole = Value::Table(text.parse::<Table>().unwrap());
    let mut found = Vec::new();
    numbers(&whole, &mut Vec::new(), &mut found);
    let mut texts = Vec::new();
    for (place, is_whole) in found {
        let mut changed = whole.clone();
        *entry(&mut changed, &place) = Value::String(MARK.into());
        let template = toml::to_string(&changed).unwrap();
        for number in if is_whole { &WHOLE[..] } else { &REAL[..] } {
            let text = template.replace(&format!("\"{MARK}\""), number);
            texts.push((format!("{} = {number}", place.join(".")), text));
        }
    }
    texts
}

/// How many are tried; each is taken or refused.
#[track_caller]
fn try_all(text: &str, read: impl Fn(&str) -> anyhow::Result<()>) -> usize {
    let texts = extremes(text);
    let failures: Vec<String> = texts
        .iter()
        .filter_map(|(name, text)| match catch_unwind(AssertUnwindSafe(|| read(text))) {
            Err(_) => Some(format!("{name}: a panic")),
            Ok(Ok(())) => None,
            Ok(Err(error)) => {
                let said = format!("{error:#}");
                (said.len() > LONGEST).then(|| format!("{name}: {said}"))
            }
        })
        .collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    texts.len()
}

#[test]
fn extreme_numbers_of_a_config_are_taken_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("config.toml");
    let overrides = Overrides { task: Some("spring_color".into()), ..Overrides::default() };
    let config = Config::load(None, &overrides).unwrap();
    let tried = try_all(&config.to_toml(), |text| {
        std::fs::write(&file, text)?;
        Config::read(&file).map(drop)
    });
    println!("{tried} extreme numbers of a config");
    assert!(tried > 400, "{tried}");
}

const VIDEO: &str = r#"
name = "scene"
summary = "filmed"
[system]
side = 32
channels = 3
objects = 1
input_steps = 4
pred_steps = 6
dt = 0.04
equation = "falling"
[data]
folder = "."
train_frames = 12
test_frames = 16
[video]
size = [640, 480]
crop = [0, 0, 480]
step = 1
film_step = 1
time_unit = "s"
frame_seconds = 0.04
pixels_per_metre = 200.0
scale_percent = 1.0
time_percent = 0.5
origin = [10.0, 20.0]
angle = 3.0
y_up = true
[[video.sources]]
file = "clip.mp4"
frames = [0, 100]
first_seconds = 0.0
held_out_from = 75
"#;

#[test]
fn extreme_numbers_of_a_task_are_taken_or_refused() {
    let tried = try_all(VIDEO, |text| Task::from_toml(text).map(drop));
    println!("{tried} extreme numbers of a task");
    assert!(tried > 150, "{tried}");
}

/// What an editor may leave in the record of the videos.
#[test]
fn a_record_that_contradicts_itself_is_refused() {
    Task::from_toml(VIDEO).unwrap();
    for (from, to, words) in [
        ("held_out_from = 75", "held_out_from = 9999", "held_out_from = 9999"),
        ("frames = [0, 100]", "frames = [100, 0]", "frames = [100, 0]"),
        ("frames = [0, 100]", "frames = [0, 100, 7]", "expected 2 values, found 3"),
        ("crop = [0, 0, 480]", "crop = [0, 0, 2000000000]", "about the picture of 640 x 480"),
        ("crop = [0, 0, 480]", "crop = [-9000, 0, 480]", "about the picture"),
        ("first_seconds = 0.0", "first_seconds = nan", "first_seconds"),
        ("angle = 3.0", "angle = 1e300", "video.angle = 1e300"),
        ("origin = [10.0, 20.0]", "origin = [10.0]", "expected 2 values, found 1"),
        ("size = [640, 480]", "size = [0, 480]", "video.size"),
        ("dt = 0.04", "dt = 0.08", "import the video again with --fps"),
    ] {
        let text = VIDEO.replace(from, to);
        assert_ne!(text, VIDEO);
        let said = format!("{:#}", Task::from_toml(&text).unwrap_err());
        assert!(said.contains(words), "{to}: {said}");
    }
}

#[test]
fn walls_stand_in_or_beside_the_frame_and_units_have_two_powers() {
    let equation = |walls: &str, unit: &str| {
        let text = format!(
            "[system.equation]\nacceleration = \"vec(0, g)\"\nwalls = {{ {walls} }}\nparameters = {{ g = {{ unit = {unit} }} }}\n"
        );
        Task::from_toml(&VIDEO[..VIDEO.find("[video]").unwrap()].replace("equation = \"falling\"\n", &text))
    };
    equation("bottom = 30", "[1, -2]").unwrap();
    equation("bottom = 60", "[1, -2]").unwrap();
    let said = |walls: &str, unit: &str| format!("{:#}", equation(walls, unit).unwrap_err());
    assert!(said("bottom = 1000", "[1, -2]").contains("walls.bottom = 1000"), "{}", said("bottom = 1000", "[1, -2]"));
    assert!(said("bottom = 30", "[1, -2, 0]").contains("expected 2 values, found 3"));
}
