//! The kernels against libtorch and its autograd, for every set of instructions that the processor has: the U-Net's logits and
//! the gradients of all its weights, the whole model's frames, losses and gradients, and steps of Adam.

use std::sync::{Mutex, PoisonError};

use paig::kernels::{self, Convolution, Instructions, Kernels, Rate, Rule, UNetOperation, Updated};
use paig::network::System;
use paig::network::blocks::{Layers, Precision, UNet};
use paig::network::cells::Actions;
use paig::network::physics_models::losses::Losses;
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::training::optimizers::{Optimizer, OptimizerKind};
use tch::nn::VarStore;
use tch::{Device, Kind, Tensor};

/// Of the largest element. Both sides round sums of some thousand products in float32, in different orders, ours of
/// transformed numbers; seen: 3e-6.
const FORWARD: f64 = 1e-5;
/// Rounding of positions grows along a roll-out.
const ROLLED_OUT: f64 = 1e-3;
/// Where rounding takes what a ReLU or a pooling sees across a kink, a pixel's whole gradient changes: seen 3e-4, and 1e-5
/// without such a pixel. The deep network has more layers to cross one in, and the fewest frames here: seen 4e-3.
const GRADIENT: f64 = 3e-3;
const DEEP_GRADIENT: f64 = 2e-2;

/// libtorch's random numbers are the process's: one test at a time draws them.
static RANDOM: Mutex<()> = Mutex::new(());

/// The kernels with every set of instructions that the processor has, whatever the environment names.
fn all_kernels() -> Vec<Kernels> {
    Instructions::all().into_iter().map(Kernels::With).collect()
}

/// The kernels with the widest of them, whatever the environment names. Equal bits are a promise of the kernels; libtorch makes
/// none.
fn widest_kernels() -> Kernels {
    Kernels::With(Instructions::all()[0])
}

/// A network of libtorch with weights drawn from a normal distribution, and its layers' weights and biases in their order.
fn network(side: usize, channels: usize, objects: usize) -> (VarStore, UNet, Vec<(Tensor, Tensor)>) {
    let store = VarStore::new(Device::Cpu);
    let net = UNet::for_side(&mut Layers::new(store.root()), side, channels, objects, Kernels::Libtorch);
    let variables = store.variables();
    let _guard = tch::no_grad_guard();
    let layers: Vec<_> = (0..variables.len() / 2)
        .map(|i| if i == 0 { "conv2d".into() } else { format!("conv2d_{i}") })
        .map(|name: String| {
            let [mut weight, mut bias] =
                ["weight", "bias"].map(|part| variables[&format!("{name}.{part}")].shallow_clone());
            let inputs: i64 = weight.size()[1..].iter().product();
            let _ = weight.normal_(0.0, (2.0 / inputs as f64).sqrt());
            let _ = bias.normal_(0.0, 0.3);
            (weight, bias)
        })
        .collect();
    (store, net, layers)
}

fn gradients(layers: &[(Tensor, Tensor)], logits: &Tensor, weight: &Tensor) -> Vec<Tensor> {
    let variables: Vec<_> = layers.iter().flat_map(|(weight, bias)| [weight, bias]).collect();
    variables.iter().for_each(|variable| variable.shallow_clone().zero_grad());
    (logits * weight).sum(Kind::Float).backward();
    variables.iter().map(|variable| variable.grad().copy()).collect()
}

/// Largest difference as a share of the largest element.
fn departure(ours: &Tensor, theirs: &Tensor) -> f64 {
    assert_eq!(ours.size(), theirs.size());
    ((ours - theirs).abs().max() / theirs.abs().max()).double_value(&[])
}

