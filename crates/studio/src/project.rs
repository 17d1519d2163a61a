//! A project: the folder of one video with everything that was made of it.

use std::fs;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result, bail, ensure};
use paig::support::atomic;
use paig_video::measure::results::{EXTENDED, Measurement};
use serde::{Deserialize, Serialize};

use crate::equations::{AUTO, definite, equation};
use crate::jobs::ProjectJob;
use crate::settings::ProjectSettings;

const RECORD: &str = "project.json";
const SETTINGS: &str = "settings.json";
const SOURCE: &str = "source";
const PREVIEW: &str = "preview";
const MEASUREMENTS: &str = "measurements";
const TRAININGS: &str = "trainings";
const FORMAT: u32 = 1;
/// Longest name of a project or a file, bytes.
const LONGEST: usize = 60;
/// Most characters of a title.
const LONGEST_TITLE: usize = 120;
/// Tries to find a name that is free.
const MOST_ALIKE: usize = 10_000;

/// What a project is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProjectRecord {
    pub format: u32,
    /// The video's name, for people.
    pub title: String,
    /// Seconds since 1970.
    pub created: u64,
    /// Key of the example that it is.
    pub example: Option<String>,
}

/// A folder with the record of a project.
#[derive(Debug, Clone)]
pub struct Project {
    folder: PathBuf,
}

impl Project {
    /// A new project in the workspace, named after a title.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn create(workspace: &Path, title: &str, example: Option<&str>) -> Result<Self> {
        let name = plain(Path::new(title).file_stem().and_then(|it| it.to_str()).unwrap_or_default());
        let names = (1..MOST_ALIKE).map(|count| if count == 1 { name.clone() } else { format!("{name}-{count}") });
        for name in names {
            let folder = workspace.join(name);
            match fs::create_dir(&folder) {
                Ok(()) => {
                    let created = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
                    let title = title.chars().filter(|c| !c.is_control()).take(LONGEST_TITLE).collect();
                    let record = ProjectRecord { format: FORMAT, title, created, example: example.map(Into::into) };
                    let project = Project { folder };
                    project.write(RECORD, &record)?;
                    project.write_settings(&ProjectSettings::default())?;
                    project.source_folder()?;
                    return Ok(project);
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => {
                    return Err(error).with_context(|| format!("cannot make the folder {}", folder.display()));
                }
            }
        }
        bail!("too many projects have the name {title}")
    }

    /// The project in a folder.
    ///
    /// # Errors
    /// There is none.
    pub fn at(folder: &Path) -> Result<Self> {
        ensure!(folder.join(RECORD).is_file(), "{} holds no project", folder.display());
        Ok(Project { folder: folder.into() })
    }

    /// A project of the workspace by its name.
    ///
    /// # Errors
    /// No name of a project, or one that leads out of the workspace.
    pub fn named(workspace: &Path, name: &str) -> Result<Self> {
        ensure!(is_plain(name), "{name:?} is no name of a project");
        let folder = workspace.join(name);
        ensure!(!folder.is_symlink(), "{name:?} is a link");
        Project::at(&folder)
    }

    /// All projects of the workspace, the newest first.
    pub fn all(workspace: &Path) -> Vec<Self> {
        let entries = fs::read_dir(workspace).into_iter().flatten().flatten();
        let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
        let mut all: Vec<_> = names.filter_map(|name| Project::named(workspace, &name).ok()).collect();
        all.sort_by_key(|project| {
            let created = project.record().map_or(0, |record| record.created);
            (std::cmp::Reverse(created), project.folder.clone())
        });
        all
    }

