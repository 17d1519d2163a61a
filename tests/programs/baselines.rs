//! The paper's comparison: the list, end-to-end baselines, and a small comparison from data to report.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::programs::{baseline, paig};
use crate::project::project;
use crate::random::numbers;
use crate::training::{SAVED, resumes_to_the_same_bits};
use paig::kernels::{Instructions, Kernels};
use paig::network::cells::Actions;
use paig::runs::checkpoint::{SavedWeights, find_weights};
use paig::tasks;
use paig_experiments::baselines::end_to_end::config::EndToEndModel;
use paig_experiments::baselines::end_to_end::frame_model::{Batch, FrameModel, named_variables, weights};
use paig_experiments::baselines::end_to_end::gaussian::normal_numbers;
use paig_experiments::baselines::end_to_end::scores::EndToEndScores;
use paig_experiments::baselines::list::Comparison;
use rand::Rng;
use serde_json::Value;
use tch::{Device, Kind, Tensor};

const WHOLE: [EndToEndModel; 2] = [EndToEndModel::VideoLstm, EndToEndModel::Ddpae];

/// Standard output and error together.
fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn built(model: EndToEndModel) -> Box<dyn FrameModel> {
    built_with(model, Kernels::Own)
}

fn built_with(model: EndToEndModel, kernels: Kernels) -> Box<dyn FrameModel> {
    model.build(&tasks::builtin("spring_color").unwrap().system, kernels, 3, Device::Cpu)
}

fn clips(count: i64, time: i64) -> Tensor {
    numbers(0, "clips", &[count, time, 3, 32, 32], |random| random.random::<f32>())
}

/// The sizes that docs/baselines.md states.
#[test]
fn end_to_end_baselines_have_the_sizes_that_are_stated() {
    assert_eq!(WHOLE.map(|model| weights(built(model).as_ref())), [1_113_136, 841_170]);
}

/// Whatever comes after the input changes no prediction, and a longer roll-out begins as a shorter one.
#[test]
fn end_to_end_baselines_see_only_the_input() {
    let _guard = tch::no_grad_guard();
    for model in WHOLE.map(built) {
        let input = clips(2, 4);
        let (short, long) = (model.predict(&input, &Actions::none(), 3), model.predict(&input, &Actions::none(), 6));
        assert_eq!(long.size(), [2, 6, 3, 32, 32]);
        assert!((long.narrow(1, 0, 3) - short).abs().max().double_value(&[]) < 1e-6);
        assert!(long.min().double_value(&[]) >= 0.0 && long.max().double_value(&[]) <= 1.0);
    }
}

/// VideoLSTM by libtorch alone is the same model: float32 in another order, so not to the bit.
#[test]
fn video_lstm_honours_the_kernels() {
    let widest = Kernels::With(Instructions::all()[0]);
    let [own, libtorch] = [widest, Kernels::Libtorch].map(|kernels| {
        let model = built_with(EndToEndModel::VideoLstm, kernels);
        let batch = Batch { frames: clips(2, 8), actions: Actions::none(), rewards: None, noise: None };
        let loss = model.loss(&batch);
        loss.backward();
        let gradients = named_variables(model.as_ref()).into_iter().map(|(_, variable)| variable.grad().flatten(0, -1));
        (loss.double_value(&[]), Tensor::cat(&gradients.collect::<Vec<_>>(), 0))
    });
    assert!((own.0 / libtorch.0 - 1.0).abs() < 1e-5, "{} and {}", own.0, libtorch.0);
    let off = ((&own.1 - &libtorch.1).norm() / libtorch.1.norm()).double_value(&[]);
    assert!(off > 0.0 && off < 1e-4, "gradients off by {off:e}");
}

/// No part is left without a gradient but what stands still, which is taken from the clips.
#[test]
fn every_weight_of_a_whole_model_learns() {
    for model in WHOLE.map(built) {
        let noise = Some(normal_numbers(3, 0, model.draws(2, 8)));
        model.loss(&Batch { frames: clips(2, 8), actions: Actions::none(), rewards: None, noise }).backward();
        for (name, variable) in named_variables(model.as_ref()) {
            let gradient = variable.grad();
            if name == "background" {
                assert!(!variable.requires_grad() && !gradient.defined());
                continue;
            }
            assert!(gradient.defined() && gradient.abs().sum(Kind::Double).double_value(&[]) > 0.0, "{name}");
        }
    }
}

