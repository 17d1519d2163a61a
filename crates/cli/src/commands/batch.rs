//! Measures many videos into one table. See `paig batch --help`.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, FromArgMatches};
use paig::runs::folder;
use paig::support::guard::ensure_no_run;
use paig::support::run_names::DONE;
use paig::support::{atomic, device, storage};
use paig_experiments::sweep::{self, JobStage, Work};
use paig_terminal::{interrupt, say};
use paig_video::batch::{BatchEntry, FILES, PAGE, videos_of, write};
use paig_video::measure::results::Measurement;
use serde::Deserialize;

use super::measure;
use crate::sweep_display::{SweepDisplay, conclude};

/// Words of a video's measurement, beside its results: with others it is measured again.
const COMMAND: &str = "command.json";

/// Measures many videos, each as `paig measure` does, and puts the results into one table: batch.csv, batch.json and batch.html.
///
/// Videos are those of a folder, or those of a list in TOML: a table `[[video]]` for each with `file`, optionally `name`, and
/// options of `paig measure` by their names (equation = "falling", frames = "30..62", y-up = true); `[measure]` holds the
/// shared options. A video that fails stops no other one; the exit code is 1 then. Given again, the same command measures only
/// the videos without a result.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  paig batch clips --jobs 2 -- --equation falling --scale 12,40,12,300,0.5 --y-up\n  \
                  paig batch clips.toml --out results\n  paig batch reports/real/videos.toml --videos downloads --out real"
)]
pub struct BatchArguments {
    /// A folder with videos, or a list of them (.toml)
    #[arg(value_name = "FOLDER or LIST")]
    source: PathBuf,
    /// Folder for the table and for each video's results
    #[arg(long, value_name = "DIR", default_value = "batch")]
    out: PathBuf,
    /// Folder from which the files of a list count [default: the list's folder]
    #[arg(long, value_name = "DIR")]
    videos: Option<PathBuf>,
    /// Videos at a time
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// Options of `paig measure` for all videos
    #[arg(last = true, value_name = "OPTIONS")]
    options: Vec<OsString>,
}

/// A list of videos.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct BatchList {
    #[serde(default)]
    measure: toml::Table,
    video: Vec<toml::Table>,
}

/// A video of a list.
#[derive(Debug, PartialEq)]
struct ListedVideo {
    name: Option<String>,
    video: PathBuf,
    options: Vec<OsString>,
}

/// One video.
struct BatchJob {
    name: String,
    video: PathBuf,
    folder: PathBuf,
    words: Vec<OsString>,
}

pub fn run(arguments: BatchArguments) -> Result<ExitCode> {
    ensure!(arguments.jobs > 0, "--jobs must be at least 1");
    let jobs = jobs(&arguments)?;
    let program = sweep::training_program()?;
    ensure_no_run(&arguments.out)?;
    FILES.settle(&arguments.out)?;
    FILES.check(&arguments.out)?;
    jobs.iter().try_for_each(BatchJob::check_folder)?;
    storage::storage().create_folder(&arguments.out).with_context(|| format!("folder {}", arguments.out.display()))?;
    // Two with other options would mix their results.
    let _lock = folder::lock(&arguments.out)?;
    for job in jobs.iter().filter(|job| job.stage().is_ok_and(|stage| stage == JobStage::New)) {
        job.begin()?;
    }
    interrupt::catch()?;
    let mut display = SweepDisplay::new(jobs.len());
    let summary = sweep::run(&program, &jobs, arguments.jobs, &interrupt::asked, &mut |event| display.show(&event))?;
    display.close();
    write(&arguments.out, &jobs.iter().map(BatchJob::entry).collect::<Vec<_>>())?;
    say!("look at {}", arguments.out.join(PAGE).display());
    Ok(conclude(&summary))
}

fn jobs(arguments: &BatchArguments) -> Result<Vec<BatchJob>> {
    let threads = (device::cores() / arguments.jobs).max(1).to_string();
    let shared = [OsString::from("--threads"), threads.into()].into_iter().chain(arguments.options.iter().cloned());
    let shared: Vec<OsString> = shared.collect();
    let videos: Vec<ListedVideo> = if arguments.source.is_dir() {
        ensure!(arguments.videos.is_none(), "--videos belongs to a list; {} is a folder", arguments.source.display());
        let alone = |video| ListedVideo { name: None, video, options: Vec::new() };
        videos_of(&arguments.source)?.into_iter().map(alone).collect()
    } else {
        listed(&arguments.source, arguments.videos.as_deref())?
    };
    // Those of the table are taken.
    let mut names: BTreeSet<String> = FILES.files.iter().map(ToString::to_string).collect();
    let job = |ListedVideo { name, video, options }: ListedVideo| {
        let words = [OsString::from("measure"), video.clone().into()].into_iter().chain(shared.iter().cloned());
        let words: Vec<OsString> = words.chain(options).collect();
        check(&words).with_context(|| format!("video {}", video.display()))?;
        let stem = || video.file_stem().unwrap_or(video.as_os_str()).to_string_lossy().into_owned();
        let name = folder_name(&name.unwrap_or_else(stem), &mut names)?;
        Ok(BatchJob { folder: arguments.out.join(&name), name, video, words })
    };
    videos.into_iter().map(job).collect()
}

