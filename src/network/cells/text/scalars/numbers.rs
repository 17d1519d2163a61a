//! Single numbers that are computed from each other, each once.
//!
//! Signs are kept beside the numbers, so what two objects do to each other is computed once: `p - q` of the one is that of the
//! other turned round.

use std::collections::HashMap;
use std::ops::Neg;

use crate::network::cells::parameter::Bounds;
use paig_kernels::gpu::roll_out::{BarrierSlots, HELD, Instruction, SINCE, STATE, ScalarOperation, SubstepListing};

/// A single number: where it comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ScalarSource {
    /// The bits of a number.
    Number(u32),
    /// An unconstrained parameter.
    Raw(usize),
    Held,
    Since,
    /// Of the positions, then of the velocities.
    State(usize),
    /// From numbers in these places, as many as the operation takes.
    Computed(ScalarOperation, [usize; 3]),
}

#[derive(Debug, Clone, Copy)]
struct ScalarNode {
    source: ScalarSource,
    /// Whether it changes with the state.
    moves: bool,
    /// Whether a gradient goes through it.
    learns: bool,
}

/// A number by its place among all, as it is or times -1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Signed {
    pub place: usize,
    pub negative: bool,
}

impl Neg for Signed {
    type Output = Signed;

    fn neg(self) -> Signed {
        Signed { negative: !self.negative, ..self }
    }
}

/// All numbers of a list that is being made.
#[derive(Debug, Default)]
pub struct Numbers {
    nodes: Vec<ScalarNode>,
    /// Of each number among the nodes.
    places: HashMap<ScalarSource, usize>,
}

/// What a list is told of the integration.
#[derive(Debug, Clone, Copy)]
pub struct Integration {
    /// Of all objects.
    pub coordinates: usize,
    pub parameters: usize,
    pub tells_time: bool,
    pub substeps: usize,
    /// Time of a frame.
    pub dt: f64,
}

impl Numbers {
    /// How many there are.
    pub fn count(&self) -> usize {
        self.nodes.len()
    }

    pub fn put(&mut self, source: ScalarSource) -> Signed {
        let Numbers { nodes, places } = self;
        let place = *places.entry(source).or_insert_with(|| {
            let of_any = |what: fn(&ScalarNode) -> bool, operation: ScalarOperation, operands: [usize; 3]| {
                operands[..operation.operands()].iter().any(|operand| what(&nodes[*operand]))
            };
            let (moves, learns) = match source {
                ScalarSource::Number(_) => (false, false),
                ScalarSource::Raw(_) => (false, true),
                ScalarSource::Held | ScalarSource::Since => (true, false),
                ScalarSource::State(_) => (true, true),
                ScalarSource::Computed(operation, operands) => {
                    (of_any(|node| node.moves, operation, operands), of_any(|node| node.learns, operation, operands))
                }
            };
            nodes.push(ScalarNode { source, moves, learns });
            nodes.len() - 1
        });
        Signed { place, negative: false }
    }

    pub fn number(&mut self, number: f64) -> Signed {
        let size = self.put(ScalarSource::Number((number.abs() as f32).to_bits()));
        if number < 0.0 { -size } else { size }
    }

    pub fn computed<const N: usize>(&mut self, operation: ScalarOperation, operands: [usize; N]) -> Signed {
        let mut all = [0; 3];
        all[..N].copy_from_slice(&operands);
        self.put(ScalarSource::Computed(operation, all))
    }

    /// The place of the number with its sign.
    pub(crate) fn with_sign(&mut self, x: Signed) -> usize {
        if x.negative { self.computed(ScalarOperation::Negative, [x.place]).place } else { x.place }
    }

    pub fn plus(&mut self, a: Signed, b: Signed) -> Signed {
        let [first, last] = [a.place.min(b.place), a.place.max(b.place)];
        let sign_of_first = if a.place <= b.place { a.negative } else { b.negative };
        let operation = if a.negative == b.negative { ScalarOperation::Plus } else { ScalarOperation::Minus };
        let sum = self.computed(operation, [first, last]);
        if sign_of_first { -sum } else { sum }
    }

    pub fn times(&mut self, a: Signed, b: Signed) -> Signed {
        let product = self.computed(ScalarOperation::Times, [a.place.min(b.place), a.place.max(b.place)]);
        Signed { negative: a.negative != b.negative, ..product }
    }

    pub fn over(&mut self, a: Signed, b: Signed) -> Signed {
        let quotient = self.computed(ScalarOperation::Over, [a.place, b.place]);
        Signed { negative: a.negative != b.negative, ..quotient }
    }

