//! The kernels against libtorch and its autograd at extreme finite inputs: saturated masks, sprites far outside the frame or of
//! no extent, huge weights and gradients.

use paig::kernels::{self, Instructions, Kernels, Rate, Rule, SceneSizes, UNetOperation, Updated};
use paig::network::blocks::{Layers, UNet};
use tch::nn::VarStore;
use tch::{Device, Kind, Tensor};

const FLOAT: (Kind, Device) = (Kind::Float, Device::Cpu);
/// Of the largest element: sums of some thousand float32 products in another order, as in `tests/kernels.rs`.
const TOLERANCE: f64 = 1e-5;
/// Where rounding takes what a ReLU or a pooling sees across a kink, a pixel's gradient changes, as in `tests/kernels.rs`.
const ACROSS_KINKS: f64 = 3e-3;

/// The kernels with every set of instructions that the processor has, whatever the environment names.
fn all_kernels() -> Vec<Kernels> {
    Instructions::all().into_iter().map(Kernels::With).collect()
}

/// Leaves of autograd with these values.
fn leaves<const N: usize>(values: [&Tensor; N]) -> [Tensor; N] {
    values.map(|value| value.copy().set_requires_grad(true))
}

/// The results of a function and the gradients of its inputs, for gradients `pull` of its result.
fn with_gradients<const N: usize>(
    inputs: [&Tensor; N],
    pull: &Tensor,
    function: impl Fn([&Tensor; N]) -> Tensor,
) -> Vec<Tensor> {
    let inputs = leaves(inputs);
    let result = function(inputs.each_ref());
    (&result * pull).sum(Kind::Float).backward();
    std::iter::once(result.detach()).chain(inputs.iter().map(Tensor::grad)).collect()
}

/// Finite, as libtorch's are, and equal within a tolerance relative to the largest element, or to `terms` where sums of terms as
/// large as that cancel.
fn assert_finite_and_alike(ours: &[Tensor], theirs: &[Tensor], tolerance: f64, terms: f64, context: &str) {
    assert_eq!(ours.len(), theirs.len());
    for (part, (ours, theirs)) in ours.iter().zip(theirs).enumerate() {
        for (whose, tensor) in [("libtorch's", theirs), ("ours", ours)] {
            assert!(
                bool::try_from(tensor.isfinite().all()).unwrap(),
                "{context}: part {part} of {whose} is not finite"
            );
        }
        let (ours, theirs) = (ours.to_kind(Kind::Double), theirs.to_kind(Kind::Double));
        let (off, largest) = ((ours - &theirs).abs().max(), theirs.abs().max());
        let (off, largest) = (off.double_value(&[]), largest.double_value(&[]));
        assert!(off <= tolerance * largest.max(terms), "{context}: part {part} off by {off:e} of {largest:e}");
    }
}

/// Numbers of this size with a fixed pattern of values.
fn pattern(size: &[i64], values: &[f32]) -> Tensor {
    let count: i64 = size.iter().product();
    // A stride that shares no factor with the lengths of the patterns.
    let numbers: Vec<f32> = (0..count as usize).map(|place| values[place * 11 % values.len()]).collect();
    Tensor::from_slice(&numbers).reshape(size)
}

/// Weights `[.., side, size]` of a sprite's `size` pixels at source pixels `[.., side]`: `stn::transform_separable`'s.
fn weights(pixels: &Tensor, size: i64) -> Tensor {
    let floor = pixels.detach().floor();
    let [below, above] = [0.0, 1.0].map(|step| (&floor + step).clamp(0.0, (size - 1) as f64));
    let index = Tensor::arange(size, FLOAT);
    let at = |place: &Tensor| place.unsqueeze(-1).eq_tensor(&index).to_kind(Kind::Float);
    at(&below) * (&above - pixels).unsqueeze(-1) + at(&above) * (pixels - &below).unsqueeze(-1)
}

