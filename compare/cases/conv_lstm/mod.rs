//! `conv_lstm`: a convolutional LSTM over some frames, and the gradients to the frames and to its weights.

use anyhow::{Result, ensure};
use paig::network::blocks::Layers;
use paig_experiments::baselines::end_to_end::conv_lstm::ConvLstmCell;
use tch::nn::VarStore;
use tch::{Device, Tensor};

use super::black_box::{check_gradients, fill};
use crate::harness::case::Case;
use crate::tolerances::{FORWARD, GRADIENT};

pub fn compare(case: &mut Case) -> Result<()> {
    let frames = case.leaf("in/x", 5)?;
    let weight = case.input("in/h_weight", 5)?;
    let kernel = case.golden.floats("param/conv2d.weight")?.size();
    ensure!(kernel.len() == 4, "tensor param/conv2d.weight has shape {kernel:?}, expected four axes");
    let mut store = VarStore::new(Device::Cpu);
    let [inputs, hidden] = [frames.size()[2], kernel[0] / 4];
    let mut layers = Layers::new(store.root());
    let cell = ConvLstmCell::new(&mut layers, inputs as usize, hidden as usize, kernel[2] as usize, case.kernels);
    store.set_kind(case.kind);
    let mut variables: Vec<_> = store.variables().into_iter().collect();
    variables.sort_by(|a, b| a.0.cmp(&b.0));
    fill(case, &variables)?;

    let mut memory = cell.start(&frames.select(1, 0));
    let mut states = Vec::new();
    let prepared = cell.prepared();
    for frame in 0..frames.size()[1] {
        memory = prepared.step(&frames.select(1, frame), &memory);
        states.push(memory[0].shallow_clone());
    }
    let h = Tensor::stack(&states, 1);
    case.check("out/h", &h, &FORWARD)?;
    (h * weight).sum(case.kind).backward();
    case.check("grad/x", &frames.grad(), &GRADIENT)?;
    check_gradients(case, &variables)
}
