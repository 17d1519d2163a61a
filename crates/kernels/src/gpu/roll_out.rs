//! The roll-out of an equation that is a list of operations on single numbers (`roll_out.cu`).
//!
//! A roll-out is a thousand operations, one after the other, on a few numbers of each clip: libtorch's launches take a
//! hundred times as long as the arithmetic. Here it is one launch, and its gradient another.

use std::ffi::{c_int, c_void};
use std::sync::{Arc, Mutex, PoisonError};

use tch::{Device, Kind, Tensor};

use super::launch::{empty_beside, floats, floats_mut, on_stream};
use crate::autograd;

/// What is computed from up to three numbers a, b and c.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(i32)]
pub enum ScalarOperation {
    Plus,
    Minus,
    Times,
    Over,
    /// `a + b c`.
    PlusProduct,
    /// `a - b c`.
    MinusProduct,
    /// The root of `a^2 + b^2`.
    Norm,
    Negative,
    Sqrt,
    Exp,
    Ln,
    Sin,
    Cos,
    Tan,
    Tanh,
    Sigmoid,
    Abs,
    Sign,
    Power,
    Atan2,
    /// Of two that are computed; where they are equal each has half of the gradient.
    Min,
    Max,
    /// Of what is computed and a number, which has no gradient.
    AtMost,
    AtLeast,
}

/// An operation on the numbers in these slots.
#[derive(Debug, Clone, Copy)]
pub struct Instruction {
    pub operation: ScalarOperation,
    /// As many as the operation takes; any others for the rest.
    pub slots: [usize; 3],
    /// Of which of them a gradient is wanted.
    pub learns: [bool; 3],
}

/// The slot of what is held for the frame (what acts, or the time), of the time since the frame, and of the state:
/// positions, then velocities. The parameters follow, the numbers, and the results of the instructions in their order.
pub const HELD: usize = 0;
pub const SINCE: usize = 1;
pub const STATE: usize = 2;

/// Slots of the walls.
#[derive(Debug, Clone, Copy)]
pub struct BarrierSlots {
    /// Where they stand, of x and of y.
    pub near: [usize; 2],
    pub far: [usize; 2],
    /// What they leave of a speed.
    pub left: usize,
}

/// A substep of an equation as a list.
#[derive(Debug)]
pub struct SubstepListing {
    /// Of all objects.
    pub coordinates: usize,
    pub parameters: usize,
    /// What stands in the list.
    pub numbers: Vec<f32>,
    /// What depends on the parameters alone, and what changes with the state.
    pub still: Vec<Instruction>,
    pub moving: Vec<Instruction>,
    /// Slots of the positions after a substep, then of the velocities: each a result of its own of what changes.
    pub moved: Vec<usize>,
    pub barrier: Option<BarrierSlots>,
    /// Whether what is held is the time, which goes on where the dataset ends.
    pub tells_time: bool,
    pub substeps: usize,
    /// Time of a frame.
    pub dt: f64,
}

/// An equation that is ready to be rolled out.
#[derive(Debug)]
pub struct Scalars {
    listing: SubstepListing,
    /// The list, on each device where it was used: a copy to a GPU cannot be recorded.
    texts: Mutex<Vec<Tensor>>,
}

/// As `PaigProgram` in `roll_out.cu`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct GpuProgram {
    text: *const i32,
    still: c_int,
    moving: c_int,
    coordinates: c_int,
    parameters: c_int,
    numbers: c_int,
    near: [c_int; 2],
    far: [c_int; 2],
    left: c_int,
    substeps: c_int,
    tells_time: c_int,
    h: f32,
    dt: f32,
}

/// As `PaigHeld` in `roll_out.cu`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct GpuHeldInputs {
    values: *const f32,
    frames: c_int,
    clip_step: c_int,
    frame_step: c_int,
}

