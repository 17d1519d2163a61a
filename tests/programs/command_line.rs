//! What a user sees who asks for something that cannot be: one clear line and a non-zero exit.

use std::fs;
use std::process::Command;

use crate::common::{dataset, fresh, spring, write_config};
use crate::programs::{paig, text};
use crate::project::project;

/// Runs a command that must be refused, and returns what it said: one line on standard error, no panic.
#[track_caller]
fn refused(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.starts_with("error: ") && said.trim_end().lines().count() == 1, "{said}");
    said
}

#[track_caller]
fn assert_says(said: &str, words: &[&str]) {
    for word in words {
        assert!(said.contains(word), "{word:?} is not in: {said}");
    }
}

#[test]
fn unknown_keys_and_values_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let said = |set: &str| refused(spring(&run).args(["--set", set]));
    assert_says(&said("join.bach=5"), &["bach", "batch"]);
    assert_says(&said("join.batch=many"), &["batch", "many"]);
    assert_says(&said("join.batch"), &["key=value"]);
    assert_says(&said("start.g=3"), &["start.g", "\"k\", \"l\""]);
    assert_says(&said("start.k=-1"), &["start.k", "positive"]);
    assert_says(&said("model.fixed={g=1.0}"), &["model.fixed.g", "\"k\", \"l\""]);
    assert_says(
        &refused(spring(&run).args(["--set", "start.k=2", "--set", "model.hold={k=4.0}"])),
        &["start.k", "fixed"],
    );
    // The name that the key had in earlier versions.
    assert_says(&said("model.hold={g=1.0}"), &["model.fixed.g"]);
    assert_says(&said("identify.horizons=[3,99]"), &["horizons", "12"]);
    for (set, words) in [
        ("identify.horizons=[]", ["horizons", "at least one"]),
        ("identify.clips=0", ["identify.clips", "at least 1"]),
        ("identify.huber=0.0", ["identify.huber", "positive"]),
        ("identify.huber=0.01", ["identify.huber", "at least 0.02"]),
        ("identify.huber=inf", ["identify.huber", "positive"]),
        ("join.validation_clips=0", ["join.validation_clips", "at least 1"]),
        ("join.learning_rate=-0.1", ["join.learning_rate", "-0.1"]),
        ("join.alpha=nan", ["join.alpha", "NaN"]),
        ("discover.schedule.anneal_at=1.5", ["discover.schedule", "anneal_at = 1.5"]),
        ("join.schedule.patience=0", ["join.schedule", "patience must be at least 1"]),
        ("discover.guide.zero_from=9", ["full_until", "zero_from = 9"]),
        ("task=\"pendulum\"", ["task=\"pendulum\"", "contradicts"]),
    ] {
        assert_says(&said(set), &words);
    }
    let of_another = write_config(folder.path(), "task = \"pendulum\"\n");
    assert_says(&refused(spring(&run).arg("--config").arg(&of_another)), &["task pendulum", "spring_color"]);
    let changed = ["--set", "task.system.dt=0.2", "--config"];
    assert_says(&refused(spring(&run).args(changed).arg(&of_another)), &["task pendulum", "spring_color"]);
    assert_says(&refused(spring(&run).args(["--seed", "18446744073709551615"])), &["--seed", "at most"]);
    assert_says(&refused(spring(&run).args(["--recipe", "slow"])), &["slow", "fast, paper"]);
    let config = write_config(folder.path(), "[join]\nlearning_rate = 1e-3\nlerning_rate = 1e-3\n");
    assert_says(&refused(spring(&run).arg("--config").arg(&config)), &["lerning_rate"]);
    assert_says(&refused(spring(&run).args(["--config", "no/such.toml"])), &["no/such.toml"]);
    let mut any = paig("train");
    assert_says(&refused(any.args(["--task", "springs"])), &["springs", "spring_color", "3bp_color"]);
    assert_says(&refused(&mut paig("train")), &["--task"]);
    assert!(!run.exists(), "a refused run left a folder");
}

/// A task of one's own, of which each test changes one thing.
const TASK: &str = "name = \"mine\"\n\
    [system]\nside = 32\nchannels = 3\nobjects = 2\ninput_steps = 4\npred_steps = 6\ndt = 0.3\nequation = \"spring\"\n\
    [data]\ntrain_frames = 12\ntest_frames = 30\n";