/// What [`kernels::draw`] computes.
fn drawn(scene: SceneSizes, [sprites, background, rows, columns]: [&Tensor; 4]) -> Tensor {
    let (rows, columns) = (weights(rows, scene.window as i64), weights(columns, scene.window as i64));
    // [objects, frames, layers, side, side]
    let moved = rows.unsqueeze(2).matmul(&sprites.unsqueeze(1)).matmul(&columns.unsqueeze(2).transpose(3, 4));
    let logits = moved.select(2, 0) - f64::from(scene.outside);
    let behind = logits.narrow(0, 0, 1).full_like(f64::from(scene.background));
    let masks = Tensor::cat(&[logits, behind], 0).softmax(0, Kind::Float).unsqueeze(2);
    let objects = scene.objects as i64;
    let contents = moved.narrow(2, 1, scene.channels as i64);
    let in_front = (masks.narrow(0, 0, objects) * contents).sum_dim_intlist([0i64].as_slice(), false, None);
    in_front + masks.select(0, objects) * background
}

#[test]
fn sprites_far_outside_or_of_no_extent_are_those_of_libtorch() {
    let scene = SceneSizes { objects: 2, channels: 3, window: 8, side: 16, outside: 5.0, background: 1.0 };
    let (frames, side) = (3, scene.side as i64);
    let line = Tensor::linspace(-4.3, 11.7, side, FLOAT);
    let at = |values: &[f32]| (&line + pattern(&[2, frames, 1], values)).contiguous();
    let places = [
        ("in the frame", at(&[0.0, 0.5, -2.25])),
        ("coincident", at(&[1.5])),
        ("partly outside", at(&[6.0, -6.0, 9.5])),
        ("far outside", at(&[1e4, -1e4, 3e6])),
        ("without end", at(&[1e30, -1e30])),
        ("of no extent", pattern(&[2, frames, side], &[3.25])),
        ("at a pixel", pattern(&[2, frames, side], &[0.0, 6.0, 7.0, -1.0])),
    ];
    let colours = pattern(&[2, 3, 8, 8], &[0.0, 1.0, 0.5]);
    let pull = pattern(&[frames, 3, side, side], &[1.0, -0.5, 0.25, 0.0]);
    for logits in [&[0.5f32, 3.0, -2.0][..], &[1e4, -1e4, 1e4, 5.0], &[1e30, -1e30]] {
        let sprites = Tensor::cat(&[pattern(&[2, 1, 8, 8], logits), colours.shallow_clone()], 1);
        for background in [0.0, 1.0] {
            let background = Tensor::full([3, side, side], background, FLOAT);
            for (number, (name, rows)) in places.iter().enumerate() {
                // Alike on both axes, and with the next.
                for (_, columns) in [&places[number], &places[(number + 1) % places.len()]] {
                    let inputs = [&sprites, &background, rows, columns];
                    let theirs = with_gradients(inputs, &pull, |inputs| drawn(scene, inputs));
                    for kernels in all_kernels() {
                        let ours = with_gradients(inputs, &pull, |inputs| {
                            let [sprites, background, rows, columns] = inputs.map(Tensor::shallow_clone);
                            let layers = || [sprites.shallow_clone(), background.shallow_clone()];
                            let [frames] = kernels::draw(kernels, scene, layers, [[rows, columns]]);
                            frames
                        });
                        let context = format!("{kernels:?}, rows {name}, logits {logits:?}");
                        let (drawing, ours_by_place) = ours.split_at(3);
                        assert_finite_and_alike(drawing, &theirs[..3], TOLERANCE, 1.0, &context);
                        // The gradient of a saturated mask is a difference of equal numbers; here it is multiplied by logits.
                        let largest = f64::from(logits[0].abs().max(logits[1].abs()));
                        assert_finite_and_alike(ours_by_place, &theirs[3..], TOLERANCE, largest, &context);
                    }
                }
            }
        }
    }
}