#[test]
fn logits_and_gradients_are_those_of_libtorch() {
    let _alone = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(3);
    for (side, channels, objects, frames) in
        [(32, 3, 2, 21), (32, 1, 1, 16), (12, 5, 3, 5), (36, 3, 4, 3), (16, 1, 2, 70), (48, 3, 2, 3), (64, 3, 3, 2)]
    {
        let (_store, net, layers) = network(side, channels, objects);
        let frames = Tensor::rand([frames, channels as i64, side as i64, side as i64], (Kind::Float, Device::Cpu));
        let theirs = net.forward(&frames);
        let weight = theirs.randn_like();
        let their_gradients = gradients(&layers, &theirs, &weight);
        let borrowed: Vec<_> = layers.iter().map(|(weight, bias)| (weight, bias)).collect();
        for instructions in Instructions::all() {
            let operation = UNetOperation::new(Kernels::With(instructions), UNet::shape(side, channels, objects));
            // Twice: the second pass is in used memory.
            for _ in 0..2 {
                let ours = operation.forward(&borrowed, &frames);
                let context = format!("{instructions:?}, {side} pixels, {channels} channels, {objects} objects");
                let off = departure(&ours, &theirs);
                assert!(off < FORWARD, "{context}: logits off by {off:e}");
                for (i, (ours, theirs)) in gradients(&layers, &ours, &weight).iter().zip(&their_gradients).enumerate() {
                    let off = departure(ours, theirs);
                    assert!(
                        off < if side < 40 { GRADIENT } else { DEEP_GRADIENT },
                        "{context}: gradient {i} off by {off:e}"
                    );
                }
            }
        }
    }
}

/// A training notices by its loss that it has left the numbers: no layer may hide that.
#[test]
fn what_is_not_a_number_reaches_the_logits() {
    let _alone = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(4);
    let (side, channels, objects) = (32, 3, 2);
    let frames = Tensor::rand([20, channels as i64, side as i64, side as i64], (Kind::Float, Device::Cpu));
    let _guard = tch::no_grad_guard();
    for instructions in Instructions::all() {
        for wrong in [f64::NAN, f64::INFINITY] {
            for layer in 0.. {
                let (_store, _, layers) = network(side, channels, objects);
                let Some((weight, _)) = layers.get(layer) else { break };
                let _ = weight.view(-1).narrow(0, 0, 1).fill_(wrong);
                let borrowed: Vec<_> = layers.iter().map(|(weight, bias)| (weight, bias)).collect();
                let operation = UNetOperation::new(Kernels::With(instructions), UNet::shape(side, channels, objects));
                let logits = operation.forward(&borrowed, &frames);
                let all_finite = bool::try_from(logits.isfinite().all()).unwrap();
                assert!(!all_finite, "{instructions:?}: {wrong} in layer {layer}");
            }
        }
    }
}

/// Of no rows there is nothing to compute, forward or backward.
#[test]
fn nothing_gives_nothing() {
    for kernels in all_kernels() {
        let numbers = |size: [i64; 2]| Tensor::ones(size, (Kind::Float, Device::Cpu)).set_requires_grad(true);
        let (x, weight, bias) = (numbers([0, 5]), numbers([3, 5]), numbers([3, 1]));
        let result = kernels::linear(kernels, &x, &weight, &bias.view(-1));
        assert_eq!(result.size(), [0, 3]);
        let clips = Tensor::ones([0, 2, 4], (Kind::Float, Device::Cpu)).set_requires_grad(true);
        let error = kernels::squared_error(kernels, &clips, &clips.detach());
        (result.sum(Kind::Float) + &error).backward();
        assert_eq!(error.double_value(&[]), 0.0);
        for (tensor, size) in [(x, [0, 5]), (weight, [3, 5]), (bias, [3, 1])] {
            let gradient = tensor.grad();
            assert_eq!(gradient.size(), size);
            assert_eq!(gradient.abs().sum(Kind::Float).double_value(&[]), 0.0);
        }
    }
}

/// A model, its frames and losses of these clips, and the gradients of all its variables by their names.
fn trained_by(system: &System, kernels: Kernels, clips: &Tensor) -> (Vec<Tensor>, Vec<(String, Tensor)>) {
    // Without refinement, which chooses between starts: rounding may take another one.
    let options = ModelOptions { kernels, ..ModelOptions::original() };
    let model = PhysicsNet::new(system, &options, Device::Cpu, 5).unwrap();
    let pass = model.forward(clips, &Actions::none()).unwrap();
    let losses = Losses::new(&pass, clips, system);
    // The masks have readers besides the localisation network.
    let seen = pass.encoding.masked.square().mean(Kind::Float) + pass.encoding.masks.square().mean(Kind::Float);
    (losses.train(2.0) + seen).backward();
    let mut results = vec![losses.reconstruction, losses.prediction];
    results.extend(losses.extrapolation);
    results.extend([pass.encoding.positions, pass.encoding.masked, pass.reconstructions, pass.predictions]);
    let gradients = model.named_variables().into_iter().map(|(name, variable)| (name, variable.grad())).collect();
    (results.iter().map(Tensor::detach).collect(), gradients)
}