    /// `a + b c`.
    pub(crate) fn plus_product(&mut self, a: Signed, b: Signed, c: Signed) -> Signed {
        let same = a.negative == (b.negative != c.negative);
        let operation = if same { ScalarOperation::PlusProduct } else { ScalarOperation::MinusProduct };
        let sum = self.computed(operation, [a.place, b.place.min(c.place), b.place.max(c.place)]);
        Signed { negative: a.negative, ..sum }
    }

    /// The value that an unconstrained parameter stands for.
    pub fn bounded(&mut self, place: usize, bounds: Bounds) -> Signed {
        let unconstrained = self.put(ScalarSource::Raw(place));
        match bounds {
            Bounds::Above(0.0) => self.computed(ScalarOperation::Exp, [unconstrained.place]),
            Bounds::Above(low) => {
                let (above, low) = (self.computed(ScalarOperation::Exp, [unconstrained.place]), self.number(low));
                self.plus(above, low)
            }
            Bounds::Between(low, high) => {
                let (share, width) =
                    (self.computed(ScalarOperation::Sigmoid, [unconstrained.place]), self.number(high - low));
                let (above, low) = (self.times(share, width), self.number(low));
                self.plus(above, low)
            }
        }
    }

    /// Where a rate leads to in a time `h`.
    pub fn along(&mut self, from: &[Signed], rate: &[Signed], h: f64) -> Vec<Signed> {
        let h = self.number(h);
        from.iter().zip(rate).map(|(from, rate)| self.plus_product(*from, *rate, h)).collect()
    }

    /// Gives the numbers slots: those that something depends on. `moved` (without signs) and `barrier` are places here.
    pub fn listing(&self, of: Integration, moved: &[Signed], barrier: Option<BarrierSlots>) -> SubstepListing {
        let Integration { coordinates, parameters, tells_time, substeps, dt } = of;
        let walls = barrier.map(|BarrierSlots { near, far, left }| [near[0], near[1], far[0], far[1], left]);
        let mut used = vec![false; self.nodes.len()];
        moved.iter().map(|number| number.place).chain(walls.into_iter().flatten()).for_each(|place| used[place] = true);
        for (place, node) in self.nodes.iter().enumerate().rev() {
            if let (true, ScalarSource::Computed(operation, operands)) = (used[place], node.source) {
                operands[..operation.operands()].iter().for_each(|operand| used[*operand] = true);
            }
        }
        let chosen = |which: fn(&ScalarNode) -> bool| -> Vec<usize> {
            (0..used.len()).filter(|place| used[*place] && which(&self.nodes[*place])).collect()
        };
        let computed = |node: &ScalarNode| matches!(node.source, ScalarSource::Computed(..));
        let numbers = chosen(|node| matches!(node.source, ScalarSource::Number(_)));
        let [still, moving] = [chosen(|node| !node.moves), chosen(|node| node.moves)]
            .map(|places| places.into_iter().filter(|place| computed(&self.nodes[*place])).collect::<Vec<_>>());
        let mut slots: Vec<usize> = self.nodes.iter().map(|node| given_slot(node.source, coordinates)).collect();
        let first = SubstepListing::first_parameter(coordinates) + parameters;
        numbers.iter().chain(&still).chain(&moving).zip(first..).for_each(|(place, slot)| slots[*place] = slot);
        let instruction = |place: &usize| {
            let ScalarSource::Computed(operation, operands) = self.nodes[*place].source else {
                unreachable!("what is given is not computed")
            };
            let learns = [0, 1, 2].map(|i| i < operation.operands() && self.nodes[operands[i]].learns);
            Instruction {
                operation,
                slots: [0, 1, 2].map(|i| if i < operation.operands() { slots[operands[i]] } else { HELD }),
                learns,
            }
        };
        let number = |place: &usize| match self.nodes[*place].source {
            ScalarSource::Number(bits) => f32::from_bits(bits),
            _ => unreachable!("a number that stands in the list"),
        };
        SubstepListing {
            coordinates,
            parameters,
            numbers: numbers.iter().map(number).collect(),
            still: still.iter().map(instruction).collect(),
            moving: moving.iter().map(instruction).collect(),
            moved: moved.iter().map(|number| slots[number.place]).collect(),
            barrier: barrier.map(|BarrierSlots { near, far, left }| BarrierSlots {
                near: near.map(|place| slots[place]),
                far: far.map(|place| slots[place]),
                left: slots[left],
            }),
            tells_time,
            substeps,
            dt,
        }
    }
}

/// The slot of what comes from outside the list; of the rest any.
fn given_slot(source: ScalarSource, coordinates: usize) -> usize {
    match source {
        ScalarSource::Since => SINCE,
        ScalarSource::State(place) => STATE + place,
        ScalarSource::Raw(place) => SubstepListing::first_parameter(coordinates) + place,
        ScalarSource::Held | ScalarSource::Number(_) | ScalarSource::Computed(..) => HELD,
    }
}
