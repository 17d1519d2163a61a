//! The port against the golden tensors, through the `compare` program; and that the program notices what is wrong.

use crate::programs::paig;
use crate::project::project;
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::Output;

fn goldens() -> PathBuf {
    project("compare/goldens")
}

fn golden(name: &str) -> PathBuf {
    goldens().join(name)
}

/// Three bodies under gravity that nearly collide again and again; from tests/data/make_near_collisions.py.
fn near_collisions() -> PathBuf {
    project("tests/data/cell_gravity_near_collisions.npz")
}

fn compare(folder: &Path) -> Output {
    paig("compare").arg("--goldens").arg(folder).output().expect("compare starts")
}

fn texts(output: &Output) -> (String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&output.stdout), text(&output.stderr))
}

/// Writes a copy of a golden file with its entries changed: each gives its `.npy` name and bytes and gets new ones.
fn rewritten(path: &Path, change: impl Fn(String, Vec<u8>) -> (String, Vec<u8>)) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut from = zip::ZipArchive::new(File::open(path).unwrap()).unwrap();
    let mut to = zip::ZipWriter::new(File::create(folder.path().join(path.file_name().unwrap())).unwrap());
    for index in 0..from.len() {
        let mut entry = from.by_index(index).unwrap();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        let (name, bytes) = change(entry.name().to_string(), bytes);
        to.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        to.write_all(&bytes).unwrap();
    }
    to.finish().unwrap();
    folder
}

/// Changes the bytes of one tensor.
fn with_tensor(path: &Path, tensor: &str, edit: impl Fn(&mut Vec<u8>)) -> tempfile::TempDir {
    let entry = format!("{tensor}.npy");
    rewritten(path, |name, mut bytes| {
        if name == entry {
            edit(&mut bytes);
        }
        (name, bytes)
    })
}

fn set_last_float(bytes: &mut [u8], value: impl Fn(f32) -> f32) {
    let last = bytes.last_chunk_mut::<4>().unwrap();
    *last = value(f32::from_le_bytes(*last)).to_le_bytes();
}

/// As NumPy stores text.
fn utf32(text: &str) -> Vec<u8> {
    text.chars().flat_map(|c| (c as u32).to_le_bytes()).collect()
}

/// Replaces bytes by as many others, once.
fn replace(bytes: &mut [u8], old: &[u8], new: &[u8]) {
    assert_eq!(old.len(), new.len());
    let at = bytes.windows(old.len()).position(|window| window == old).expect("the array holds these bytes");
    bytes[at..at + old.len()].copy_from_slice(new);
}

fn assert_bad_input(folder: &Path, parts: &[&str]) {
    let output = compare(folder);
    let (_, stderr) = texts(&output);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    for part in parts {
        assert!(stderr.contains(part), "{part:?} is not in {stderr:?}");
    }
}

/// Files in which rounding grows: bodies nearly collide, the edge of a sprite's window crosses a pixel. The exponential of
/// log g, or of log sigma, differs in its last digit from one processor to another, and where it is not TensorFlow's some
/// rows of these say nothing. The single steps, and the files without such events (`.._spread_train`), hold the same code.
const CHAOTIC: [&str; 2] = ["cell_gravity.npz", "spring_color_train.npz"];

#[test]
fn every_golden_tensor_is_matched() {
    let output = compare(&goldens());
    let (stdout, stderr) = texts(&output);
    assert_eq!(output.status.code(), Some(0), "{stdout}\n{stderr}");
    let mut files = 0;
    for entry in goldens().read_dir().unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if name.ends_with(".npz") {
            files += 1;
            assert!(stdout.contains(&name), "{name} is not in the table");
        }
    }
    let summary = stdout.lines().last().unwrap();
    assert!(summary.starts_with(&format!("{files} files")), "{summary}");
    assert!(summary.contains(" 0 failed, "), "{summary}");
    let uninformative: Vec<_> = stdout.lines().filter(|line| line.contains("  uninformative (")).collect();
    assert!(summary.contains(&format!(" {} uninformative", uninformative.len())), "{summary}");
    for row in uninformative {
        assert!(CHAOTIC.iter().any(|file| row.starts_with(file)), "{row}");
    }
}

