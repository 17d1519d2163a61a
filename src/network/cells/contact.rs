//! Contact of two discs within a substep, once for single numbers and for tensors.

use super::impact::{Impact, slowed};

/// What a contact adds to a state a substep later: velocities, and positions by what is left of the substep.
pub(super) struct Recoil<I> {
    /// Change of the relative velocity, object two minus object one, x and y; 0 where there is no contact.
    pub velocity: [I; 2],
    /// Change of the relative position.
    pub position: [I; 2],
}

/// Contact of two discs whose centres are `distance` apart when they touch. States are relative, object two minus object one:
/// position and velocity where the substep begins and where it ends without contact, over which the way is taken to be straight.
/// `left` is the share of the closing speed that is left, `friction` Coulomb's coefficient (none of smooth discs), `h` the length of
/// the substep.
///
/// The time of impact follows from the way, so that the path goes evenly with every parameter: no penalty force, no jump as an
/// impact moves from one substep to the next.
pub(super) fn recoil<I: Impact>(
    [before, now]: [([&I; 2], [&I; 2]); 2],
    distance: &I,
    (left, friction): (&I, Option<&I>),
    h: &I,
) -> Recoil<I> {
    let dot = |a: [&I; 2], b: [&I; 2]| a[0].times(b[0]).plus(&a[1].times(b[1]));
    let way = [0, 1].map(|axis| now.0[axis].minus(before.0[axis]));
    let begin = before.0;
    // |begin + s way| = distance: a s^2 + 2 b s + c = 0.
    let (a, b) = (dot(way.each_ref(), way.each_ref()), dot(begin, way.each_ref()));
    let c = dot(begin, begin).minus(&distance.times(distance));
    let inner = b.times(&b).minus(&a.times(&c));
    // Apart at the beginning, on the way to each other, near enough.
    let apart = I::both(&I::not(&c.is_negative()), &b.is_negative());
    let meet = I::both(&apart, &inner.is_positive());
    // Where they do not meet, numbers whose root and ratio have a gradient.
    let [a, inner] = [a, inner].map(|number| number.or_else(&meet, &number.one_like()));
    let share = b.negative().minus(&inner.root()).over(&a);
    let meet = I::both(&meet, &share.is_within(&share.zero_like(), &share.one_like()));
    let at_impact = |from: &I, to: &I| from.plus(&to.minus(from).times(&share));
    let normal = [0, 1].map(|axis| begin[axis].plus(&way[axis].times(&share)).over(distance));
    let closing = [0, 1].map(|axis| at_impact(before.1[axis], now.1[axis]));
    let impulse = dot(closing.each_ref(), normal.each_ref()).times(&left.plus(&left.one_like())).negative();
    let impulse = impulse.or_else(&meet, &impulse.zero_like());
    let mut velocity = normal.each_ref().map(|part| impulse.times(part));
    if let Some(friction) = friction {
        let slowed = slowed(&closing, &normal, friction, &impulse);
        velocity = [0, 1].map(|axis| velocity[axis].plus(&slowed[axis]));
    }
    let rest = h.times(&share.one_like().minus(&share));
    let position = [0, 1].map(|axis| velocity[axis].times(&rest));
    Recoil { velocity, position }
}
