//! Whatever fails at whatever moment, what was there before is whole or the new is: every command that writes is run
//! with a disk that is full, a write that is torn and a power cut at its first operation, its second, and so on.
//!
//! By default trainings are tried at every 97th operation and the rest at every fifth, for the time it takes; with
//! `PAIG_FAULTS_STRIDE=1`, as `make torture` has it, each is tried. Each file is run by itself in one thread: the faults are
//! those of a thread.

#[path = "common/faults.rs"]
mod faults;

use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::Result;
use faults::{Fault, at_every_operation};
use paig::datasets::files::{ClipShape, DatasetFile, Split};
use paig::datasets::iterators::Clips;
use paig::datasets::settings::Counts;
use paig::datasets::states::States;
use paig::evaluation::{self, ScoredClips, rollout};
use paig::generators::source_images::SourceImages;
use paig::generators::variant::Variant;
use paig::generators::{DatasetJob, generate};
use paig::network::physics_models::PhysicsNet;
use paig::runs::checkpoint::{SavedWeights, Store, find_weights};
use paig::runs::convert::convert;
use paig::runs::folder::RunFolder;
use paig::runs::metrics;
use paig::runs::scores::ScoresFile;
use paig::runs::weights;
use paig::support::atomic;
use paig::support::device::set_threads;
use paig::training::base::TrainingOutcome;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use paig::training::recorder::Recorder;
use paig::training::saved::load_model;
use paig::training::trainer::Trainer;
use paig::{tasks, viz};
use paig_experiments::sweep::{self, SweepPlan};
use paig_report as report;
use paig_report::WithPictures;
use paig_video::import::crop::CropChoice;
use paig_video::import::import;
use paig_video::import::request::ImportRequest;
use tch::{Device, Tensor};
use tempfile::TempDir;

/// A training of all phases that takes a second.
const TINY: [&str; 14] = [
    "discover.frames=4",
    "discover.max_steps=2",
    "discover.schedule.validate_every=2",
    "discover.guide.full_until=1",
    "discover.guide.zero_from=2",
    "identify.clips=2",
    "identify.horizons=[3]",
    "identify.max_iterations=1",
    "join.batch=2",
    "join.max_steps=2",
    "join.validation_clips=2",
    "join.schedule.validate_every=1",
    "output.print_every=1",
    "output.checkpoint_every=1",
];

/// How many operations lie between two that are tried.
fn stride(usual: u64) -> u64 {
    std::env::var("PAIG_FAULTS_STRIDE").map_or(usual, |text| text.parse().expect("a whole number"))
}

fn temporary() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn job(folder: &Path) -> DatasetJob {
    let task = tasks::find("spring_color").unwrap();
    DatasetJob {
        variant: Variant::new(&task, 0).unwrap(),
        counts: Counts { train: 4, valid: 2, test: 2 },
        images: SourceImages::original().unwrap(),
        folder: folder.into(),
        force: false,
    }
}

/// A dataset that the tests share.
fn data() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER
        .get_or_init(|| {
            set_threads(1).unwrap();
            let folder = temporary();
            generate(&job(folder.path()), &|_| {}).unwrap();
            folder
        })
        .path()
}

fn config() -> Config {
    let overrides = Overrides {
        task: Some("spring_color".into()),
        threads: Some(1),
        data: Some(data().into()),
        set: TINY.map(String::from).into(),
        ..Overrides::default()
    };
    Config::load(None, &overrides).unwrap()
}

/// Clips to learn from and to validate on.
fn clips(config: &Config) -> Result<[Clips; 2]> {
    let file = DatasetFile::read(&config.data.train_path(), &ClipShape::training(&config.task))?;
    Ok([Split::Train, Split::Valid].map(|split| Clips::new(file.split(split), None, Device::Cpu)))
}

/// Trains in a folder to the end, from where it stands.
fn train(config: &Config, folder: &Path) -> Result<()> {
    let [train, valid] = clips(config)?;
    let run = if folder.join("config.toml").exists() {
        RunFolder::reopen(folder)?
    } else {
        RunFolder::create(folder, &config.to_toml())?
    };
    let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, config.seed)?;
    let mut recorder = Recorder::new(&run)?;
    let mut trainer =
        Trainer::new(config, &model, &train, &valid)?.save_to(Store::new(folder)).observed_by(&mut recorder);
    trainer.run().map(drop)
}

/// A finished run that the tests share.
fn finished() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER
        .get_or_init(|| {
            let folder = temporary();
            train(&config(), &folder.path().join("run")).unwrap();
            folder
        })
        .path()
}

fn run() -> PathBuf {
    finished().join("run")
}

