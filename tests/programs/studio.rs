//! The server of `paig studio`, asked without a browser: who may ask, what leads out of the folder, damaged and large files, a
//! server that is killed.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::process::{Signal, signal};
use crate::programs::paig;
use crate::project::project;
use serde_json::{Value, json};

/// Ends what should not take long, on any machine.
const PATIENCE: Duration = Duration::from_secs(300);

struct Server {
    child: Child,
    port: u16,
    token: String,
}

struct HttpResponse {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl HttpResponse {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&self.body)))
    }
}

impl Server {
    fn start(folder: &Path, options: &[&str]) -> Self {
        let mut command = paig("studio");
        command.args(["--no-open", "--folder", "projects"]).args(options).current_dir(folder);
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let (address, token) = line.trim().split_once("/?token=").unwrap_or_else(|| panic!("{line}"));
        let port = address.rsplit(':').next().unwrap().parse().unwrap();
        Server { child, port, token: token.into() }
    }

    /// A request with these lines in its head and nothing else.
    fn send(&self, method: &str, path: &str, head: &[String], body: &[u8]) -> HttpResponse {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let length = format!("Content-Length: {}", body.len());
        let lines = [&[format!("{method} {path} HTTP/1.1")], head, &[length, "Connection: close".into()]].concat();
        stream.write_all((lines.join("\r\n") + "\r\n\r\n").as_bytes()).unwrap();
        // A server that refuses a large body closes before it has read it.
        let _ = stream.write_all(body);
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|it| it == b"\r\n\r\n").unwrap();
        let head = String::from_utf8_lossy(&answer[..end]).into_owned();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        let body = answer[end + 4..].to_vec();
        HttpResponse { status, body: if head.contains("chunked") { joined(&body) } else { body }, head }
    }

    fn head(&self) -> Vec<String> {
        let port = self.port;
        let cookie = format!("Cookie: paig_studio_{port}={}", self.token);
        vec![format!("Host: 127.0.0.1:{port}"), format!("Origin: http://127.0.0.1:{port}"), cookie]
    }

    /// A request as the page makes it.
    fn ask(&self, method: &str, path: &str, body: &Value) -> HttpResponse {
        let mut head = self.head();
        head.push("Content-Type: application/json".into());
        let body = if body.is_null() { Vec::new() } else { body.to_string().into_bytes() };
        self.send(method, path, &head, &body)
    }

    fn get(&self, path: &str) -> HttpResponse {
        self.ask("GET", path, &Value::Null)
    }

    /// Creates a project with a file; its name.
    fn upload(&self, file: &str, content: &[u8]) -> (String, HttpResponse) {
        let name =
            self.ask("POST", "/api/projects", &json!({ "title": file })).json()["name"].as_str().unwrap().to_string();
        let answer = self.send("PUT", &format!("/api/projects/{name}/source/{file}"), &self.head(), content);
        (name, answer)
    }

    /// The project, once a part of its state is no longer `running`.
    fn wait(&self, name: &str, part: &str) -> Value {
        let begun = Instant::now();
        loop {
            let state = self.get(&format!("/api/projects/{name}")).json();
            let work = state.pointer(part).unwrap_or_else(|| panic!("{state}"));
            if work != "running" {
                return state;
            }
            assert!(begun.elapsed() < PATIENCE, "{state}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn kill(mut self) {
        signal(self.child.id(), Signal::SIGKILL);
        self.child.wait().unwrap();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // It may have been killed by the test.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A body that came in chunks.
fn joined(mut chunks: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    loop {
        let end = chunks.windows(2).position(|it| it == b"\r\n").unwrap();
        let length = usize::from_str_radix(std::str::from_utf8(&chunks[..end]).unwrap(), 16).unwrap();
        if length == 0 {
            return body;
        }
        body.extend(&chunks[end + 2..end + 2 + length]);
        chunks = &chunks[end + 4 + length..];
    }
}

#[test]
fn only_the_page_is_answered() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), &[]);
    let port = server.port;
    let [host, origin, cookie] = server.head().try_into().unwrap();
    let status = |method: &str, head: &[&String]| {
        let head: Vec<String> = head.iter().map(|line| (*line).clone()).collect();
        server.send(method, "/api/projects", &head, b"").status
    };
    assert_eq!(status("GET", &[&host, &cookie]), 200);
    assert_eq!(status("GET", &[&host]), 401);
    assert_eq!(status("GET", &[&host, &format!("Cookie: paig_studio_{port}=0123")]), 401);
    assert_eq!(status("GET", &[&format!("Host: evil.example:{port}"), &cookie]), 421);
    assert_eq!(status("GET", &[&host, &"Origin: http://evil.example".into(), &cookie]), 403);
    assert_eq!(status("POST", &[&host, &cookie]), 403);
    // An allowed one without a body.
    assert_eq!(status("POST", &[&host, &origin, &cookie]), 415);
    let page = server.send("GET", &format!("/?token={}", server.token), &[host], b"");
    assert_eq!(page.status, 200);
    let head = page.head.to_lowercase();
    assert!(head.contains("httponly; samesite=strict") && head.contains("default-src 'none'"), "{head}");
    let text = String::from_utf8(page.body).unwrap();
    assert!(!text.contains("<script>") && !text.contains("style=") && !text.contains("//"), "{text}");
    assert!(TcpStream::connect(("127.0.0.2", port)).is_err(), "bound to more than 127.0.0.1");
}

