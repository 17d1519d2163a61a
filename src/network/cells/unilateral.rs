//! Unilateral constraints within a substep, once for single numbers and for tensors: lines and circles that objects bounce off,
//! strings that go slack.
//!
//! Each constraint keeps a gap from becoming negative. The time of impact is the root of a quadratic polynomial through the gap
//! at both ends of the substep and its rate at the first, which is exact for a line under a constant acceleration. An object whose
//! next flight would end within a substep rests: it is put on the constraint, its normal velocity is removed, and while it is pressed
//! its normal acceleration is cancelled at every stage of the integration. Without that rule bounces would become infinitely many.

use super::impact::{Impact, left_after, slowed};

/// Where a constraint keeps the position of what it holds.
#[derive(Debug, Clone)]
pub(super) enum AllowedRegion<I> {
    /// Half-plane: a point of the line, and the unit normal into the half-plane.
    HalfPlane { point: [I; 2], normal: [I; 2] },
    /// Outside or inside of a circle about a centre.
    Circle { centre: [I; 2], outside: bool },
}

/// What a constraint holds.
#[derive(Debug, Clone)]
pub(super) enum Held<I> {
    Object(usize),
    /// The position of the second relative to the first, and the share that each takes of a change of it.
    Pair {
        objects: [usize; 2],
        shares: [I; 2],
    },
}

/// A unilateral constraint with the values of its parameters.
#[derive(Debug, Clone)]
pub(super) struct UnilateralConstraint<I> {
    pub region: AllowedRegion<I>,
    /// Distance from the line or the centre at contact, pixels.
    pub distance: I,
    /// Share of the closing speed that is left, 0 to 1.
    pub restitution: I,
    /// Coulomb's coefficient; none for a smooth contact.
    pub friction: Option<I>,
    pub held: Held<I>,
}

/// How far a position is from a constraint.
struct Gap<I> {
    /// Negative beyond the constraint.
    size: I,
    /// Its gradient, a unit vector.
    normal: [I; 2],
    /// Its second derivative along the tangent; none of a line.
    bend: Option<I>,
}

/// What a constraint does for a substep to what lies on it.
pub(super) struct Support<I: Impact> {
    rests: I::Mask,
    /// Whether anything rests.
    any: bool,
    /// Normal acceleration that is cancelled where the substep begins; 0 of what does not rest.
    pressure: I,
    /// Tangential acceleration by friction; none of a smooth contact.
    drag: Option<I>,
}

fn dot<I: Impact>(a: &[I; 2], b: &[I; 2]) -> I {
    a[0].times(&b[0]).plus(&a[1].times(&b[1]))
}

fn minus<I: Impact>(a: &[I; 2], b: &[I; 2]) -> [I; 2] {
    [0, 1].map(|axis| a[axis].minus(&b[axis]))
}

fn plus<I: Impact>(a: &[I; 2], b: &[I; 2]) -> [I; 2] {
    [0, 1].map(|axis| a[axis].plus(&b[axis]))
}

fn times<I: Impact>(a: &[I; 2], factor: &I) -> [I; 2] {
    a.each_ref().map(|part| part.times(factor))
}

fn scaled<I: Impact>(a: &[I; 2], factor: f64) -> [I; 2] {
    a.each_ref().map(|part| part.scaled(factor))
}

fn tangent<I: Impact>(normal: &[I; 2]) -> [I; 2] {
    [normal[1].negative(), normal[0].copy()]
}

/// The greater of a number and 0.
fn positive_part<I: Impact>(x: &I) -> I {
    x.or_else(&x.is_positive(), &x.zero_like())
}

impl<I: Impact> Gap<I> {
    fn rate(&self, velocity: &[I; 2]) -> I {
        dot(&self.normal, velocity)
    }

    /// Second derivative by time.
    fn acceleration(&self, velocity: &[I; 2], acceleration: &[I; 2]) -> I {
        let straight = dot(&self.normal, acceleration);
        let Some(bend) = &self.bend else { return straight };
        let across = self.normal[0].times(&velocity[1]).minus(&self.normal[1].times(&velocity[0]));
        straight.plus(&bend.times(&across.times(&across)))
    }
}

impl<I: Impact> UnilateralConstraint<I> {
    fn of(&self, values: &[I]) -> [I; 2] {
        let object = |object: usize| [values[2 * object].copy(), values[2 * object + 1].copy()];
        match &self.held {
            Held::Object(one) => object(*one),
            Held::Pair { objects: [first, second], .. } => minus(&object(*second), &object(*first)),
        }
    }