#[test]
fn the_list_is_sound_and_says_what_is_wrong() {
    let list = Comparison::read(&project("configs/baselines.toml")).unwrap();
    assert_eq!(list.tasks.len(), 5);
    assert!(list.model("interaction_network").is_ok());
    assert!(format!("{:#}", list.model("alchemy").unwrap_err()).contains("physics, physics_unrefined, lstm"));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("list.toml");
    let text = fs::read_to_string(project("configs/baselines.toml")).unwrap();
    for (change, complaint) in [
        (("name = \"gru\"", "name = \"lstm\""), "lstm stands there twice"),
        (("name = \"gru\"", "name = \"objects\""), "model objects: runs that find objects"),
        (("name = \"gru\"", "name = \"gru\"\nlearning_rate = 1e-3"), "model gru: an end-to-end baseline"),
        (("learning_rate = 1e-3 ", "#"), "model video_lstm: an end-to-end baseline has a learning_rate"),
        (("tasks = [\"spring_color\"", "tasks = [\"spring_color_half\""), "task spring_color_half stands there twice"),
        (("tasks = [\"spring_color\"", "tasks = [\"spring.toml\""), "only built-in tasks"),
        (("seeds = [0, 1, 2]", "seeds = [0, 1, 0]"), "seed 0 stands there twice"),
        (("tasks = [\"spring_color\"", "tasks = [\"spring_colour\""), "spring_colour"),
        (("recipe = ", "recipes = "), "recipes"),
        (("steps = { spring_color = 24000", "steps = { pendulum = 24000"), "model video_lstm: steps for \"pendulum\""),
        (("label = \"GRU\"", "label = \"GRU\"\nsteps = { spring_color = 5 }"), "stand in its recipe"),
        (("steps = { spring_color = 24000", "steps = { spring_color = 0"), "model video_lstm: steps must"),
        (("learning_rate = 1e-3", "learning_rate = 0.0"), "model video_lstm: the learning rate"),
        (("rates = [3e-4, 1e-3, 3e-3]", "rates = [1e-3, inf]"), "model video_lstm: the learning rate"),
        (("rates = [3e-4, 1e-3, 3e-3, 1e-2", "rates = [-3e-4, 1e-3, 3e-3, 1e-2"), "all that are searched"),
        (("\nsteps = 6000", "\nsteps = 0"), "whole.steps"),
        (("whole_steps = 1500", "whole_steps = 0"), "search.whole_steps"),
    ] {
        fs::write(&path, text.replacen(change.0, change.1, 1)).unwrap();
        let error = format!("{:#}", Comparison::read(&path).unwrap_err());
        assert!(error.contains(complaint) && error.contains("list.toml"), "{error}");
    }
}

/// A list of the smallest size: one task, one seed, one step of everything.
fn small_list(folder: &Path) -> PathBuf {
    let path = folder.join("small.toml");
    let list = r#"
recipe = "fast"
tasks = ["spring_color"]
seeds = [0]
clips = { train = 30, valid = 10, test = 4 }
search = { task = "spring_color", seed = 1, rates = [1e-3, 1e-2], whole_steps = 2 }
efficiency = { task = "spring_color", train = [], models = [] }
whole = { steps = 4, batch = 2, checkpoint_every = 2 }
[[models]]
name = "gru_and_mlp"
label = "GRU and MLP decoder"
own_objects = true
set = ["model.dynamics=gru", "model.decoder=mlp", "discover.max_steps=2", "pretrain.max_steps=2", "join.max_steps=2",
       "join.validation_clips=5", "join.batch=4", "discover.frames=4"]
[[models]]
name = "video_lstm"
label = "VideoLSTM"
whole = "video_lstm"
rate = "learning_rate"
learning_rate = 1e-3
steps = { spring_color = 3 }
"#;
    fs::write(&path, list).unwrap();
    path
}

