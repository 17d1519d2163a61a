//! Whole runs of the training program on a small generated dataset.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::{dataset, fresh, spring, write_config};
use crate::process::{Signal, signal};
use crate::programs::{paig, text, train};
use paig::runs::checkpoint::{SavedWeights, find_weights};
use serde_json::Value;

/// L_rec of a blank frame: 9.25 for each ball of radius 2.
const BLANK: f64 = 18.5;

fn summary(run: &Path) -> Value {
    serde_json::from_slice(&fs::read(run.join("summary.json")).unwrap()).unwrap()
}

fn number(value: &Value, path: &str) -> f64 {
    value.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("no number at {path} of {value}"))
}

/// From a network that knows nothing to balls, positions and a spring, on 300 clips and in a fraction of the steps.
#[test]
fn a_short_training_finds_balls_and_spring() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let config = write_config(
        folder.path(),
        "[discover]\nmax_steps = 200\n[discover.guide]\nfull_until = 80\nzero_from = 160\n\
         [identify]\nclips = 150\n[join]\nmax_steps = 60\nbatch = 10\nvalidation_clips = 20\n",
    );
    let done = fresh(&mut spring(&run)).arg("--config").arg(config).output().unwrap();
    assert!(done.status.success(), "{}", text(&done));
    let summary = summary(&run);
    let (recons, pred) = (number(&summary, "/test/recons_loss"), number(&summary, "/test/pred_loss"));
    // A ninth of a blank frame's loss needs both balls; half of it for predicted frames needs the physics as well.
    assert!(recons < BLANK / 9.0, "L_rec {recons}; one ball missing costs {}", BLANK / 2.0);
    assert!(pred < BLANK / 2.0, "L_pred {pred}");
    // Two seeds end 0.2 % low in k, as even true positions do, and within 0.1 % of l. Both start at 1 and stay there without
    // the fit.
    let (k, l) = (number(&summary, "/parameters/k/learned"), number(&summary, "/parameters/l/learned"));
    assert!((k / 4.0 - 1.0).abs() < 0.02, "k {k} for a true 4");
    assert!((l / 6.0 - 1.0).abs() < 0.01, "l {l} for a true 6");
    assert_eq!(number(&summary, "/parameters/k/truth"), 4.0);
    let written = ["example0.png", "animation.gif", "templates.png", "encoder_masks.png", "outputs.npz", "losses.png"];
    for name in written {
        assert!(run.join(name).metadata().is_ok_and(|file| file.len() > 0), "{name} was not written");
    }

    // Rolled-out states are hardly worse than encoded positions, 0.13 and 0.1 px; without the fit they are 6 px off.
    assert!(number(&summary, "/test/states/predicted") < 1.0, "{summary}");
    assert_eq!(number(&summary, "/test/predicted_frames/25/frame"), 29.0);

    // The score of the saved checkpoint is the score that was reported.
    let scored = spring(&run).arg("--test-mode").output().unwrap();
    assert!(text(&scored).contains(&format!("{recons:.4}")), "{}", text(&scored));
    assert!(text(&scored).contains("T_ext begins") && text(&scored).contains("encoded positions"), "{}", text(&scored));
}

/// A run so small that it takes seconds, with checkpoints between validations and at phase ends.
const TINY: &str = "[discover]\nframes = 8\nmax_steps = 14\n[discover.schedule]\nvalidate_every = 5\n[discover.guide]\nfull_until = 4\n\
    zero_from = 8\n[identify]\nclips = 6\nhorizons = [3, 5]\nmax_iterations = 3\n\
    [join]\nbatch = 4\nmax_steps = 12\nlearning_rate = 1e-3\nvalidation_clips = 4\n[join.schedule]\nvalidate_every = 5\n\
    [output]\nprint_every = 2\ncheckpoint_every = 3\nexamples = 0\n";

/// The tensors of the last weights. The header before them holds a checksum of the run's config, which names paths and
/// threads.
fn last_weights(run: &Path) -> Vec<u8> {
    tensors(&find_weights(run, SavedWeights::Last).unwrap())
}

fn tensors(weights: &Path) -> Vec<u8> {
    let bytes = fs::read(weights).unwrap();
    let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    bytes[8 + header..].to_vec()
}