#[test]
fn changed_value_fails_by_name() {
    for (file, tensor) in [
        ("cell_spring.npz", "out/pos"),
        ("cell_gravity.npz", "out/vel"),
        ("shallow_unet.npz", "grad/unet/conv2d_12/bias"),
        ("decoder_spring_color.npz", "grad/pos"),
        ("spring_color_train.npz", "out/output"),
        ("spring_color_train.npz", "train/loss_before_each_step"),
    ] {
        let folder = with_tensor(&golden(file), tensor, |bytes| set_last_float(bytes, |value| value * 1.01 + 0.01));
        let output = compare(folder.path());
        let (stdout, stderr) = texts(&output);
        assert_eq!(output.status.code(), Some(1), "{file} {tensor}: {stdout}{stderr}");
        assert!(stdout.lines().any(|line| line.contains(tensor) && line.contains("FAIL")), "{stdout}");
    }
}

/// The line of a table on one tensor.
fn line<'a>(stdout: &'a str, tensor: &str) -> &'a str {
    let about = format!(" {tensor} ");
    stdout.lines().find(|line| line.contains(&about)).unwrap_or_else(|| panic!("no line on {tensor} in {stdout}"))
}

#[test]
fn what_rounding_alone_decides_is_counted_as_uninformative() {
    let folder = rewritten(&near_collisions(), |name, bytes| (name, bytes));
    let output = compare(folder.path());
    let (stdout, stderr) = texts(&output);
    assert_eq!(output.status.code(), Some(0), "{stdout}{stderr}");
    for tensor in ["out/pos", "out/vel"] {
        let held = format!("held by \"{tensor}, step by step\"");
        let line = line(&stdout, tensor);
        assert!(line.contains("uninformative") && line.contains(&held), "{line}");
    }
    for tensor in ["out/loss", "grad/pos", "grad/vel", "grad/log_g"] {
        let line = line(&stdout, tensor);
        assert!(line.contains("uninformative") && line.contains("not held by a single step"), "{line}");
    }
    for tensor in ["out/pos, step by step", "out/vel, step by step"] {
        assert!(line(&stdout, tensor).trim_end().ends_with("pass"), "{stdout}");
    }
    let summary = stdout.lines().last().unwrap();
    assert!(summary.contains("0 failed, 6 uninformative (4 of them not held by a single step)"), "{summary}");
}

#[test]
fn uninformative_tensor_fails_with_its_single_steps() {
    // Another last position; a body's force that is 1 % off, which no whole trajectory of this file could show.
    for (changed, failing) in [("out/pos", &["out/pos"] as &[&str]), ("param/log_g", &["out/pos", "out/vel"])] {
        let folder = with_tensor(&near_collisions(), changed, |bytes| set_last_float(bytes, |value| value * 1.01));
        let output = compare(folder.path());
        let (stdout, stderr) = texts(&output);
        assert_eq!(output.status.code(), Some(1), "{changed}: {stdout}{stderr}");
        for tensor in failing {
            assert!(line(&stdout, &format!("{tensor}, step by step")).contains("FAIL"), "{changed}: {stdout}");
            assert!(line(&stdout, tensor).contains("FAIL (uninformative, and"), "{changed}: {stdout}");
        }
        // Neither pass nor fail: nothing holds it.
        assert!(line(&stdout, "grad/pos").contains("uninformative (rounding"), "{changed}: {stdout}");
    }
}

#[test]
fn nan_is_bad_input() {
    let folder = with_tensor(&golden("stn.npz"), "out/y", |bytes| set_last_float(bytes, |_| f32::NAN));
    assert_bad_input(folder.path(), &["stn.npz", "out/y", "NaN"]);
}

#[test]
fn file_cut_short_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(goldens().join("stn.npz")).unwrap();
    fs::write(folder.path().join("stn.npz"), &bytes[..bytes.len() / 2]).unwrap();
    assert_bad_input(folder.path(), &["stn.npz", "cut short"]);
    let folder = with_tensor(&golden("stn.npz"), "in/theta", |bytes| bytes.truncate(bytes.len() - 1));
    assert_bad_input(folder.path(), &["stn.npz", "in/theta"]);
}

#[test]
fn renamed_tensor_is_bad_input() {
    let folder = rewritten(&golden("cell_spring.npz"), |name, bytes| (name.replace("out/vel", "out/velocity"), bytes));
    assert_bad_input(folder.path(), &["cell_spring.npz", "out/vel", "missing"]);
}