/// From nothing to a report with the search, the rows and the pictures; the same command again trains nothing, and every
/// program reads the run of a black box.
#[test]
fn a_small_comparison_runs_to_its_report() {
    let folder = tempfile::tempdir().unwrap();
    let list = small_list(folder.path());
    let compare = |options: &[&str]| {
        let mut command = paig("baselines");
        command.arg("--list").arg(&list).args(options).current_dir(folder.path());
        command.output().unwrap()
    };
    let done = compare(&[]);
    assert!(done.status.success(), "{}", text(&done));
    let report = folder.path().join("runs/baselines/report");
    let rows: Value = serde_json::from_slice(&fs::read(report.join("results.json")).unwrap()).unwrap();
    let [gru, video] = rows.as_array().unwrap().as_slice() else { panic!("{rows}") };
    assert_eq!((gru["model"].as_str(), video["model"].as_str()), (Some("gru_and_mlp"), Some("video_lstm")));
    for row in [gru, video] {
        assert_eq!(row["ssim"].as_array().unwrap().len(), 26);
        assert!(row["pred_loss"].as_f64().unwrap() > 0.0 && row["weights"].as_u64().unwrap() > 100_000);
    }
    // Its own steps on this task, not the four of `whole`.
    assert_eq!(video["steps"], 3);
    assert!(gru["recons_loss"].is_f64() && video["recons_loss"].is_null());
    let searched: Value = serde_json::from_slice(&fs::read(report.join("search.json")).unwrap()).unwrap();
    assert_eq!(video["searched_rate"], searched[0]["chosen"]);
    assert_eq!(searched[0]["rates"].as_array().unwrap().len(), 2);
    let page = fs::read_to_string(report.join("report.md")).unwrap();
    assert!(page.contains("2 of these 2 trainings are finished"), "{page}");
    let size = format!("| GRU and MLP decoder | {0} = 1.00 x ({1}) |", gru["weights"], gru["dynamics_weights"]);
    assert!(page.contains(&size), "{size}: {page}");
    for picture in ["frames", "gallery", "black-boxes", "whole"] {
        let file = format!("pictures/spring_color-{picture}.png");
        assert!(page.contains(&file) && report.join(file).exists(), "{picture}");
    }

    // Nothing is trained twice.
    let runs = folder.path().join("runs/baselines/clips=30/spring_color");
    let scores =
        runs.join(format!("video_lstm-rate-{:e}/seed=0/scores.json", video["searched_rate"].as_f64().unwrap()));
    let before = fs::metadata(&scores).unwrap().modified().unwrap();
    let again = compare(&[]);
    assert!(again.status.success() && text(&again).contains("finished before"), "{}", text(&again));
    assert_eq!(fs::metadata(&scores).unwrap().modified().unwrap(), before);

    // Another seed is shown beside those of the list; a run of it that was killed at once is none.
    let killed = runs.join("fast-gru_and_mlp/seed=2");
    fs::create_dir_all(&killed).unwrap();
    fs::write(killed.join("output.log"), "").unwrap();
    let more = compare(&["--model", "video_lstm", "--seeds", "2", "--no-search", "--out", "more"]);
    assert!(more.status.success(), "{}", text(&more));
    let page = fs::read_to_string(folder.path().join("more/report.md")).unwrap();
    assert!(page.contains("3 of these 4 trainings are finished"), "{page}");

    let run = runs.join("fast-gru_and_mlp/seed=0");
    let evaluated = paig("evaluate").arg(&run).current_dir(folder.path()).output().unwrap();
    assert!(evaluated.status.success(), "{}", text(&evaluated));

    // Where the runs are gone, their report is enough: nothing is trained, and the new one is the same to the byte.
    fs::rename(&report, folder.path().join("kept")).unwrap();
    let report = folder.path().join("kept");
    fs::remove_dir_all(folder.path().join("runs")).unwrap();
    let copied = compare(&["--add", "kept", "--out", "copy"]);
    assert!(copied.status.success() && !text(&copied).contains("started"), "{}", text(&copied));
    assert!(!folder.path().join("runs").exists());
    for file in ["report.md", "results.json", "search.json", "pictures/spring_color-gallery.png"] {
        let read = |of: &Path| fs::read(of.join(file)).unwrap();
        assert!(read(&report) == read(&folder.path().join("copy")), "{file}");
    }
    // A report without figures holds all that a later one draws them of.
    let plain = compare(&["--add", "kept", "--report-only", "--no-pictures", "--out", "plain"]);
    assert!(plain.status.success(), "{}", text(&plain));
    let page = fs::read_to_string(folder.path().join("plain/report.md")).unwrap();
    assert!(!page.contains("![") && page.contains("draws them"), "{page}");
    let drawn = compare(&["--add", "plain", "--report-only", "--out", "drawn"]);
    assert!(drawn.status.success(), "{}", text(&drawn));
    for file in ["report.md", "results.json", "pictures/spring_color-gallery.png"] {
        let read = |of: &Path| fs::read(of.join(file)).unwrap();
        assert!(read(&report) == read(&folder.path().join("drawn")), "{file}");
    }
    // A row of an end-to-end baseline with other steps than the list's is none of it, nor one of other clips.
    let text_of_list = fs::read_to_string(&list).unwrap();
    fs::write(&list, text_of_list.replace("steps = { spring_color = 3 }", "steps = { spring_color = 2 }")).unwrap();
    let other = compare(&["--add", "kept", "--report-only", "--out", "other"]);
    assert!(other.status.success(), "{}", text(&other));
    let page = fs::read_to_string(folder.path().join("other/report.md")).unwrap();
    assert!(page.contains("1 of these 2 trainings are finished"), "{page}");
    fs::write(&list, text_of_list.replace("train = 30", "train = 20")).unwrap();
    let other = compare(&["--add", "kept", "--report-only", "--out", "other"]);
    assert!(!other.status.success() && text(&other).contains("no finished training"), "{}", text(&other));
    let missing = compare(&["--add", "nowhere"]);
    assert!(!missing.status.success() && text(&missing).contains("nowhere/results.json"), "{}", text(&missing));
}