    fn change(&self, values: &mut [I], by: &[I; 2]) {
        let mut object = |object: usize, by: &[I; 2]| {
            (0..2).for_each(|axis| values[2 * object + axis] = values[2 * object + axis].plus(&by[axis]));
        };
        match &self.held {
            Held::Object(one) => object(*one, by),
            Held::Pair { objects: [first, second], shares: [of_first, of_second] } => {
                object(*first, &times(by, &of_first.negative()));
                object(*second, &times(by, of_second));
            }
        }
    }

    fn gap(&self, at: &[I; 2]) -> Gap<I> {
        match &self.region {
            AllowedRegion::HalfPlane { point, normal } => {
                let size = dot(&minus(at, point), normal).minus(&self.distance);
                Gap { size, normal: normal.each_ref().map(I::copy), bend: None }
            }
            AllowedRegion::Circle { centre, outside } => {
                let arm = minus(at, centre);
                let square = dot(&arm, &arm);
                // At the centre no direction, and a root that has a gradient.
                let square = square.or_else(&I::not(&square.is_zero()), &square.one_like());
                let radius = square.root();
                let per_pixel = radius.one_like().over(&radius);
                let (size, normal) = (radius.minus(&self.distance), times(&arm, &per_pixel));
                if *outside {
                    return Gap { size, normal, bend: Some(per_pixel) };
                }
                let normal = normal.each_ref().map(I::negative);
                // Near the centre nothing is held, however fast it turns.
                let least = self.distance.scaled(0.5);
                let bend = radius.or_else(&radius.minus(&least).is_positive(), &least);
                Gap { size: size.negative(), normal, bend: Some(bend.one_like().over(&bend).negative()) }
            }
        }
    }

    /// Puts what is beyond the constraint on it, and what rests on it to rest. The `acceleration` loses what is cancelled.
    fn support(&self, [pos, vel]: [&mut [I]; 2], acceleration: &mut [I], h: f64) -> Support<I> {
        let gap = self.gap(&self.of(pos));
        let velocity = self.of(vel);
        let (rate, second) = (gap.rate(&velocity), gap.acceleration(&velocity, &self.of(acceleration)));
        let height = positive_part(&gap.size);
        // A flight from rate and height takes 2 sqrt(rate^2 - 2 second height) / |second|.
        let flight = rate.times(&rate).minus(&second.times(&height).scaled(2.0));
        let most = second.scaled(h / 2.0);
        let short = I::not(&flight.minus(&most.times(&most)).is_positive());
        let rests = I::both(&second.is_negative(), &short);
        let pressure = second.negative().or_else(&rests, &second.zero_like());
        let any = I::any(&rests);
        let moved = I::either(&rests, &gap.size.is_negative());
        if I::any(&moved) {
            let shift = gap.size.negative().or_else(&moved, &gap.size.zero_like());
            self.change(pos, &times(&gap.normal, &shift));
        }
        if any {
            let taken = rate.negative().or_else(&rests, &rate.zero_like());
            self.change(vel, &times(&gap.normal, &taken));
            self.change(acceleration, &times(&gap.normal, &pressure));
        }
        let drag = self.friction.as_ref().filter(|_| any).map(|friction| {
            let tangent = tangent(&gap.normal);
            let slope = dot(&self.of(acceleration), &tangent).scaled(if h > 0.0 { 1.0 } else { 0.0 });
            // What stops the object by the end of the substep, and no more.
            let stopping = dot(&velocity, &tangent).scaled(h.abs().recip()).plus(&slope);
            let most = friction.times(&pressure);
            stopping.between(&most.negative(), &most)
        });
        Support { rests, any, pressure, drag }
    }

    /// Cancels the normal acceleration of what rests, as far as it is pressed, and slows it by friction.
    fn hold(&self, [pos, vel]: [&[I]; 2], acceleration: &mut [I], support: &Support<I>) {
        if !support.any {
            return;
        }
        let gap = self.gap(&self.of(pos));
        let push = positive_part(&gap.acceleration(&self.of(vel), &self.of(acceleration)).negative());
        let push = push.or_else(&support.rests, &push.zero_like());
        self.change(acceleration, &times(&gap.normal, &push));
        if let Some(drag) = &support.drag {
            self.change(acceleration, &times(&tangent(&gap.normal), &drag.negative()));
        }
    }

    /// Impact in a substep of length `h` that began with `before` and ends with the other state.
    fn rebound(&self, before: [&[I]; 2], [pos, vel]: [&mut [I]; 2], support: &Support<I>, h: f64) {
        self.strike(before, [&mut *pos, &mut *vel], support, h);
        self.stop([pos, vel], support, h);
    }