/// A name like this one that none of those before has, for a folder within the batch's: `.` and `..` are other folders, and what begins
/// with a dot is hidden.
fn folder_name(like: &str, names: &mut BTreeSet<String>) -> Result<String> {
    let visible = match like.trim_start_matches('.') {
        "" => "video",
        visible => visible,
    };
    let named = |ending: &str| atomic::named_after(visible.as_ref(), ending, 0);
    let numbered = (2..).map(|number| named(&format!("-{number}")));
    let name = std::iter::once(named("")).chain(numbered).find(|name| names.insert(name.clone()));
    name.context("no name is left")
}

/// Videos of a list with their options. Files count from `videos`, or the list's folder.
fn listed(path: &Path, videos: Option<&Path>) -> Result<Vec<ListedVideo>> {
    let read = || Ok::<BatchList, anyhow::Error>(toml::from_str(&storage::read_to_string(path)?)?);
    let BatchList { measure, video } = read().with_context(|| format!("list {}", path.display()))?;
    ensure!(!video.is_empty(), "list {}: expected a table [[video]] for each video, found none", path.display());
    let folder = videos.or(path.parent()).unwrap_or(Path::new("."));
    let of = |mut own: toml::Table| {
        let file = own.remove("file").and_then(|file| file.as_str().map(String::from));
        let file = file.with_context(|| format!("list {}: a [[video]] lacks file = \"NAME\"", path.display()))?;
        let name = match own.remove("name") {
            Some(toml::Value::String(name)) if is_file_name(&name) => Some(name),
            Some(name) => bail!("list {}, {file}: name = {name}: expected a name for a folder", path.display()),
            None => None,
        };
        let mut options = measure.clone();
        options.extend(own);
        let words = options.iter().map(|(key, value)| words(key, value)).collect::<Result<Vec<_>>>();
        let words = words.with_context(|| format!("list {}, {file}", path.display()))?;
        Ok(ListedVideo { name, video: folder.join(file), options: words.concat() })
    };
    video.into_iter().map(of).collect()
}

/// Whether a text is one normal part of a path.
fn is_file_name(text: &str) -> bool {
    Path::new(text).file_name().is_some_and(|name| name == text)
}

/// An option as words: a switch, or a value for each of several.
fn words(key: &str, value: &toml::Value) -> Result<Vec<OsString>> {
    let name = format!("--{}", key.replace('_', "-"));
    let one = |value: &toml::Value| match value {
        toml::Value::String(text) => Ok(text.clone()),
        toml::Value::Integer(number) => Ok(number.to_string()),
        toml::Value::Float(number) => Ok(number.to_string()),
        other => bail!("{key}: expected a text, a number, true, false or a list of these, found {other}"),
    };
    Ok(match value {
        toml::Value::Boolean(true) => vec![name.into()],
        toml::Value::Boolean(false) => Vec::new(),
        toml::Value::Array(values) => {
            let values = values.iter().map(one).collect::<Result<Vec<_>>>()?;
            values.into_iter().flat_map(|value| [name.clone().into(), value.into()]).collect()
        }
        value => vec![name.into(), one(value)?.into()],
    })
}

/// Refuses options that `paig measure` does not have before a video is measured.
fn check(words: &[OsString]) -> Result<()> {
    ensure!(words.iter().all(|word| word != "--out"), "--out is the batch's: give it before --");
    let command = measure::MeasureArguments::augment_args(clap::Command::new("measure"));
    let matches = command.try_get_matches_from(words).map_err(|error| {
        let text = error.to_string();
        anyhow::anyhow!("{}", text.lines().next().unwrap_or_default().trim_start_matches("error: "))
    })?;
    measure::MeasureArguments::from_arg_matches(&matches)?;
    Ok(())
}

