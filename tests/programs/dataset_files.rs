//! Dataset files, true states and source images on the disk: round trips, numpy's files, and what bad files say.

use std::fs;
use std::path::{Path, PathBuf};

use crate::programs::paig;
use crate::project::project;
use ndarray::{Array, Array2, Array5, s};
use ndarray_npy::{NpzWriter, WritableElement};
use paig::datasets::dataset::Dataset;
use paig::datasets::files::{ClipShape, DatasetFile, FrameIdentity, Origin, Split};
use paig::datasets::iterators::Clips;
use paig::datasets::states::States;
use paig::generators::source_images::SourceImages;
use paig::generators::variant::{Changes, Variant};
use paig::generators::{Counts, DatasetJob, generate, generate_clips};
use paig::tasks::scene::Background;
use paig::tasks::{Task, find};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tch::{Device, Kind};
use tempfile::TempDir;

const COUNTS: Counts = Counts { train: 12, valid: 2, test: 3 };

/// What [`small`] holds.
fn shape() -> ClipShape {
    ClipShape {
        task: "spring_color".into(),
        origin: Origin::Generated,
        frames: 3,
        or_frames: None,
        side: 4,
        channels: 3,
        actions: false,
        needed: [true; 3],
    }
}

fn task() -> Task {
    find("spring_color").unwrap()
}

fn make(folder: &Path, seed: u64, force: bool) -> anyhow::Result<()> {
    let job = DatasetJob {
        variant: Variant::new(&task(), seed).unwrap(),
        counts: COUNTS,
        images: SourceImages::original().unwrap(),
        folder: folder.to_owned(),
        force,
    };
    Ok(generate(&job, &|_| {})?)
}

fn files_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn counting(offset: usize) -> Array5<u8> {
    Array::from_shape_fn((2, 3, 4, 4, 3), |(n, t, y, x, c)| ((((n * 3 + t) * 4 + y) * 4 + x) * 3 + c + offset) as u8)
}

fn small() -> DatasetFile {
    DatasetFile { train: counting(0), valid: counting(1), test: counting(2), actions: None }
}

#[test]
fn files_come_back_as_written() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("new/folder/data.npz");
    small().write(&path).unwrap();
    assert_eq!(DatasetFile::read(&path, &shape()).unwrap(), small());
    assert_eq!(files_in(path.parent().unwrap()), ["data.npz"]);
}

/// The files come from tests/data/make_skimage_render.py.
#[test]
fn numpy_files_are_read() {
    for name in ["numpy_savez.npz", "numpy_savez_compressed.npz"] {
        let path = project("tests/data").join(name);
        assert_eq!(DatasetFile::read(&path, &shape()).unwrap(), small(), "{name}");
    }
}

fn write_npz<T: WritableElement>(path: &Path, arrays: &[(&str, Array<T, ndarray::IxDyn>)]) {
    let mut npz = NpzWriter::new(fs::File::create(path).unwrap());
    for (name, array) in arrays {
        npz.add_array(*name, array).unwrap();
    }
    npz.finish().unwrap();
}

/// The message for a file whose three arrays have this shape.
fn message_for_shape(shape: &[usize]) -> String {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("data.npz");
    write_npz(&path, &["train_x", "valid_x", "test_x"].map(|name| (name, Array::<u8, _>::zeros(shape))));
    message(&path)
}

fn message(path: &Path) -> String {
    format!("{:#}", DatasetFile::read(path, &shape()).unwrap_err())
}

fn assert_says(message: &str, parts: &[&str]) {
    assert!(parts.iter().all(|part| message.contains(part)), "{message:?} lacks one of {parts:?}");
}