    /// The impact of what did not rest.
    fn strike(&self, [start, speed]: [&[I]; 2], [pos, vel]: [&mut [I]; 2], support: &Support<I>, h: f64) {
        let from = [self.of(start), self.of(speed)];
        let to = [self.of(pos), self.of(vel)];
        let (begin, end) = (self.gap(&from[0]), self.gap(&to[0]));
        // Of the substep's share s: size(s) = size + rate s + bend s^2.
        let (size, rate) = (positive_part(&begin.size), begin.rate(&from[1]).scaled(h));
        let bend = end.size.minus(&size).minus(&rate);
        let inner = rate.times(&rate).minus(&bend.times(&size).scaled(4.0));
        let (approaching, beyond) = (rate.is_negative(), end.size.is_negative());
        let free = I::both(&I::not(&support.rests), &inner.is_positive());
        let meet = I::both(&free, &I::either(&approaching, &beyond));
        if !I::any(&meet) {
            return;
        }
        // Where they do not meet, numbers whose root and ratio have a gradient.
        let root = inner.or_else(&meet, &inner.one_like()).root();
        let numerator = size.scaled(2.0).or_else(&approaching, &rate.plus(&root));
        let denominator = root.minus(&rate).or_else(&approaching, &bend.scaled(-2.0));
        let share = numerator.over(&denominator.or_else(&meet, &denominator.one_like()));
        let within = share.is_within(&share.zero_like(), &share.one_like());
        let meet = I::both(&meet, &I::either(&beyond, &within));
        let share = share.as_share();
        let rest = share.one_like().minus(&share).scaled(h);

        let straight = scaled(&from[1], h);
        let curve = minus(&minus(&to[0], &from[0]), &straight);
        let way = plus(&straight, &times(&curve, &share));
        let normal = self.gap(&plus(&from[0], &times(&way, &share))).normal;
        let velocity = plus(&from[1], &times(&minus(&to[1], &from[1]), &share));
        let left = left_after(&self.restitution, h);
        let closing = positive_part(&dot(&velocity, &normal).scaled(-h.signum()));
        let impulse = closing.times(&left.plus(&left.one_like()));
        let mut change = times(&normal, &impulse);
        if let Some(friction) = &self.friction {
            change = plus(&change, &slowed(&velocity, &normal, friction, &impulse));
        }
        let change = scaled(&change, h.signum()).map(|part| part.or_else(&meet, &part.zero_like()));
        self.change(pos, &times(&change, &rest));
        self.change(vel, &change);
    }

    /// Nothing ends a substep beyond the constraint: it would have struck again, after a flight shorter than the substep. What rested
    /// and lies as near as the pressure would bring it back in a substep stays on the constraint.
    fn stop(&self, [pos, vel]: [&mut [I]; 2], support: &Support<I>, h: f64) {
        let gap = self.gap(&self.of(pos));
        let beyond = gap.size.is_negative();
        let reach = support.pressure.scaled(h * h);
        let near = I::both(&support.rests, &I::not(&gap.size.minus(&reach).is_positive()));
        let moved = I::either(&beyond, &near);
        if !I::any(&moved) {
            return;
        }
        let shift = gap.size.negative().or_else(&moved, &gap.size.zero_like());
        self.change(pos, &times(&gap.normal, &shift));
        let closing = positive_part(&gap.rate(&self.of(vel)).scaled(-h.signum())).scaled(h.signum());
        let taken = closing.or_else(&beyond, &closing.zero_like());
        self.change(vel, &times(&gap.normal, &taken));
    }
}

/// All constraints of an equation, which count in their order.
#[derive(Debug, Clone)]
pub(super) struct UnilateralConstraints<I>(pub Vec<UnilateralConstraint<I>>);

impl<I: Impact> UnilateralConstraints<I> {
    /// What rests for a substep of length `h`, and puts the state there: positions, velocities, and the accelerations in this state,
    /// coordinate by coordinate.
    pub(super) fn support(&self, [pos, vel]: [&mut [I]; 2], acceleration: &mut [I], h: f64) -> Vec<Support<I>> {
        self.0.iter().map(|it| it.support([&mut *pos, &mut *vel], acceleration, h)).collect()
    }

    /// Cancels the normal acceleration of what rests in a state, and slows it by friction.
    pub(super) fn hold(&self, [pos, vel]: [&[I]; 2], acceleration: &mut [I], supports: &[Support<I>]) {
        self.0.iter().zip(supports).for_each(|(it, support)| it.hold([pos, vel], acceleration, support));
    }

    /// Impacts of a substep of length `h`: positions and velocities where it began, supported, and where it ended.
    pub(super) fn rebound(&self, before: [&[I]; 2], [pos, vel]: [&mut [I]; 2], supports: &[Support<I>], h: f64) {
        let pairs = self.0.iter().zip(supports);
        pairs.for_each(|(it, support)| it.rebound(before, [&mut *pos, &mut *vel], support, h));
    }
}

/// Whether any constraint holds something for the substep.
pub(super) fn holds_any<I: Impact>(supports: &[Support<I>]) -> bool {
    supports.iter().any(|support| support.any)
}