#[test]
fn masks_of_0_and_1_and_black_and_white_frames_are_those_of_libtorch() {
    // Masks of 0, 1, 1/2 and 1e-38.
    let (logits, background) = (pattern(&[6, 2, 8, 8], &[-1e4, 1e4, 1e4, -86.5]), 1.0);
    let frames = pattern(&[6, 3, 8, 8], &[0.0, 1.0, 1.0]);
    let pull = pattern(&[2, 6, 3, 8, 8], &[1.0, -1e30, 0.0]);
    let theirs = with_gradients([&logits], &pull, |[logits]| {
        let behind = logits.narrow(1, 0, 1).full_like(background);
        let masks = Tensor::cat(&[logits, &behind], 1).softmax(1, Kind::Float);
        masks.narrow(1, 0, 2).transpose(0, 1).unsqueeze(2) * frames.unsqueeze(0)
    });
    for kernels in all_kernels() {
        let ours = with_gradients([&logits], &pull, |[logits]| {
            let [_, masked] = kernels::masked_frames(kernels, background, logits, &frames);
            masked
        });
        assert_finite_and_alike(&ours, &theirs, TOLERANCE, 0.0, &format!("{kernels:?}, masked frames"));
    }
}

#[test]
fn products_of_huge_and_tiny_numbers_are_those_of_libtorch() {
    for (of_x, of_weight) in [(1e4, 1e4), (1e30, 1e-30), (1e-30, 1e30), (1e15, 1e15)] {
        let x = pattern(&[20, 300], &[of_x, -0.5 * of_x, 0.0]);
        let weight = pattern(&[17, 300], &[of_weight, 0.25 * of_weight, -of_weight, of_weight]);
        let (bias, pull) = (pattern(&[17], &[1.0, -1e4]), pattern(&[20, 17], &[1.0, -1.0, 0.5]));
        let inputs = [&x, &weight, &bias];
        let theirs = with_gradients(inputs, &pull, |[x, weight, bias]| x.linear(weight, Some(bias)));
        for kernels in all_kernels() {
            let ours = with_gradients(inputs, &pull, |[x, weight, bias]| kernels::linear(kernels, x, weight, bias));
            let context = format!("{kernels:?}, {of_x:e} times {of_weight:e}");
            assert_finite_and_alike(&ours, &theirs, TOLERANCE, 0.0, &context);
        }
    }
}

#[test]
fn errors_of_huge_frames_are_those_of_libtorch() {
    for size in [1.0, 1e4, 1e15] {
        let (a, b) = (pattern(&[4, 3, 50], &[size, -size, 0.0]), pattern(&[4, 3, 50], &[0.0, 1.0]));
        let pull = Tensor::from(0.5f32);
        let theirs = with_gradients([&a], &pull, |[a]| (a - &b).square().sum(Kind::Float));
        for kernels in all_kernels() {
            let ours = with_gradients([&a], &pull, |[a]| kernels::squared_error(kernels, a, &b));
            assert_finite_and_alike(&ours, &theirs, TOLERANCE, 0.0, &format!("{kernels:?}, frames of {size:e}"));
        }
    }
}

#[test]
fn saturated_gates_are_those_of_libtorch() {
    for size in [30.0, 1e4, 1e30] {
        let gates = pattern(&[5, 12, 2], &[size, -size, 0.5, size, -size]);
        let c = pattern(&[5, 3, 2], &[1e4, -1e4, 0.25, 0.0]);
        let pull = pattern(&[2, 5, 3, 2], &[1.0, -0.5, 2.0]);
        let theirs = with_gradients([&gates, &c], &pull, |[gates, c]| {
            let gates = gates.chunk(4, 1);
            let c = (&gates[1] + 1.0).sigmoid() * c + gates[0].sigmoid() * gates[2].tanh();
            Tensor::stack(&[gates[3].sigmoid() * c.tanh(), c], 0)
        });
        for kernels in all_kernels() {
            let step = |[gates, c]: [&Tensor; 2]| Tensor::stack(&kernels::lstm_cell(kernels, gates, c, 1.0), 0);
            let ours = with_gradients([&gates, &c], &pull, step);
            assert_finite_and_alike(&ours, &theirs, TOLERANCE, 0.0, &format!("{kernels:?}, gates of {size:e}"));
        }
    }
}