/// Nothing half-written stands under a final name, and of what fails by itself nothing half-written is left at all.
fn assert_no_halves(folder: &Path, fault: Fault) {
    if fault != Fault::NoSpace {
        return;
    }
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let entry = entry.unwrap();
        assert!(!atomic::is_partial(&entry.file_name()), "{:?} was left", entry.path());
        if entry.path().is_dir() {
            assert_no_halves(&entry.path(), fault);
        }
    }
}

fn last_weights(run: &Path) -> Vec<u8> {
    fs::read(find_weights(run, SavedWeights::Last).unwrap()).unwrap()
}

/// The records without the time, which is never the same.
fn records(run: &Path) -> Vec<metrics::Record> {
    let records = metrics::read(&run.join("metrics.jsonl")).unwrap();
    records.into_iter().map(|record| metrics::Record { seconds: None, ..record }).collect()
}

/// The weights of a training that saves nothing, and how often it stopped, which it does after each step if it `stops`.
fn in_memory(config: &Config, stops: bool) -> (Vec<(String, Tensor)>, usize) {
    let [train, valid] = clips(config).unwrap();
    let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, config.seed).unwrap();
    let mut trainer = Trainer::new(config, &model, &train, &valid).unwrap().stop_when(|| stops);
    let stopped =
        std::iter::repeat_with(|| trainer.run().unwrap()).take_while(|it| *it == TrainingOutcome::Interrupted).count();
    (model.named_variables().into_iter().map(|(name, variable)| (name, variable.detach().copy())).collect(), stopped)
}

#[test]
fn a_training_in_memory_goes_on_to_the_same_bits() {
    let config = config();
    let ((whole, never), (parts, often)) = (in_memory(&config, false), in_memory(&config, true));
    assert!(never == 0 && often > 3, "stopped {often} times");
    for ((name, whole), (_, parts)) in whole.iter().zip(&parts) {
        assert!(whole.equal(parts), "{name}");
    }
}

#[test]
fn a_training_goes_on_to_the_same_bits_whatever_failed() {
    let config = config();
    let whole = run();
    let (weights, course, log) =
        (last_weights(&whole), records(&whole), fs::read_to_string(whole.join("log.txt")).unwrap());
    let tried = at_every_operation(
        stride(97),
        temporary,
        |folder| train(&config, &folder.path().join("run")),
        |folder, fault, at| {
            let run = folder.path().join("run");
            train(&config, &run).unwrap_or_else(|error| panic!("{fault:?} at {at}: cannot go on: {error:#}"));
            assert!(last_weights(&run) == weights, "{fault:?} at {at}: other bits");
            assert_eq!(records(&run), course, "{fault:?} at {at}: another course");
            assert_eq!(fs::read_to_string(run.join("log.txt")).unwrap(), log, "{fault:?} at {at}: another log");
            assert_no_halves(&run, fault);
        },
    );
    println!("training: {} faults", tried.faults);
    assert!(tried.faults > 3);
}

#[test]
fn datasets_appear_whole_or_not_at_all() {
    let task = tasks::find("spring_color").unwrap();
    let read = |folder: &Path| [&task.train_file, &task.test_file].map(|file| fs::read(folder.join(file)).ok());
    let whole = read(data());
    let tried = at_every_operation(
        stride(5),
        temporary,
        |folder| Ok(generate(&job(folder.path()), &|_| {})?),
        |folder, fault, at| {
            for (file, shape) in
                [(&task.train_file, ClipShape::training(&task)), (&task.test_file, ClipShape::test(&task))]
            {
                let path = folder.path().join(file);
                if path.exists() {
                    // Where the dataset is, its states are, and belong to it.
                    let dataset = DatasetFile::read(&path, &shape).unwrap();
                    assert!(States::read(&path, &dataset).unwrap().is_some(), "{fault:?} at {at}: no states");
                }
            }
            assert_no_halves(folder.path(), fault);
            generate(&job(folder.path()), &|_| {}).unwrap();
            assert!(read(folder.path()) == whole, "{fault:?} at {at}: another dataset");
        },
    );
    println!("generate: {} faults", tried.faults);
}

