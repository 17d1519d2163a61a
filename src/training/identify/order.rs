//! Which object is which, where the equation tells them apart: by `p1` in a text, an acceleration for each, or a mass that is
//! known for each. The encoder numbers what it finds as it likes, so the order is taken in which the equation explains the
//! motion. Not in the original.

use anyhow::Result;

use super::{FitStart, MotionDetector, explain_some};
use crate::datasets::iterators::Clips;
use crate::network::physics_models::{DecoderKind, PhysicsNet};
use crate::support::statistics::is_smaller;

/// Most objects whose orders are tried: four have 24.
const MOST_OBJECTS: usize = 4;
/// Clips that are fitted in each order.
const CLIPS: usize = 50;

/// What another order must leave of the usual residual to be believed.
const CLEARLY_LESS: f64 = 0.7;

/// Numbers the model's objects anew, if the equation explains their motion clearly better in another order, and gives the
/// model the parameters that do. Gives the order: the old numbers, each at its new place. `begun`: the unconstrained
/// parameters of the parameters that the training began with.
///
/// # Errors
/// Positions that are not finite.
pub(super) fn find(
    model: &PhysicsNet,
    train: &Clips,
    motion: &MotionDetector,
    begun: &[f64],
) -> Result<Option<Vec<i64>>> {
    let objects = model.system.objects;
    let apart = model.tells_objects_apart() && model.options.decoder != DecoderKind::Mlp;
    if !apart || objects > MOST_OBJECTS {
        return Ok(None);
    }
    // Parameters that were fitted in a wrong order are no start for another.
    let start = FitStart { unconstrained: begun.to_vec(), ..FitStart::of(model) };
    let explained = |order: &[i64]| {
        model.reorder(order);
        let explanation = explain_some(model, train, motion, CLIPS, &start);
        model.reorder(&inverse(order));
        explanation
    };
    let mut orders = orders(objects).into_iter();
    let Some(as_it_is) = orders.next() else { return Ok(None) };
    let mut best = (explained(&as_it_is)?, as_it_is);
    let now = best.0.fit.usual_residual;
    // Where the order that stands leaves the numbers, any other that does not is better.
    let limit = if now.is_nan() { f64::INFINITY } else { CLEARLY_LESS * now };
    for order in orders {
        let explanation = explained(&order)?;
        let left = explanation.fit.usual_residual;
        if left <= limit && is_smaller(left, best.0.fit.usual_residual) {
            best = (explanation, order);
        }
    }
    let (explanation, order) = best;
    if order.is_sorted() {
        return Ok(None);
    }
    model.reorder(&order);
    explanation.apply(model);
    Ok(Some(order))
}

/// All orders of so many objects, the one that changes nothing first.
fn orders(objects: usize) -> Vec<Vec<i64>> {
    let Some(last) = objects.checked_sub(1) else { return vec![Vec::new()] };
    let with_last = |place: usize| {
        orders(last).into_iter().map(move |mut order| {
            order.insert(last - place, last as i64);
            order
        })
    };
    (0..objects).flat_map(with_last).collect()
}

fn inverse(order: &[i64]) -> Vec<i64> {
    let mut inverse = vec![0; order.len()];
    (0..).zip(order).for_each(|(place, &number)| inverse[number as usize] = place);
    inverse
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::{inverse, orders};

    #[test]
    fn every_order_is_tried_once_and_undone_by_its_inverse() {
        for (objects, count) in [(1, 1), (2, 2), (3, 6), (4, 24)] {
            let all = orders(objects);
            assert_eq!(all[0], (0..objects as i64).collect::<Vec<_>>());
            assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), count);
            for order in &all {
                let back = inverse(order);
                assert!((0..objects).all(|place| order[back[place] as usize] == place as i64), "{order:?} {back:?}");
            }
        }
    }
}
