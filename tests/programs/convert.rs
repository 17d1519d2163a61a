//! The `convert` program: round trips to the bit, layouts, and what is refused.

use std::fs::{self, File};
use std::path::Path;
use std::process::Output;

use crate::programs::paig;
use ndarray::{ArrayD, IxDyn};
use ndarray_npy::{NpzReader, NpzWriter};
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use tch::{Device, Tensor};

fn convert(task: &str, from: &Path, to: &Path, more: &[&str]) -> Output {
    let mut command = paig("convert");
    command.args(["--task", task]).args(more).arg(from).arg(to).output().expect("convert starts")
}

fn assert_converts(task: &str, from: &Path, to: &Path, more: &[&str]) {
    let output = convert(task, from, to, more);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn assert_refused(output: &Output, parts: &[&str]) {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    for part in parts {
        assert!(stderr.contains(part), "{part:?} is not in {stderr:?}");
    }
}

/// A fresh model's weights as a file.
fn weights(folder: &Path, task: &str, alt_vel: bool) -> (PhysicsNet, std::path::PathBuf) {
    let options = ModelOptions { alt_vel, ..ModelOptions::original() };
    let model = PhysicsNet::new(&tasks::find(task).unwrap().system, &options, Device::Cpu, 7).unwrap();
    let path = folder.join(format!("{task}.safetensors"));
    let named = model.named_variables();
    Tensor::write_safetensors(&named, &path).unwrap();
    (model, path)
}

type TensorBytes = Vec<(String, ArrayD<f32>)>;

fn read_npz(path: &Path) -> TensorBytes {
    let mut archive = NpzReader::new(File::open(path).unwrap()).unwrap();
    let names = archive.names().unwrap();
    names.into_iter().map(|name| (name.clone(), archive.by_name(&name).unwrap())).collect()
}

fn write_npz(path: &Path, arrays: &[(String, ArrayD<f32>)]) {
    let mut archive = NpzWriter::new(File::create(path).unwrap());
    for (name, array) in arrays {
        archive.add_array(name, array).unwrap();
    }
    archive.finish().unwrap();
}

#[test]
fn round_trips_are_exact() {
    for (task, alt_vel) in tasks::all().map(|task| (task.name, false)).chain([("spring_color".into(), true)]) {
        let task = task.as_str();
        let more: &[&str] = if alt_vel { &["--alt-vel"] } else { &[] };
        let folder = tempfile::tempdir().unwrap();
        let (model, first) = weights(folder.path(), task, alt_vel);
        let [npz, second, npz_again] = ["a.npz", "b.safetensors", "b.npz"].map(|name| folder.path().join(name));
        assert_converts(task, &first, &npz, more);
        assert_converts(task, &npz, &second, more);
        assert_converts(task, &second, &npz_again, more);
        assert_eq!(fs::read(&npz).unwrap(), fs::read(&npz_again).unwrap(), "{task}");
        let back = Tensor::read_safetensors(&second).unwrap();
        let named = model.named_variables();
        assert_eq!(back.len(), named.len());
        for (name, variable) in named {
            let (_, value) = back.iter().find(|(found, _)| *found == name).unwrap();
            assert!(value.kind() == variable.kind() && value.equal(&variable), "{task} {name}");
        }
    }
}

#[test]
fn what_a_model_holds_is_said_or_read_from_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    fs::create_dir_all(&run).unwrap();
    let set = vec!["model.fixed={g=60.0}".to_string()];
    let task = Some("3bp_color".to_string());
    let config = Config::load(None, &Overrides { task, set, ..Overrides::default() }).unwrap();
    let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, 1).unwrap();
    let weights = run.join("weights.safetensors");
    Tensor::write_safetensors(&model.named_variables(), &weights).unwrap();
    let npz = folder.path().join("a.npz");
    assert_refused(&convert("3bp_color", &weights, &npz, &[]), &["gravity_ode_cell.log_m", "model.fixed"]);
    assert_refused(&convert("3bp_color", &weights, &npz, &["--fixed", "x=1"]), &["x", "3bp_color"]);
    assert_converts("3bp_color", &weights, &npz, &["--fixed", "g=60"]);
    assert!(read_npz(&npz).iter().any(|(name, _)| name == "net/gravity_ode_cell/log_m"));
    fs::write(run.join("config.toml"), config.to_toml()).unwrap();
    assert_converts("3bp_color", &run, &folder.path().join("b.npz"), &[]);
    assert_eq!(fs::read(&npz).unwrap(), fs::read(folder.path().join("b.npz")).unwrap());
    assert_refused(&convert("spring_color", &run, &folder.path().join("c.npz"), &[]), &["task 3bp_color"]);
}

