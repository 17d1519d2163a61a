//! `<task>[_variant]_train`: a whole model: forward tensors, losses, gradients and optimizer steps.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use paig::network::cells::{Actions, State};
use paig::network::physics_models::losses::Losses;
use paig::network::physics_models::{ForwardPass, ModelOptions, PhysicsNet};
use paig::runs::weights;
use tch::{Device, Kind, Tensor};

use crate::cases::optimizers;
use crate::harness::case::{Case, channels_first, channels_last};
use crate::harness::formula;
use crate::harness::golden::as_stored;
use crate::harness::meta::Meta;
use crate::harness::variables::{Variable, VariableListing, fill};
use crate::tolerances::{FORWARD, GRADIENT, Tolerance};

/// What is described by a formula: equal but for the last bit of float32.
static GIVEN: Tolerance = Tolerance { relative: 2e-7, chaotic: 2e-7 };
/// `in/head` holds every 7th of the first 4096 input values, `w/<variable>` the first 64 weights.
const HEAD: (i64, i64) = (4096, 7);
const WEIGHTS_HEAD: i64 = 64;

/// Where the case names a checkpoint, its weights must be the file's own.
pub fn compare(case: &mut Case) -> Result<()> {
    let meta = read_meta(case)?;
    let task = &meta.task;
    ensure_sizes(case, &meta)?;
    let options = ModelOptions { alt_vel: meta.alt_vel, ..case.options() };
    let mut model = PhysicsNet::new(&task.system, &options, Device::Cpu, 0)?;
    model.variables.set_kind(case.kind);
    let variables = fill_variables(case, &meta, &model)?;
    if let Some(path) = case.weights {
        load_weights(path, &model, &options)?;
    }
    let clips = formula::clips(meta.weight_seed, meta.batch, task.train_frames, task.system.side);
    check_given(case, &clips, &variables)?;

    let clips = channels_first(&case.taken_in(&clips));
    let pass = model.forward(&clips, &Actions::none())?;
    check_forward(case, &model, &pass)?;
    let losses = Losses::new(&pass, &clips, &task.system);
    check_losses(case, &losses, task.alpha)?;
    let loss = losses.train(task.alpha);
    loss.backward();
    check_gradients(case, &variables)?;
    optimizers::check_steps(case, &meta, &model, &clips, &loss, &variables)
}

fn read_meta(case: &Case) -> Result<Meta> {
    match case.golden.texts("meta")? {
        [text] => Meta::parse(text).context("tensor meta"),
        texts => anyhow::bail!("tensor meta has {} entries, expected one", texts.len()),
    }
}

/// Compares what `meta` says with arrays that are there, before anything of that size is made.
fn ensure_sizes(case: &Case, meta: &Meta) -> Result<()> {
    let task = &meta.task;
    let [batch, side, objects] = [meta.batch, task.system.side, task.system.objects].map(|n| n as i64);
    let encoded = (task.system.input_steps + task.system.pred_steps) as i64;
    let rolled = (task.train_frames - task.system.input_steps) as i64;
    let _ = case.golden.tensor("out/background_content", &[1, side, side, task.system.channels as i64])?;
    let _ = case.golden.tensor("out/enc_pos", &[batch, encoded, 2 * objects])?;
    let _ = case.golden.tensor("out/pos_vel_seq", &[batch, rolled + 1, 4 * objects])?;
    Ok(())
}

fn fill_variables(case: &Case, meta: &Meta, model: &PhysicsNet) -> Result<Vec<Variable>> {
    let scalars = case.golden.assignments("scalars")?;
    if let Some(key) = scalars.keys().find(|key| !["log_k", "log_l", "log_g", "logsigma"].contains(key)) {
        anyhow::bail!("tensor scalars: {key} is not known");
    }
    let factors = if case.golden.has("scale") { case.golden.assignments("scale")? } else { BTreeMap::new() };
    let listing = VariableListing {
        names: "var_names",
        shapes: "var_shapes",
        prefix: "",
        weight_seed: meta.weight_seed,
        scalars,
        factors,
    };
    fill(case, &listing, &model.variables)
}

/// Replaces the model's weights by those of a checkpoint, which is in single precision whatever the model is in.
fn load_weights(path: &Path, model: &PhysicsNet, options: &ModelOptions) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let saved = PhysicsNet::new(&model.system, options, Device::Cpu, 0)?;
    weights::load(path, &saved)?;
    for ((_, variable), (_, value)) in model.named_variables().iter().zip(saved.named_variables()) {
        variable.shallow_clone().copy_(&value);
    }
    Ok(())
}