unsafe extern "C" {
    fn paig_gpu_roll_out_room(program: GpuProgram, batch: c_int, backward: bool) -> usize;
    fn paig_gpu_roll_out(
        program: GpuProgram,
        initial: *const f32,
        parameters: *const f32,
        held: GpuHeldInputs,
        states: *mut f32,
        history: *mut f32,
        room: *mut f32,
        batch: c_int,
        frames: c_int,
        stream: *mut c_void,
    ) -> bool;
    fn paig_gpu_roll_out_backward(
        program: GpuProgram,
        gradient: *const f32,
        parameters: *const f32,
        held: GpuHeldInputs,
        history: *const f32,
        room: *mut f32,
        by_initial: *mut f32,
        by_clip: *mut f32,
        by_parameters: *mut f32,
        batch: c_int,
        frames: c_int,
        stream: *mut c_void,
    ) -> bool;
}

impl ScalarOperation {
    /// How many numbers it takes.
    pub fn operands(self) -> usize {
        use ScalarOperation::{
            Abs, Cos, Exp, Ln, MinusProduct, Negative, PlusProduct, Sigmoid, Sign, Sin, Sqrt, Tan, Tanh,
        };
        match self {
            PlusProduct | MinusProduct => 3,
            Negative | Sqrt | Exp | Ln | Sin | Cos | Tan | Tanh | Sigmoid | Abs | Sign => 1,
            _ => 2,
        }
    }
}

impl Instruction {
    /// As the kernel reads it: above the operation a bit for each number that learns.
    fn words(&self) -> [i32; 4] {
        let learns = (0..3).filter(|place| self.learns[*place]).map(|place| 0x100 << place).sum::<i32>();
        let [a, b, c] = self.slots.map(|slot| slot as i32);
        [self.operation as i32 | learns, a, b, c]
    }
}

impl SubstepListing {
    /// The slot of the first parameter.
    pub fn first_parameter(coordinates: usize) -> usize {
        STATE + 2 * coordinates
    }

    fn text(&self) -> Vec<i32> {
        let instructions = self.still.iter().chain(&self.moving).flat_map(Instruction::words);
        let moved = self.moved.iter().map(|slot| *slot as i32);
        let numbers = self.numbers.iter().map(|number| number.to_bits().cast_signed());
        instructions.chain(moved).chain(numbers).collect()
    }

    /// # Panics
    /// A slot that an instruction reads before it is written, or a state after a substep that is no result of one.
    fn check(&self) {
        let first = Self::first_parameter(self.coordinates) + self.parameters + self.numbers.len();
        let all = self.still.iter().chain(&self.moving);
        let last = all.enumerate().fold(first, |next, (place, instruction)| {
            assert!(
                instruction.slots.iter().all(|slot| *slot < next),
                "instruction {place} reads what is written later"
            );
            next + 1
        });
        let moving = first + self.still.len()..last;
        assert!(self.moved.len() == 2 * self.coordinates && self.moved.iter().all(|slot| moving.contains(slot)));
        let walls = self.barrier.map(|BarrierSlots { near, far, left }| [near[0], near[1], far[0], far[1], left]);
        assert!(walls.into_iter().flatten().all(|slot| slot < moving.start), "walls that stand");
        assert!(self.substeps > 0);
    }
}

impl Scalars {
    /// # Panics
    /// A list whose slots are not in order: a mistake in the program, never in its input.
    pub fn new(listing: SubstepListing) -> Self {
        listing.check();
        Scalars { listing, texts: Mutex::new(Vec::new()) }
    }

    /// The list on a device.
    fn text(&self, device: Device) -> Tensor {
        let mut texts = self.texts.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = texts.iter().find(|text| text.device() == device) {
            return known.shallow_clone();
        }
        let text = Tensor::from_slice(&self.listing.text()).to_device(device);
        texts.push(text.shallow_clone());
        text
    }