/// What is written as single files: each is the old one or the new one.
#[test]
fn scores_predictions_and_weights_are_the_old_or_the_new() {
    let (config, model) = load_model(&run(), SavedWeights::Last, Device::Cpu).unwrap();
    let test = ScoredClips::read(&config.data.test_path(), &config.task, Split::Test, Device::Cpu).unwrap();
    let scores = ScoresFile {
        format: ScoresFile::FORMAT,
        task: config.task.name.clone(),
        run: run(),
        file: config.data.test_path(),
        split: "test".into(),
        parameters: [("k".to_string(), 1.0)].into(),
        scores: evaluation::evaluate(&model, &test).unwrap(),
    };
    let clip = test.clips.batch(&[0], 12).squeeze_dim(0);
    let [before, prediction] =
        [4, 8].map(|frames| rollout::roll_out(&model, &clip, &test.clips.actions(&[0]), frames).unwrap());
    let write = |folder: &Path| {
        scores.write(&folder.join("scores.json"))?;
        convert(&config.task.system, &config.model, &run(), &folder.join("weights.npz"))?;
        convert(&config.task.system, &config.model, &run(), &folder.join("weights.safetensors")).map(drop)
    };
    let names = ["scores.json", "weights.npz", "weights.safetensors"];
    let whole = temporary();
    write(whole.path()).unwrap();
    let read = |folder: &Path, name: &str| fs::read(folder.join(name)).unwrap();
    let tried = at_every_operation(
        stride(5),
        || {
            let folder = temporary();
            names.iter().for_each(|name| fs::write(folder.path().join(name), "old").unwrap());
            folder
        },
        |folder| write(folder.path()),
        |folder, fault, at| {
            for name in names {
                let found = read(folder.path(), name);
                let (old, new) = (found == b"old", found == read(whole.path(), name));
                assert!(old || new, "{fault:?} at {at}: {name} is neither old nor new");
            }
            assert_no_halves(folder.path(), fault);
        },
    );
    println!("evaluate, convert: {} faults", tried.faults);
    let predict = |folder: &Path, prediction| viz::write_rollout(&folder.join("prediction"), &model.system, prediction);
    let arrays = |prediction| {
        let place = temporary();
        predict(place.path(), prediction).unwrap();
        fs::read(place.path().join("prediction/rollout.npz")).unwrap()
    };
    let (old, new) = (arrays(&before), arrays(&prediction));
    let tried = at_every_operation(
        stride(5),
        || {
            let folder = temporary();
            predict(folder.path(), &before).unwrap();
            folder
        },
        |folder| Ok(predict(folder.path(), &prediction)?),
        |folder, fault, at| {
            assert_no_halves(folder.path(), fault);
            // The next one puts in its place what was complete.
            viz::check_rollout_folder(&folder.path().join("prediction")).unwrap();
            let lines = fs::read_to_string(folder.path().join("prediction/states.csv")).unwrap().lines().count();
            let archive = fs::read(folder.path().join("prediction/rollout.npz")).unwrap();
            assert!([6, 10].contains(&lines), "{fault:?} at {at}: {lines} lines");
            let whole = if lines == 6 { &old } else { &new };
            assert!(archive == *whole, "{fault:?} at {at}: table and arrays are of two predictions");
        },
    );
    println!("predict: {} faults", tried.faults);
}

#[test]
fn a_report_is_the_old_or_the_new_at_the_latest_after_the_next() {
    let runs = [run()];
    let tried = at_every_operation(
        stride(5),
        || {
            let folder = temporary();
            report::write(&runs, &folder.path().join("report"), WithPictures::Shown).unwrap();
            folder
        },
        |folder| Ok(report::write(&runs, &folder.path().join("report"), WithPictures::Shown).map(drop)?),
        |folder, fault, at| {
            let out = folder.path().join("report");
            // A run that could not be read is said to be so. Otherwise its records, from which a report is made again when
            // the run is gone, are there in one place or the other.
            let records = ["records", ".new/records"].map(|name| out.join(name).join("spring_color"));
            let said = || fs::read_to_string(out.join("report.md")).unwrap().contains("cannot be read");
            assert!(records.iter().any(|place| place.exists()) || said(), "{fault:?} at {at}: the records are gone");
            report::write(&runs, &out, WithPictures::Shown)
                .unwrap_or_else(|error| panic!("{fault:?} at {at}: {error:#}"));
            for name in ["report.md", "report.html", "results.json", "records", "pictures"] {
                assert!(out.join(name).exists(), "{fault:?} at {at}: {name} is missing");
            }
            assert!(!out.join(".new").exists(), "{fault:?} at {at}: a report was not put in its place");
        },
    );
    println!("report: {} faults", tried.faults);
}

