//! What a wall does to a ball that a force moves.

use tch::Tensor;

/// Positions and velocities after the walls have turned back what has passed them, each with the share `left` of its speed
/// (none for all of it). `before` is where the substep began; all of one shape, with which the walls go together.
///
/// What the force gave after the impact counts on the way back. Otherwise a path would jump by twice what a substep gives as
/// its impact moves from one substep to the next, and the ball would gain energy at every wall: no fit stands still on such
/// a cost, and what it finds is biased.
pub(super) fn turned_back(
    before: [&Tensor; 2],
    [pos, vel]: [Tensor; 2],
    [near, far]: [&Tensor; 2],
    left: Option<&Tensor>,
) -> [Tensor; 2] {
    let outside = pos.gt_tensor(far).logical_or(&pos.lt_tensor(near));
    let wall = pos.clamp_tensor(Some(near), Some(far));
    let way = pos.ones_like().where_self(&outside.logical_not(), &(&pos - before[0]));
    // A ball that stands behind the wall has had its impact before.
    let way = way.ones_like().where_self(&way.eq(0.0), &way);
    let since = ((&pos - &wall) / way).clamp(0.0, 1.0);
    let gained = (&vel - before[1]) * since;
    let part = |x: Tensor| left.map_or_else(|| x.shallow_clone(), |left| &x * left);
    let back = &gained - part(&vel - &gained);
    let vel = back.where_self(&outside, &vel);
    let pos = &wall - part(&pos - &wall);
    [pos, vel]
}