#[test]
fn wrong_shapes_are_named() {
    assert_says(&message_for_shape(&[2, 3, 4, 4]), &["train_x", "4 dimensions, expected 5"]);
    assert_says(&message_for_shape(&[2, 3, 4, 5, 3]), &["frames are 4 x 5 x 3, expected 4 x 4 x 3"]);
    assert_says(&message_for_shape(&[2, 3, 4, 4, 1]), &["4 x 4 x 1"]);
    assert_says(&message_for_shape(&[2, 7, 4, 4, 3]), &["7 frames, expected 3", "swapped", "spring_color"]);
    assert_says(&message_for_shape(&[0, 3, 4, 4, 3]), &["no clips"]);
}

/// A training file of one's own needs no test clips, a test file no training clips.
#[test]
fn splits_that_are_not_needed_may_be_missing_or_empty() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("data.npz");
    let test = ClipShape { needed: [false, false, true], ..shape() };
    let none = Array5::<u8>::zeros((0, 3, 4, 4, 3));
    for arrays in [vec![("test_x", counting(2))], vec![("test_x", counting(2)), ("train_x", none.clone())]] {
        let arrays: Vec<_> = arrays.into_iter().map(|(name, array)| (name, array.into_dyn())).collect();
        write_npz(&path, &arrays);
        let read = DatasetFile::read(&path, &test).unwrap();
        assert_eq!((read.test, read.train, read.valid), (counting(2), none.clone(), none.clone()));
        let training = ClipShape { needed: [true, true, false], ..shape() };
        assert_says(&format!("{:#}", DatasetFile::read(&path, &training).unwrap_err()), &["train_x"]);
    }
}

#[test]
fn clips_without_light_or_motion_are_refused() {
    let path = Path::new("mine.npz");
    let refused =
        |train| format!("{:#}", Dataset::InMemory(DatasetFile { train, ..small() }).check_motion(path).unwrap_err());
    Dataset::InMemory(small()).check_motion(path).unwrap();
    assert_says(&refused(counting(0).mapv(|value| value % 2)), &["train_x", "mine.npz", "brighter than 1", "by 255"]);
    let still = Array::from_shape_fn((2, 3, 4, 4, 3), |(n, _, y, x, c)| (n * 50 + y * 12 + x * 3 + c) as u8);
    assert_says(&refused(still), &["train_x", "mine.npz", "nothing moves"]);
}

#[test]
fn damaged_and_foreign_files_are_named() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("data.npz");
    assert_says(&message(&path), &["data.npz", "generate --task spring_color"]);

    assert_says(&message(folder.path()), &["is a folder"]);

    fs::write(&path, b"not a zip file").unwrap();
    assert_says(&message(&path), &["data.npz", "truncated"]);

    small().write(&path).unwrap();
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    assert_says(&message(&path), &["data.npz", "truncated"]);

    let mut flipped = whole.clone();
    flipped[150..180].fill(0xAA);
    fs::write(&path, &flipped).unwrap();
    assert_says(&message(&path), &["train_x", "damaged"]);

    write_npz(&path, &[("train_x", counting(0).into_dyn()), ("labels", counting(0).into_dyn())]);
    assert_says(&message(&path), &["no array \"valid_x\"", "labels"]);

    write_npz(&path, &[("train_x", counting(0).mapv(f32::from).into_dyn())]);
    assert_says(&message(&path), &["train_x", "<f4", "uint8"]);
}

#[test]
fn arrays_in_fortran_order_are_read() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("data.npz");
    let fortran =
        |offset| counting(offset).reversed_axes().as_standard_layout().into_owned().reversed_axes().into_dyn();
    write_npz(&path, &[("train_x", fortran(0)), ("valid_x", fortran(1)), ("test_x", fortran(2))]);
    let dataset = DatasetFile::read(&path, &shape()).unwrap();
    assert_eq!(dataset, small());
    assert!(dataset.train.is_standard_layout());
}

