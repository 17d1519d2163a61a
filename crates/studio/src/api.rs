//! What the page asks for.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail, ensure};
use axum::body::Body;
use axum::extract::{self, Query, State};
use axum::http::StatusCode;
use axum::response::IntoResponse;
use axum::routing::{get, post, put};
use axum::{Json, Router};
use paig::support::run_names::METRICS;
use serde::Deserialize;
use serde_json::json;

use crate::answers::{Answer, Refusal, archive, file, missing};
use crate::assets::asset;
use crate::cards::Card;
use crate::equations::EQUATIONS;
use crate::examples::EXAMPLES;
use crate::found;
use crate::jobs::{ProcessStatus, ProjectJob};
use crate::preview::ProjectPreview;
use crate::project::{Project, file_name};
use crate::settings::{ProjectSettings, command_line};
use crate::state::{self, COMMAND_OF, SETTINGS_OF};
use crate::training::{IMPORT, PICTURE, RUN, TASK};
use crate::uploads::receive;

/// Files of a measurement that are handed out.
const RESULTS: [&str; 5] =
    ["measurement.json", "measurement.html", "positions.csv", "overlay.gif", "measurement-positions.png"];

/// What all requests share.
#[derive(Debug)]
pub struct App {
    /// Folder of the projects.
    pub workspace: PathBuf,
    /// This program.
    pub program: PathBuf,
    /// Largest upload, bytes.
    pub upload_limit: u64,
}

type Shared = State<Arc<App>>;

/// All addresses.
pub fn routes(app: Arc<App>) -> Router {
    Router::new()
        .route("/", get(|| asset_named("index.html".into())))
        .route("/assets/{name}", get(|extract::Path(name): extract::Path<String>| asset_named(name)))
        .route("/api/offers", get(offers))
        .route("/api/results", get(results))
        .route("/api/results/{*place}", get(result_elsewhere))
        .route("/api/projects", get(projects).post(create))
        .route("/api/projects/{name}", get(project).delete(remove))
        .route("/api/projects/{name}/settings", put(change_settings))
        .route("/api/projects/{name}/source/{file}", put(upload))
        .route("/api/projects/{name}/preview", post(preview))
        .route("/api/projects/{name}/frames/{frame}", get(frame))
        .route("/api/projects/{name}/measure", post(measure))
        .route("/api/projects/{name}/measurements/{number}/{file}", get(result))
        .route("/api/projects/{name}/train", post(train))
        .route("/api/projects/{name}/trainings/{number}/{file}", get(training_file))
        .route("/api/projects/{name}/stop", post(stop))
        .with_state(app)
}

async fn asset_named(name: String) -> Answer {
    asset(&name).ok_or_else(|| missing(anyhow!("there is no {name}")))
}

async fn offers() -> Answer {
    Ok(Json(json!({ "equations": EQUATIONS, "examples": EXAMPLES })).into_response())
}

async fn projects(State(app): Shared) -> Answer {
    let cards: Vec<_> = Project::all(&app.workspace).iter().filter_map(Card::of).collect();
    Ok(Json(cards).into_response())
}

/// Those of the commands.
async fn results(State(app): Shared) -> Answer {
    Ok(Json(found::results(&app.workspace)).into_response())
}

