//! The report, on made-up run folders.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::programs::paig;
use crate::project::project;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use serde_json::{Value, json};

/// Makes a run folder with its config and a little metrics.jsonl.
fn unfinished(folder: &Path, task: &str, seed: u64, set: &[&str]) {
    begun(folder, (task, "fast"), seed, set);
}

/// The same with any recipe.
fn begun(folder: &Path, (task, recipe): (&str, &str), seed: u64, set: &[&str]) {
    fs::create_dir_all(folder).unwrap();
    let set = set.iter().map(ToString::to_string).collect();
    let (task, recipe) = (Some(task.into()), Some(recipe.into()));
    let overrides = Overrides { task, recipe, seed: Some(seed), set, ..Overrides::default() };
    fs::write(folder.join("config.toml"), Config::load(None, &overrides).unwrap().to_toml()).unwrap();
    let record = |step: u64, k: f64| {
        json!({"kind": "valid", "phase": "join", "step": step, "k": k, "recons_loss": 2.0 / (step + 1) as f64,
               "pred_loss": 4.0 / (step + 1) as f64, "extrap_loss": null, "score": 1.0, "seconds": 1.0})
    };
    fs::write(folder.join("metrics.jsonl"), format!("{}\n{}\n", record(0, 1.0), record(50, 4.0))).unwrap();
}

/// Makes a finished run of the spring, as an earlier version left it.
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

/// Adds to a run's summary what later versions write.
fn add_scores(folder: &Path, velocity: f64, ssim: f64) {
    let mut summary = read(&folder.join("summary.json"));
    let frame = |frame: u64, ssim: f64| {
        let error = 1.0 - ssim;
        json!({"frame": frame, "extrapolated": frame >= 10, "squared_error": error, "ssim": ssim})
    };
    summary["test"]["predicted_frames"] = json!([frame(9, 1.0), frame(10, ssim)]);
    summary["test"]["states"] = json!({
        "objects": [0, 1], "offsets": [[0.0, 0.0], [0.0, 0.0]], "encoded": 0.07, "encoded_without_offset": 0.06,
        "predicted": 0.15, "predicted_without_offset": 0.14, "extrapolated": null,
        "extrapolated_without_offset": null, "initial_velocity": velocity, "initial_velocity_slope": 1.0 - velocity / 2.0, "predicted_velocity": 0.3,
    });
    summary["test"]["made_with"] =
        "generator 1, task spring_color, seed 3, clips 10+10+10 of 30 frames, another scene".into();
    summary["training_clips"] = 1000.into();
    summary["validation_clips"] = 100.into();
    summary["hardware"] = json!({"processor": "Some Processor", "cores": 64});
    fs::write(folder.join("summary.json"), summary.to_string()).unwrap();
}