#[test]
fn no_path_leads_out_of_the_projects() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("secret.jpg"), "secret").unwrap();
    let server = Server::start(folder.path(), &[]);
    let (name, uploaded) = server.upload("..%2F..%2Fescaped.mp4", b"x");
    assert_eq!(uploaded.status, 201);
    let project = folder.path().join("projects").join(&name);
    assert!(project.join("source/escaped.mp4").exists() && !folder.path().join("escaped.mp4").exists());
    let preview = project.join("preview");
    fs::create_dir(&preview).unwrap();
    fs::write(preview.join("0.jpg"), "own").unwrap();
    std::os::unix::fs::symlink(folder.path().join("secret.jpg"), preview.join("1.jpg")).unwrap();
    std::os::unix::fs::symlink(folder.path(), folder.path().join("projects/linked")).unwrap();
    let status = |path: &str| server.get(path).status;
    assert_eq!(status(&format!("/api/projects/{name}/frames/0")), 200);
    for path in [
        format!("/api/projects/{name}/frames/1"),
        format!("/api/projects/{name}/frames/..%2F..%2Fsecret"),
        format!("/api/projects/{name}/measurements/1/..%2F..%2Fproject.json"),
        format!("/api/projects/{name}/measurements/1/project.json"),
        "/api/projects/..".into(),
        "/api/projects/%2e%2e".into(),
        "/api/projects/linked".into(),
        "/assets/..%2F..%2FCargo.toml".into(),
        "/../secret.jpg".into(),
    ] {
        assert_eq!(status(&path), 404, "{path}");
    }
    assert_eq!(server.ask("DELETE", "/api/projects/linked", &Value::Null).status, 404);
    // A folder of uploads that leads elsewhere is not written to.
    fs::remove_dir_all(project.join("source")).unwrap();
    std::os::unix::fs::symlink(folder.path(), project.join("source")).unwrap();
    let answer = server.send("PUT", &format!("/api/projects/{name}/source/a.mp4"), &server.head(), b"x");
    assert_eq!((answer.status, folder.path().join("a.mp4").exists()), (400, false));
}

#[test]
fn a_damaged_file_ends_its_own_job_and_a_large_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), &["--upload-limit", "1"]);
    let (large, answer) = server.upload("large.mp4", &vec![0; 1_000_001]);
    assert_eq!(answer.status, 413);
    assert!(answer.json()["error"].as_str().unwrap().contains("larger than 1 MB"));
    let source = folder.path().join("projects").join(large).join("source");
    assert_eq!(fs::read_dir(source).unwrap().count(), 0, "a part of it is left");
    let mut film = fs::read(project("tests/data/numbered.mp4")).unwrap();
    film.truncate(film.len() / 2);
    let (damaged, answer) = server.upload("damaged.mp4", &film);
    assert_eq!(answer.status, 201);
    assert_eq!(server.ask("POST", &format!("/api/projects/{damaged}/preview"), &Value::Null).status, 202);
    let state = server.wait(&damaged, "/preview_work/state");
    assert_eq!(state["preview_work"]["state"], "failed", "{state}");
    assert!(state["preview_work"]["reason"].as_str().unwrap().contains("damaged.mp4"), "{state}");
    assert_eq!(server.get("/api/projects").status, 200);
    for settings in [json!({ "equation": "none" }), json!({ "frames": [9, 2] }), json!({ "unknown": 1 })] {
        let status = server.ask("PUT", &format!("/api/projects/{damaged}/settings"), &settings).status;
        assert!((400..500).contains(&status), "{settings}: {status}");
    }
}