#[test]
fn task_files_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (file, run) = (folder.path().join("mine.toml"), folder.path().join("run"));
    let of_file = || {
        let mut command = paig("train");
        command.arg("--task").arg(&file).arg("--out").arg(&run);
        command
    };
    assert_says(&refused(&mut of_file()), &["mine.toml", "No such file"]);
    for (here, there, words) in [
        ("side = 32", "side = = 32", ["line 3", "extra `=`"]),
        ("side = 32", "sides = 32", ["line 3", "unknown field `sides`"]),
        ("name =", "colour = 1\nname =", ["line 1", "unknown field `colour`"]),
        ("side = 32", "side = 50", ["side = 50", "the nearest side is 48"]),
        ("objects = 2", "objects = 3", ["objects = 3", "\"spring\" is written for exactly 2"]),
        ("\"spring\"", "\"gravity\"", ["objects = 2", "\"gravity\" is written for exactly 3"]),
        ("\"spring\"", "\"springs\"", ["unknown equation \"springs\"", "damped_spring, gravity"]),
        ("\"mine\"", "\"pendulum\"", ["task name \"pendulum\"", "built-in"]),
        (
            "test_frames = 30\n",
            "test_frames = 30\n[success.losses]\npred_loss = nan\n",
            ["success.losses.pred_loss = NaN", "must be a positive number"],
        ),
        ("test_frames = 30\n", "test_frames = 30\n[recipe]\nfast = 3\n", ["recipe.fast = 3", "must be a table"]),
        ("test_frames = 30", "test_frames = 1000001", ["data.test_frames = 1000001", "at most 1000000"]),
        (
            "test_frames = 30",
            "test_frames = 30\ntest_file = \"clips.png\"",
            ["data.test_file = \"clips.png\"", "end in .npz"],
        ),
        (
            "test_frames = 30",
            "test_frames = 30\ntest_file = \"train_states.npz\"",
            ["data.test_file = \"train_states.npz\"", "for true states"],
        ),
    ] {
        fs::write(&file, TASK.replacen(here, there, 1)).unwrap();
        let said = refused(&mut of_file());
        assert_says(&said, &words);
        assert_says(&said, &["mine.toml"]);
    }
    // As it is there is nothing wrong with it.
    fs::write(&file, TASK).unwrap();
    let output = of_file().arg("--print-config").output().unwrap();
    assert!(output.status.success(), "{}", text(&output));
    assert_says(&text(&output), &["name = \"mine\"", "train_file = \"mine/train.npz\""]);
    assert!(!run.exists(), "a refused run left a folder");
}

/// A model would learn wrong numbers from them, and no loss would show it.
#[test]
fn data_of_another_system_are_refused_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    for (task, option, way_out, [short, long]) in [
        (
            "spring_color",
            ["--dt", "0.2"],
            "task.system.dt=0.2",
            [12, 30].map(|frames| format!("spring_color/color_spring_vx8_vy8_sl{frames}_r2_k4_e6_dt02.npz")),
        ),
        (
            "bouncing_balls",
            ["--radius", "4"],
            "task.system.wall_margin=4.0",
            [12, 30].map(|frames| format!("bouncing/color_bounce_vx8_vy8_sl{frames}_r4.npz")),
        ),
    ] {
        for changes in [&[][..], &option] {
            let mut generate = paig("generate");
            generate.args(["--task", task, "--train", "2", "--valid", "1", "--test", "1", "--out"]);
            let made = generate.arg(&data).args(changes).output().unwrap();
            assert!(made.status.success(), "{}", text(&made));
        }
        let train = |set: &[&str]| {
            let mut command = paig("train");
            command.args(["--task", task, "--data"]).arg(&data).arg("--out").arg(&run);
            command.args(set.iter().flat_map(|assignment| ["--set", assignment]));
            refused(&mut command)
        };
        let (train_file, test_file) = (format!("data.train_file={short:?}"), format!("data.test_file={long:?}"));
        assert_says(&train(&[&train_file]), &[&short, task, &format!("--set {way_out}\n")]);
        assert_says(&train(&[&test_file]), &[&long, task, &format!("--set {way_out}\n")]);
        // That way leads to the next check.
        assert_says(&train(&[&train_file, "data.test_file=\"none.npz\"", way_out]), &["none.npz"]);
    }
    assert!(!run.exists(), "a refused run left a folder");
}