/// A file of 2 clips of 3 frames in each split, and these actions.
fn write_with_actions<T: WritableElement>(path: &Path, actions: &[(&str, Array2<T>)]) {
    let mut npz = NpzWriter::new(fs::File::create(path).unwrap());
    ["train_x", "valid_x", "test_x"].iter().for_each(|name| npz.add_array(*name, &counting(0)).unwrap());
    actions.iter().for_each(|(name, values)| npz.add_array(*name, values).unwrap());
    npz.finish().unwrap();
}

#[test]
fn actions_are_read_where_they_are_needed() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("data.npz");
    let driven = ClipShape { task: "pendulum".into(), actions: true, ..shape() };
    let values = |offset: f32| Array2::from_shape_fn((2, 3), |(n, t)| offset + n as f32 - 0.25 * t as f32);
    let written = DatasetFile { actions: Some([values(0.0), values(1.0), values(2.0)]), ..small() };
    written.write(&path).unwrap();
    let read = DatasetFile::read(&path, &driven).unwrap();
    assert_eq!(read, written);
    assert_eq!(read.actions(Split::Test), Some(&values(2.0)));
    assert_eq!(DatasetFile::read(&path, &shape()).unwrap(), small());

    let wide = |offset: f32| values(offset).mapv(f64::from);
    let message = || format!("{:#}", DatasetFile::read(&path, &driven).unwrap_err());
    let good = [("train_u", wide(0.0)), ("valid_u", wide(1.0)), ("test_u", wide(2.0))];
    write_with_actions(&path, &good);
    assert_eq!(DatasetFile::read(&path, &driven).unwrap().actions, written.actions);
    write_with_actions(&path, &good[..2]);
    assert_says(&message(), &["data.npz", "no array \"test_u\"", "generate --task pendulum"]);
    let [train, valid, test] = good;
    write_with_actions(&path, &[train.clone(), ("valid_u", Array2::zeros((3, 2))), test.clone()]);
    assert_says(&message(), &["valid_u", "[3, 2], expected [2, 3]"]);
    // Numbers of fewer bytes than were expected are of another type, not damaged.
    write_with_actions(&path, &["train_u", "valid_u", "test_u"].map(|name| (name, Array2::<i16>::ones((2, 3)))));
    assert_says(&message(), &["train_u", "dtype '<i2'", "save it as float32"]);
    let mut damaged = test.1;
    damaged[[1, 2]] = f64::NAN;
    write_with_actions(&path, &[train, valid, ("test_u", damaged)]);
    assert_says(&message(), &["test_u", "not finite"]);
}

#[test]
fn clips_are_served_with_their_actions() {
    let frames = counting(0);
    let actions = Array2::from_shape_fn((2, 3), |(n, t)| (10 * n + t) as f32);
    let clips = Clips::new(&frames, Some(&actions), Device::Cpu);
    let chosen = clips.actions(&[1, 0, 1]).at(2).unwrap();
    assert_eq!((chosen.size(), chosen.kind()), (vec![3, 1], Kind::Float));
    let values: Vec<f32> = chosen.flatten(0, 1).try_into().unwrap();
    assert_eq!(values, [12.0, 2.0, 12.0]);
    assert!(Clips::new(&frames, None, Device::Cpu).actions(&[0]).at(2).is_none());
}

/// A file's frames are channels last in 0 to 255, the network's channels first in 0 to 1.
#[test]
fn pixels_are_served_at_their_places() {
    // Mostly dark: what is lit could be taken for a light that flickers.
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let frames =
        Array5::from_shape_simple_fn((3, 4, 5, 5, 3), || random.random::<u8>() * u8::from(random.random_bool(0.2)));
    let batch = Clips::new(&frames, None, Device::Cpu).batch(&[2, 0], 3);
    assert_eq!((batch.size(), batch.kind()), (vec![2, 3, 3, 5, 5], Kind::Float));
    for (n, clip) in [2, 0].into_iter().enumerate() {
        for place in 0..3 * 3 * 25 {
            let (t, c, y, x) = (place / 75, place / 25 % 3, place / 5 % 5, place % 5);
            let served = batch.double_value(&[n, t, c, y, x].map(|place| place as i64));
            assert_eq!(served as f32, f32::from(frames[[clip, t, y, x, c]]) / 255.0);
        }
    }
}

