//! Impact of a ball that a force moves on a wall, once for single numbers and for tensors.

use num_traits::Float;
use tch::Tensor;

/// The least restitution that is taken back when time runs backwards: a ball that lost all its speed has no past.
pub(super) const LEAST_RESTITUTION: f64 = 0.1;

/// What an impact is computed with.
pub(super) trait Impact: Sized {
    /// Whether something is so, for each number.
    type Mask;

    fn copy(&self) -> Self;
    fn zero_like(&self) -> Self;
    fn one_like(&self) -> Self;
    fn plus(&self, other: &Self) -> Self;
    fn minus(&self, other: &Self) -> Self;
    fn negative(&self) -> Self;
    fn root(&self) -> Self;
    fn sine(&self) -> Self;
    fn cosine(&self) -> Self;
    fn scaled(&self, factor: f64) -> Self;
    fn times(&self, other: &Self) -> Self;
    fn over(&self, other: &Self) -> Self;
    fn between(&self, least: &Self, most: &Self) -> Self;
    /// Between 0 and 1.
    fn as_share(&self) -> Self;
    /// Not beyond one of the two.
    fn is_within(&self, least: &Self, most: &Self) -> Self::Mask;
    fn is_zero(&self) -> Self::Mask;
    fn is_negative(&self) -> Self::Mask;
    fn is_positive(&self) -> Self::Mask;
    fn both(one: &Self::Mask, other: &Self::Mask) -> Self::Mask;
    fn either(one: &Self::Mask, other: &Self::Mask) -> Self::Mask;
    fn not(mask: &Self::Mask) -> Self::Mask;
    fn any(mask: &Self::Mask) -> bool;
    /// 1 where the mask is set.
    fn one_where(&self, mask: &Self::Mask) -> Self;
    /// `other` where the mask is not set.
    fn or_else(&self, mask: &Self::Mask, other: &Self) -> Self;
}

/// The share of a closing speed that is left after an impact in a substep of length `h`. Back in time an impact gives what it took.
pub(super) fn left_after<I: Impact>(left: &I, h: f64) -> I {
    if h < 0.0 {
        let one = left.one_like();
        one.over(&left.between(&one.scaled(LEAST_RESTITUTION), &one))
    } else {
        left.copy()
    }
}

/// Change of a velocity by Coulomb's friction: at most `friction` times the normal `impulse`, which is not negative, of its tangential
/// part.
pub(super) fn slowed<I: Impact>(velocity: &[I; 2], normal: &[I; 2], friction: &I, impulse: &I) -> [I; 2] {
    let tangent = [normal[1].negative(), normal[0].copy()];
    let most = friction.times(impulse);
    let along = velocity[0].times(&tangent[0]).plus(&velocity[1].times(&tangent[1]));
    let taken = along.between(&most.negative(), &most);
    tangent.map(|part| part.times(&taken).negative())
}

/// Positions and velocities after the walls have turned back what has passed them, each with the share `left` of its speed
/// (none for all of it). `before` is where the substep began; tensors are of one shape, with which the walls go together.
///
/// What the force gave after the impact counts on the way back. Otherwise a path would jump by twice what a substep gives as
/// its impact moves from one substep to the next, and the ball would gain energy at every wall: no fit stands still on such
/// a cost, and what it finds is biased.
pub(super) fn turned_back<I: Impact>(
    before: [&I; 2],
    [pos, vel]: [&I; 2],
    [near, far]: [&I; 2],
    left: Option<&I>,
) -> [I; 2] {
    let inside = pos.is_within(near, far);
    let wall = pos.between(near, far);
    let way = pos.minus(before[0]).one_where(&inside);
    // A ball that stands behind the wall has had its impact before.
    let way = way.one_where(&way.is_zero());
    let since = pos.minus(&wall).over(&way).as_share();
    let gained = vel.minus(before[1]).times(&since);
    let part = |of: I| match left {
        Some(left) => of.times(left),
        None => of,
    };
    let back = gained.minus(&part(vel.minus(&gained)));
    let vel = vel.or_else(&inside, &back);
    [wall.minus(&part(pos.minus(&wall))), vel]
}

impl Impact for Tensor {
    type Mask = Tensor;

    fn copy(&self) -> Tensor {
        self.shallow_clone()
    }

    fn zero_like(&self) -> Tensor {
        self.zeros_like()
    }