fn read(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn report(runs: &[PathBuf], out: &Path) -> Output {
    paig("report").args(runs).arg("--out").arg(out).output().unwrap()
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
    fs::write(spring.join("seed=3/metrics.jsonl"), "{\"kind\":\n").unwrap();
    let out = folder.path().join("report");
    // The same folder twice counts once.
    let done = report(&[runs.clone(), spring.clone()], &out);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let said = String::from_utf8(done.stdout).unwrap();
    assert!(said.contains("5 finished, 2 unfinished, 1 unreadable"), "{said}");

    let results = read(&out.join("results.json"));
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
    let wide = json!("fast, join.batch=50");
    assert_eq!((&tasks[1]["recipe"], &tasks[1]["overrides"]), (&wide, &json!(["join.batch=50"])));
    assert_eq!(tasks[1]["base_recipe"], json!("fast"));
    assert_eq!(counts(1), [1.0, 1.0, 1.0]);
    assert_eq!(tasks[2]["task"], json!("3bp_color"));
    assert_eq!(counts(2), [1.0, 0.0, 0.0]);

    let page = fs::read_to_string(out.join("report.md")).unwrap();
    for line in [
        "**Unreadable run folders, not counted and listed at the end: 1.**",
        "- spring_color, fast: **2 of 5** runs succeeded; k 4.000 [3.980, 4.200] (ERROR), l 6.000 [5.990, 6.010]",
        "| spring_color | fast | 1 | 5 | 4 | **2** |",
        "- spring_color: k within 1 %, l within 0.5 %",
        "| mnist_spring_color | no run | 0 | 0 | 0 | 0 |",
        "| spring_color | k | 4 | 4.26 | +6.50\u{a0}% | fast | **4.000 [3.980, 4.200]** | ERROR | 2 / 5 |",
        "| 3bp_color | g | 60 | 65.7 | +9.50\u{a0}% | fast | – | – | 0 / 1 |",
        "| spring_color | paper | no | 0.63 | 1.39 |",
        "| spring_color | TF original, rerun, 500 epochs | no | 0.7 | 13.8 | 23.1 |",
        "| 4 | cut off after 50 steps | missing |",
        "| 1 | criterion missed | 4.200 (+5.00\u{a0}%) |",
        "The plots lack seed 3",
        "paig train --task spring_color --recipe fast --set 'join.batch=50' --seed 0 \
         --out 'runs/spring_color/fast-wide/seed=0' --threads 1 --device cpu",
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
fn a_report_can_be_made_again_from_its_records_and_counts_no_run_twice() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    let spring = runs.join("spring_color");
    finished(&spring.join("fast/seed=0"), 0, &[], (4.0, 6.0), 0.3);
    unfinished(&spring.join("fast/seed=1"), "spring_color", 1, &[]);
    let many = ["join.batch=50", "join.max_steps=9", "join.clip=1", "discover.frames=7"];
    finished(&spring.join("fast-mine/seed=0"), 0, &many, (4.0, 6.0), 0.1);
    // Two runs of one seed keep apart: no two took the same time.
    finished(&runs.join("again"), 0, &[], (4.01, 6.0), 0.2);
    let course = fs::read_to_string(runs.join("again/metrics.jsonl")).unwrap();
    fs::write(runs.join("again/metrics.jsonl"), course.replace("\"seconds\":1.0", "\"seconds\":1.1")).unwrap();
    // A report within the folder of the runs: the second time its records are met on the way.
    let first = runs.join("report");
    for _ in 0..2 {
        let done = report(std::slice::from_ref(&runs), &first);
        assert!(String::from_utf8(done.stdout).unwrap().contains("3 finished, 1 unfinished, 0 unreadable"));
        // The second time this is gone.
        assert!(!first.join("pictures/left.png").exists());
        fs::write(first.join("pictures/left.png"), []).unwrap();
    }
    for place in ["fast/seed=0", "fast/seed=0-2", "fast/seed=1", "fast-mine/seed=0"] {
        assert!(first.join("records/spring_color").join(place).join("config.toml").exists(), "{place}");
    }
    let second = folder.path().join("second");
    assert!(report(std::slice::from_ref(&first), &second).status.success());
    assert_eq!(read(&first.join("results.json")), read(&second.join("results.json")));
    for out in [&first, &second] {
        let page = fs::read_to_string(out.join("report.md")).unwrap();
        assert!(page.contains("](records/spring_color/fast/seed=0/example0.png)"), "{page}");
    }
    // A run and its record are one, the one that went further.
    let mut course = fs::read_to_string(spring.join("fast/seed=1/metrics.jsonl")).unwrap();
    course += "{\"kind\": \"valid\", \"phase\": \"join\", \"step\": 77, \"seconds\": 3.0}\n";
    fs::write(spring.join("fast/seed=1/metrics.jsonl"), course).unwrap();
    let third = folder.path().join("third");
    let done = report(&[second.clone(), runs.clone()], &third);
    assert!(String::from_utf8(done.stdout).unwrap().contains("3 finished, 1 unfinished, 0 unreadable"));
    assert!(fs::read_to_string(third.join("report.md")).unwrap().contains("| 1 | cut off after 77 steps |"));
    // What cannot be read of a run beside its config and its summary is left out.
    fs::remove_file(runs.join("again/metrics.jsonl")).unwrap();
    for name in ["templates.png", "metrics.jsonl"] {
        fs::create_dir(runs.join("again").join(name)).unwrap();
    }
    let done = report(std::slice::from_ref(&runs), &third);
    assert!(String::from_utf8(done.stdout).unwrap().contains("3 finished, 1 unfinished, 0 unreadable"));
    assert!(third.join("records/spring_color/fast/seed=0/example0.png").exists());
    assert!(!third.join("records/spring_color/fast/seed=0/templates.png").exists());
    // A report that fails leaves the one before as it was: no file system has room for a folder of this recipe's name.
    unfinished(&runs.join("endless"), "spring_color", 5, &[]);
    let config = runs.join("endless/config.toml");
    let endless = format!("recipe = {:?}", "fast".repeat(64));
    fs::write(&config, fs::read_to_string(&config).unwrap().replace("recipe = \"fast\"", &endless)).unwrap();
    let before = read(&third.join("results.json"));
    let failed = report(std::slice::from_ref(&runs), &third);
    assert!(!failed.status.success() && String::from_utf8(failed.stderr).unwrap().contains("cannot create"));
    assert_eq!(read(&third.join("results.json")), before);
    assert!(third.join("records/spring_color/fast/seed=0/summary.json").exists());
    assert_eq!(fs::read_dir(&third).unwrap().count(), 5, "something is left of the report that failed");
    fs::remove_dir_all(runs.join("endless")).unwrap();
    // Names of folders have an end.
    let place = "a folder of data with a long name/".repeat(9);
    finished(&runs.join("far"), 0, &[&format!("data.folder={place:?}")], (4.0, 6.0), 0.3);
    assert!(report(std::slice::from_ref(&runs), &third).status.success());
    // Files that are not a report's stay: those in its place stop it, those beside it do not.
    let foreign = folder.path().join("foreign");
    fs::create_dir_all(foreign.join("pictures")).unwrap();
    fs::write(foreign.join("results.json"), "{}").unwrap();
    fs::write(foreign.join("pictures/holiday.txt"), []).unwrap();
    let done = report(std::slice::from_ref(&second), &foreign);
    assert!(!done.status.success() && String::from_utf8(done.stderr).unwrap().contains("not of a report"));
    assert_eq!(fs::read_dir(&foreign).unwrap().count(), 2);
    assert_eq!(fs::read_to_string(foreign.join("results.json")).unwrap(), "{}");
    fs::rename(foreign.join("pictures"), foreign.join("holidays")).unwrap();
    fs::remove_file(foreign.join("results.json")).unwrap();
    assert!(report(std::slice::from_ref(&second), &foreign).status.success());
    assert!(foreign.join("holidays/holiday.txt").exists());
    // Its own records are not replaced while they are read.
    let done = report(std::slice::from_ref(&second), &second);
    assert!(!done.status.success() && String::from_utf8(done.stderr).unwrap().contains("another folder with --out"));
    assert!(second.join("records/spring_color/fast/seed=0/summary.json").exists());
}

#[test]
fn a_report_without_pictures_has_the_same_numbers_and_leaves_no_picture() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    finished(&runs.join("spring_color/fast/seed=0"), 0, &[], (4.0, 6.0), 0.3);
    let out = folder.path().join("report");
    assert!(report(std::slice::from_ref(&runs), &out).status.success());
    let (results, page) = (read(&out.join("results.json")), fs::read_to_string(out.join("report.md")).unwrap());
    let picture = out.join("records/spring_color/fast/seed=0/example0.png");
    assert!(page.contains("![") && picture.exists());
    let mut command = paig("report");
    assert!(command.arg(&runs).arg("--no-pictures").arg("--out").arg(&out).output().unwrap().status.success());
    let plain = fs::read_to_string(out.join("report.md")).unwrap();
    assert!(
        !plain.contains("![") && plain.contains(&format!("`paig report {}` draws them", runs.display())),
        "{plain}"
    );
    assert_eq!(read(&out.join("results.json")), results);
    assert!(!picture.exists() && fs::read_dir(out.join("pictures")).unwrap().next().is_none());
    // All words and numbers are there, in their order.
    let without = plain.lines().filter(|line| !line.is_empty() && !line.contains("draws them"));
    let mut lines = page.lines();
    without.for_each(|line| assert!(lines.any(|other| other == line), "{line}"));
}

/// Without truths there is nothing to be right about; a loss beyond its limit is a failure all the same.
#[test]
fn what_nobody_knows_is_not_judged() {
    let folder = tempfile::tempdir().unwrap();
    for (seed, recons_loss) in [(0, 0.05), (1, 5.0)] {
        let place = folder.path().join(format!("runs/spring_color/fast/seed={seed}"));
        finished(&place, seed, &[], (3.0, 5.0), 0.3);
        let mut summary = read(&place.join("summary.json"));
        for symbol in ["k", "l"] {
            summary["parameters"][symbol]["truth"] = Value::Null;
        }
        summary["test"]["recons_loss"] = json!(recons_loss);
        summary["test"]["extrap_loss"] = Value::Null;
        fs::write(place.join("summary.json"), summary.to_string()).unwrap();
    }
    let out = folder.path().join("report");
    assert!(report(&[folder.path().join("runs")], &out).status.success());
    let page = fs::read_to_string(out.join("report.md")).unwrap();
    for line in ["| 0 | succeeded | 3.000 | 5.000 |", "| 1 | criterion missed | 3.000 | 5.000 |"] {
        assert!(page.contains(line), "{line:?} is not in:\n{page}");
    }
}

#[test]
fn changed_recipes_stand_beside_the_plain_one_with_a_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs/spring_color");
    for seed in 0..3 {
        let offset = 0.001 * seed as f64;
        let run = |name: &str, set: &[&str], parameters, velocity| {
            let place = runs.join(format!("{name}/seed={seed}"));
            finished(&place, seed, set, parameters, 0.3);
            add_scores(&place, velocity, 0.9 + offset);
        };
        run("fast", &[], (3.99 - offset, 5.999), 0.24 + offset);
        run("fast-shift", &["model.exact_shift=false"], (3.99, 6.0 + offset), 0.24);
        run("fast-estimate", &["model.refinement_steps=0"], (4.2 + offset, 6.0), 0.9 + offset);
        let long = ["join.max_steps=1000", "join.learning_rate=0.0006"];
        run("fast-long", &long, (3.95, 6.0), 0.5);
        run("fast-long-estimate", &[&["model.refinement_steps=0"], &long[..]].concat(), (4.6, 6.0), 0.8);
        run("fast-start", &["start.k=0.2"], (3.98, 5.999), 0.24);
        run("fast-l", &["model.fixed.k=4"], (4.0, 6.0), 0.24);
    }
    let out = folder.path().join("report");
    assert!(report(&[runs], &out).status.success());
    let page = fs::read_to_string(out.join("report.md")).unwrap();
    for line in [
        "- Where do the paper's errors come from? From the decoder's unit of length: **confirmed** for l of spring_color. \
         From the estimated velocity: **confirmed** for k of spring_color.",
        "| spring_color | l | 1.0283 | 1.0324 [1.0323, 1.0326] | 1.0323 | 0.9998 | 3, 3 | confirmed |",
        "## Other initial values: spring_color, fast",
        "| fast, join.learning_rate=0.0006, join.max_steps=1000, model.refinement_steps=0 | 0.6000 | 0.8000 | 0.3000 | k | \
         +15.00\u{a0}% | +6.50\u{a0}% | 3 | confirmed |\n\
         |  | with: otherwise the same training | 0.7500 | 0.5000 | 0.3000 | k | -1.25\u{a0}% |  | 3 |  |",
        "|  | with: the unchanged recipe | 0.8795 [0.8790, 0.8800] | 0.2410 [0.2400, 0.2420] |",
        "| start.k=0.2 | 3.980 |",
        "Largest differences in 3 such pairs: k by 0.01000, l by 0 (the same bits).",
        "| fast, model.exact_shift=false | **6.001 [6.000, 6.002]** (own unit: 6.195 [6.194, 6.196]) |",
        "| spring_color | fast | px | 0.07000 | 0.1500 | – | 0.2410 [0.2400, 0.2420] |",
        "| 10 | T_ext | 0.09900 [0.09800, 0.1000] | 0.9010 [0.9000, 0.9020] |",
        "# to be completed, the test file is made with: generator 1, task spring_color, seed 3",
        "generate --task spring_color --train 1000 --valid 100 --test 10 --seed 3",
        "sweep --task spring_color --recipe fast --seeds '0,1,2' --set 'model.exact_shift=false' --name shift",
        "| 1000, 100, 10 | Some Processor | 64 | 1 | cpu |",
        "No run of the `paper` recipe is among the given runs",
        "| spring_color | l | 6 | 6.17 | +2.83\u{a0}% | fast, model.fixed.k=4.0 | **6.000** |",
    ] {
        assert!(page.contains(line), "{line:?} is not in:\n{page}");
    }
    // What is held is not learned.
    assert!(!page.contains("| spring_color | k | 4 | 4.26 | +6.50\u{a0}% | fast, model.fixed"));
    let results = read(&out.join("results.json"));
    let plain = &results["tasks"][0];
    assert_eq!((&plain["recipe"], &plain["overrides"]), (&json!("fast"), &json!([])));
    assert!((number(plain, "/predicted_frames/1/ssim/median") - 0.901).abs() < 1e-12);
    assert_eq!(plain["predicted_frames"][1]["extrapolated"], json!(true));
    assert_eq!(number(plain, "/state_errors/initial_velocity/min"), 0.24);
    assert!(plain["state_errors"]["extrapolated_position"].is_null());
}

