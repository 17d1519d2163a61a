//! Public datasets of filmed motions as lists for `paig batch`: `cargo xtask dataset`.
//!
//! ```sh
//! cargo xtask dataset reports/datasets/delfys75.toml Delfys75 --out delfys75
//! paig batch delfys75/videos.toml --out delfys75/measured
//! paig measurements delfys75/measured --references delfys75/references.toml --json delfys75/measurements.json
//! cargo xtask tables delfys75/measured --published delfys75/published.toml --out delfys75
//! ```
//!
//! A description names the classes of a dataset. A class is a folder `CLASS/SETTING/..` of videos, beside which videos of masks
//! may lie, or one file. True values stand in the description, or by class and setting in the dataset's parameters.json:
//! `{"pendulum": {"pendulum_45": {"length": {"mean": 0.45}}}}`.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use paig::support::{atomic, storage};
use paig_video::batch::videos_of;
use paig_video::measure::table::{Reference, References};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::tables::{PublishedFile, PublishedValue};

mod frames;

/// List of the videos.
const VIDEOS: &str = "videos.toml";
/// True values of a dataset's settings.
const TRUE_VALUES: &str = "parameters.json";

/// Writes videos.toml, references.toml and published.toml of a public dataset.
#[derive(Debug, Args)]
pub struct DatasetArguments {
    /// Description of the dataset (reports/datasets/*.toml)
    description: PathBuf,
    /// Folder of the dataset
    folder: PathBuf,
    /// Pixels to a metre in the videos of a setting, such as sliding_block/low=812; may be repeated
    #[arg(long, value_name = "CLASS/SETTING=F")]
    pixels_per_metre: Vec<String>,
    /// Folder of the files
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct DatasetDescription {
    /// Name of the table.
    table: String,
    class: Vec<DatasetClass>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct DatasetClass {
    /// Folder, in any case, or file.
    path: PathBuf,
    quantity: String,
    truth: Option<TrueValue>,
    /// Whether the quantity is a length or an acceleration in the picture.
    #[serde(default)]
    needs_scale: bool,
    /// Source of the published values.
    by: String,
    /// Published values by setting; of a file by its name without the ending.
    #[serde(default)]
    published: BTreeMap<String, f64>,
    /// Options of `paig measure`.
    measure: toml::Table,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum TrueValue {
    Number(f64),
    /// Key in parameters.json.
    Key(String),
}

/// A list for `paig batch`.
#[derive(Debug, Serialize)]
struct VideoList {
    video: Vec<toml::Table>,
}

/// One video of a dataset.
struct DatasetVideo {
    path: PathBuf,
    /// Name in the batch.
    name: String,
    setting: String,
}

/// Files of a batch and of its table.
struct DatasetFiles {
    list: VideoList,
    references: References,
    published: PublishedFile,
}

/// # Errors
/// A folder without any video of the description, a damaged file, a full disk.
pub fn run(arguments: &DatasetArguments) -> Result<()> {
    let DatasetArguments { description, folder, pixels_per_metre, out } = arguments;
    let text = storage::read_to_string(description)?;
    let read = || Ok::<DatasetDescription, anyhow::Error>(toml::from_str(&text)?);
    let DatasetDescription { table, class } =
        read().with_context(|| format!("description {}", description.display()))?;
    let scales = scales(pixels_per_metre)?;
    let truths = true_values(&folder.join(TRUE_VALUES))?;
    fs::create_dir_all(out)?;
    let mut files = DatasetFiles {
        list: VideoList { video: Vec::new() },
        references: References::new(),
        published: PublishedFile { track: Vec::new(), value: Vec::new() },
    };
    for class in &class {
        let Some(place) = place(folder, &class.path)? else {
            println!("class {}: not in {}", class.path.display(), folder.display());
            continue;
        };
        for video in videos(folder, &place)? {
            let mut options = class.measure.clone();
            if class.needs_scale {
                let setting = format!("{}/{}", class.path.display(), video.setting);
                let Some(scale) = scales.get(&setting) else {
                    println!("{}: left out, its scale is unknown: give --pixels-per-metre {setting}=F", video.name);
                    continue;
                };
                options.insert("pixels-per-metre".into(), (*scale).into());
            }
            let film = frames::converted(&video.path, &video.name, out, &mut options)?;
            options.insert("file".into(), film.canonicalize()?.to_string_lossy().into_owned().into());
            files.add(&table, class, &video, options, class.true_value(&truths, &video.setting)?);
        }
    }
    ensure!(!files.list.video.is_empty(), "folder {}: no videos of {}", folder.display(), description.display());
    println!("{} videos in {}", files.list.video.len(), out.join(VIDEOS).display());
    write(&out.join(VIDEOS), &files.list)?;
    write(&out.join("references.toml"), &files.references)?;
    write(&out.join("published.toml"), &files.published)
}

impl DatasetFiles {
    fn add(
        &mut self,
        table: &str,
        class: &DatasetClass,
        video: &DatasetVideo,
        options: toml::Table,
        truth: Option<f64>,
    ) {
        let mut options = options;
        options.insert("name".into(), video.name.clone().into());
        self.list.video.push(options);
        if let Some(value) = truth {
            let reference = Reference::Sourced { value, from: table.into() };
            self.references.entry(video.name.clone()).or_default().insert(class.quantity.clone(), reference);
        }
        self.published.value.push(PublishedValue {
            table: table.into(),
            clip: video.name.clone(),
            quantity: class.quantity.clone(),
            published: class.published.get(&video.setting).copied(),
            by: class.by.clone(),
            truth,
        });
    }
}

impl DatasetClass {
    fn true_value(&self, truths: &Value, setting: &str) -> Result<Option<f64>> {
        let key = match &self.truth {
            None => return Ok(None),
            Some(TrueValue::Number(number)) => return Ok(Some(*number)),
            Some(TrueValue::Key(_)) if truths.is_null() => return Ok(None),
            Some(TrueValue::Key(key)) => key,
        };
        let class = self.path.to_string_lossy();
        let value = truths[class.as_ref()][setting][key]["mean"].as_f64();
        let named = || format!("{TRUE_VALUES}: no number {class}.{setting}.{key}.mean");
        value.map(Some).with_context(named)
    }
}

/// Content of parameters.json; null of a dataset without it.
fn true_values(path: &Path) -> Result<Value> {
    if !path.is_file() {
        return Ok(Value::Null);
    }
    serde_json::from_str(&storage::read_to_string(path)?).with_context(|| format!("true values {}", path.display()))
}

fn write(path: &Path, content: &impl Serialize) -> Result<()> {
    let text = toml::to_string(content)?;
    atomic::write_file(path, |file| Ok(file.write_all(text.as_bytes())?))
}

/// Pixels to a metre by `CLASS/SETTING`.
fn scales(stated: &[String]) -> Result<BTreeMap<String, f64>> {
    let parsed = |text: &String| {
        let (setting, scale) = text.split_once('=')?;
        Some((setting.to_string(), scale.parse().ok().filter(|scale: &f64| scale.is_finite() && *scale > 0.0)?))
    };
    let one = |text: &String| {
        parsed(text).with_context(|| format!("--pixels-per-metre {text}: expected CLASS/SETTING=F, F positive"))
    };
    stated.iter().map(one).collect()
}

/// The folder or file of a class; the case of a folder's name does not matter.
fn place(folder: &Path, class: &Path) -> Result<Option<PathBuf>> {
    let exact = folder.join(class);
    if exact.exists() {
        return Ok(Some(exact));
    }
    let matches = |path: &PathBuf| path.file_name().is_some_and(|name| name.eq_ignore_ascii_case(class.as_os_str()));
    Ok(entries(folder)?.into_iter().find(matches))
}

/// Entries of a folder in order of their names.
fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let named = || format!("folder {}", folder.display());
    let entries = fs::read_dir(folder).with_context(named)?.map(|entry| Ok(entry.with_context(named)?.path()));
    let mut entries = entries.collect::<Result<Vec<_>>>()?;
    entries.sort();
    Ok(entries)
}

/// Videos in and under the place of a class, without those of masks.
fn videos(root: &Path, place: &Path) -> Result<Vec<DatasetVideo>> {
    let (mut folders, mut found) = (Vec::new(), Vec::new());
    match place.is_dir() {
        true => folders.push(place.to_path_buf()),
        false => found.push(place.to_path_buf()),
    }
    while let Some(folder) = folders.pop() {
        folders.extend(entries(&folder)?.into_iter().filter(|path| path.is_dir()));
        // A folder of folders has no videos.
        found.extend(videos_of(&folder).unwrap_or_default());
    }
    found.sort();
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    found.retain(|path| !name(path).contains("mask"));
    let video = |path: PathBuf| {
        let within = |folder| Ok::<_, anyhow::Error>(parts(path.strip_prefix(folder)?));
        let (name, below) = (within(root)?.join("-"), within(place)?);
        let setting = below.into_iter().next().or_else(|| parts(place).pop()).unwrap_or_default();
        Ok(DatasetVideo { name, setting, path })
    };
    found.into_iter().map(video).collect()
}

/// Parts of a path in small letters, the last one without its ending.
fn parts(path: &Path) -> Vec<String> {
    path.with_extension("").iter().map(|part| part.to_string_lossy().to_lowercase()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn description(name: &str) -> PathBuf {
        crate::project::project(&format!("reports/datasets/{name}.toml"))
    }

    /// Lists of a made-up folder with these files.
    fn lists(name: &str, files: &[&str], truths: &str, scales: &[&str]) -> Result<[toml::Table; 3]> {
        let folder = tempfile::tempdir()?;
        let (dataset, out) = (folder.path().join("dataset"), folder.path().join("out"));
        for file in files {
            fs::create_dir_all(dataset.join(file).parent().unwrap())?;
            fs::write(dataset.join(file), "")?;
        }
        fs::write(dataset.join(TRUE_VALUES), truths)?;
        let pixels_per_metre = scales.iter().map(|it| it.to_string()).collect();
        run(&DatasetArguments { description: description(name), folder: dataset, pixels_per_metre, out: out.clone() })?;
        let read = |name: &str| Ok::<toml::Table, anyhow::Error>(toml::from_str(&fs::read_to_string(out.join(name))?)?);
        Ok([read(VIDEOS)?, read("references.toml")?, read("published.toml")?])
    }

    fn names(videos: &toml::Table) -> Vec<&str> {
        videos["video"].as_array().unwrap().iter().map(|video| video["name"].as_str().unwrap()).collect()
    }

    #[test]
    fn takes_of_delfys75_have_the_true_and_published_values_of_their_setting() {
        let files =
            ["pendulum/pendulum_45/01/video.mp4", "pendulum/pendulum_45/01/video_mask.mp4", "led/led_2s/01/a.mp4"];
        let truths = r#"{"pendulum": {"pendulum_45": {"length": {"mean": 0.45, "std": 0.0}}}}"#;
        let [videos, references, published] = lists("delfys75", &files, truths, &[]).unwrap();
        assert_eq!(names(&videos), ["pendulum-pendulum_45-01-video"]);
        assert_eq!(videos["video"][0]["equation"].as_str(), Some("swing"));
        assert_eq!(references["pendulum-pendulum_45-01-video"]["l"]["value"].as_float(), Some(0.45));
        let row = &published["value"][0];
        assert_eq!((row["truth"].as_float(), row["published"].as_float()), (Some(0.45), Some(0.51)));
    }

    #[test]
    fn accelerations_need_a_scale() {
        let files = ["dropped_ball/small/01/a.mp4", "dropped_ball/large/01/a.mp4"];
        let [videos, ..] = lists("delfys75", &files, "{}", &["dropped_ball/large=800"]).unwrap();
        assert_eq!(names(&videos), ["dropped_ball-large-01-a"]);
        assert_eq!(videos["video"][0]["pixels-per-metre"].as_float(), Some(800.0));
        let error = format!("{:#}", lists("delfys75", &files, "{}", &["dropped_ball/large=0"]).unwrap_err());
        assert!(error.contains("dropped_ball/large=0: expected CLASS/SETTING=F"), "{error}");
        let error = format!("{:#}", lists("delfys75", &files, "{}", &[]).unwrap_err());
        assert!(error.contains("no videos of"), "{error}");
    }

    #[test]
    fn classes_of_iris_may_begin_with_a_capital() {
        let truths = r#"{"pendulum": {"pendulum_20": {"rope_length": {"mean": 0.5}}}}"#;
        let [videos, _, published] = lists("iris", &["Pendulum/pendulum_20/03.MP4"], truths, &[]).unwrap();
        assert_eq!(names(&videos), ["pendulum-pendulum_20-03"]);
        assert_eq!(published["value"][0]["truth"].as_float(), Some(0.5));
        let error = format!("{:#}", lists("iris", &["Pendulum/pendulum_20/03.mp4"], "{}", &[]).unwrap_err());
        assert!(error.contains("parameters.json: no number pendulum.pendulum_20.rope_length.mean"), "{error}");
    }
}