    /// With its text, which must live as long as it is used.
    fn program(&self, text: &Tensor) -> GpuProgram {
        let SubstepListing {
            coordinates, parameters, numbers, still, moving, barrier, tells_time, substeps, dt, ..
        } = &self.listing;
        let slot = |of: fn(&BarrierSlots) -> usize| barrier.as_ref().map_or(-1, |barrier| of(barrier) as c_int);
        GpuProgram {
            text: text.data_ptr().cast_const().cast(),
            still: still.len() as c_int,
            moving: moving.len() as c_int,
            coordinates: *coordinates as c_int,
            parameters: *parameters as c_int,
            numbers: numbers.len() as c_int,
            near: [slot(|walls| walls.near[0]), slot(|walls| walls.near[1])],
            far: [slot(|walls| walls.far[0]), slot(|walls| walls.far[1])],
            left: slot(|walls| walls.left),
            substeps: *substeps as c_int,
            tells_time: c_int::from(*tells_time),
            h: (dt / *substeps as f64) as f32,
            dt: *dt as f32,
        }
    }
}

impl GpuHeldInputs {
    /// What is held, `[batch, frames]`, side by side in memory or not.
    fn of(values: Option<&Tensor>) -> Self {
        let Some(values) = values else {
            return GpuHeldInputs { values: std::ptr::null(), frames: 0, clip_step: 0, frame_step: 0 };
        };
        let (size, stride) = (values.size(), values.stride());
        let [frames, clip_step, frame_step] = [size[1], stride[0], stride[1]].map(|n| n as c_int);
        GpuHeldInputs { values: values.data_ptr().cast_const().cast(), frames, clip_step, frame_step }
    }
}

/// The states of the next `frames` frames, `[frames, 2, batch, coordinates]` (positions, velocities), from `initial`
/// (`[batch, 2 * coordinates]`, positions then velocities) and raw `parameters` (`[parameters]`), differentiable by
/// both. `held` (`[batch, frames]`) is what the dataset holds for each frame, if anything.
///
/// # Panics
/// Tensors of other sizes, no clip, no frame.
pub fn roll_out(
    scalars: &Arc<Scalars>,
    initial: &Tensor,
    parameters: &Tensor,
    held: Option<&Tensor>,
    frames: usize,
) -> Tensor {
    let listing = &scalars.listing;
    let (coordinates, batch) = (listing.coordinates as i64, initial.size()[0]);
    assert!(batch > 0 && frames > 0 && initial.size()[1] == 2 * coordinates, "states of the equation");
    assert_eq!(parameters.size(), [listing.parameters as i64], "parameters of the equation");
    let beside = |tensor: &Tensor| tensor.kind() == Kind::Float && tensor.device() == initial.device();
    assert!(held.is_none_or(|held| beside(held) && held.size()[0] == batch), "a row for each clip");
    let inputs = [initial, parameters];
    let records = autograd::records(&inputs);
    let [initial, parameters] = inputs.map(|input| input.detach().contiguous());
    let held = held.map(Tensor::detach);
    let text = scalars.text(initial.device());
    let substeps = if records { (frames * listing.substeps) as i64 } else { 0 };
    let mut states = empty_beside(&initial, &[frames as i64, 2, batch, coordinates]);
    let mut history = empty_beside(&initial, &[substeps, 2 * coordinates, batch]);
    let mut room = room(scalars, &text, &initial, false);
    let into = [&mut states, &mut room].map(floats_mut);
    let past = if records { floats_mut(&mut history) } else { std::ptr::null_mut() };
    // SAFETY: tensors of the sizes that are said, which live on the stream as long as the launch needs them.
    on_stream(&initial, |stream| unsafe {
        let ([states, room], program, acts) = (into, scalars.program(&text), GpuHeldInputs::of(held.as_ref()));
        let [from, values] = [&initial, &parameters].map(floats);
        paig_gpu_roll_out(program, from, values, acts, states, past, room, batch as c_int, frames as c_int, stream)
    });
    if !records {
        return states;
    }
    let scalars = scalars.clone();
    autograd::attach(states, &inputs, move |gradient| {
        backward(&scalars, &gradient.contiguous(), &parameters, held.as_ref(), &history)
    })
}