#[test]
fn runs_of_the_paper_recipe_that_were_cut_off_are_shown_as_far_as_they_went() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs/spring_color");
    // Says how many clips there are: 10 batches of 100.
    finished(&runs.join("fast/seed=0"), 0, &[], (4.0, 6.0), 0.3);
    add_scores(&runs.join("fast/seed=0"), 0.2, 0.9);
    let cut_off = runs.join("paper/seed=1");
    begun(&cut_off, ("spring_color", "paper"), 1, &[]);
    let mut metrics = String::new();
    for (step, k) in [(0, 1.0), (20, 0.8), (40, 0.5), (55, 0.4)] {
        let seconds = 9.0 * f64::from(step);
        let record = json!({"kind": "valid", "phase": "join", "step": step, "k": k, "l": 1.0 + k, "seconds": seconds,
                            "recons_loss": 1.2, "pred_loss": 14.0, "extrap_loss": 25.0});
        metrics += &format!("{record}\n");
    }
    // The record that was being written.
    fs::write(cut_off.join("metrics.jsonl"), metrics + "{\"kind\": \"val").unwrap();
    let out = folder.path().join("report");
    assert!(report(&[runs], &out).status.success());
    let page = fs::read_to_string(out.join("report.md")).unwrap();
    for line in [
        "**Not answered by these runs: none of 1 finished.** The longest reached 5.5 of 500 epochs. Objects were \
         found in 1 of 1 runs. At the last record k was nearer to its truth than at the start in 0 of 1.",
        "| spring_color | 1 | 55 | 5.5 of 500 | no, cut off | 1.200 | yes | 14.00 | k 1.000 → 0.8000 → 0.4000, further \
         from its truth 4; l",
        "| 1 | cut off after 55 steps (5.5 epochs) | missing |",
        "| 1 | 8.2 min until it was cut off |",
        "| spring_color | paper | 1 | 1 | 0 | **0** |",
        "Not run with this recipe: spring_color (not finished), mnist_spring_color (not at all)",
        "generate --task spring_color --train 1000 --valid 100 --test 10 --seed 3",
    ] {
        assert!(page.contains(line), "{line:?} is not in:\n{page}");
    }
    let results = read(&out.join("results.json"));
    let paper = &results["tasks"][1];
    assert_eq!(["tried", "finished", "succeeded"].map(|key| number(paper, &format!("/{key}"))), [1.0, 0.0, 0.0]);
    assert!(paper["parameters"].as_object().unwrap().is_empty());
}