#[test]
fn the_whole_model_is_that_of_libtorch() {
    let _alone = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(4);
    for (task, side, channels, frames) in
        [("spring_color", 32, 3, 13), ("spring_color", 36, 1, 12), ("3bp_color", 48, 3, 22)]
    {
        let system = System { side, channels, ..paig::tasks::find(task).unwrap().system };
        let (channels, side) = (channels as i64, side as i64);
        let clips = Tensor::rand([3, frames, channels, side, side], (Kind::Float, Device::Cpu));
        let (theirs, their_gradients) = trained_by(&system, Kernels::Libtorch, &clips);
        for kernels in all_kernels() {
            let (ours, our_gradients) = trained_by(&system, kernels, &clips);
            for (i, (ours, theirs)) in ours.iter().zip(&theirs).enumerate() {
                let off = departure(ours, theirs);
                assert!(off < ROLLED_OUT, "{kernels:?}, {task} {side}: result {i} off by {off:e}");
            }
            for ((name, ours), (_, theirs)) in our_gradients.iter().zip(&their_gradients) {
                assert_eq!(ours.defined(), theirs.defined(), "{name}");
                if theirs.defined() {
                    let off = departure(ours, theirs);
                    assert!(
                        off < if side < 40 { GRADIENT } else { DEEP_GRADIENT },
                        "{kernels:?}, {task} {side}: gradient of {name} off by {off:e}"
                    );
                }
            }
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let _alone = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(6);
    let given = tch::get_num_threads();
    // Many blocks for a thread, a block for each, and several threads that share one.
    for (side, blocks) in [(32, 18.75), (48, 2.5), (64, 0.3125)] {
        let (_store, _, layers) = network(side, 3, 2);
        let borrowed: Vec<_> = layers.iter().map(|(weight, bias)| (weight, bias)).collect();
        for instructions in Instructions::all() {
            let kernels = Kernels::With(instructions);
            let frames = (blocks * instructions.lanes() as f64).ceil() as i64;
            let frames = Tensor::rand([frames, 3, side as i64, side as i64], (Kind::Float, Device::Cpu));
            let operation = UNetOperation::new(kernels, UNet::shape(side, 3, 2));
            let [once, again] = [1, 3].map(|threads| {
                tch::set_num_threads(threads);
                let logits = operation.forward(&borrowed, &frames);
                let gradients = gradients(&layers, &logits, &frames.narrow(1, 0, 2));
                (logits.detach(), gradients)
            });
            let context = format!("{kernels:?}, {side} pixels");
            assert!(once.0.equal(&again.0), "{context}");
            assert!(once.1.iter().zip(&again.1).all(|(once, again)| once.equal(again)), "{context}");
        }
    }
    tch::set_num_threads(given);
}

/// `[rows, outputs]` and the gradients of `x`, weight and bias, where `pull` is that of the result.
fn linear_and_gradients(
    linear: impl Fn(&Tensor, &Tensor, &Tensor) -> Tensor,
    inputs: [&Tensor; 3],
    pull: &Tensor,
) -> Vec<Tensor> {
    let inputs = inputs.map(|input| input.copy().set_requires_grad(true));
    let [x, weight, bias] = &inputs;
    let result = linear(x, weight, bias);
    (&result * pull).sum(Kind::Float).backward();
    [result.detach()].into_iter().chain(inputs.iter().map(Tensor::grad)).collect()
}

#[test]
fn products_of_a_dense_layer_are_those_of_libtorch() {
    let _alone = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(9);
    let given = tch::get_num_threads();
    for [rows, inputs, outputs] in [[1, 7, 3], [13, 1, 5], [70, 300, 17], [500, 3072, 200]] {
        let [x, weight, bias, pull] = [&[rows, inputs][..], &[outputs, inputs], &[outputs], &[rows, outputs]]
            .map(|size| Tensor::randn(size, (Kind::Float, Device::Cpu)));
        let by = |kernels: Kernels| {
            let linear = |x: &Tensor, weight: &Tensor, bias: &Tensor| kernels::linear(kernels, x, weight, bias);
            linear_and_gradients(linear, [&x, &weight, &bias], &pull)
        };
        let theirs = by(Kernels::Libtorch);
        for kernels in all_kernels() {
            let context = format!("{kernels:?}, {rows} x {inputs} x {outputs}");
            for (part, (ours, theirs)) in by(kernels).iter().zip(&theirs).enumerate() {
                let off = departure(ours, theirs);
                assert!(off < FORWARD, "{context}: part {part} off by {off:e}");
            }
            let [once, again] = [1, 3].map(|threads| {
                tch::set_num_threads(threads);
                by(kernels)
            });
            tch::set_num_threads(given);
            assert!(once.iter().zip(&again).all(|(once, again)| once.equal(again)), "{context}");
        }
    }
}

/// Half of them would be missing without a word.
#[test]
fn second_derivatives_are_refused() {
    let [x, weight, bias] = [&[2i64, 3][..], &[4, 3], &[4]]
        .map(|size| Tensor::ones(size, (Kind::Float, Device::Cpu)).set_requires_grad(true));
    for kernels in all_kernels() {
        let sum = kernels::linear(kernels, &x, &weight, &bias).square().sum(Kind::Float);
        assert!(Tensor::f_run_backward(&[&sum], &[&x], true, false).is_ok());
        let refused = Tensor::f_run_backward(&[&sum], &[&x], true, true).unwrap_err().to_string();
        assert!(refused.contains("no second derivatives"), "{refused}");
    }
}

/// What a layer that is applied twice gives, `[results, results of the results]`, and the gradients of what it sees first,
/// of its weight and of its bias.
fn applied_twice(layer: impl Fn(&Tensor) -> Tensor, inputs: [&Tensor; 3], pull: &Tensor) -> Vec<Tensor> {
    inputs.iter().for_each(|input| input.shallow_clone().zero_grad());
    let once = layer(inputs[0]);
    let twice = layer(&once.narrow(1, 0, inputs[0].size()[1]));
    (&twice * pull).sum(Kind::Float).backward();
    [once.detach(), twice.detach()].into_iter().chain(inputs.iter().map(|input| input.grad().copy())).collect()
}

#[test]
fn a_prepared_convolution_is_that_of_libtorch() {
    let _alone = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(11);
    let given = tch::get_num_threads();
    // One kernel for all: its memory of one size is not taken for another.
    let convolutions: Vec<_> = all_kernels().into_iter().map(|kernels| (kernels, Convolution::new(kernels))).collect();
    for [pictures, inputs, outputs, side] in [[25, 112, 256, 8], [3, 8, 16, 9], [40, 24, 32, 9], [1, 8, 8, 1]] {
        let bound = |inputs: i64| (1.0 / (9 * inputs) as f64).sqrt();
        let draw = |size: &[i64], scale: f64| {
            (Tensor::randn(size, (Kind::Float, Device::Cpu)) * scale).set_requires_grad(true)
        };
        let x = draw(&[pictures, inputs, side, side], 1.0);
        let (weight, bias) = (draw(&[outputs, inputs, 3, 3], bound(inputs)), draw(&[outputs], 1.0));
        let pull = Tensor::randn([pictures, outputs, side, side], (Kind::Float, Device::Cpu));
        let by_libtorch = |x: &Tensor| x.conv2d(&weight, Some(&bias), 1, 1, 1, 1);
        let theirs = applied_twice(by_libtorch, [&x, &weight, &bias], &pull);
        for (kernels, convolution) in &convolutions {
            assert!(convolution.has_kernel_for(&weight));
            let own = || {
                let prepared = convolution.prepared(&weight, &bias);
                applied_twice(|x| prepared.forward(x), [&x, &weight, &bias], &pull)
            };
            for (part, (ours, theirs)) in own().iter().zip(&theirs).enumerate() {
                let off = departure(ours, theirs);
                let context = format!("{kernels:?}, {pictures} x {inputs} to {outputs}, side {side}");
                assert!(off < FORWARD, "{context}: part {part} off by {off:e}");
            }
            let [once, again] = [1, 3].map(|threads| {
                tch::set_num_threads(threads);
                own()
            });
            tch::set_num_threads(given);
            assert!(once.iter().zip(&again).all(|(once, again)| once.equal(again)), "{kernels:?}, side {side}");
        }
    }
}

#[test]
fn steps_of_a_memory_are_those_of_libtorch() {
    let _alone = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(12);
    let by_libtorch = |gates: &Tensor, c: &Tensor| {
        let gates = gates.chunk(4, 1);
        let c = (&gates[1] + 1.0).sigmoid() * c + gates[0].sigmoid() * gates[2].tanh();
        [gates[3].sigmoid() * c.tanh(), c]
    };
    for size in [&[25, 64, 8, 8][..], &[3, 5], &[1, 1, 1, 3]] {
        let wide: Vec<i64> = size.iter().enumerate().map(|(axis, n)| if axis == 1 { 4 * n } else { *n }).collect();
        let [gates, c, of_h, of_c] = [&wide[..], size, size, size]
            .map(|size| (Tensor::randn(size, (Kind::Float, Device::Cpu)) * 3.0).set_requires_grad(true));
        // A second step, so that the memory is pulled at both of its parts.
        let twice = |step: &dyn Fn(&Tensor, &Tensor) -> [Tensor; 2]| {
            [&gates, &c].iter().for_each(|input| input.shallow_clone().zero_grad());
            let [first, memory] = step(&gates, &c);
            let [second, memory] = step(&(&gates + first.repeat(repeats(&wide, size))), &memory);
            ((&second * &of_h) + (&memory * &of_c)).sum(Kind::Float).backward();
            [first.detach(), second.detach(), memory.detach(), gates.grad().copy(), c.grad().copy()]
        };
        let theirs = twice(&by_libtorch);
        for kernels in all_kernels() {
            let ours = twice(&|gates, c| kernels::lstm_cell(kernels, gates, c, 1.0));
            for (part, (ours, theirs)) in ours.iter().zip(&theirs).enumerate() {
                let off = departure(ours, theirs);
                assert!(off < FORWARD, "{kernels:?}, {size:?}: part {part} off by {off:e}");
            }
        }
    }
}

/// How often a tensor stands in another on each axis.
fn repeats(wide: &[i64], size: &[i64]) -> Vec<i64> {
    wide.iter().zip(size).map(|(wide, size)| wide / size).collect()
}

#[test]
fn bfloat16_rounds_the_first_dense_layer_alone() {
    let _alone = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(10);
    let system = paig::tasks::find("spring_color").unwrap().system;
    let frames = Tensor::rand([7, 3, 32, 32], (Kind::Float, Device::Cpu));
    let [exact, rounded] = [Precision::Float32, Precision::Bfloat16].map(|dense_precision| {
        let options = ModelOptions { kernels: widest_kernels(), dense_precision, ..ModelOptions::original() };
        let model = PhysicsNet::new(&system, &options, Device::Cpu, 5).unwrap();
        let seen = model.encoder.forward(&frames);
        seen.positions.sum(Kind::Float).backward();
        let gradients = model.named_variables().into_iter().map(|(name, variable)| (name, variable.grad()));
        (seen, gradients.filter(|(_, gradient)| gradient.defined()).collect::<Vec<_>>())
    });
    assert!(exact.0.masks.equal(&rounded.0.masks));
    // Eight bits: a factor or a sum is off by at most 2^-9.
    let off = departure(&rounded.0.positions, &exact.0.positions);
    assert!(off > 1e-7 && off < 4e-3, "positions off by {off:e}");
    assert_eq!(exact.1.len(), rounded.1.len());
    for ((name, exact), (_, rounded)) in exact.1.iter().zip(&rounded.1) {
        // A unit whose rounded sum falls on the other side of zero has another gradient, and the U-Net's are sums that nearly
        // cancel: seen 0.13.
        let off = departure(rounded, exact);
        assert!(off < 0.2, "gradient of {name} off by {off:e}");
    }
}

#[test]
fn steps_of_adam_are_those_of_libtorch() {
    let _guard = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(8);
    let starts = [&[1i64][..], &[7, 5], &[3, 40_000]].map(|size| Tensor::randn(size, (Kind::Float, Device::Cpu)));
    let pulls = starts.each_ref().map(Tensor::randn_like);
    let after = |kernels: Kernels| {
        let variables = starts.each_ref().map(|start| ("x".to_string(), start.copy().set_requires_grad(true)));
        for variable in &variables {
            let mut optimizer =
                Optimizer::new(OptimizerKind::Adam, Some(0.5), std::slice::from_ref(variable)).with_kernels(kernels);
            for pull in &pulls {
                // Gradients of very different size, some of them clipped.
                let scale = pull.flatten(0, -1).get(0);
                ((&variable.1 * scale).sin() * &variable.1).sum(Kind::Float).backward();
                optimizer.step(std::slice::from_ref(variable), |_| 1e-2);
                assert!(!variable.1.grad().defined());
            }
        }
        variables.map(|(_, variable)| variable.detach())
    };
    let theirs = after(Kernels::Libtorch);
    for kernels in all_kernels() {
        for ((ours, theirs), start) in after(kernels).iter().zip(&theirs).zip(&starts) {
            assert!((ours - start).abs().max().double_value(&[]) > 1e-3);
            // Two operations are in another order: a rounding or two of numbers up to 5.
            let apart = (ours - theirs).abs().max().double_value(&[]);
            assert!(apart < 2e-6, "{kernels:?}: {apart}");
        }
    }
}

#[test]
#[should_panic(expected = "each has memory of its own")]
fn adam_refuses_numbers_that_overlap() {
    let [variable, square] = [(); 2].map(|()| Tensor::zeros([4], (Kind::Float, Device::Cpu)));
    let both = Tensor::zeros([5], (Kind::Float, Device::Cpu));
    let [gradient, mean] = [0, 1].map(|start| both.narrow(0, start, 4));
    let rule = Rule::Adam { decays: (0.9, 0.999), epsilon: 1e-8 };
    let updated = Updated { variable, gradient, slots: vec![mean, square], rate: Rate::Number(0.1) };
    kernels::descend(Kernels::Libtorch, rule, None, vec![updated]);
}

/// Positions that teach the masks and positions that do not, from one product: the same numbers and the same gradients as from
/// two passes of the localisation network, of small frames and of those that it sees halved.
#[test]
fn positions_with_and_without_a_way_back_share_their_product() {
    let _alone = RANDOM.lock().unwrap_or_else(PoisonError::into_inner);
    tch::manual_seed(12);
    let cases =
        ["spring_color", "mnist_spring_color"].map(|task| [widest_kernels(), Kernels::Libtorch].map(|it| (task, it)));
    for (task, kernels) in cases.into_iter().flatten() {
        let options = ModelOptions { kernels, ..ModelOptions::original() };
        let system = paig::tasks::find(task).unwrap().system;
        let side = system.side as i64;
        let frames = Tensor::rand([6, 3, side, side], (Kind::Float, Device::Cpu));
        let pulls = [(); 2].map(|()| Tensor::randn([6, 4], (Kind::Float, Device::Cpu)));
        let [shared, apart] = [true, false].map(|shared| {
            let model = PhysicsNet::new(&system, &options, Device::Cpu, 7).unwrap();
            let (seen, again) = if shared {
                model.encoder.forward_twice(&frames)
            } else {
                let seen = model.encoder.forward(&frames);
                let again = model.encoder.localise(&seen.masked.detach());
                (seen, again)
            };
            (&seen.positions * &pulls[0] + &again * &pulls[1]).sum(Kind::Float).backward();
            let gradients = model.named_variables().into_iter().map(|(name, variable)| (name, variable.grad()));
            (seen.positions.detach(), again.detach(), gradients.filter(|(_, it)| it.defined()).collect::<Vec<_>>())
        });
        for (one, other) in [(&shared.0, &apart.0), (&shared.1, &apart.1), (&shared.0, &shared.1)] {
            assert!(kernels == Kernels::Libtorch || one.equal(other), "{task}");
            assert!(departure(one, other) < FORWARD, "{task}, {kernels:?}");
        }
        assert_eq!(shared.2.len(), apart.2.len());
        for ((name, shared), (_, apart)) in shared.2.iter().zip(&apart.2) {
            // Two sums of float32 added before or after they are summed.
            let off = departure(shared, apart);
            assert!(off < 1e-4, "{task}: gradient of {name} off by {off:e}");
        }
    }
}