#[test]
fn unknown_tensor_is_bad_input() {
    let folder = rewritten(&golden("decoder_mnist_spring_color.npz"), |name, bytes| {
        (name.replace("dense_5/bias", "dense_6/bias"), bytes)
    });
    assert_bad_input(folder.path(), &["decoder_mnist_spring_color.npz", "grad/net/decoder/dense_5/bias"]);
    // Out of a case's sight: a second copy of a tensor that it has no use for.
    let folder = rewritten(&golden("cell_bouncing.npz"), |name, bytes| (name, bytes));
    let path = folder.path().join("cell_bouncing.npz");
    let mut archive = zip::ZipWriter::new_append(File::options().read(true).write(true).open(&path).unwrap()).unwrap();
    archive.start_file("out/energy.npy", zip::write::SimpleFileOptions::default()).unwrap();
    archive.write_all(b"\x93NUMPY\x01\x00\x3a\x00{'descr': '<f4', 'fortran_order': False, 'shape': (), }   ").unwrap();
    archive.write_all(&1f32.to_le_bytes()).unwrap();
    archive.finish().unwrap();
    assert_bad_input(folder.path(), &["cell_bouncing.npz", "out/energy"]);
}

/// A shared array is read from the other file and compared: neither a changed nor a missing one passes.
#[test]
fn shared_tensors_are_compared() {
    let (file, other, text) = ("cell_spring-shared.npz", "cell_spring.npz", "out/pos=cell_spring");
    let header = format!("{{'descr': '<U{}', 'fortran_order': False, 'shape': (1,), }}", text.len());
    let mut shared = [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes()].concat();
    shared.extend(utf32(text));
    let folder = rewritten(&golden(other), |name, bytes| match name.as_str() {
        "out/pos.npy" => ("shared.npy".into(), shared.clone()),
        _ => (name, bytes),
    });
    let place = |name: &str| folder.path().join(name);
    fs::rename(place(other), place(file)).unwrap();
    fs::copy(golden(other), place(other)).unwrap();
    let results = || {
        let (stdout, stderr) = texts(&compare(folder.path()));
        let of = |file: &str| {
            let row = stdout.lines().find(|row| row.starts_with(&format!("{file} ")) && row.contains(" out/pos "));
            row.unwrap_or_else(|| panic!("{file}: {stdout}{stderr}")).contains("FAIL")
        };
        [file, other].map(of)
    };
    assert_eq!(results(), [false, false]);
    let changed = with_tensor(&golden(other), "out/pos", |bytes| set_last_float(bytes, |value| value * 1.01 + 0.01));
    fs::copy(changed.path().join(other), place(other)).unwrap();
    assert_eq!(results(), [true, true]);
    let renamed = rewritten(&golden(other), |name, bytes| (name.replace("out/pos", "out/position"), bytes));
    fs::copy(renamed.path().join(other), place(other)).unwrap();
    assert_bad_input(folder.path(), &[file, "out/pos", "missing in cell_spring.npz"]);
    fs::remove_file(place(other)).unwrap();
    assert_bad_input(folder.path(), &[file, other, "cannot be opened"]);
}

#[test]
fn wrong_shape_is_bad_input() {
    let folder =
        with_tensor(&golden("cell_spring.npz"), "out/pos", |bytes| replace(bytes, b"(20, 64, 4)", b"(64, 20, 4)"));
    assert_bad_input(folder.path(), &["cell_spring.npz", "out/pos", "shape"]);
}

#[test]
fn bad_meta_is_bad_input() {
    for (old, new, named) in [
        ("task=spring", "task=sprung", "tensor meta"),
        ("batch=2", "batch=x", "tensor meta"),
        ("opt=rmsprop", "opt=rmsprob", "tensor meta"),
        ("batch=2", "batch=9", "tensor out/enc_pos"),
    ] {
        let folder =
            with_tensor(&golden("spring_color_train.npz"), "meta", |bytes| replace(bytes, &utf32(old), &utf32(new)));
        assert_bad_input(folder.path(), &["spring_color_train.npz", named]);
    }
}

#[test]
fn file_without_a_case_fails() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(goldens().join("stn.npz"), folder.path().join("pendulum.npz")).unwrap();
    let output = compare(folder.path());
    let (stdout, _) = texts(&output);
    assert_eq!(output.status.code(), Some(1), "{stdout}");
    assert!(stdout.contains("pendulum.npz"), "{stdout}");
}

#[test]
fn empty_folder_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    assert_bad_input(folder.path(), &["no .npz file"]);
}
