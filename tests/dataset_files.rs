//! Dataset files, true states and source images on the disk: round trips, numpy's files, and what bad files say.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use ndarray::{Array, Array5};
use ndarray_npy::{NpzWriter, WritableElement};
use paig::datasets::files::{ClipShape, DatasetFile};
use paig::datasets::generators::{Counts, Plan, generate, generate_clips};
use paig::datasets::sprites::Sprites;
use paig::datasets::states::States;
use paig::datasets::variant::Variant;
use paig::tasks::{Task, find};
use tempfile::TempDir;

const SMALL: ClipShape = ClipShape { task: "spring_color", frames: 3, side: 4, channels: 3 };
const COUNTS: Counts = Counts { train: 12, valid: 2, test: 3 };

fn task() -> &'static Task {
    find("spring_color").unwrap()
}

fn plan(folder: &Path, seed: u64, force: bool) -> Plan {
    Plan {
        variant: Variant::new(task(), seed),
        counts: COUNTS,
        sprites: Sprites::original().unwrap(),
        folder: folder.to_owned(),
        force,
    }
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
    DatasetFile { train: counting(0), valid: counting(1), test: counting(2) }
}

#[test]
fn files_come_back_as_written() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("new/folder/data.npz");
    small().write(&path).unwrap();
    assert_eq!(DatasetFile::read(&path, &SMALL).unwrap(), small());
    assert_eq!(files_in(path.parent().unwrap()), ["data.npz"]);
}

/// The files come from tests/data/make_skimage_render.py.
#[test]
fn numpy_files_are_read() {
    for name in ["numpy_savez.npz", "numpy_savez_compressed.npz"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
        assert_eq!(DatasetFile::read(&path, &SMALL).unwrap(), small(), "{name}");
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
    format!("{:#}", DatasetFile::read(path, &SMALL).unwrap_err())
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

#[test]
fn damaged_and_foreign_files_are_named() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("data.npz");
    assert_says(&message(&path), &["data.npz", "generate --task spring_color"]);

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
    let dataset = DatasetFile::read(&path, &SMALL).unwrap();
    assert_eq!(dataset, small());
    assert!(dataset.train.is_standard_layout());
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
    let sprites = Sprites::original().unwrap();
    let (dataset, states) = generate_clips(&Variant::new(task(), 0), &sprites, 12, counts).unwrap();
    assert_eq!(States::read(&path, &dataset).unwrap(), None);
    states.write(&path, &dataset).unwrap();
    assert_eq!(files_in(folder.path()), ["data_states.npz"]);
    assert_eq!(States::read(&path, &dataset).unwrap(), Some(states));
    let (other, _) = generate_clips(&Variant::new(task(), 1), &sprites, 12, counts).unwrap();
    let error = States::read(&path, &other).unwrap_err().to_string();
    assert_says(&error, &["data_states.npz", "other frames"]);
}

#[test]
fn generate_makes_both_files_and_keeps_them() {
    let folder = TempDir::new().unwrap();
    generate(&plan(folder.path(), 0, false)).unwrap();
    let (train, test) = (folder.path().join(task().train_file), folder.path().join(task().test_file));
    let read = |path: &PathBuf, shape: ClipShape| DatasetFile::read(path, &shape).unwrap();
    let short = read(&train, ClipShape::training(task()));
    let long = read(&test, ClipShape::test(task()));
    assert_eq!(short.train.dim(), (12, 12, 32, 32, 3));
    assert_eq!((long.train.dim().0, long.valid.dim().0, long.test.dim().0), (10, 2, 3));
    assert!(States::read(&train, &short).unwrap().is_some() && States::read(&test, &long).unwrap().is_some());
    let names = files_in(train.parent().unwrap());
    assert_eq!(names.len(), 6, "{names:?}");
    let picture = image::open(train.with_extension("png")).unwrap();
    assert_eq!((picture.width(), picture.height()), (12 * 130 + 2, 3 * 130 + 2));

    let before = fs::metadata(&train).unwrap().modified().unwrap();
    generate(&plan(folder.path(), 0, false)).unwrap();
    assert_eq!(fs::metadata(&train).unwrap().modified().unwrap(), before);
    let error = format!("{:#}", generate(&plan(folder.path(), 1, false)).unwrap_err());
    assert_says(&error, &["--force", "seed 0", "seed 1"]);
    assert_eq!(read(&train, ClipShape::training(task())), short);
    generate(&plan(folder.path(), 1, true)).unwrap();
    assert_ne!(read(&train, ClipShape::training(task())), short);

    // Without states the file is the user's own.
    fs::remove_file(States::path_beside(&train)).unwrap();
    let own = read(&train, ClipShape::training(task()));
    generate(&plan(folder.path(), 1, false)).unwrap();
    assert_eq!(read(&train, ClipShape::training(task())), own);
}

#[test]
fn the_command_reports_errors_once() {
    let folder = TempDir::new().unwrap();
    let command = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_generate"))
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
    assert_eq!((code, errors.as_str()), (Some(1), "error: --k means nothing for task bouncing_balls; leave it out\n"));
    let (code, errors) = command(&["--task", "spring_color", "--cifar-dir", "x"]);
    assert_eq!(code, Some(1));
    assert_says(&errors, &["error: --mnist-dir and --cifar-dir"]);
    let (code, errors) = command(&["--task", "pendulum"]);
    assert_eq!(code, Some(2));
    assert_says(&errors, &["pendulum", "spring_color"]);
    let (code, errors) = command(&["--task", "spring_color", "--size", "4"]);
    assert_eq!(code, Some(1));
    assert_says(&errors, &["error: --size must be 8 to 512 pixels, not 4"]);
}

#[test]
fn other_source_images_are_read() {
    let folder = TempDir::new().unwrap();
    let original = Sprites::original().unwrap();
    let error = format!("{:#}", original.clone().with_mnist(folder.path(), [0, 1]).unwrap_err());
    assert_says(&error, &["train-images-idx3-ubyte"]);

    let mut idx = vec![0, 0, 8, 3, 0, 0, 0, 3, 0, 0, 0, 28, 0, 0, 0, 28];
    (0..3_u8).for_each(|image| idx.extend([image; 28 * 28]));
    fs::write(folder.path().join("train-images-idx3-ubyte"), &idx).unwrap();
    let sprites = original.clone().with_mnist(folder.path(), [2, 1]).unwrap();
    assert_eq!((sprites.digits[0][[5, 5]], sprites.digits[1][[27, 27]]), (2, 1));
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
    let sprites = original.clone().with_cifar(folder.path(), 1).unwrap();
    assert_eq!(sprites.background[[31, 0, 2]], 22);
    let error = format!("{:#}", original.clone().with_cifar(folder.path(), 2).unwrap_err());
    assert_says(&error, &["incomplete"]);
    let error = format!("{:#}", original.with_cifar(folder.path(), 10_001).unwrap_err());
    assert_says(&error, &["data_batch_2.bin"]);
}

#[test]
fn datasets_that_no_file_holds_are_refused() {
    let variant = Variant::new(find("mnist_spring_color").unwrap(), 0);
    let sprites = Sprites::original().unwrap();
    let message = |counts| generate_clips(&variant, &sprites, 12, counts).unwrap_err().to_string();
    assert_says(&message(Counts { train: 100_000, ..COUNTS }), &["--train 100000", "4 GiB", "at most"]);
    assert_says(&message(Counts { test: 0, ..COUNTS }), &["--test must be at least 1"]);
}