    pub fn name(&self) -> String {
        self.folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// # Errors
    /// A damaged file.
    pub fn record(&self) -> Result<ProjectRecord> {
        self.read(RECORD)
    }

    /// # Errors
    /// A damaged file.
    pub fn settings(&self) -> Result<ProjectSettings> {
        self.read(SETTINGS)
    }

    /// # Errors
    /// A full disk.
    pub fn write_settings(&self, settings: &ProjectSettings) -> Result<()> {
        self.write(SETTINGS, settings)
    }

    fn read<T: serde::de::DeserializeOwned>(&self, name: &str) -> Result<T> {
        let path = self.folder.join(name);
        let bytes = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        serde_json::from_slice(&bytes).with_context(|| format!("{} is damaged", path.display()))
    }

    fn write(&self, name: &str, value: &impl Serialize) -> Result<()> {
        atomic::write_file(&self.folder.join(name), |file| Ok(serde_json::to_writer_pretty(file, value)?))
    }

    /// Folder of the video, or of the pictures.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn source_folder(&self) -> Result<PathBuf> {
        let folder = self.folder.join(SOURCE);
        ensure!(!folder.is_symlink(), "{} is a link", folder.display());
        fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        Ok(folder)
    }

    /// The video: a file, or a folder of pictures.
    ///
    /// # Errors
    /// There is none yet.
    pub fn source(&self) -> Result<PathBuf> {
        let folder = self.source_folder()?;
        let files = fs::read_dir(&folder)?.flatten().map(|entry| entry.path());
        let mut files: Vec<_> = files.filter(|path| !atomic::is_partial(path.as_os_str())).collect();
        files.sort();
        match files.as_slice() {
            [] => bail!("no video was uploaded"),
            [file] if !is_picture(file) => Ok(file.clone()),
            _ => Ok(folder),
        }
    }

    pub fn preview_folder(&self) -> PathBuf {
        self.folder.join(PREVIEW)
    }

    /// Makes the previews.
    pub fn preview_job(&self) -> ProjectJob {
        ProjectJob::new(self.preview_folder())
    }

    /// Numbers of the measurements, ascending.
    pub fn measurements(&self) -> Vec<usize> {
        self.numbers(MEASUREMENTS)
    }

    /// Numbers of the trainings, ascending.
    pub fn trainings(&self) -> Vec<usize> {
        self.numbers(TRAININGS)
    }

    fn numbers(&self, of: &str) -> Vec<usize> {
        let entries = fs::read_dir(self.folder.join(of)).into_iter().flatten().flatten();
        let mut numbers: Vec<_> = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok()).collect();
        numbers.sort_unstable();
        numbers
    }

    pub fn measurement_folder(&self, number: usize) -> PathBuf {
        self.folder.join(MEASUREMENTS).join(number.to_string())
    }

    /// What `--equation` is given: a name, or the file of an equation with its missing term.
    ///
    /// # Errors
    /// An unknown name, a measurement that has no such file.
    pub fn equation(&self, settings: &ProjectSettings) -> Result<String> {
        let Some(number) = settings.extended else { return Ok(equation(&settings.equation)?.key.into()) };
        let file = self.measurement_folder(number).join(EXTENDED);
        ensure!(file.is_file(), "measurement {number} names no missing term; choose an equation");
        Ok(file.display().to_string())
    }

    /// The same of a training, where it is that of the latest measurement if the program is to choose.
    ///
    /// # Errors
    /// None is chosen yet.
    pub fn equation_to_train(&self, settings: &ProjectSettings) -> Result<String> {
        if settings.extended.is_some() || settings.equation != AUTO {
            return self.equation(settings);
        }
        let latest = self.measurements().last().map(|number| Measurement::read(&self.measurement_folder(*number)));
        let chosen = latest.and_then(Result::ok).map_or_else(|| AUTO.into(), |measurement| measurement.equation);
        Ok(definite(&chosen)?.key.into())
    }

    pub fn training_folder(&self, number: usize) -> PathBuf {
        self.folder.join(TRAININGS).join(number.to_string())
    }

    /// A file of the project by its path within it.
    ///
    /// # Errors
    /// No such file, or a path that leads out of the project, by its parts or by a link.
    pub fn file(&self, path: &Path) -> Result<PathBuf> {
        let plain = path.components().all(|part| matches!(part, Component::Normal(_)));
        ensure!(plain, "{} leads out of the project", path.display());
        let root = self.folder.canonicalize()?;
        let full = root.join(path).canonicalize().with_context(|| format!("there is no {}", path.display()))?;
        ensure!(full == root.join(path) && full.is_file(), "{} is no file of the project", path.display());
        Ok(full)
    }

    /// Removes the folder with all in it.
    ///
    /// # Errors
    /// A folder that cannot be removed.
    pub fn remove(&self) -> Result<()> {
        fs::remove_dir_all(&self.folder).with_context(|| format!("cannot remove {}", self.folder.display()))
    }
}