/// A dark square wanders over a bright ground, whose light changes by up to a fifth from frame to frame, or not at all.
#[test]
fn flickering_light_is_divided_out() {
    let light = |clip: usize, frame: usize| [1.0, 0.85, 1.1, 0.95, 1.2][(3 * clip + 2 * frame) % 5];
    let film = |flickers: bool, ground: f64| {
        Array::from_shape_fn((6, 5, 16, 16, 3), |(clip, frame, y, x, _)| {
            let square = (2 * frame..2 * frame + 4).contains(&x) && (clip..clip + 4).contains(&y);
            let level = if square { 0.2 * ground } else { ground };
            (level * if flickers { light(clip, frame) } else { 1.0 }).round() as u8
        })
    };
    let [flickering, steady, dark] = [(true, 150.0), (false, 150.0), (true, 40.0)]
        .map(|(flickers, ground)| Clips::new(&film(flickers, ground), None, Device::Cpu));
    assert_eq!([&flickering, &steady, &dark].map(|clips| clips.flickers()), [true, false, false]);
    let off = (flickering.batch(&[4, 1], 5) - steady.batch(&[4, 1], 5)).abs().max().double_value(&[]);
    // Half a level, rounded before and after, and the light of the median frame, which is one of five.
    assert!(off < 0.11, "{off}");
    // All frames are in one light, whichever that is, and single frames in the same as those of clips.
    let frames = flickering.batch(&[4, 1], 5).flatten(0, 1);
    let ground = frames.select(1, 0).select(1, 15).select(1, 15);
    let spread = (ground.max() - ground.min()).double_value(&[]);
    assert!(spread < 2.0 / 255.0, "{spread}");
    assert!(frames.equal(&flickering.frames(&flickering.places(&[4, 1], 5))));
}

/// Frames that stay on the disk are served as those in memory are.
#[test]
fn a_dataset_larger_than_the_memory_is_read_from_the_disk() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("data.npz");
    let values = |offset: f32| Array2::from_shape_fn((2, 3), |(n, t)| offset + n as f32 - 0.25 * t as f32);
    let driven = ClipShape { task: "pendulum".into(), actions: true, ..shape() };
    DatasetFile { actions: Some([values(0.0), values(1.0), values(2.0)]), ..small() }.write(&path).unwrap();
    let open = |free| Dataset::open_within(&path, &driven, free).unwrap();
    let (held, stored) = (open(u64::MAX), open(0));
    assert_eq!((held.is_on_disk(), stored.is_on_disk()), (false, true));
    assert_eq!(stored.checksums(), held.checksums());
    stored.check_motion(&path).unwrap();
    for split in Split::ALL {
        assert_eq!(stored.lengths(split), held.lengths(split));
        let [held, stored] = [&held, &stored].map(|dataset| dataset.clips(split, Device::Cpu));
        assert_eq!((held.len(), held.time()), (stored.len(), stored.time()));
        assert_eq!(held.batch(&[1, 0, 1], 2), stored.batch(&[1, 0, 1], 2));
        assert_eq!(held.frames(&[5, 0, 3]), stored.frames(&[5, 0, 3]));
        assert_eq!(held.actions(&[1]).at(0), stored.actions(&[1]).at(0));
    }
    drop(stored);
    assert_eq!(files_in(folder.path()), ["data.npz"]);
}