    fn one_like(&self) -> Tensor {
        self.ones_like()
    }

    fn plus(&self, other: &Tensor) -> Tensor {
        self + other
    }

    fn negative(&self) -> Tensor {
        -self
    }

    fn root(&self) -> Tensor {
        self.sqrt()
    }

    fn sine(&self) -> Tensor {
        self.sin()
    }

    fn cosine(&self) -> Tensor {
        self.cos()
    }

    fn scaled(&self, factor: f64) -> Tensor {
        self * factor
    }

    fn minus(&self, other: &Tensor) -> Tensor {
        self - other
    }

    fn times(&self, other: &Tensor) -> Tensor {
        self * other
    }

    fn over(&self, other: &Tensor) -> Tensor {
        self / other
    }

    fn between(&self, least: &Tensor, most: &Tensor) -> Tensor {
        self.clamp_tensor(Some(least), Some(most))
    }

    fn as_share(&self) -> Tensor {
        self.clamp(0.0, 1.0)
    }

    fn is_within(&self, least: &Tensor, most: &Tensor) -> Tensor {
        self.gt_tensor(most).logical_or(&self.lt_tensor(least)).logical_not()
    }

    fn is_zero(&self) -> Tensor {
        self.eq(0.0)
    }

    fn is_negative(&self) -> Tensor {
        self.lt(0.0)
    }

    fn is_positive(&self) -> Tensor {
        self.gt(0.0)
    }

    fn both(one: &Tensor, other: &Tensor) -> Tensor {
        one.logical_and(other)
    }

    fn either(one: &Tensor, other: &Tensor) -> Tensor {
        one.logical_or(other)
    }

    fn not(mask: &Tensor) -> Tensor {
        mask.logical_not()
    }

    fn any(mask: &Tensor) -> bool {
        mask.any().int64_value(&[]) != 0
    }

    fn one_where(&self, mask: &Tensor) -> Tensor {
        self.ones_like().where_self(mask, self)
    }

    fn or_else(&self, mask: &Tensor, other: &Tensor) -> Tensor {
        self.where_self(mask, other)
    }
}

/// A single number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Single<F>(pub F);

impl<F: Float> Impact for Single<F> {
    type Mask = bool;

    fn copy(&self) -> Self {
        *self
    }

    fn zero_like(&self) -> Self {
        Single(F::zero())
    }

    fn one_like(&self) -> Self {
        Single(F::one())
    }

    fn plus(&self, other: &Self) -> Self {
        Single(self.0 + other.0)
    }

    fn negative(&self) -> Self {
        Single(-self.0)
    }

    fn root(&self) -> Self {
        Single(self.0.sqrt())
    }

    fn sine(&self) -> Self {
        Single(self.0.sin())
    }

    fn cosine(&self) -> Self {
        Single(self.0.cos())
    }

    fn scaled(&self, factor: f64) -> Self {
        Single(self.0 * F::from(factor).expect("a float of any width holds a float64"))
    }

    fn minus(&self, other: &Self) -> Self {
        Single(self.0 - other.0)
    }

    fn times(&self, other: &Self) -> Self {
        Single(self.0 * other.0)
    }

    fn over(&self, other: &Self) -> Self {
        Single(self.0 / other.0)
    }

    fn between(&self, least: &Self, most: &Self) -> Self {
        Single(self.0.max(least.0).min(most.0))
    }

    fn as_share(&self) -> Self {
        Single(self.0.max(F::zero()).min(F::one()))
    }

    fn is_within(&self, least: &Self, most: &Self) -> bool {
        self.0 <= most.0 && self.0 >= least.0
    }

    fn is_zero(&self) -> bool {
        self.0.is_zero()
    }

    fn is_negative(&self) -> bool {
        self.0 < F::zero()
    }

    fn is_positive(&self) -> bool {
        self.0 > F::zero()
    }

    fn both(one: &bool, other: &bool) -> bool {
        *one && *other
    }

    fn either(one: &bool, other: &bool) -> bool {
        *one || *other
    }

    fn not(mask: &bool) -> bool {
        !mask
    }

    fn any(mask: &bool) -> bool {
        *mask
    }

    fn one_where(&self, mask: &bool) -> Self {
        if *mask { Single(F::one()) } else { *self }
    }

    fn or_else(&self, mask: &bool, other: &Self) -> Self {
        if *mask { *self } else { *other }
    }
}