/// A pendulum's true states are angles, by which no equation in x and y can be scored: said before the training.
#[test]
fn true_states_that_cannot_score_a_run_are_refused_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let (data, file, run) = (folder.path().join("data"), folder.path().join("drop.toml"), folder.path().join("run"));
    let mut generate = paig("generate");
    generate.args(["--task", "pendulum", "--train", "2", "--valid", "1", "--test", "1", "--out"]);
    let made = generate.arg(&data).output().unwrap();
    assert!(made.status.success(), "{}", text(&made));
    let stem = |frames: usize| format!("color_pendulum_sl{frames}_g10_m1_l1_a1_u2_dt005");
    let task = format!(
        "name = \"drop\"\n\
         [system]\nside = 64\nchannels = 3\nobjects = 1\ninput_steps = 4\npred_steps = 6\ndt = 0.05\n\
         [system.equation]\nacceleration = \"vec(0, g)\"\n[system.equation.parameters]\ng = {{ unit = [1, -2] }}\n\
         [data]\ntrain_frames = 14\ntest_frames = 30\nfolder = \"pendulum\"\n\
         train_file = \"{}.npz\"\ntest_file = \"{}.npz\"\n",
        stem(14),
        stem(30)
    );
    fs::write(&file, task).unwrap();
    let train = || {
        let mut command = paig("train");
        command.arg("--task").arg(&file).arg("--data").arg(&data).arg("--out").arg(&run);
        refused(command.args(["--set", "discover.frames=100000"]))
    };
    let states = format!("{}_states.npz", stem(30));
    assert_says(&train(), &[&states, "coordinates in a frame: 1, of the system: 2", "move the file"]);
    fs::rename(data.join("pendulum").join(&states), folder.path().join("away.npz")).unwrap();
    // That way leads to the next check.
    assert_says(&train(), &["discover.frames = 100000"]);
    assert!(!run.exists(), "a refused run left a folder");
}

#[test]
fn printed_config_is_complete_and_reads_back_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let print = |arguments: &[&str]| {
        let output = spring(folder.path()).arg("--print-config").args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", text(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let paper = print(&["--recipe", "paper", "--seed", "3", "--set", "join.max_steps=7"]);
    assert_says(
        &paper,
        &["seed = 3", "max_steps = 7", "optimizer = \"rmsprop\"", "learning_rate = 0.0006", "alpha = 3.0"],
    );
    assert!(!paper.contains("epochs") && !paper.contains("[discover]"), "{paper}");
    // The original's protocol.
    let protocol = ["epochs = 500", "batch = 100", "clip_gradients = 1.0", "anneal_at = 0.75", "anneal_factor = 5.0"];
    assert_says(&print(&["--recipe", "paper"]), &protocol);
    let again = write_config(folder.path(), &paper);
    assert_eq!(paper, print(&["--config", again.to_str().unwrap()]));
    assert_says(&print(&[]), &["recipe = \"fast\"", "[discover.guide]"]);
    // What is switched off is written down: a report tells such a run from the plain recipe by it.
    assert_says(&print(&["--set", "discover.first_fit=0"]), &["first_fit = 0"]);
}

#[test]
fn missing_data_and_devices_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let said = refused(spring(&folder.path().join("a")).arg("--data").arg(folder.path()));
    assert_says(&said, &["sl12_r2_k4_e6.npz", "generate --task spring_color"]);
    if !tch::Cuda::is_available() {
        let said = refused(fresh(&mut spring(&folder.path().join("b"))).args(["--device", "cuda"]));
        assert_says(&said, &["cuda", "no GPU", "CUDA=1"]);
    }
    let said = refused(fresh(&mut spring(&folder.path().join("c"))).args(["--device", "tpu"]));
    assert_says(&said, &["tpu", "cpu"]);
    // The training file holds clips of 12 frames, the test file must hold 30.
    let short = format!("data.test_file={:?}", "spring_color/color_spring_vx8_vy8_sl12_r2_k4_e6.npz");
    let said = refused(fresh(&mut spring(&folder.path().join("d"))).args(["--set", &short]));
    assert_says(&said, &["12 frames", "30"]);
    // A run that never began is in nobody's way.
    for name in ["a", "b", "c", "d"] {
        assert!(!folder.path().join(name).exists(), "a refused run left folder {name}");
    }
}

/// What a task's file says wrongly is not blamed on the command line, and a file without clips is not sent in a circle.
#[test]
fn task_files_are_named_where_they_are_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let spring =
        fs::read_to_string(project("configs/tasks/spring_color.toml")).unwrap().replace("spring_color", "springs");
    let path = folder.path().join("springs.toml");
    let said = |text: &str, options: &[&str]| {
        fs::write(&path, text).unwrap();
        refused(paig("train").arg("--task").arg(&path).args(options))
    };
    let with = |lines: &str| format!("{spring}\n{lines}\n");
    let print = ["--print-config"];
    assert_says(&said(&with("[recipe.fst.join]\nbatch = 3"), &print), &["springs", "[recipe.fst]", "fast, paper"]);
    assert_says(&said(&with("[recipe.fast.join]\nbach = 3"), &print), &["task springs: [recipe.fast]", "`bach`"]);
    let equation = "[system.equation]\nacceleration = \"vec(0, g)\"\n[system.equation.parameters]\ng = 9.81";
    let text = format!(
        "name = \"drop\"\n[system]\nside = 32\nchannels = 1\nobjects = 1\ninput_steps = 4\n\
                        pred_steps = 6\ndt = 0.3\n{equation}\n[data]\ntrain_frames = 12\ntest_frames = 30\n"
    );
    assert_says(&said(&text, &print), &["9.81", "{ unit = [1, -2] }"]);
    let own = said(&text.replace("g = 9.81", "g = {}"), &["--data", "nowhere"]);
    assert_says(&own, &["there is no dataset file", "own-data.md", "`paig import` a video"]);
    assert!(!own.contains("`paig generate"), "{own}");
}