/// metrics.jsonl without the times.
fn metrics(run: &Path) -> Vec<Value> {
    let lines = fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    lines
        .lines()
        .map(|line| {
            let mut record: Value = serde_json::from_str(line).unwrap();
            record.as_object_mut().unwrap().remove("seconds");
            record
        })
        .collect()
}

/// The step of `join` with its best validation, if a later one is worse.
fn best_before_the_last_of_join(metrics: &[Value]) -> Option<u64> {
    let validations = metrics.iter().filter(|record| record["kind"] == "valid" && record["phase"] == "join");
    let scores: Vec<_> = validations.map(|it| (it["step"].as_u64().unwrap(), it["score"].as_f64().unwrap())).collect();
    let best = scores.iter().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    (best.1 < scores.last().unwrap().1).then(|| best.0 - scores[0].0)
}

/// The last weights are those of the best validation, and the log says so where a later one is worse.
fn assert_ends_at_best(run: &Path) {
    let log = fs::read_to_string(run.join("log.txt")).unwrap();
    let returned = best_before_the_last_of_join(&metrics(run));
    match returned {
        Some(step) => {
            assert!(log.contains(&format!("join - back to its step {step}, the best by validation")), "{log}")
        }
        None => assert!(!log.contains("back to its step"), "{log}"),
    }
    assert!(last_weights(run) == tensors(&run.join("checkpoints/best.safetensors")));
}

/// Waits until a file holds some words, or the program has ended.
fn wait_for(file: &Path, words: &str, child: &mut Child) {
    let started = Instant::now();
    while child.try_wait().unwrap().is_none() && !fs::read_to_string(file).is_ok_and(|text| text.contains(words)) {
        assert!(started.elapsed() < Duration::from_secs(300), "no {words} in {} after five minutes", file.display());
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// There is something that a run can go on from.
pub(crate) const SAVED: [&str; 2] = ["checkpoints/index.json", "last"];

/// After as many a run goes on to its end, however slow the machine is.
const MOST_KILLS: u64 = 12;

/// Trains into `whole` by the command that `fresh` makes for a folder, and into `killed` by the same one, killed at ever
/// later moments and taken up by `again`: the bits are the same, and are not those of a run that began anew, by the steps
/// `done_before` that an output names. The first kills are `when` a file of the run holds some words, however fast the machine
/// is.
pub(crate) fn resumes_to_the_same_bits(
    [whole, killed]: [&Path; 2],
    when: &[[&str; 2]],
    fresh: impl Fn(&Path) -> Command,
    again: impl Fn(&Path) -> Command,
    done_before: impl Fn(&Output) -> Option<u64>,
) {
    let done = fresh(whole).output().unwrap();
    assert!(done.status.success(), "{}", text(&done));

    // Killed first where there is something to lose, then at ever later moments, wherever in a step, a save or a phase that is.
    let (mut kills, mut taken_up) = (0, Vec::new());
    for attempt in 0..=MOST_KILLS {
        let mut command = if killed.join("config.toml").exists() { again(killed) } else { fresh(killed) };
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        match when.get(attempt as usize) {
            Some([file, words]) => wait_for(&killed.join(file), words, &mut child),
            None if attempt < MOST_KILLS => std::thread::sleep(Duration::from_millis(400 + 450 * attempt)),
            None => {}
        }
        if attempt < MOST_KILLS && child.try_wait().unwrap().is_none() {
            // SIGKILL: nothing can be saved any more.
            child.kill().unwrap();
            kills += 1;
        }
        let output = child.wait_with_output().unwrap();
        taken_up.extend(done_before(&output));
        if output.status.success() {
            break;
        }
        assert!(output.status.code().is_none(), "a run failed by itself: {}", text(&output));
    }
    assert!(kills > 0, "the run finished before it could be killed");
    assert!(taken_up.is_sorted() && taken_up.last() > Some(&0), "begun anew after {kills} kills: {taken_up:?}");
    assert!(last_weights(whole) == last_weights(killed), "weights differ after {kills} kills");
    let begin = serde_json::json!({"kind": "begin", "phase": "", "step": 0, "format": 1});
    assert_eq!(metrics(whole)[0], begin);
    assert_eq!(metrics(whole), metrics(killed));
    assert_eq!(fs::read(whole.join("log.txt")).unwrap(), fs::read(killed.join("log.txt")).unwrap());
}

/// After how many steps a run was taken up, as it says.
fn steps_done_before(output: &Output) -> Option<u64> {
    let said = text(output);
    let (_, rest) = said.split_once("resuming after step ")?;
    Some(rest.split(' ').next().unwrap().parse().unwrap())
}

/// The command that trains into a folder.
type StartOfRun = Box<dyn Fn(&Path) -> Command>;

/// The training of the springs in a folder by a config, and its resumption.
fn begin_and_resume(config: &Path, set: &'static [&'static str]) -> [StartOfRun; 2] {
    let config = config.to_path_buf();
    let begin = move |run: &Path| {
        let mut command = spring(run);
        fresh(&mut command).arg("--config").arg(&config).args(set);
        command
    };
    let again = |run: &Path| {
        let mut command = spring(run);
        command.arg("--resume");
        command
    };
    [Box::new(begin), Box::new(again)]
}

#[test]
fn a_killed_run_resumes_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_config(folder.path(), TINY);
    let [whole, killed] = ["whole", "killed"].map(|name| folder.path().join(name));
    let [begin, again] = begin_and_resume(&config, &[]);
    resumes_to_the_same_bits([&whole, &killed], &[SAVED], begin, again, steps_done_before);
    assert_ends_at_best(&whole);
}