/// Weights a hundred times too large, on black and white frames: logits beyond 1e15, and gradients as large.
#[test]
fn huge_weights_of_the_unet_give_the_logits_and_gradients_of_libtorch() {
    let (side, objects) = (32, 2);
    let store = VarStore::new(Device::Cpu);
    let net = UNet::for_side(&mut Layers::new(store.root()), side, 3, objects, Kernels::Libtorch);
    let variables = store.variables();
    let layers: Vec<_> = (0..variables.len() / 2)
        .map(|i| if i == 0 { "conv2d".into() } else { format!("conv2d_{i}") })
        .map(|name: String| ["weight", "bias"].map(|part| variables[&format!("{name}.{part}")].shallow_clone()))
        .collect();
    tch::no_grad(|| {
        for [weight, bias] in &layers {
            // Mostly positive, so that few sums cancel.
            weight.shallow_clone().copy_(&(pattern(&weight.size(), &[1.0, 0.5, -0.25, 0.75, 1.0, 0.25]) * 3.0));
            bias.shallow_clone().copy_(&pattern(&bias.size(), &[100.0, -50.0]));
        }
    });
    let frames = pattern(&[20, 3, side as i64, side as i64], &[0.0, 1.0, 1.0, 0.0, 1.0]);
    let pull = pattern(&[20, objects as i64, side as i64, side as i64], &[1.0, 0.5, -0.25]);
    let gradients = |logits: Tensor| {
        layers.iter().flatten().for_each(|variable| variable.shallow_clone().zero_grad());
        (&logits * &pull).sum(Kind::Float).backward();
        let gradients = layers.iter().flatten().map(|variable| variable.grad().copy());
        std::iter::once(logits.detach()).chain(gradients).collect::<Vec<_>>()
    };
    let theirs = gradients(net.forward(&frames));
    assert!(theirs[0].abs().max().double_value(&[]) > 1e15);
    let borrowed: Vec<_> = layers.iter().map(|[weight, bias]| (weight, bias)).collect();
    for kernels in all_kernels() {
        let operation = UNetOperation::new(kernels, UNet::shape(side, 3, objects));
        let ours = gradients(operation.forward(&borrowed, &frames));
        assert_finite_and_alike(&ours, &theirs, ACROSS_KINKS, 0.0, &format!("{kernels:?}"));
    }
}

/// A gradient whose square exceeds float32 moves nothing at first, and then no number is left: the divergence shows, as with
/// libtorch's own operations.
#[test]
fn steps_of_adam_on_huge_gradients_are_those_of_libtorch() {
    let rule = Rule::Adam { decays: (0.9, 0.999), epsilon: 1e-8 };
    let gradient = Tensor::from_slice(&[1e15f32, -1e18, 1e30, -3e38]);
    for kernels in all_kernels() {
        let [variable, mean, square] = [(); 3].map(|()| Tensor::zeros([4], FLOAT));
        let [mut x, mut m, mut v] = [(); 3].map(|()| Tensor::zeros([4], FLOAT));
        for number in 0..2 {
            let [of_variable, gradient, mean, square] =
                [&variable, &gradient, &mean, &square].map(Tensor::shallow_clone);
            let updated =
                Updated { variable: of_variable, gradient, slots: vec![mean, square], rate: Rate::Number(0.1) };
            let _ = m.lerp_(&updated.gradient, 1.0 - 0.9);
            let _ = v.lerp_(&updated.gradient.square(), 1.0 - 0.999);
            let _ = x.addcdiv_(&(&m * -0.1), &(v.sqrt() + 1e-8));
            kernels::descend(kernels, rule, None, vec![updated]);
            let [ours, theirs] = [&variable, &x].map(|it| Vec::<f32>::try_from(it).unwrap());
            for (ours, theirs) in ours.iter().zip(&theirs) {
                // 1 - 0.999 in float32 is off by 5e-5; its root divides a step of 0.3.
                let alike = (ours - theirs).abs() < 2e-5 || (ours.is_nan() && theirs.is_nan());
                assert!(alike, "{kernels:?}, step {number}: {ours} {theirs}");
            }
            let lost: Vec<_> = ours.iter().map(|number| number.is_nan()).collect();
            assert_eq!(lost, if number == 0 { [false; 4] } else { [false, false, true, true] });
        }
    }
}