#[test]
fn what_cannot_be_read_from_the_disk_is_named() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("data.npz");
    let said = |path: &Path| format!("{:#}", Dataset::open_within(path, &shape(), 0).unwrap_err());
    small().write(&path).unwrap();
    let mut flipped = fs::read(&path).unwrap();
    flipped[150..180].fill(0xAA);
    fs::write(&path, &flipped).unwrap();
    assert_says(&said(&path), &["train_x", "damaged"]);
    write_npz(&path, &[("train_x", counting(0).mapv(f32::from).into_dyn())]);
    assert_says(&said(&path), &["train_x", "<f4", "uint8"]);
    write_npz(&path, &[("train_x", Array::<u8, _>::zeros([2, 7, 4, 4, 3]).into_dyn())]);
    assert_says(&said(&path), &["7 frames, expected 3"]);
    let fortran = counting(0).reversed_axes().as_standard_layout().into_owned().reversed_axes().into_dyn();
    write_npz(&path, &[("train_x", fortran)]);
    assert_says(&said(&path), &["train_x", "row-major"]);
}

#[test]
fn a_failed_write_leaves_nothing() {
    let folder = TempDir::new().unwrap();
    let taken = folder.path().join("data.npz");
    fs::create_dir(&taken).unwrap();
    let error = format!("{:#}", small().write(&taken).unwrap_err());
    assert_says(&error, &["data.npz", "nothing is left"]);
    assert_eq!(files_in(folder.path()), ["data.npz"]);

    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let error = format!("{:#}", small().write(&file.join("data.npz")).unwrap_err());
    assert_says(&error, &["cannot make the folder"]);
}

#[test]
fn states_stay_with_their_frames() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("data.npz");
    let counts = Counts { train: 2, valid: 1, test: 1 };
    let images = SourceImages::original().unwrap();
    let made = |seed| {
        let variant = Variant::new(&task(), seed).unwrap();
        generate_clips(&variant, &images, 12, counts, &|_| {}).unwrap()
    };
    let (dataset, states) = made(0);
    assert_eq!(States::read(&path, &dataset).unwrap(), None);
    states.write(&path, &dataset).unwrap();
    assert_eq!(files_in(folder.path()), ["data_states.npz"]);
    assert_eq!(States::read(&path, &dataset).unwrap(), Some(states));
    let (other, _) = made(1);
    let error = States::read(&path, &other).unwrap_err().to_string();
    assert_says(&error, &["data_states.npz", "other frames"]);
}

#[test]
fn generate_makes_both_files_and_keeps_them() {
    let folder = TempDir::new().unwrap();
    make(folder.path(), 0, false).unwrap();
    let (train, test) = (folder.path().join(task().train_file), folder.path().join(task().test_file));
    let read = |path: &PathBuf, shape: ClipShape| DatasetFile::read(path, &shape).unwrap();
    let short = read(&train, ClipShape::training(&task()));
    let long = read(&test, ClipShape::test(&task()));
    assert_eq!(short.train.dim(), (12, 12, 32, 32, 3));
    assert_eq!((long.train.dim().0, long.valid.dim().0, long.test.dim().0), (10, 2, 3));
    assert!(States::read(&train, &short).unwrap().is_some() && States::read(&test, &long).unwrap().is_some());
    let names = files_in(train.parent().unwrap());
    assert_eq!(names.len(), 6, "{names:?}");
    let picture = image::open(train.with_extension("png")).unwrap();
    assert_eq!((picture.width(), picture.height()), (12 * 130 + 2, 3 * 130 + 2));

    let before = fs::metadata(&train).unwrap().modified().unwrap();
    make(folder.path(), 0, false).unwrap();
    assert_eq!(fs::metadata(&train).unwrap().modified().unwrap(), before);
    let error = format!("{:#}", make(folder.path(), 1, false).unwrap_err());
    assert_says(&error, &["--force", "seed 0", "seed 1"]);
    assert_eq!(read(&train, ClipShape::training(&task())), short);
    make(folder.path(), 1, true).unwrap();
    assert_ne!(read(&train, ClipShape::training(&task())), short);

    // Without states the file is the user's own.
    fs::remove_file(States::path_beside(&train)).unwrap();
    let own = read(&train, ClipShape::training(&task()));
    make(folder.path(), 1, false).unwrap();
    assert_eq!(read(&train, ClipShape::training(&task())), own);
}