/// Settings with which the loss of `join` exceeds the largest float32, 3.4e38: L_rec is above 1.2 after so few steps, as a
/// frame without its balls costs 18.5.
const OVERFLOW: [&str; 4] = ["--set", "join.end_at_best=true", "--set", "join.alpha=3e38"];

#[test]
fn a_killed_run_whose_join_diverges_resumes_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_config(folder.path(), TINY);
    let [whole, killed] = ["whole", "killed"].map(|name| folder.path().join(name));
    let [begin, again] = begin_and_resume(&config, &OVERFLOW);
    resumes_to_the_same_bits([&whole, &killed], &[SAVED], begin, again, steps_done_before);
    let log = fs::read_to_string(whole.join("log.txt")).unwrap();
    let expected = "join - the total loss is not finite at step 15: back to its step 0, the best by validation";
    assert!(log.contains(expected), "{log}");
    assert!(last_weights(&whole) == tensors(&whole.join("checkpoints/best.safetensors")));
}

/// The kernels sum in the same order on any number of threads, and libtorch computes on one beside them.
#[test]
fn threads_do_not_change_a_bit_of_a_training() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_config(folder.path(), TINY);
    let [one, three] = ["1", "3"].map(|threads| {
        let run = folder.path().join(threads);
        let mut command = spring(&run);
        let done = command.args(["--threads", threads, "--data"]).arg(dataset()).arg("--config").arg(&config).output();
        let done = done.unwrap();
        assert!(done.status.success(), "{}", text(&done));
        (last_weights(&run), metrics(&run))
    });
    assert!(one.0 == three.0, "weights differ");
    assert_eq!(one.1, three.1);
}

/// Large frames: objects are found on halved ones first, and nothing of that is saved.
#[test]
fn a_run_that_was_killed_among_halved_frames_resumes_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let made = paig("generate")
        .args(["--task", "pendulum", "--train", "20", "--valid", "6", "--test", "6", "--out"])
        .arg(&data)
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", text(&made));
    let config = write_config(folder.path(), &TINY.replace("max_steps = 14", "max_steps = 14\ncoarse_steps = 40"));
    let [whole, killed] = ["whole", "killed"].map(|name| folder.path().join(name));
    let begin = |run: &Path| {
        let mut command = train("pendulum");
        command.args(["--threads", "1", "--data"]).arg(&data).arg("--config").arg(&config).arg("--out").arg(run);
        command
    };
    let again = |run: &Path| {
        let mut command = train("pendulum");
        command.arg("--resume").arg("--out").arg(run);
        command
    };
    resumes_to_the_same_bits([&whole, &killed], &[["metrics.jsonl", "coarse"], SAVED], begin, again, steps_done_before);
    let phases: Vec<_> = metrics(&whole).iter().map(|record| record["phase"].as_str().unwrap().to_string()).collect();
    let first = |phase: &str| phases.iter().position(|known| known == phase).expect(phase);
    assert!(first("coarse") < first("discover"), "{phases:?}");
}

#[test]
fn sigterm_saves_and_stops() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let config = write_config(folder.path(), &TINY.replace("max_steps = 14", "max_steps = 100000"));
    let mut child = fresh(&mut spring(&run)).arg("--config").arg(&config).stdout(Stdio::piped()).spawn().unwrap();
    let [file, words] = SAVED;
    wait_for(&run.join(file), words, &mut child);
    signal(child.id(), Signal::SIGTERM);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(143), "{}", text(&output));
    assert!(text(&output).contains("--resume"), "{}", text(&output));
}