/// All tensors of an end-to-end baseline's last checkpoint, and of its best validation, by file and name.
fn of_checkpoint(run: &Path) -> BTreeMap<String, Tensor> {
    let checkpoints = run.join("checkpoints");
    let last = find_weights(run, SavedWeights::Last).unwrap();
    let files = [last.clone(), last.with_file_name("slots.safetensors"), checkpoints.join("best_train.safetensors")];
    let named = files.iter().enumerate().flat_map(|(number, file)| {
        let all = Tensor::read_safetensors(file).unwrap();
        all.into_iter().map(move |(name, tensor)| (format!("{number} {name}"), tensor))
    });
    named.collect()
}

fn assert_same_bits(one: &BTreeMap<String, Tensor>, other: &BTreeMap<String, Tensor>) {
    assert!(one.keys().eq(other.keys()) && !one.is_empty());
    one.iter().for_each(|(name, tensor)| assert!(tensor.equal(&other[name]), "{name}"));
}

/// As many end-to-end baselines at a time as `--jobs` says: each ends with the bits that it has alone.
#[test]
fn end_to_end_baselines_side_by_side_end_as_alone() {
    let folder = tempfile::tempdir().unwrap();
    let list = small_list(folder.path());
    let weights = |jobs: &str| {
        let mut command = paig("baselines");
        command.arg("--list").arg(&list).args(["--model", "video_lstm", "--seeds", "2-4", "--no-search"]);
        command.args(["--jobs", jobs, "--runs", jobs, "--out", "report"]).current_dir(folder.path());
        let done = command.output().unwrap();
        assert!(done.status.success(), "{}", text(&done));
        let run = |seed: u64| folder.path().join(format!("{jobs}/clips=30/spring_color/video_lstm/seed={seed}"));
        [2, 3, 4].map(run).map(|run| of_checkpoint(&run))
    };
    let (alone, together) = (weights("1"), weights("3"));
    alone.iter().zip(&together).for_each(|(alone, together)| assert_same_bits(alone, together));
    let differs = |(name, weight): (&String, &Tensor)| !weight.equal(&alone[1][name]);
    assert!(alone[0].iter().any(differs), "all seeds give the same weights: the test shows nothing");
}