#[test]
fn the_command_reports_errors_once() {
    let folder = TempDir::new().unwrap();
    let command = |arguments: &[&str]| {
        let output = paig("generate")
            .args([
                "--out",
                folder.path().to_str().unwrap(),
                "--train",
                "2",
                "--valid",
                "1",
                "--test",
                "1",
                "--threads",
                "1",
            ])
            .args(arguments)
            .output()
            .unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, errors) = command(&["--task", "bouncing_balls"]);
    assert_eq!(code, Some(0), "{errors}");
    let (code, errors) = command(&["--task", "bouncing_balls", "--k", "3"]);
    assert_eq!((code, errors.as_str()), (Some(2), "error: --k means nothing for task bouncing_balls; leave it out\n"));
    let (code, errors) = command(&["--task", "spring_color", "--cifar-dir", "x"]);
    assert_eq!(code, Some(2));
    assert_says(&errors, &["error: --cifar-dir means nothing for task spring_color without --background"]);
    let (code, errors) = command(&["--task", "spring_color", "--mnist-dir", "x"]);
    assert_eq!(code, Some(2));
    assert_says(&errors, &["error: --mnist-dir means nothing for task spring_color"]);
    let (code, errors) = command(&["--task", "falling", "--background", "random-cifar"]);
    assert_eq!((code, errors.as_str()), (Some(2), "error: --background random-cifar needs --cifar-dir\n"));
    let (code, errors) = command(&["--task", "trebuchet"]);
    assert_eq!((code, errors.lines().count()), (Some(2), 1));
    assert_says(&errors, &["error: unknown task \"trebuchet\"", "a task file (.toml)", "spring_color", "pendulum"]);
    let (code, errors) = command(&["--task", "spring_color", "--damping", "-1"]);
    assert_eq!((code, errors.as_str()), (Some(2), "error: --damping must be at least 0, not -1\n"));
    let (code, errors) = command(&["--task", "pendulum", "--torque", "0.5"]);
    assert_eq!(code, Some(0), "{errors}");
    let made = folder.path().join("pendulum/color_pendulum_sl14_g10_m1_l1_a1_u0.5_dt005.npz");
    let dataset = DatasetFile::read(&made, &ClipShape::training(&find("pendulum").unwrap())).unwrap();
    assert!(dataset.actions(Split::Train).unwrap().iter().all(|u| u.abs() <= 0.5));
}

/// The network halves a frame several times: what it could not learn from is not made.
#[test]
fn sizes_that_the_network_cannot_halve_are_refused() {
    let folder = TempDir::new().unwrap();
    for (size, multiple, nearest) in [(4, 4, 12), (33, 4, 32), (50, 8, 48), (520, 8, 512)] {
        let output = paig("generate")
            .args(["--task", "spring_color", "--size", &size.to_string(), "--out"])
            .arg(folder.path())
            .output()
            .unwrap();
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), errors.lines().count()), (Some(2), 1), "{errors}");
        let words = [
            format!("error: --size {size}: "),
            "12 to 512 pixels a side".into(),
            format!("a multiple of {multiple} "),
            format!("the nearest side is {nearest}\n"),
        ];
        assert_says(&errors, &words.each_ref().map(String::as_str));
    }
    assert!(files_in(folder.path()).is_empty());
}

