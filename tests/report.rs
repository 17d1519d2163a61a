//! The report, on made-up run folders.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use paig::config::{Config, Overrides};
use serde_json::{Value, json};

/// Makes a run folder with its config and a little metrics.jsonl.
fn unfinished(folder: &Path, task: &str, seed: u64, set: &[&str]) {
    fs::create_dir_all(folder).unwrap();
    let set = set.iter().map(ToString::to_string).collect();
    let overrides = Overrides { task: Some(task.into()), seed: Some(seed), set, ..Overrides::default() };
    fs::write(folder.join("config.toml"), Config::load(None, &overrides).unwrap().to_toml()).unwrap();
    let record = |step: u64, k: f64| {
        json!({"kind": "valid", "phase": "join", "step": step, "k": k, "recons_loss": 2.0 / (step + 1) as f64,
               "pred_loss": 4.0 / (step + 1) as f64, "extrap_loss": null, "score": 1.0, "seconds": 1.0})
    };
    fs::write(folder.join("metrics.jsonl"), format!("{}\n{}\n", record(0, 1.0), record(50, 4.0))).unwrap();
}

/// Makes a finished run of the spring.
fn finished(folder: &Path, seed: u64, set: &[&str], (k, l): (f64, f64), pred: f64) {
    unfinished(folder, "spring_color", seed, set);
    let summary = json!({
        "task": "spring_color", "recipe": "fast", "seed": seed,
        "parameters": {"k": {"learned": k, "truth": 4.0}, "l": {"learned": l, "truth": 6.0}},
        "test": {"recons_loss": 0.05, "pred_loss": pred, "extrap_loss": 1.5, "clips": 10},
        "steps": 50, "wall_seconds": 60.0 + seed as f64, "phase_seconds": {"join": 40.0}, "device": "cpu",
        "threads": 1, "versions": {"paig": "0.1.0", "libtorch": "2.11.0"},
    });
    fs::write(folder.join("summary.json"), summary.to_string()).unwrap();
    image::RgbImage::new(40, 20).save(folder.join("example0.png")).unwrap();
}

fn report(runs: &[PathBuf], out: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_report")).args(runs).arg("--out").arg(out).output().unwrap()
}

fn number(results: &Value, path: &str) -> f64 {
    results.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("no number at {path} of {results}"))
}

#[test]
fn all_runs_are_counted_and_nothing_is_selected() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    let spring = runs.join("spring_color/fast");
    finished(&spring.join("seed=0"), 0, &[], (4.01, 6.01), 0.3);
    finished(&spring.join("seed=1"), 1, &[], (4.2, 6.0), 0.3);
    finished(&spring.join("seed=2"), 2, &[], (3.99, 5.99), 0.9);
    finished(&spring.join("seed=3"), 3, &[], (3.98, 6.0), 0.4);
    unfinished(&spring.join("seed=4"), "spring_color", 4, &[]);
    finished(&runs.join("spring_color/fast-wide/seed=0"), 0, &["join.batch=50"], (4.0, 6.0), 0.1);
    unfinished(&runs.join("mine"), "3bp_color", 0, &[]);
    let damaged = runs.join("spring_color/fast/seed=9");
    unfinished(&damaged, "spring_color", 9, &[]);
    fs::write(damaged.join("config.toml"), "task = [").unwrap();
    // A plot that cannot be drawn costs no run.
    fs::write(spring.join("seed=3/metrics.jsonl"), "{\"kind\":").unwrap();
    let out = folder.path().join("report");
    // The same folder twice counts once.
    let done = report(&[runs.clone(), spring.clone()], &out);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let said = String::from_utf8(done.stdout).unwrap();
    assert!(said.contains("5 finished, 2 unfinished, 1 unreadable"), "{said}");

    let results: Value = serde_json::from_slice(&fs::read(out.join("results.json")).unwrap()).unwrap();
    let tasks = results["tasks"].as_array().unwrap();
    assert_eq!(tasks.len(), 3);
    let counts = |place: usize| ["tried", "finished", "succeeded"].map(|key| number(&tasks[place], &format!("/{key}")));
    assert_eq!((&tasks[0]["task"], &tasks[0]["recipe"]), (&json!("spring_color"), &json!("fast")));
    assert_eq!(counts(0), [5.0, 4.0, 2.0]);
    assert_eq!(tasks[0]["seeds"], json!([0, 1, 2, 3, 4]));
    assert!((number(&tasks[0], "/parameters/k/median") - 4.0).abs() < 1e-12);
    assert_eq!(number(&tasks[0], "/parameters/k/min"), 3.98);
    assert_eq!(number(&tasks[0], "/parameters/k/max"), 4.2);
    assert_eq!(number(&tasks[0], "/parameters/l/truth"), 6.0);
    assert!((number(&tasks[0], "/losses/pred_loss/median") - 0.35).abs() < 1e-12);
    assert_eq!(number(&tasks[0], "/losses/pred_loss/max"), 0.9);
    assert_eq!((&tasks[1]["recipe"], &tasks[1]["changes"]), (&json!("fast-wide"), &json!(["join.batch=50"])));
    assert_eq!(counts(1), [1.0, 1.0, 1.0]);
    assert_eq!(tasks[2]["task"], json!("3bp_color"));
    assert_eq!(counts(2), [1.0, 0.0, 0.0]);

    let page = fs::read_to_string(out.join("report.md")).unwrap();
    for line in [
        "| spring_color | fast | 5 | 4 | **2** | k within 1 %, l within 0.5 %",
        "| mnist_spring_color | no run | 0 | 0 | 0 |",
        "| spring_color | k | 4 | 4.26 | +6.50\u{a0}% | fast | **4.000 [3.980, 4.200]** | ERROR | 2 / 5 |",
        "| 3bp_color | g | 60 | 65.7 | +9.50\u{a0}% | fast | – | – | 0 / 1 |",
        "| spring_color | paper | 0.63 | 1.39 |",
        "| spring_color | TF original, rerun, 500 epochs | 0.7 | 13.8 | 23.1 |",
        "| 4 | unfinished | missing |",
        "| 1 | criterion missed | 4.200 (+5.00\u{a0}%) |",
        "Seed 3 is in no plot",
        "run_physics --task spring_color --recipe fast --set 'join.batch=50' --seed 0 --threads 1 --device cpu",
        "## Unreadable run folders",
    ] {
        let error = 100.0 * (number(&tasks[0], "/parameters/k/median") / 4.0 - 1.0);
        let line = line.replace("ERROR", &format!("{error:+.2}\u{a0}%"));
        assert!(page.contains(&line), "{line:?} is not in:\n{page}");
    }
    let html = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(html.contains("<table>") && html.matches("src=\"data:image/png;base64,").count() >= 5);
    assert!(!html.contains("http") && !html.contains("src=\"pictures"), "the page needs something outside of it");
    for (_, picture) in page.match_indices("](").map(|(at, _)| (at, page[at + 2..].split(')').next().unwrap())) {
        assert!(out.join(picture).exists(), "{picture} is missing");
    }
}

#[test]
fn a_folder_without_runs_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    for place in [folder.path().to_path_buf(), folder.path().join("none")] {
        let refused = report(&[place], &out);
        assert_eq!(refused.status.code(), Some(1));
        let said = String::from_utf8(refused.stderr).unwrap();
        assert!(said.starts_with("error: ") && said.lines().count() == 1, "{said}");
    }
    assert!(!out.exists());
}