#[test]
fn an_imported_task_is_whole_or_not_there() {
    let film = temporary();
    let video = film.path().join("film.npz");
    let mut npz = ndarray_npy::NpzWriter::new(fs::File::create(&video).unwrap());
    let frames = ndarray::Array4::from_shape_fn((90, 32, 32, 3), |(t, y, x, _)| {
        let (dx, dy) = (x as f64 - 6.0 - t as f64 / 5.0, y as f64 - 16.0);
        if dx.hypot(dy) < 3.0 { 255u8 } else { 0 }
    });
    npz.add_array("frames", &frames).unwrap();
    npz.finish().unwrap();
    let request = |folder: &Path| ImportRequest {
        fps: Some(30.0),
        crop: CropChoice::Full,
        ..ImportRequest::of(vec![video.clone()], folder.join("task"))
    };
    let tried = at_every_operation(
        stride(5),
        temporary,
        |folder| Ok(import(&request(folder.path()), &|_, _| {}).map(drop)?),
        |folder, fault, at| {
            let out = folder.path().join("task");
            if out.exists() {
                for name in ["task.toml", "train.npz", "test.npz", "contact-sheet.png"] {
                    assert!(out.join(name).exists(), "{fault:?} at {at}: {name} is missing");
                }
            } else {
                import(&request(folder.path()), &|_, _| {}).unwrap();
            }
            assert_no_halves(folder.path(), fault);
        },
    );
    println!("import: {} faults", tried.faults);
    // Over a task that was edited: all of the old one or all of the new one, and what else lies there.
    let edited = |folder: &Path| {
        import(&request(folder), &|_, _| {}).unwrap();
        let task = folder.join("task/task.toml");
        let text = fs::read_to_string(&task).unwrap();
        fs::write(&task, text + "# my equation\n").unwrap();
        fs::write(folder.join("task/notes.txt"), "dear diary").unwrap();
    };
    let again = |folder: &Path| ImportRequest { force: true, side: 24, ..request(folder) };
    let whole = |folder: &Path| {
        ["task.toml", "train.npz", "test.npz", "film.npz", "contact-sheet.png"]
            .map(|name| fs::read(folder.join("task").join(name)).unwrap())
    };
    let (old, new) = (temporary(), temporary());
    edited(old.path());
    import(&again(new.path()), &|_, _| {}).unwrap();
    let (old, new) = (whole(old.path()), whole(new.path()));
    let tried = at_every_operation(
        stride(5),
        || {
            let folder = temporary();
            edited(folder.path());
            folder
        },
        |folder| Ok(import(&again(folder.path()), &|_, _| {}).map(drop)?),
        |folder, fault, at| {
            let found = whole(folder.path());
            assert!(found == old || found == new, "{fault:?} at {at}: neither the old task nor the new one");
            assert_eq!(fs::read(folder.path().join("task/notes.txt")).unwrap(), b"dear diary", "{fault:?} at {at}");
            assert_no_halves(folder.path(), fault);
        },
    );
    println!("import over an edited task: {} faults", tried.faults);
}

/// A sweep of programs that do nothing: what the sweep itself writes.
#[test]
fn a_sweep_marks_what_has_finished_or_does_not() {
    let plan = |out: &Path| SweepPlan {
        tasks: vec!["spring_color".into()],
        seeds: vec![0, 1],
        recipe: "fast".into(),
        name: None,
        config: None,
        set: Vec::new(),
        data: None,
        device: None,
        threads: 1,
        out: out.into(),
    };
    let sweep = |out: &Path| {
        let jobs = plan(out).jobs()?;
        let ended = sweep::run(Path::new("/bin/true"), &jobs, 2, &|| false, &mut |_| {})?;
        anyhow::ensure!(ended.failed.is_empty(), "{:?}", ended.failed);
        Ok(())
    };
    let tried = at_every_operation(
        stride(5),
        temporary,
        |folder| sweep(folder.path()),
        |folder, fault, at| {
            sweep(folder.path()).unwrap_or_else(|error| panic!("{fault:?} at {at}: {error:#}"));
            for seed in [0, 1] {
                assert!(folder.path().join(format!("spring_color/fast/seed={seed}/DONE")).exists());
            }
            assert_no_halves(folder.path(), fault);
        },
    );
    println!("sweep: {} faults", tried.faults);
}