#[test]
fn other_source_images_are_read() {
    let folder = TempDir::new().unwrap();
    let original = SourceImages::original().unwrap();
    let error = format!("{:#}", original.clone().with_mnist(folder.path(), [0, 1]).unwrap_err());
    assert_says(&error, &["train-images-idx3-ubyte"]);

    let mut idx = vec![0, 0, 8, 3, 0, 0, 0, 3, 0, 0, 0, 28, 0, 0, 0, 28];
    (0..3_u8).for_each(|image| idx.extend([image; 28 * 28]));
    fs::write(folder.path().join("train-images-idx3-ubyte"), &idx).unwrap();
    let images = original.clone().with_mnist(folder.path(), [2, 1]).unwrap();
    assert_eq!((images.digits[0][[5, 5]], images.digits[1][[27, 27]]), (2, 1));
    let error = format!("{:#}", original.clone().with_mnist(folder.path(), [0, 3]).unwrap_err());
    assert_says(&error, &["image 3", "3 images"]);
    idx.truncate(idx.len() - 1);
    fs::write(folder.path().join("train-images-idx3-ubyte"), &idx).unwrap();
    let error = format!("{:#}", original.clone().with_mnist(folder.path(), [0, 2]).unwrap_err());
    assert_says(&error, &["incomplete"]);
    fs::write(folder.path().join("train-images-idx3-ubyte"), [9; 40]).unwrap();
    let error = format!("{:#}", original.clone().with_mnist(folder.path(), [0, 2]).unwrap_err());
    assert_says(&error, &["not an IDX image file"]);

    let record = |label: u8| -> Vec<u8> {
        std::iter::once(label).chain((0..3_u8).flat_map(|channel| [10 * channel + label; 1024])).collect()
    };
    fs::write(folder.path().join("data_batch_1.bin"), [record(1), record(2)].concat()).unwrap();
    let images = original.clone().with_cifar(folder.path(), 1).unwrap();
    assert_eq!((images.pictures.dim(), images.pictures[[0, 31, 0, 2]]), ((1, 32, 32, 3), 22));
    let error = format!("{:#}", original.clone().with_cifar(folder.path(), 2).unwrap_err());
    assert_says(&error, &["incomplete"]);
    let error = format!("{:#}", original.with_cifar(folder.path(), 10_001).unwrap_err());
    assert_says(&error, &["data_batch_2.bin"]);
}

/// CIFAR-10 files of two plain pictures each; picture p has the colour (100 + 10 p, 80 + 10 p, 60 + 10 p).
fn write_cifar(folder: &Path) {
    for file in 0..5_u8 {
        let record = |picture: u8| {
            let colours = [100, 80, 60].map(|colour| colour + 10 * picture);
            std::iter::once(9).chain(colours.into_iter().flat_map(|colour| [colour; 1024])).collect::<Vec<u8>>()
        };
        let name = format!("data_batch_{}.bin", file + 1);
        fs::write(folder.join(name), [record(2 * file), record(2 * file + 1)].concat()).unwrap();
    }
}

