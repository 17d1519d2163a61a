//! Interaction network (Battaglia et al. 2016): what each object does to each other one, and what becomes of each.
//!
//! ```text
//! e_ij = relation(o_i, o_j)           for each ordered pair i != j
//! change of p_i = object(o_i, sum_j e_ij)
//! ```
//!
//! `o_i` are the positions of object i in the last L frames, and what acted in them. Both networks are shared by all
//! objects.

use tch::Tensor;

use super::{Features, Predictor, SEEN, keep_last};
use crate::network::blocks::{Activation, Layers, Mlp};

/// Units of a hidden layer.
const HIDDEN: usize = 100;
/// Numbers of an effect e_ij.
const EFFECT: usize = 50;

/// Relation network and object network.
#[derive(Debug)]
pub struct InteractionNetwork {
    /// None where there is only one object.
    relation: Option<Mlp>,
    object: Mlp,
    features: Features,
}

impl InteractionNetwork {
    pub(super) fn new(layers: &mut Layers, features: &Features) -> Self {
        let of_object = features.frames * (SEEN + features.actions);
        let mut mlp = |widths: &[usize]| Mlp::new(layers, widths, Activation::Relu, Activation::None);
        let relation = (features.objects > 1).then(|| mlp(&[2 * of_object, HIDDEN, HIDDEN, HIDDEN, EFFECT]));
        let object = mlp(&[of_object + EFFECT, HIDDEN, HIDDEN, features.coordinates]);
        InteractionNetwork { relation, object, features: *features }
    }

    /// `[batch, objects, features of an object]` to the changes of the positions `[batch, coordinates * objects]`.
    pub fn forward(&self, objects: &Tensor) -> Tensor {
        let effects = self.relation.as_ref().map_or_else(
            || Tensor::zeros([objects.size()[0], 1, EFFECT as i64], (objects.kind(), objects.device())),
            |relation| effects(relation, objects),
        );
        self.object.forward(&Tensor::cat(&[objects, &effects], 2)).flatten(1, 2)
    }

    /// The last frames by object, `[batch, objects, features of an object]`.
    fn objects(&self, memory: &[Tensor]) -> Tensor {
        let objects = self.features.objects as i64;
        let of_frame = |frame: &Tensor| {
            let parts = frame.split_with_sizes([self.features.in_positions() as i64, self.features.actions as i64], 1);
            let positions = parts[0].reshape([-1, objects, SEEN as i64]);
            Tensor::cat(&[positions, parts[1].unsqueeze(1).expand([-1, objects, -1], false)], 2)
        };
        Tensor::cat(&memory.iter().map(of_frame).collect::<Vec<_>>(), 2)
    }
}

/// The sum of the effects on each object, `[batch, objects, EFFECT]`.
fn effects(relation: &Mlp, objects: &Tensor) -> Tensor {
    let count = objects.size()[1];
    let on = |receiver: i64| {
        let o_i = objects.select(1, receiver);
        let pairs = (0..count).filter(|sender| *sender != receiver);
        let pairs: Vec<_> = pairs.map(|sender| Tensor::cat(&[&o_i, &objects.select(1, sender)], 1)).collect();
        Tensor::stack(&pairs, 1)
    };
    // [batch, receiver, sender, both objects]
    let pairs = Tensor::stack(&(0..count).map(on).collect::<Vec<_>>(), 1);
    relation.forward(&pairs).sum_dim_intlist([2i64].as_slice(), false, None)
}

impl Predictor for InteractionNetwork {
    fn see(&self, memory: &mut Vec<Tensor>, frame: &Tensor) {
        keep_last(memory, frame, self.features.frames);
    }

    fn change(&self, memory: &[Tensor]) -> Tensor {
        self.forward(&self.objects(memory))
    }
}