async fn result_elsewhere(State(app): Shared, extract::Path(place): extract::Path<String>) -> Answer {
    file(&found::file(&app.workspace, &place).map_err(missing)?, None).await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct New {
    /// Name of the video, or of the first picture.
    title: Option<String>,
    example: Option<String>,
}

async fn create(State(app): Shared, Json(new): Json<New>) -> Answer {
    let project = match (&new.example, &new.title) {
        (Some(key), None) => {
            let example = EXAMPLES.iter().find(|it| it.key == *key);
            let example = example.with_context(|| format!("there is no example {key:?}"))?;
            let project = Project::create(&app.workspace, example.title, Some(key))?;
            app.start_preview(&project)?;
            project
        }
        (None, Some(title)) => Project::create(&app.workspace, title, None)?,
        _ => return Err(anyhow!("expected a title or an example").into()),
    };
    Ok((StatusCode::CREATED, Json(json!({ "name": project.name() }))).into_response())
}

async fn project(State(app): Shared, extract::Path(name): extract::Path<String>) -> Answer {
    Ok(Json(state::ProjectState::read(&app.project(&name)?)?).into_response())
}

async fn remove(State(app): Shared, extract::Path(name): extract::Path<String>) -> Answer {
    let project = app.project(&name)?;
    for job in jobs(&project) {
        ensure_idle(&job)?;
    }
    project.remove()?;
    Ok(StatusCode::NO_CONTENT.into_response())
}

async fn change_settings(
    State(app): Shared,
    extract::Path(name): extract::Path<String>,
    Json(settings): Json<ProjectSettings>,
) -> Answer {
    let project = app.project(&name)?;
    settings.check()?;
    project.equation(&settings)?;
    project.write_settings(&settings)?;
    Ok(Json(state::ProjectState::read(&project)?).into_response())
}

async fn upload(
    State(app): Shared,
    extract::Path((name, uploaded)): extract::Path<(String, String)>,
    body: Body,
) -> Answer {
    let project = app.project(&name)?;
    ensure_idle(&project.preview_job())?;
    let path = project.source_folder()?.join(file_name(&uploaded)?);
    receive(body, &path, app.upload_limit).await?;
    Ok(StatusCode::CREATED.into_response())
}

async fn preview(State(app): Shared, extract::Path(name): extract::Path<String>) -> Answer {
    let project = app.project(&name)?;
    app.start_preview(&project)?;
    Ok(StatusCode::ACCEPTED.into_response())
}

async fn frame(State(app): Shared, extract::Path((name, frame)): extract::Path<(String, String)>) -> Answer {
    let project = app.project(&name)?;
    let number = frame.strip_prefix("small-").unwrap_or(&frame);
    let is_number = !number.is_empty() && number.bytes().all(|c| c.is_ascii_digit());
    if !is_number {
        return Err(missing(anyhow!("{frame:?} is no frame")));
    }
    let path = project.file(&Path::new("preview").join(format!("{frame}.jpg"))).map_err(missing)?;
    file(&path, None).await
}

async fn measure(State(app): Shared, extract::Path(name): extract::Path<String>) -> Answer {
    let number = app.start_measurement(&app.project(&name)?)?;
    Ok((StatusCode::ACCEPTED, Json(json!({ "number": number }))).into_response())
}

#[derive(Deserialize)]
struct Save {
    /// Present if the file is to be saved rather than shown.
    save: Option<String>,
}

async fn result(
    State(app): Shared,
    extract::Path((name, number, wanted)): extract::Path<(String, usize, String)>,
    Query(save): Query<Save>,
) -> Answer {
    let project = app.project(&name)?;
    if !RESULTS.contains(&wanted.as_str()) {
        return Err(missing(anyhow!("{wanted:?} is no file of a measurement")));
    }
    let path = project.file(&Path::new("measurements").join(number.to_string()).join(&wanted)).map_err(missing)?;
    let save_as = format!("{}-{wanted}", project.name());
    file(&path, save.save.is_some().then_some(save_as.as_str())).await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Train {
    /// Goes on with the latest one.
    #[serde(default)]
    resume: bool,
}

async fn train(State(app): Shared, extract::Path(name): extract::Path<String>, Json(asked): Json<Train>) -> Answer {
    let number = app.start_training(&app.project(&name)?, asked.resume)?;
    Ok((StatusCode::ACCEPTED, Json(json!({ "number": number }))).into_response())
}

async fn training_file(
    State(app): Shared,
    extract::Path((name, number, wanted)): extract::Path<(String, usize, String)>,
) -> Answer {
    let project = app.project(&name)?;
    let folder = project.training_folder(number);
    if wanted == "task.zip" {
        return Ok(archive(folder.join(TASK), &format!("{}-task.zip", project.name())).await?);
    }
    let within = match wanted.as_str() {
        PICTURE => PathBuf::from(PICTURE),
        METRICS => Path::new(RUN).join(METRICS),
        _ => return Err(missing(anyhow!("{wanted:?} is no file of a training"))),
    };
    let path = project.file(&Path::new("trainings").join(number.to_string()).join(within)).map_err(missing)?;
    file(&path, None).await
}

async fn stop(State(app): Shared, extract::Path(name): extract::Path<String>) -> Answer {
    let project = app.project(&name)?;
    let running: Vec<_> = jobs(&project).into_iter().filter(|job| job.progress() == ProcessStatus::Running).collect();
    if running.is_empty() {
        return Err(anyhow!("nothing is running").into());
    }
    running.iter().try_for_each(ProjectJob::stop)?;
    Ok(StatusCode::ACCEPTED.into_response())
}

/// Jobs of a project that may be running.
fn jobs(project: &Project) -> Vec<ProjectJob> {
    let measured = project.measurements().last().map(|number| ProjectJob::new(project.measurement_folder(*number)));
    let trained = project.trainings().last().map(|number| ProjectJob::new(project.training_folder(*number)));
    std::iter::once(project.preview_job()).chain(measured).chain(trained).collect()
}

fn ensure_idle(job: &ProjectJob) -> Result<(), Refusal> {
    match job.progress() {
        ProcessStatus::Running => Err(Refusal(StatusCode::CONFLICT, "it is still running; stop it first".into())),
        _ => Ok(()),
    }
}

impl App {
    fn project(&self, name: &str) -> Result<Project, Refusal> {
        Project::named(&self.workspace, name).map_err(missing)
    }

    /// Starts to make the pictures and proposals of a project's video.
    ///
    /// # Errors
    /// No video, a job that runs already.
    pub fn start_preview(&self, project: &Project) -> Result<()> {
        ensure!(project.record()?.example.is_some() || project.source().is_ok(), "no video was uploaded");
        let arguments = ["studio".into(), "--prepare".into(), project.folder().display().to_string()];
        project.preview_job().start(&self.program, &arguments)
    }

    fn start_measurement(&self, project: &Project) -> Result<usize> {
        let settings = project.settings()?;
        settings.check()?;
        let numbers = project.measurements();
        if let Some(last) = numbers.last() {
            let job = ProjectJob::new(project.measurement_folder(*last));
            ensure!(job.progress() != ProcessStatus::Running, "a measurement is running already");
        }
        let number = numbers.last().map_or(1, |last| last + 1);
        let out = project.measurement_folder(number);
        let arguments = settings.measure(&project.source()?, &project.equation(&settings)?, &out);
        fs::create_dir_all(&out).with_context(|| format!("cannot make the folder {}", out.display()))?;
        fs::write(out.join(COMMAND_OF), command_line(&arguments))?;
        fs::write(out.join(SETTINGS_OF), serde_json::to_vec_pretty(&settings)?)?;
        ProjectJob::new(out).start(&self.program, &arguments)?;
        Ok(number)
    }

    /// Begins a training with the present settings, or goes on with the latest one.
    fn start_training(&self, project: &Project, resume: bool) -> Result<usize> {
        let latest = project.trainings().last().copied();
        let job = |number: usize| ProjectJob::new(project.training_folder(number));
        ensure!(
            latest.is_none_or(|last| job(last).progress() != ProcessStatus::Running),
            "a training is running already"
        );
        let number = match (resume, latest) {
            (true, Some(last)) => last,
            (true, None) => bail!("there is no training to go on with"),
            (false, latest) => latest.map_or(1, |last| last + 1),
        };
        let folder = project.training_folder(number);
        if !resume {
            let mut settings = project.settings()?;
            settings.check()?;
            // A measurement finds all free motion by itself, an import takes the frames that it is given.
            settings.frames = settings.frames.or_else(|| ProjectPreview::read(&project.preview_folder()).free_motion());
            let equation = project.equation_to_train(&settings)?;
            let import = settings.import(&project.source()?, &equation, &folder.join(TASK));
            fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
            fs::write(folder.join(IMPORT), serde_json::to_vec(&import)?)?;
        }
        job(number).start(&self.program, &["studio".into(), "--train".into(), folder.display().to_string()])?;
        Ok(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::equations::definite;
    use crate::examples;

    #[test]
    fn each_example_is_made() {
        for example in EXAMPLES {
            let made = examples::made(example.key).unwrap();
            made.settings().check().unwrap();
            definite(&made.settings().equation).unwrap();
        }
    }
}