/// A checkpoint that was changed in one bit, or cut off, is never taken: the one before it is, and the run says so.
#[test]
fn a_flipped_bit_is_found_and_the_checkpoint_before_is_taken() {
    let config = config();
    let weights = last_weights(&run());
    let copy = |folder: &Path| {
        let to = folder.join("run");
        fs::create_dir_all(to.join("checkpoints")).unwrap();
        for name in ["config.toml", "metrics.jsonl", "log.txt"] {
            fs::copy(run().join(name), to.join(name)).unwrap();
        }
        for entry in fs::read_dir(run().join("checkpoints")).unwrap().map(|entry| entry.unwrap()) {
            let to = to.join("checkpoints").join(entry.file_name());
            if entry.path().is_file() {
                fs::copy(entry.path(), to).unwrap();
                continue;
            }
            fs::create_dir_all(&to).unwrap();
            for file in fs::read_dir(entry.path()).into_iter().flatten().map(|file| file.unwrap()) {
                fs::copy(file.path(), to.join(file.file_name())).unwrap();
            }
        }
        to
    };
    let folder = temporary();
    let run = copy(folder.path());
    let last = find_weights(&run, SavedWeights::Last).unwrap().parent().unwrap().to_path_buf();
    let model = || PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, 0).unwrap();
    let fresh = model();
    let tried = RefCell::new(0);
    let assert_found = |file: &str, bytes: &[u8]| {
        fs::write(last.join(file), bytes).unwrap();
        let loaded = Store::new(&run).load(fresh.named_variables(), "spring_color").unwrap().unwrap();
        let damaged = loaded.damaged.expect("the damage was not found");
        assert!(damaged.contains(file), "{damaged}");
        *tried.borrow_mut() += 1;
    };
    for file in ["state.json", "weights.safetensors", "slots.safetensors"] {
        let sound = fs::read(last.join(file)).unwrap();
        let places = (0..sound.len().min(600)).step_by(29).chain((0..sound.len()).step_by(sound.len() / 12 + 1));
        for place in places {
            let mut flipped = sound.clone();
            flipped[place] ^= 1 << (place % 8);
            // A number may be written in more than one way; then nothing is lost.
            if file == "state.json" && same_json(&flipped, &sound) {
                continue;
            }
            assert_found(file, &flipped);
        }
        for cut in (0..sound.len()).step_by(sound.len() / 7 + 1) {
            assert_found(file, &sound[..cut]);
        }
        fs::remove_file(last.join(file)).unwrap();
        let loaded = Store::new(&run).load(fresh.named_variables(), "spring_color").unwrap().unwrap();
        assert!(loaded.damaged.unwrap().contains("missing"));
        fs::write(last.join(file), sound).unwrap();
    }
    assert!(*tried.borrow() > 80, "{tried:?}");
    // Without the index nothing is lost, and with a damaged last one the run ends with the same bits.
    fs::remove_file(run.join("checkpoints/index.json")).unwrap_or_default();
    fs::write(last.join("weights.safetensors"), "no tensors").unwrap();
    train(&config, &run).unwrap();
    assert!(last_weights(&run) == weights);
    // All damaged: no fresh start that nobody asked for.
    for entry in fs::read_dir(run.join("checkpoints")).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.join("state.json").exists() {
            fs::write(entry.join("state.json"), "{}").unwrap();
        }
    }
    let error = format!("{:#}", train(&config, &run).unwrap_err());
    assert!(error.contains("state.json") && error.contains("begin the run again"), "{error}");
}

fn same_json(a: &[u8], b: &[u8]) -> bool {
    let value = |bytes| serde_json::from_slice::<serde_json::Value>(bytes).ok();
    value(a).is_some() && value(a) == value(b)
}

#[test]
fn weights_with_a_nan_and_an_edited_config_are_refused() {
    let config = config();
    let folder = temporary();
    let path = folder.path().join("weights.safetensors");
    let saved = weights::parse(&last_weights(&run())).unwrap();
    assert!(saved.checked);
    let tensors = saved.tensors;
    let _ = tensors[0].1.view([-1]).get(0).fill_(f64::NAN);
    weights::write(&path, &tensors).unwrap();
    let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, 0).unwrap();
    let error = format!("{:#}", weights::load(&path, &model).unwrap_err());
    assert!(error.contains(&tensors[0].0) && error.contains("NaN"), "{error}");

    let run = folder.path().join("run");
    train(&config, &run).unwrap();
    let text = fs::read_to_string(run.join("config.toml")).unwrap();
    fs::write(run.join("config.toml"), text.replace("seed = 0", "seed = 1")).unwrap();
    let edited = Config::read(&run.join("config.toml")).unwrap();
    let error = format!("{:#}", train(&edited, &run).unwrap_err());
    assert!(error.contains("config.toml was edited"), "{error}");
    fs::write(run.join("config.toml"), text).unwrap();
    // A course with a bad byte would stop the run at its end.
    let mut course = fs::read(run.join("metrics.jsonl")).unwrap();
    course[200] = 0xff;
    fs::write(run.join("metrics.jsonl"), course).unwrap();
    let error = format!("{:#}", train(&config, &run).unwrap_err());
    assert!(error.contains("metrics.jsonl: line") && error.contains("damaged"), "{error}");
}