/// Pictures whose names differ in their endings alone, and two of one name: none is mixed with another.
#[test]
fn uploads_at_the_same_time_stay_whole() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), &[]);
    let name = server.ask("POST", "/api/projects", &json!({ "title": "pictures" })).json()["name"].clone();
    let name = name.as_str().unwrap();
    let files = ["a.jpg", "a.png", "b.jpg", "b.jpg"];
    let content = |number: usize| vec![b'0' + number as u8; 3_000_000];
    std::thread::scope(|scope| {
        for (number, file) in files.iter().enumerate() {
            let path = format!("/api/projects/{name}/source/{file}");
            let server = &server;
            scope.spawn(move || assert_eq!(server.send("PUT", &path, &server.head(), &content(number)).status, 201));
        }
    });
    let source = folder.path().join("projects").join(name).join("source");
    let read = |file: &str| fs::read(source.join(file)).unwrap();
    assert!(read("a.jpg") == content(0) && read("a.png") == content(1), "mixed");
    assert!([content(2), content(3)].contains(&read("b.jpg")), "mixed");
    assert_eq!(fs::read_dir(source).unwrap().count(), 3, "something half-written was left");
}

/// A generated throw, measured by the command that the page shows; the server is killed meanwhile.
#[test]
fn a_measurement_survives_its_server_and_equals_the_commands() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), &[]);
    let name = server.ask("POST", "/api/projects", &json!({ "example": "throw" })).json()["name"]
        .as_str()
        .unwrap()
        .to_string();
    let state = server.wait(&name, "/preview_work/state");
    assert_eq!(state["preview_work"]["state"], "done", "{state}");
    assert_eq!(state["preview"]["proposals"]["equation"], "falling", "{state}");
    assert_eq!(server.get(&format!("/api/projects/{name}/frames/0")).body[..2], [0xff, 0xd8]);
    assert_eq!(server.ask("POST", &format!("/api/projects/{name}/measure"), &Value::Null).status, 202);
    server.kill();
    let server = Server::start(folder.path(), &[]);
    let state = server.wait(&name, "/measured/work/state");
    let measured = &state["measured"];
    assert_eq!(measured["work"]["state"], "done", "{measured}");
    let quantity = |measurement: &Value| measurement["quantities"][0].clone();
    let g = quantity(&measured["result"]);
    assert_eq!(g["name"], "g");
    // JPEG's artefacts and the ruler's drawing, a per cent at most.
    assert!((g["value"].as_f64().unwrap() - 9.81).abs() < 0.1, "{g}");
    let words = shlex::split(measured["command"].as_str().unwrap()).unwrap();
    assert_eq!(words[..2], ["paig", "measure"]);
    let mut command = paig("measure");
    let out = words.iter().position(|word| word == "--out").unwrap();
    command.args(&words[2..out]).args(["--out", "again"]).current_dir(folder.path());
    assert!(command.output().unwrap().status.success());
    let again: Value =
        serde_json::from_slice(&fs::read(folder.path().join("again/measurement.json")).unwrap()).unwrap();
    assert_eq!(quantity(&again), g);
    let csv = server.get(&format!("/api/projects/{name}/measurements/1/positions.csv?save=yes"));
    assert!(
        csv.status == 200 && csv.head.contains("attachment; filename=\"a-thrown-ball-positions.csv\""),
        "{}",
        csv.head
    );
    assert_eq!(
        csv.body,
        fs::read(folder.path().join(format!("projects/{name}/measurements/1/positions.csv"))).unwrap()
    );
    assert_eq!(server.ask("DELETE", &format!("/api/projects/{name}"), &Value::Null).status, 204);
    assert!(!folder.path().join("projects").join(&name).exists());
}