/// Killed after some steps and begun again, a training ends with the same bits as one that was never stopped.
#[test]
fn an_end_to_end_baseline_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let mut generate = paig("generate");
    generate.args(["--task", "spring_color", "--train", "10", "--valid", "4", "--test", "2", "--out"]).arg(&data);
    assert!(generate.output().unwrap().status.success());
    let train = |out: &str, steps: &str| {
        let mut command = baseline("ddpae");
        command.args(["--batch", "2", "--checkpoint-every", "2", "--threads", "1", "--steps", steps, "--data"]);
        let done = command.arg(&data).arg("--out").arg(folder.path().join(out)).output().unwrap();
        assert!(done.status.success(), "{}", text(&done));
        text(&done)
    };
    train("whole", "6");
    train("half", "6");
    // As if it had been killed after its checkpoint at step 2: the later one and the results are gone.
    train("start", "2");
    let [whole, half, start] = ["whole", "half", "start"].map(|name| folder.path().join(name));
    fs::remove_dir_all(half.join("checkpoints")).unwrap();
    for name in ["checkpoints", "metrics.jsonl"] {
        fs::rename(start.join(name), half.join(name)).unwrap();
    }
    fs::remove_file(half.join("scores.json")).unwrap();
    let said = train("half", "6");
    assert!(said.contains("step 4: validation") && !said.contains("step 2: validation"), "{said}");
    assert_same_bits(&of_checkpoint(&whole), &of_checkpoint(&half));
}

/// The first validation that an output names: before the first step where the training begins, else after a checkpoint.
fn first_validation(output: &Output) -> Option<u64> {
    let said = text(output);
    let (before, _) = said.split_once(": validation error")?;
    Some(before.rsplit(' ').next().unwrap().parse().unwrap())
}

#[test]
fn a_killed_end_to_end_baseline_resumes_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let mut generate = paig("generate");
    generate.args(["--task", "spring_color", "--train", "10", "--valid", "4", "--test", "2", "--out"]).arg(&data);
    assert!(generate.output().unwrap().status.success());
    let train = |run: &Path| {
        let mut command = baseline("ddpae");
        command.args(["--batch", "2", "--checkpoint-every", "4", "--threads", "1", "--steps", "48", "--data"]);
        command.arg(&data).arg("--out").arg(run);
        command
    };
    let [whole, killed] = ["whole", "killed"].map(|name| folder.path().join(name));
    resumes_to_the_same_bits([&whole, &killed], &[SAVED], train, train, first_validation);
    assert_same_bits(&of_checkpoint(&whole), &of_checkpoint(&killed));
    let [whole, killed] =
        [&whole, &killed].map(|run| EndToEndScores { seconds: 0.0, ..EndToEndScores::read(run).unwrap().unwrap() });
    assert_eq!(serde_json::to_string(&whole).unwrap(), serde_json::to_string(&killed).unwrap());
}

/// A training that leaves the numbers ends in a line that says so, also where libtorch refuses what is none.
#[test]
fn an_end_to_end_baseline_that_diverges_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let mut generate = paig("generate");
    generate.args(["--task", "spring_color", "--train", "10", "--valid", "4", "--test", "2", "--out"]).arg(&data);
    assert!(generate.output().unwrap().status.success());
    let mut command = baseline("ddpae");
    command.args(["--batch", "2", "--steps", "6", "--threads", "1", "--learning-rate", "1e30", "--data"]);
    let done = command.arg(&data).arg("--out").arg(folder.path().join("run")).output().unwrap();
    assert_eq!(done.status.code(), Some(1), "{}", text(&done));
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(said.contains("not finite at step") && said.contains("lower learning rate"), "{said}");
}