#[test]
fn each_clip_has_a_random_background() {
    let folder = TempDir::new().unwrap();
    write_cifar(folder.path());
    let images = SourceImages::original().unwrap().with_all_cifar(folder.path()).unwrap();
    assert_eq!(images.pictures.dim(), (10, 32, 32, 3));
    let counts = Counts { train: 40, valid: 1, test: 1 };
    for key in ["bouncing_balls", "falling", "mnist_spring_color"] {
        let plain = Variant::new(&find(key).unwrap(), 0).unwrap();
        let background = Some(Background::RandomCifar);
        let random = plain.clone().with(&Changes { background, ..Changes::default() }).unwrap();
        assert!(random.files()[0].1.to_str().unwrap().ends_with("_randomcifar.npz"));
        let make = |variant: &Variant, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| generate_clips(variant, &images, 4, counts, &|_| {})).unwrap()
        };
        let (dataset, states) = make(&random, 1);
        assert_eq!(make(&random, 3), (dataset.clone(), states.clone()));
        // The motion is that of the same clips on black.
        let black = plain.with(&Changes { background: Some(Background::Plain), ..Changes::default() }).unwrap();
        let (on_black, same_states) = make(&black, 1);
        assert_eq!(same_states.train, states.train);
        let black_pixels = on_black.train.iter().filter(|&&level| level == 0).count();
        assert!(2 * black_pixels > on_black.train.len());
        let mut seen = [0; 10];
        for (clip, frames) in dataset.train.outer_iter().enumerate() {
            // Brightness 0.2 is taken off: 51 grey levels; then levels are cut off.
            let level = |picture: usize, channel: usize| match (key, channel) {
                ("falling", _) => 0.299 * 100.0 + 0.587 * 80.0 + 0.114 * 60.0 + 10.0 * picture as f64 - 51.0,
                _ => [100.0, 80.0, 60.0][channel] + 10.0 * picture as f64 - 51.0,
            };
            let shows = |pixel: ndarray::ArrayView1<u8>, picture: usize| {
                pixel.iter().enumerate().all(|(c, &value)| (f64::from(value) - level(picture, c)).abs() <= 1.0)
            };
            // Of the pixels of a clip's frames most show its picture, none another (off the objects and their edges,
            // where anything may come out).
            let rows = |frame: usize| frames.slice(s![frame, .., .., ..]).to_owned();
            let count = |frame: usize, picture: usize| {
                rows(frame).rows().into_iter().filter(|pixel| shows(pixel.view(), picture)).count()
            };
            let pixels = frames.dim().1 * frames.dim().2;
            let shown = (0..10).max_by_key(|&picture| count(0, picture)).unwrap();
            assert!((0..4).all(|frame| 2 * count(frame, shown) > pixels), "{key}, clip {clip}");
            seen[shown] += 1;
        }
        // 40 draws of 10 pictures: 7 different ones or more but for one time in 10^5.
        assert!(seen.iter().filter(|&&clips| clips > 0).count() >= 7, "{key}: {seen:?}");
    }

    fs::write(folder.path().join("data_batch_4.bin"), [0; 3074]).unwrap();
    let error = format!("{:#}", SourceImages::original().unwrap().with_all_cifar(folder.path()).unwrap_err());
    assert_says(&error, &["data_batch_4.bin", "3074 bytes", "incomplete"]);
    fs::remove_file(folder.path().join("data_batch_4.bin")).unwrap();
    let error = format!("{:#}", SourceImages::original().unwrap().with_all_cifar(folder.path()).unwrap_err());
    assert_says(&error, &["no CIFAR-10 training images", "data_batch_4.bin", "download"]);
}

#[test]
fn balls_cover_the_picture_behind_them() {
    let counts = Counts { train: 20, valid: 1, test: 1 };
    let changes = Changes { background: Some(Background::Cifar), ..Changes::default() };
    let variant = Variant::new(&task(), 0).unwrap().with(&changes).unwrap();
    let (dataset, states) = generate_clips(&variant, &SourceImages::original().unwrap(), 3, counts, &|_| {}).unwrap();
    for (clip, frames) in dataset.train.outer_iter().enumerate() {
        // The second ball lies above the first. Its middle is one colour: nothing of the picture shines through but what
        // the blur brings from 2 px off, some percent.
        let [x, y] = [2, 3].map(|entry| states.train.positions[[clip, 1, entry]] as usize);
        let [red, green, blue] = [0, 1, 2].map(|channel| frames[[1, y, x, channel]]);
        assert!(green > 230 && red < 26 && blue < 26, "clip {clip}: {red} {green} {blue}");
    }
}

#[test]
fn datasets_that_no_file_holds_are_refused() {
    let variant = Variant::new(&find("mnist_spring_color").unwrap(), 0).unwrap();
    let images = SourceImages::original().unwrap();
    let message = |counts| generate_clips(&variant, &images, 12, counts, &|_| {}).unwrap_err().to_string();
    assert_says(
        &message(Counts { train: 100_000, ..COUNTS }),
        &["100000 clips in the train split", "4 GiB", "at most"],
    );
    assert_says(&message(Counts { test: 0, ..COUNTS }), &["the test split must have at least one clip"]);
}