impl BatchJob {
    /// # Errors
    /// A folder with files that no batch wrote.
    fn check_folder(&self) -> Result<()> {
        let (folder, command) = (&self.folder, self.folder.join(COMMAND));
        let ours = |text: &[u8]| {
            serde_json::from_slice::<Vec<String>>(text)
                .is_ok_and(|words| words.first().is_some_and(|it| it == "measure"))
        };
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let entry = entries.map(|entry| entry.file_name()).find(|name| !atomic::is_partial(name));
        let Some(entry) = entry.filter(|_| !storage::read(&command).is_ok_and(|text| ours(&text))) else {
            return Ok(());
        };
        bail!(
            "{} holds {:?}, and no measurement of `paig batch`; choose another folder with --out",
            folder.display(),
            entry
        )
    }

    /// Notes what is measured, for another time.
    fn begin(&self) -> Result<()> {
        let named = || format!("folder {}", self.folder.display());
        storage::storage().create_folder(&self.folder).with_context(named)?;
        storage::storage().remove_if_there(&self.folder.join(DONE)).with_context(named)?;
        let words = self.lossy();
        atomic::write_file(&self.folder.join(COMMAND), |file| Ok(serde_json::to_writer_pretty(file, &words)?))
    }

    fn lossy(&self) -> Vec<String> {
        self.words.iter().map(|word| word.to_string_lossy().into_owned()).collect()
    }

    fn entry(&self) -> BatchEntry {
        let ending = match sweep::failure(&self.folder) {
            Some(reason) => Err(reason),
            None => Measurement::read(&self.folder).map_err(|error| format!("{error:#}")),
        };
        BatchEntry { name: self.name.clone(), video: self.video.clone(), ending }
    }
}

impl Work for BatchJob {
    fn folder(&self) -> &Path {
        &self.folder
    }

    fn stage(&self) -> Result<JobStage> {
        let same = || {
            let text = storage::read_to_string(&self.folder.join(COMMAND)).ok()?;
            Some(serde_json::from_str::<Vec<String>>(&text).ok()? == self.lossy())
        };
        let finished = self.folder.join(DONE).exists() && same().unwrap_or(false);
        Ok(if finished { JobStage::Finished } else { JobStage::New })
    }

    fn words(&self, _stage: JobStage) -> Vec<OsString> {
        self.words.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_gives_each_video_what_all_share_and_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("list.toml");
        let text = "[measure]\nequation = \"falling\"\ny-up = true\n[[video]]\nfile = \"a.mp4\"\nfps = 120\n\
                    [[video]]\nfile = \"b.mp4\"\nname = \"second\"\nequation = \"spring\"\nignore = [\"0,0,9,9\", \"1,1,5,5\"]\n";
        std::fs::write(&list, text).unwrap();
        let one = ["--equation", "falling", "--fps", "120", "--y-up"].map(OsString::from).to_vec();
        let two = ["--equation", "spring", "--ignore", "0,0,9,9", "--ignore", "1,1,5,5", "--y-up"];
        let two = two.map(OsString::from).to_vec();
        let videos = |folder: &Path| {
            let one = ListedVideo { name: None, video: folder.join("a.mp4"), options: one.clone() };
            vec![one, ListedVideo { name: Some("second".into()), video: folder.join("b.mp4"), options: two.clone() }]
        };
        assert_eq!(listed(&list, None).unwrap(), videos(folder.path()));
        let other = Path::new("downloads");
        assert_eq!(listed(&list, Some(other)).unwrap(), videos(other));
        std::fs::write(&list, "[[video]]\nfile = \"a.mp4\"\nname = \"../b\"\n").unwrap();
        let error = format!("{:#}", listed(&list, None).unwrap_err());
        assert!(error.contains("../b") && error.contains("expected a name for a folder"), "{error}");
    }

    #[test]
    fn folders_of_videos_lie_in_the_batchs_and_are_not_its_table() {
        let mut names = BTreeSet::from(["batch.csv".to_string()]);
        let mut name = |like: &str| folder_name(like, &mut names).unwrap();
        assert_eq!(
            ["a", "a", "..", ".", ".b", "batch.csv"].map(&mut name),
            ["a", "a-2", "video", "video-2", "b", "batch.csv-2"]
        );
        // As long as the file system takes.
        let long = "x".repeat(255);
        assert_eq!([&*long, &long].map(name), [long.clone(), "x".repeat(253) + "-2"]);
    }

    #[test]
    fn options_that_are_not_there_are_refused_at_once() {
        let words = |text: &str| text.split(' ').map(OsString::from).collect::<Vec<_>>();
        check(&words("measure a.mp4 --equation falling --y-up")).unwrap();
        let error = format!("{:#}", check(&words("measure a.mp4 --equatoin falling")).unwrap_err());
        assert!(error.contains("--equatoin"), "{error}");
        assert!(check(&words("measure a.mp4 --out b")).is_err());
    }
}