#[test]
fn layouts_are_tensorflows() {
    let folder = tempfile::tempdir().unwrap();
    let (model, path) = weights(folder.path(), "spring_color", false);
    let npz = folder.path().join("a.npz");
    assert_converts("spring_color", &path, &npz, &[]);
    let arrays = read_npz(&npz);
    let get = |name: &str| &arrays.iter().find(|(found, _)| found == name).unwrap().1;
    let ours = |name: &str, at: &[i64]| model.variables.variables()[name].double_value(at) as f32;
    let kernel = get("net/encoder/conv2d_2/kernel");
    assert_eq!(kernel.shape(), [3, 3, 8, 16]);
    assert_eq!(kernel[[0, 2, 5, 11]], ours("encoder.conv2d_2.weight", &[11, 5, 0, 2]));
    let kernel = get("net/decoder/dense_1/kernel");
    assert_eq!(kernel.shape(), [200, 512]);
    assert_eq!(kernel[[17, 300]], ours("decoder.dense_1.weight", &[300, 17]));
    assert_eq!(get("net/spring_ode_cell/log_k").ndim(), 0);
}

#[test]
fn wrong_variables_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = weights(folder.path(), "spring_color", false);
    let npz = folder.path().join("good.npz");
    assert_converts("spring_color", &path, &npz, &[]);
    let (bad, out) = (folder.path().join("bad.npz"), folder.path().join("out.safetensors"));
    let with = |change: &dyn Fn(&mut TensorBytes)| {
        let mut arrays = read_npz(&npz);
        change(&mut arrays);
        write_npz(&bad, &arrays);
        convert("spring_color", &bad, &out, &[])
    };
    fn find<'a>(arrays: &'a mut [(String, ArrayD<f32>)], name: &str) -> &'a mut (String, ArrayD<f32>) {
        arrays.iter_mut().find(|(found, _)| found == name).unwrap()
    }
    let bias = "net/encoder/conv2d/bias";
    let missing = with(&|arrays| arrays.retain(|(name, _)| name != bias));
    assert_refused(&missing, &["bad.npz", bias, "missing"]);
    let unknown = with(&|arrays| find(arrays, bias).0 = "net/encoder/conv2d_99/bias".into());
    assert_refused(&unknown, &["bad.npz", "net/encoder/conv2d_99/bias", "unknown"]);
    let slot = with(&|arrays| find(arrays, bias).0 = "net/encoder/conv2d/bias/RMSProp".into());
    assert_refused(&slot, &["bad.npz", "net/encoder/conv2d/bias/RMSProp"]);
    let shape = with(&|arrays| find(arrays, bias).1 = ArrayD::zeros(IxDyn(&[1, 8])));
    assert_refused(&shape, &["bad.npz", bias, "[1, 8]", "[8]"]);
    let nan = with(&|arrays| find(arrays, bias).1[[3]] = f32::NAN);
    assert_refused(&nan, &["bad.npz", "encoder.conv2d.bias", "NaN"]);
    assert!(!out.exists());
}

#[test]
fn bad_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = weights(folder.path(), "spring_color", false);
    let [npz, out] = ["a.npz", "out.safetensors"].map(|name| folder.path().join(name));
    assert_converts("spring_color", &path, &npz, &[]);
    assert_refused(&convert("3bp_color", &npz, &out, &[]), &["a.npz", "net/"]);
    assert_refused(&convert("bouncing_balls", &path, &out, &[]), &["spring_color.safetensors", "spring_ode_cell"]);
    assert_refused(&convert("spring_color", &npz, &out, &["--alt-vel"]), &["a.npz", "net/init_vel/"]);
    assert_refused(&convert("spring_color", &path, &npz, &[]), &["a.npz", "--force"]);
    assert_refused(&convert("spring_color", &path, &folder.path().join("out.pt"), &[]), &["out.pt"]);
    assert_refused(&convert("spring_color", &folder.path().join("none.npz"), &out, &[]), &["none.npz", "cannot open"]);
    let whole = fs::read(&npz).unwrap();
    fs::write(&npz, &whole[..whole.len() / 2]).unwrap();
    assert_refused(&convert("spring_color", &npz, &out, &[]), &["a.npz", "truncated"]);
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    assert_refused(&convert("spring_color", &path, &out, &[]), &["spring_color.safetensors", "cut short"]);
}