#[test]
fn run_folders_are_guarded() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let steps = ["--set", "discover.max_steps=0", "--set", "identify.clips=4", "--set", "join.max_steps=0"];
    let small = ["--set", "join.validation_clips=4", "--set", "output.examples=0"];
    assert_says(&refused(spring(&run).arg("--resume")), &["nothing to resume"]);
    let done = fresh(&mut spring(&run)).args(steps).args(small).output().unwrap();
    assert!(done.status.success(), "{}", text(&done));
    assert_says(&refused(fresh(&mut spring(&run)).args(steps)), &["holds a run already", "--resume"]);
    assert_says(&refused(spring(&run).args(["--resume", "--seed", "9"])), &["another config", "config.toml", "seed=0"]);
    let said = refused(spring(&run).args(["--resume", "--set", "join.batch=7"]));
    assert_says(&said, &["another config", "join.batch=25", "--threads"]);
    // Where a run computes may change, and the folder says the task.
    let mut elsewhere = paig("train");
    elsewhere.args(["--resume", "--threads", "2", "--seed", "0", "--data"]).arg(dataset()).arg("--out").arg(&run);
    let done = elsewhere.output().unwrap();
    assert!(done.status.success() && text(&done).contains("2 threads"), "{}", text(&done));
    // Clips that were made again under the old name are not gone on with.
    let other = folder.path().join("other");
    let mut generate = paig("generate");
    generate.args([
        "--task",
        "spring_color",
        "--train",
        "300",
        "--valid",
        "40",
        "--test",
        "20",
        "--seed",
        "5",
        "--out",
    ]);
    assert!(generate.arg(&other).output().unwrap().status.success());
    let said = refused(spring(&run).args(["--resume", "--data"]).arg(&other));
    assert_says(&said, &["not those that the run was begun with", "another folder"]);
    // Without its config a run's checkpoints are not taken for the beginning of another run.
    fs::rename(run.join("config.toml"), run.join("away.toml")).unwrap();
    assert_says(&refused(fresh(&mut spring(&run)).args(["--seed", "9"])), &["holds a run already"]);
    fs::rename(run.join("away.toml"), run.join("config.toml")).unwrap();
    let mut other = paig("train");
    let said = refused(other.args(["--task", "3bp_color", "--resume", "--out"]).arg(&run));
    assert_says(&said, &["spring_color", "3bp_color"]);

    // Another run in the same folder at the same time.
    let lock = fs::File::open(run.join(".lock")).unwrap();
    lock.lock().unwrap();
    assert_says(&refused(spring(&run).arg("--resume")), &["another run"]);
    drop(lock);

    // A checkpoint that was cut short: the one before it is taken, and the run ends.
    let index: serde_json::Value =
        serde_json::from_slice(&fs::read(run.join("checkpoints/index.json")).unwrap()).unwrap();
    let weights = run.join("checkpoints").join(index["last"].as_str().unwrap()).join("weights.safetensors");
    let sound = fs::read(&weights).unwrap();
    fs::write(&weights, &sound[..sound.len() / 2]).unwrap();
    let done = spring(&run).arg("--resume").output().unwrap();
    assert!(done.status.success(), "{}", text(&done));
    assert_says(&text(&done), &["warning: checkpoint", "weights.safetensors", "cut short", "before it is taken"]);
    assert!(fs::read(&weights).unwrap() == sound, "other bits after a damaged checkpoint");
    // An edited config is none that the checkpoints were made with.
    let config = fs::read_to_string(run.join("config.toml")).unwrap();
    fs::write(run.join("config.toml"), config.replace("seed = 0", "seed = 5")).unwrap();
    assert_says(&refused(spring(&run).arg("--resume")), &["config.toml was edited"]);
    fs::write(run.join("config.toml"), config).unwrap();
    assert!(dataset().exists());
}

#[test]
fn output_that_cannot_be_written_is_an_error() {
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let mut print = paig("train");
    let output = print.args(["--task", "spring_color", "--print-config"]).stdout(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert_says(&text(&output), &["error: cannot write to standard output", "No space left"]);
}

/// As on a terminal that has closed: the error is lost, and no panic comes in its place.
#[test]
fn an_error_that_nobody_reads_keeps_its_exit_code() {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut unread = paig("train");
    let output = unread.args(["--task", "springs"]).stderr(writer).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
}