/// The gradients by the initial state and by the parameters.
fn backward(
    scalars: &Scalars,
    gradient: &Tensor,
    parameters: &Tensor,
    held: Option<&Tensor>,
    history: &Tensor,
) -> Vec<Tensor> {
    let (frames, _, batch, coordinates) = gradient.size4().expect("states of all frames");
    let count = parameters.size()[0];
    let text = scalars.text(gradient.device());
    let mut by_initial = empty_beside(gradient, &[batch, 2 * coordinates]);
    let mut by_clip = empty_beside(gradient, &[count, batch]);
    let mut by_parameters = empty_beside(gradient, &[count]);
    let mut room = room(scalars, &text, gradient, true);
    let into = [&mut by_initial, &mut by_clip, &mut by_parameters, &mut room].map(floats_mut);
    // SAFETY: as above.
    on_stream(gradient, |stream| unsafe {
        let ([by_initial, by_clip, by_parameters, room], held) = (into, GpuHeldInputs::of(held));
        let ([gradient, parameters, history], program) =
            ([gradient, parameters, history].map(floats), scalars.program(&text));
        let (batch, frames) = (batch as c_int, frames as c_int);
        paig_gpu_roll_out_backward(
            program,
            gradient,
            parameters,
            held,
            history,
            room,
            by_initial,
            by_clip,
            by_parameters,
            batch,
            frames,
            stream,
        )
    });
    vec![by_initial, by_parameters]
}

/// Memory for what a multiprocessor's own has no room for; `states` are initial ones, or the gradient of all.
fn room(scalars: &Scalars, text: &Tensor, states: &Tensor, backward: bool) -> Tensor {
    let batch = states.size()[states.dim() - 2];
    // SAFETY: only counts.
    let floats = unsafe { paig_gpu_roll_out_room(scalars.program(text), batch as c_int, backward) };
    empty_beside(states, &[floats as i64])
}

#[cfg(test)]
mod tests {
    use ScalarOperation::*;

    use super::super::testing::{scattered, test_device};
    use super::*;

    /// One coordinate, accelerated by what an operation gives of the position, the velocity and a parameter.
    fn equation(operation: ScalarOperation, padding: usize) -> Arc<Scalars> {
        let limit = STATE + 3;
        let slots = match operation {
            AtMost | AtLeast => [STATE, limit, limit],
            _ => [STATE, STATE + 1, STATE + 2],
        };
        let first = limit + 2;
        let step = limit + 1;
        let learns = [0, 1, 2].map(|place| place < operation.operands() && slots[place] != limit);
        let move_on = |to: usize, by: usize| Instruction {
            operation: PlusProduct,
            slots: [to, by, step],
            learns: [true, true, false],
        };
        let mut moving =
            vec![Instruction { operation, slots, learns }, move_on(STATE + 1, first), move_on(STATE, first + 1)];
        moving.extend(vec![Instruction { operation: Negative, slots: [HELD; 3], learns: [false; 3] }; padding]);
        let (substeps, dt) = (2, 0.2);
        Arc::new(Scalars::new(SubstepListing {
            coordinates: 1,
            parameters: 1,
            numbers: vec![0.5, (dt / substeps as f64) as f32],
            still: Vec::new(),
            moving,
            moved: vec![first + 2, first + 1],
            barrier: None,
            tells_time: false,
            substeps,
            dt,
        }))
    }

    /// The operation on tensors.
    fn of_tensors(operation: ScalarOperation, [a, b, c]: [&Tensor; 3]) -> Tensor {
        match operation {
            Plus => a + b,
            Minus => a - b,
            Times => a * b,
            Over => a / b,
            PlusProduct => a + b * c,
            MinusProduct => a - b * c,
            Norm => (a * a + b * b).sqrt(),
            Negative => -a,
            Sqrt => a.sqrt(),
            Exp => a.exp(),
            Ln => a.log(),
            Sin => a.sin(),
            Cos => a.cos(),
            Tan => a.tan(),
            Tanh => a.tanh(),
            Sigmoid => a.sigmoid(),
            Abs => a.abs(),
            Sign => a.sign(),
            Power => a.pow(b),
            Atan2 => a.atan2(b),
            Min => a.minimum(b),
            Max => a.maximum(b),
            AtMost => a.clamp_max(0.5),
            AtLeast => a.clamp_min(0.5),
        }
    }