/// Guides of this weight overflow float32: together they are far above 1.2 before the first step, the cross-entropies of masks
/// that tell nothing alone 1.4 and 0.7.
#[test]
fn divergence_stops_the_run_and_names_tensor_and_step() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let config = write_config(folder.path(), TINY);
    let mut command = spring(&run);
    fresh(&mut command).arg("--config").arg(&config);
    for guide in ["coverage", "identity", "tie"] {
        command.arg("--set").arg(format!("discover.guide.{guide}=3e38"));
    }
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.starts_with("error: discover: the total loss is not finite at step 1; "), "{said}");
    assert!(!run.join("summary.json").exists());
}

/// What was found before the last phase is not lost where that diverges. At this weight of L_rec the loss is finite, but the
/// squares of its gradients, which Adam averages, are not: the next validation would judge weights that are no numbers.
#[test]
fn a_join_that_diverges_goes_back_to_its_best() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_config(folder.path(), TINY);
    let run = folder.path().join("run");
    let mut command = spring(&run);
    fresh(&mut command).arg("--config").arg(&config);
    let schedule = ["join.schedule.validate_every=1", "join.schedule.plateau=0"];
    for setting in ["join.end_at_best=true", "join.alpha=1e36"].iter().chain(&schedule) {
        command.args(["--set", setting]);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    let log = fs::read_to_string(run.join("log.txt")).unwrap();
    let line = log.lines().find(|line| line.contains("is not finite after step ")).unwrap_or_else(|| panic!("{log}"));
    assert!(line.contains("join - variable ") && line.ends_with(", the best by validation"), "{line}");
    assert!(last_weights(&run) == tensors(&run.join("checkpoints/best.safetensors")));
    assert!(run.join("summary.json").exists());
}

/// The same file with all true positions and velocities ten times as large.
fn change_states(from: &Path, to: &Path) {
    use ndarray::ArrayD;
    let mut reader = ndarray_npy::NpzReader::new(fs::File::open(from).unwrap()).unwrap();
    let mut writer = ndarray_npy::NpzWriter::new_compressed(fs::File::create(to).unwrap());
    for name in reader.names().unwrap() {
        if let Ok(states) = reader.by_name::<ndarray::OwnedRepr<f32>, ndarray::IxDyn>(&name) {
            writer.add_array(&*name, &(10.0f32 * states)).unwrap();
        } else if let Ok(numbers) = reader.by_name::<ndarray::OwnedRepr<f64>, ndarray::IxDyn>(&name) {
            let numbers: ArrayD<f64> = numbers;
            writer.add_array(&*name, &numbers).unwrap();
        } else if let Ok(sums) = reader.by_name::<ndarray::OwnedRepr<u64>, ndarray::IxDyn>(&name) {
            writer.add_array(&*name, &sums).unwrap();
        } else {
            let text: ArrayD<u8> = reader.by_name(&name).unwrap();
            writer.add_array(&*name, &text).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// The true states lie beside the data for scoring alone: without them, or with others, a training ends with the same bits.
#[test]
fn true_states_never_enter_a_training() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_config(folder.path(), TINY);
    let beside = |name: &str| name.ends_with("_states.npz");
    let weights = ["whole", "deleted", "changed"].map(|states| {
        let data = folder.path().join(states);
        fs::create_dir_all(data.join("spring_color")).unwrap();
        for entry in fs::read_dir(dataset().join("spring_color")).unwrap() {
            let from = entry.unwrap().path();
            let to = data.join("spring_color").join(from.file_name().unwrap());
            match (beside(from.to_str().unwrap()), states) {
                (true, "deleted") => {}
                // Of other numbers, but sound: a damaged file is refused before the training.
                (true, "changed") => change_states(&from, &to),
                _ => drop(fs::copy(&from, to).unwrap()),
            }
        }
        let run = folder.path().join(format!("run-{states}"));
        let mut command = spring(&run);
        command.args(["--threads", "1", "--config"]).arg(&config).arg("--data").arg(&data);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", text(&output));
        last_weights(&run)
    });
    assert!(weights[0] == weights[1] && weights[0] == weights[2], "the states beside the data changed the weights");
}