/// That both sides started from the same numbers.
fn check_given(case: &mut Case, clips: &Tensor, variables: &[Variable]) -> Result<()> {
    let flat = clips.reshape([-1]);
    case.check("in/head", &flat.slice(0, 0, HEAD.0, HEAD.1), &GIVEN)?;
    case.check("in/sum", &flat.sum(Kind::Double), &GIVEN)?;
    for name in case.golden.names_under("w/") {
        let variable = variables
            .iter()
            .find(|variable| variable.original_name == name)
            .with_context(|| format!("tensor w/{name}: no such variable"))?;
        let head = variable.in_original_layout()?.reshape([-1]).slice(0, 0, WEIGHTS_HEAD, 1);
        case.check(&format!("w/{name}"), &head, &GIVEN)?;
    }
    Ok(())
}

fn check_forward(case: &mut Case, model: &PhysicsNet, pass: &ForwardPass) -> Result<()> {
    let sprites = model.decoder.sprites().context("a decoder with sprites")?;
    let states = pass.sequence();
    let last = pass.states.last().context("at least one predicted frame")?;
    let rendering = model.decoder.forward(&last.pos);
    let last_masks = rendering.masks.unsqueeze(-1);
    let channels = model.system.channels as i64;
    let last_contents = {
        let background = sprites.background.expand_as(&rendering.frames).unsqueeze(0);
        Tensor::cat(&[&rendering.contents, &background], 0)
    };
    let repeated = [-1, -1, -1, -1, channels];
    case.check("out/enc_masks", &channels_last(&pass.encoding.masks), &FORWARD)?;
    case.check("out/masked_objs", &channels_last(&pass.encoding.masked), &FORWARD)?;
    case.check("out/enc_pos", &pass.positions, &FORWARD)?;
    case.check("out/recons_out", &channels_last(&pass.reconstructions), &FORWARD)?;
    case.check("out/pos_vel_seq", &states, &FORWARD)?;
    case.check("out/output", &channels_last(&pass.predictions), &FORWARD)?;
    case.check("out/template", &channels_last(&sprites.template), &FORWARD)?;
    case.check("out/contents", &channels_last(&sprites.contents), &FORWARD)?;
    case.check("out/background_content", &channels_last(&sprites.background), &FORWARD)?;
    case.check("out/last_masks", &last_masks.expand(repeated, false), &FORWARD)?;
    case.check("out/last_contents", &channels_last(&last_contents), &FORWARD)?;
    check_from_golden_states(case, model)
}

/// The roll-out one frame at a time, each from the golden state before it, and the frames drawn at golden positions:
/// rounding has no trajectory to grow along, so physics and drawing are bound tightly in every file.
fn check_from_golden_states(case: &mut Case, model: &PhysicsNet) -> Result<()> {
    let golden = case.golden.floats("out/pos_vel_seq")?;
    let (batch, steps) = (golden.size()[0], golden.size()[1] - 1);
    let before = case.taken_in(&golden.narrow(1, 0, steps).flatten(0, 1));
    let after = golden.narrow(1, 1, steps).flatten(0, 1);
    let stepped = model.cell.step(&State::from_joined(&before), None, model.system.dt).joined();
    case.check_single_step("out/pos_vel_seq", "step by step", &after, &stepped);
    let positions = State::from_joined(&case.taken_in(&after)).pos;
    let [drawn] = model.decoder.draw([&positions]);
    let drawn = channels_last(&drawn);
    let shape = drawn.size();
    let output = case.golden.tensor("out/output", &[batch, steps, shape[1], shape[2], shape[3]])?;
    case.check_single_step("out/output", "at golden positions", &output.flatten(0, 1), &drawn);
    Ok(())
}

fn check_losses(case: &mut Case, losses: &Losses, alpha: f64) -> Result<()> {
    case.check("out/recons_loss", &losses.reconstruction, &FORWARD)?;
    case.check("out/pred_loss", &losses.prediction, &FORWARD)?;
    case.check("out/train_loss", &losses.train(alpha), &FORWARD)?;
    match &losses.extrapolation {
        Some(loss) => case.check("out/extrap_loss", loss, &FORWARD),
        None => {
            let golden = case.golden.number_or_nan("out/extrap_loss")?;
            ensure!(
                golden.is_nan() || golden == 0.0,
                "tensor out/extrap_loss is {golden}, but no frame is extrapolated"
            );
            Ok(())
        }
    }
}

fn check_gradients(case: &mut Case, variables: &[Variable]) -> Result<()> {
    for variable in variables {
        let (name, gradient) = (&variable.original_name, variable.gradient()?);
        case.check(&format!("grad/{name}"), &as_stored(&gradient), &GRADIENT)?;
        case.check(&format!("gradnorm/{name}"), &gradient.norm(), &GRADIENT)?;
    }
    Ok(())
}