    const ALL: [ScalarOperation; 24] = [
        Plus,
        Minus,
        Times,
        Over,
        PlusProduct,
        MinusProduct,
        Norm,
        Negative,
        Sqrt,
        Exp,
        Ln,
        Sin,
        Cos,
        Tan,
        Tanh,
        Sigmoid,
        Abs,
        Sign,
        Power,
        Atan2,
        Min,
        Max,
        AtMost,
        AtLeast,
    ];

    /// The largest difference, in parts of the largest number.
    fn difference(a: &Tensor, b: &Tensor) -> f64 {
        (a - b).abs().max().double_value(&[]) / b.abs().max().double_value(&[]).max(1.0)
    }

    /// States, and gradients of a weighted sum of them by the initial state and by the parameter.
    fn results(device: Device, roll: impl Fn(&Tensor, &Tensor) -> Tensor) -> [Tensor; 3] {
        // Numbers that each operation takes.
        let initial = scattered(&[35, 2], 2.3) * 0.15 + Tensor::from_slice(&[0.45f32, 0.85]);
        let initial = initial.to_device(device).set_requires_grad(true);
        let parameter = Tensor::from_slice(&[0.7f32]).to_device(device).set_requires_grad(true);
        let states = roll(&initial, &parameter);
        let weights = scattered(&states.size(), 1.7).to_device(device);
        (&states * weights).sum(Kind::Float).backward();
        // Where the operation takes no parameter libtorch has no gradient by it.
        let by_parameter = parameter.grad();
        let by_parameter = if by_parameter.defined() { by_parameter } else { parameter.zeros_like() };
        [states.detach(), initial.grad(), by_parameter]
    }

    #[test]
    fn each_operation_is_that_of_tensors_with_its_gradients() {
        let Some(device) = test_device() else { return };
        for operation in ALL {
            let found =
                results(device, |initial, parameter| roll_out(&equation(operation, 0), initial, parameter, None, 3));
            let expected = results(device, |initial, parameter| {
                let h = 0.1;
                let [mut pos, mut vel] = [initial.narrow(1, 0, 1), initial.narrow(1, 1, 1)];
                let mut states = Vec::new();
                for substep in 0..6 {
                    vel = &vel + of_tensors(operation, [&pos, &vel, parameter]) * h;
                    pos = &pos + &vel * h;
                    if substep % 2 == 1 {
                        states.push(Tensor::stack(&[&pos, &vel], 0));
                    }
                }
                Tensor::stack(&states, 0)
            });
            for (found, expected) in found.iter().zip(&expected) {
                assert!(difference(found, expected) < 2e-5, "{operation:?}: {found} instead of {expected}");
            }
        }
    }

    /// One that is too long for a multiprocessor's own memory.
    #[test]
    fn a_long_list_gives_the_same() {
        let Some(device) = test_device() else { return };
        let roll = |padding| {
            let equation = equation(Times, padding);
            results(device, |initial, parameter| roll_out(&equation, initial, parameter, None, 3))
        };
        for (long, short) in roll(2000).iter().zip(&roll(0)) {
            assert_eq!(long, short);
        }
    }

    /// No gradient is asked for, so nothing is kept; the states are the same.
    #[test]
    fn states_without_gradients_are_the_same() {
        let Some(device) = test_device() else { return };
        let equation = equation(Times, 0);
        let initial = Tensor::rand([70, 2], (Kind::Float, device));
        let parameter = Tensor::from_slice(&[0.7f32]).to_device(device).set_requires_grad(true);
        let taught = roll_out(&equation, &initial, &parameter, None, 4);
        let alone = tch::no_grad(|| roll_out(&equation, &initial, &parameter, None, 4));
        assert!(taught.requires_grad() && !alone.requires_grad());
        assert_eq!(taught.detach(), alone);
    }
}