#[test]
fn finished_runs_of_the_paper_recipe_are_held_against_the_paper() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs/spring_color");
    for (seed, learned, course) in [(0, (4.0, 6.0), [1.0, 2.0, 5.0]), (1, (1.0, 6.0), [1.0, 0.5, 1.0])] {
        let run = runs.join(format!("paper/seed={seed}"));
        finished(&run, seed, &[], learned, 0.3);
        begun(&run, ("spring_color", "paper"), seed, &[]);
        let summary = fs::read_to_string(run.join("summary.json")).unwrap();
        fs::write(run.join("summary.json"), summary.replace("fast", "paper")).unwrap();
        let losses = r#""recons_loss": 0.1, "pred_loss": 0.3"#;
        let record = |(step, k): (u64, f64)| {
            format!(r#"{{"kind": "valid", "phase": "join", "step": {step}, "k": {k}, {losses}}}"#)
        };
        let records: Vec<_> = [0, 25, 50].into_iter().zip(course).map(record).collect();
        fs::write(run.join("metrics.jsonl"), records.join("\n") + "\n").unwrap();
    }
    let out = folder.path().join("report");
    assert!(report(&[runs], &out).status.success());
    let page = fs::read_to_string(out.join("report.md")).unwrap();
    for line in [
        "**In 1 of the 2 runs that finished their 500 epochs (2 tried)**: no parameter further from its truth",
        "At the last record k was nearer to its truth than at the start in 1 of 2.",
        "| k 1.000 → 2.000 → 5.000, nearer to its truth 4 |",
        "| k 1.000 → 0.5000 → 1.000, as far as at the start from its truth 4 |",
        "Not run with this recipe: mnist_spring_color (not at all), 3bp_color (not at all).",
    ] {
        assert!(page.contains(line), "{line:?} is not in:\n{page}");
    }
}

