//! The server: bound to loopback, until it is told to stop.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use axum::middleware;
use paig_video::import::sources::SourceVideo;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;

use crate::access::{Access, guard};
use crate::api::{App, routes};
use crate::project::{Project, file_name};

/// How often it is looked whether the server is to stop.
const TICK: Duration = Duration::from_millis(100);
const THREADS: usize = 2;
/// Threads that read and write files; by default there would be one for each request, up to 512.
const FILE_THREADS: usize = 16;

/// How the page is served.
#[derive(Debug, Clone)]
pub struct ServerOptions {
    /// Folder of the projects; made if it does not exist.
    pub workspace: PathBuf,
    /// Of 127.0.0.1; 0 for one that is free.
    pub port: u16,
    /// Largest upload, bytes.
    pub upload_limit: u64,
    /// This program, which does the work.
    pub program: PathBuf,
}

/// A server that has its port.
pub struct Studio {
    runtime: Runtime,
    listener: TcpListener,
    access: Access,
    app: Arc<App>,
}

impl Studio {
    /// # Errors
    /// A folder that cannot be made, a port that is taken.
    pub fn bind(options: ServerOptions) -> Result<Self> {
        let ServerOptions { workspace, port, upload_limit, program } = options;
        fs::create_dir_all(&workspace).with_context(|| format!("cannot make the folder {}", workspace.display()))?;
        let mut runtime = tokio::runtime::Builder::new_multi_thread();
        runtime.worker_threads(THREADS).max_blocking_threads(FILE_THREADS).enable_all();
        let runtime = runtime.build().context("cannot start the server's threads")?;
        let listener = runtime.block_on(TcpListener::bind(("127.0.0.1", port)));
        let listener =
            listener.with_context(|| format!("port {port} of 127.0.0.1 is not free; choose another with --port"))?;
        let access = Access::new(listener.local_addr()?.port())?;
        Ok(Studio { runtime, listener, access, app: Arc::new(App { workspace, program, upload_limit }) })
    }

    /// Makes a project of a video file or a folder of pictures, a copy of it.
    ///
    /// # Errors
    /// A video that cannot be read or copied.
    pub fn add(&self, video: &Path) -> Result<String> {
        // What is no video is refused at once, not in the page.
        SourceVideo::open(video)?;
        let title = video.file_name().unwrap_or(video.as_os_str()).to_string_lossy();
        let project = Project::create(&self.app.workspace, &title, None)?;
        let folder = project.source_folder()?;
        let copy = |from: &Path, name: &str| {
            fs::copy(from, folder.join(name)).map(drop).with_context(|| format!("cannot copy {}", from.display()))
        };
        if video.is_dir() {
            for entry in fs::read_dir(video)? {
                let path = entry?.path();
                if path.is_file() {
                    copy(&path, &path.file_name().unwrap_or_default().to_string_lossy())?;
                }
            }
        } else {
            copy(video, &file_name(&title)?)?;
        }
        self.app.start_preview(&project)?;
        Ok(project.name())
    }

    /// The link that opens the page, at a project if one is named.
    pub fn link(&self, project: Option<&str>) -> String {
        let place = project.map_or_else(String::new, |name| format!("#/p/{name}"));
        self.access.link() + &place
    }

    /// Serves until `stop` holds. Jobs that run go on.
    ///
    /// # Errors
    /// The connection of the server itself fails.
    pub fn serve(self, stop: impl Fn() -> bool + Send + 'static) -> Result<()> {
        let router = routes(self.app).layer(middleware::from_fn_with_state(self.access, guard));
        let asked = async move {
            while !stop() {
                tokio::time::sleep(TICK).await;
            }
        };
        let served = self.runtime.block_on(async {
            tokio::select! {
                served = axum::serve(self.listener, router) => served,
                () = asked => Ok(()),
            }
        });
        self.runtime.shutdown_timeout(TICK);
        served.context("the server failed")
    }
}