fn is_picture(path: &Path) -> bool {
    let extension = path.extension().and_then(|it| it.to_str()).unwrap_or_default().to_lowercase();
    ["png", "jpg", "jpeg"].contains(&extension.as_str())
}

/// Name of a file in which the video is kept: that of the uploaded one in plain characters.
///
/// # Errors
/// A name without an ending.
pub fn file_name(uploaded: &str) -> Result<String> {
    let path = Path::new(uploaded);
    let extension = path.extension().and_then(|it| it.to_str()).map(plain).unwrap_or_default();
    ensure!(
        path.extension().is_some() && !extension.is_empty(),
        "{uploaded:?}: expected a video file with an ending such as .mp4"
    );
    let stem = path.file_stem().and_then(|it| it.to_str()).unwrap_or_default();
    Ok(format!("{}.{extension}", plain(stem)))
}

/// Small letters, digits and hyphens.
fn plain(text: &str) -> String {
    let mut plain = String::new();
    for c in text.to_lowercase().chars() {
        match c {
            'a'..='z' | '0'..='9' => plain.push(c),
            _ if plain.ends_with('-') || plain.is_empty() => {}
            _ => plain.push('-'),
        }
    }
    plain.truncate(LONGEST);
    let plain = plain.trim_end_matches('-');
    if plain.is_empty() { "video".into() } else { plain.into() }
}

fn is_plain(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= LONGEST + 8
        && name.bytes().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'-')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projects_of_one_title_have_folders_of_their_own() {
        let workspace = tempfile::tempdir().unwrap();
        let title = "My <i>throw.MP4";
        let names: Vec<_> = (0..2).map(|_| Project::create(workspace.path(), title, None).unwrap().name()).collect();
        assert_eq!(names, ["my-i-throw", "my-i-throw-2"]);
        assert_eq!(Project::all(workspace.path()).len(), 2);
        assert_eq!(Project::named(workspace.path(), &names[0]).unwrap().record().unwrap().title, title);
    }

    #[test]
    fn nothing_outside_a_project_is_reached() {
        let workspace = tempfile::tempdir().unwrap();
        let project = Project::create(workspace.path(), "a.mp4", None).unwrap();
        fs::write(workspace.path().join("secret"), "s").unwrap();
        fs::write(project.folder().join("own"), "o").unwrap();
        std::os::unix::fs::symlink(workspace.path().join("secret"), project.folder().join("link")).unwrap();
        std::os::unix::fs::symlink(workspace.path(), project.folder().join("up")).unwrap();
        std::os::unix::fs::symlink(project.folder(), workspace.path().join("b")).unwrap();
        assert!(project.file("own".as_ref()).is_ok());
        for outside in ["../secret", "/etc/passwd", "link", "up/secret", "./../secret", "", "."] {
            assert!(project.file(outside.as_ref()).is_err(), "{outside}");
        }
        for name in ["..", ".", "", "A", "a/b", "a\\b", "b", "%2e%2e"] {
            assert!(Project::named(workspace.path(), name).is_err(), "{name}");
        }
    }

    #[test]
    fn uploaded_names_become_plain() {
        assert_eq!(file_name("../../Wurf 1 (Ä).MOV").unwrap(), "wurf-1.mov");
        assert_eq!(file_name("$(rm).mp4").unwrap(), "rm.mp4");
        assert!(file_name("noending").is_err() && file_name(".mp4").is_err());
    }
}