#[test]
fn runs_differ_by_what_is_switched_off_only_if_another_has_it_on() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    let run = |seed: u64| runs.join(format!("seed={seed}"));
    (0..3).for_each(|seed| finished(&run(seed), seed, &[], (4.0, 6.0), 0.3));
    let config = |seed: u64| fs::read_to_string(run(seed).join("config.toml")).unwrap();
    // An earlier version did not write this down, another had it on.
    assert!(config(0).contains("velocity_steps = 0\n"));
    fs::write(run(0).join("config.toml"), config(0).replace("velocity_steps = 0\n", "")).unwrap();
    fs::write(run(2).join("config.toml"), config(2).replace("velocity_steps = 0\n", "velocity_steps = 5\n")).unwrap();
    let out = folder.path().join("report");
    assert!(report(&[runs], &out).status.success());
    let page = fs::read_to_string(out.join("report.md")).unwrap();
    assert!(page.contains("- spring_color, fast: **2 of 2** runs succeeded"), "{page}");
    assert!(page.contains("| spring_color | fast, identify.velocity_steps=5 | 1 | 1 | 1 |"), "{page}");
}

#[test]
fn the_records_that_come_with_the_program_are_all_read() {
    fn configs(folder: &Path) -> usize {
        let below = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir());
        usize::from(folder.join("config.toml").exists()) + below.map(|folder| configs(&folder)).sum::<usize>()
    }
    let records = project("reports/seeds/records");
    let folder = tempfile::tempdir().unwrap();
    let done = report(std::slice::from_ref(&records), folder.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let said = String::from_utf8(done.stdout).unwrap();
    assert!(said.contains(" 0 unreadable runs"), "{said}");
    let results = read(&folder.path().join("results.json"));
    assert_eq!(results["format"], json!(1));
    let tried = results["tasks"].as_array().unwrap().iter().map(|task| task["tried"].as_u64().unwrap());
    assert_eq!(tried.sum::<u64>(), configs(&records) as u64);
}

/// Only with the scene's picture can it be said whether the usual options make the data.
#[test]
fn a_background_that_is_gone_costs_no_report() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    let background = "task.scene.background={ kind = \"picture\", file = \"gone.png\" }";
    finished(&runs.join("seed=0"), 0, &[background], (4.0, 6.0), 0.3);
    add_scores(&runs.join("seed=0"), 0.2, 0.9);
    let out = folder.path().join("report");
    let done = report(&[runs], &out);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let page = fs::read_to_string(out.join("report.md")).unwrap();
    assert!(page.contains("# to be completed, the test file is made with: generator 1, task spring_color, seed 3"));
}

#[test]
fn a_folder_without_runs_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    for place in [folder.path().to_path_buf(), folder.path().join("none")] {
        let refused = report(&[place], &out);
        assert_eq!(refused.status.code(), Some(2));
        let said = String::from_utf8(refused.stderr).unwrap();
        assert!(said.starts_with("error: ") && said.lines().count() == 1, "{said}");
    }
    assert!(!out.exists());
}
