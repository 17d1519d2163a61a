//! Whether the numbers of a measurement can be quoted.
//!
//! Judged are the track (one thing, followed throughout, beyond chance), the fit (over the whole recording as good as over short
//! parts of it), the prediction of what was held out, agreement of the observations, and the width of each interval. The drawing
//! of a model decides nothing.

use paig::support::significant::significant;

use super::other_parts::PartEstimate;
use super::results::{HeldOut, Judgement, MissingTerm, Outcome, Quantity, Residuals};

/// Share of the frames in which the objects must be seen, and below which nothing is found.
const SEEN: f64 = 0.7;
const HARDLY_SEEN: f64 = 0.4;
/// Median second difference of the positions over that in shuffled order: above it a track is hardly smoother than chance.
const SMOOTH: f64 = 0.35;
/// Fewest held-out frames with all objects that say whether an equation predicts.
const LEAST_HELD_OUT: usize = 2;
/// Held-out error in per cent of the amplitude up to which a fit predicts, and beyond which it does not.
const PREDICTS: f64 = 15.0;
const DOES_NOT_PREDICT: f64 = 40.0;
/// Part of constant velocity's error that the held-out error must stay below, where more than noise is left.
const BETTER: f64 = 0.5;
/// What the fit leaves, in per cent of the amplitude, up to which it explains the motion, and beyond which it does not.
const EXPLAINS: f64 = 5.0;
const DOES_NOT_EXPLAIN: f64 = 15.0;
/// What the fit leaves over the whole recording over what it leaves in short pieces, from which on something is missing in the
/// equation, where it is also this many per cent of the amplitude.
pub(super) const PIECEWISE: f64 = 8.0;
const NOTICEABLE: f64 = 2.0;
/// Half the width of an interval over the value, up to which a value is known, and beyond which nothing is.
const NARROW: f64 = 0.15;
const WIDE: f64 = 0.5;
/// End of an interval, as a share of the other end, that counts as 0: parameters that are positive never reach it.
const ALMOST_ZERO: f64 = 0.01;
/// Share of the residual that a missing term must take to count against a value.
const TAKES: f64 = 0.2;
/// By how many intervals' half-widths, and by which part of the value, two observations, or two equations, may differ.
const AGREE: f64 = 3.0;
const NEARLY_EQUAL: f64 = 0.03;
/// By how many half-widths of their difference's interval, and by which part of the value, two parts of a video may differ.
const PARTS_AGREE: f64 = 1.5;
const PARTS_NEARLY_EQUAL: f64 = 0.05;

/// What a verdict rests on.
#[derive(Debug, Clone)]
pub struct Evidence<'a> {
    /// What speaks against every number from the outset.
    pub doubts: &'a [String],
    /// Share of the frames in which all objects are seen.
    pub seen: f64,
    /// Median second difference of the positions over that in shuffled order; none where there are too few.
    pub chance: Option<f64>,
    pub held_out: &'a HeldOut,
    pub residuals: &'a Residuals,
    /// Half of the way from one end of the motion to the other, in the unit of the residuals.
    pub amplitude: f64,
    /// Noise of the observed positions from their high differences, in the same unit.
    pub noise: f64,
    pub missing: Option<&'a MissingTerm>,
    /// Whether the fit to the other observation counts against a value.
    pub checked: bool,
    /// What other parts of the video say by themselves.
    pub parts: &'a [PartEstimate],
}

/// Judges a measurement; sets the outcome of each of its quantities.
pub fn judge(evidence: &Evidence, quantities: &mut [Quantity]) -> Judgement {
    let mut against: Vec<(Outcome, String)> = evidence.against();
    let of_all = against.iter().map(|(outcome, _)| *outcome).max().unwrap_or(Outcome::Found);
    for quantity in quantities.iter_mut() {
        let (own, reason) = of_quantity(quantity, evidence);
        quantity.outcome = Some(of_all.max(own));
        against.extend(reason.map(|reason| (own, reason)));
    }
    against.sort_by_key(|(outcome, _)| std::cmp::Reverse(*outcome));
    // A number that is badly known leaves the others found; the run is found where one of the first kind is.
    let kind = quantities.iter().map(|quantity| quantity.kind).min();
    let of_kind = quantities.iter().filter(|quantity| Some(quantity.kind) == kind);
    let best = of_kind.filter_map(|quantity| quantity.outcome).min().unwrap_or(of_all);
    Judgement { outcome: best, reasons: against.into_iter().map(|(_, reason)| reason).collect() }
}

impl Evidence<'_> {
    fn against(&self) -> Vec<(Outcome, String)> {
        let unit = &self.residuals.unit;
        let mut against: Vec<_> = self.doubts.iter().map(|doubt| (Outcome::Doubtful, doubt.clone())).collect();
        if self.seen < SEEN {
            let outcome = if self.seen < HARDLY_SEEN { Outcome::NotFound } else { Outcome::Doubtful };
            against.push((
                outcome,
                format!(
                    "the objects are seen in {:.0} % of the frames only; take the part of the video in which they are (--frames)",
                    100.0 * self.seen
                ),
            ));
        }
        if let Some(chance) = self.chance.filter(|chance| *chance > SMOOTH) {
            against.push((
                Outcome::NotFound,
                format!("the path is hardly smoother than chance ({chance:.2} of it): nothing is followed"),
            ));
        }
        let HeldOut { frames, error, constant_velocity, .. } = self.held_out;
        if *frames < LEAST_HELD_OUT {
            against.push((
                Outcome::Doubtful,
                format!("the objects are seen in {frames} of the held-out frames: whether the equation predicts is not known"),
            ));
        } else {
            let percent = self.held_out.percent_of_amplitude;
            let beyond_noise = *error > 3.0 * self.noise;
            if percent > PREDICTS && beyond_noise {
                let outcome = if percent > DOES_NOT_PREDICT { Outcome::NotFound } else { Outcome::Doubtful };
                against.push((
                    outcome,
                    format!(
                        "the held-out frames are predicted with an error of {error:.2} {unit}, {percent:.0} % of the amplitude: \
                         the motion changes, or something is missing in the equation"
                    ),
                ));
            } else if *error > BETTER * constant_velocity && beyond_noise {
                against.push((
                    Outcome::Doubtful,
                    format!(
                        "the held-out frames are predicted little better ({error:.2} {unit}) than by constant velocity \
                         ({constant_velocity:.2} {unit})"
                    ),
                ));
            }
        }
        let left = 100.0 * self.residuals.usual / self.amplitude;
        if left > EXPLAINS && self.residuals.usual > 3.0 * self.noise {
            let outcome = if left > DOES_NOT_EXPLAIN { Outcome::NotFound } else { Outcome::Doubtful };
            against.push((
                outcome,
                format!(
                    "the fit leaves {:.2} {unit} of the positions, {left:.0} % of the amplitude, where their noise is {:.2} {unit}: \
                     it is another motion, or something else moves in the part that was taken",
                    self.residuals.usual, self.noise
                ),
            ));
        }
        if let Some(pieces) = self.residuals.usual_in_pieces
            && self.residuals.usual > PIECEWISE * pieces.max(self.noise)
            && left > NOTICEABLE
        {
            against.push((
                Outcome::Doubtful,
                format!(
                    "over the whole recording the fit leaves {:.2} {unit} of the positions, over short pieces {pieces:.2} {unit}: \
                     a term is missing in the equation, or the recording holds more than one motion (--frames)",
                    self.residuals.usual
                ),
            ));
        }
        against
    }
}

/// The outcome of one quantity by itself, and why it is not found.
fn of_quantity(quantity: &Quantity, evidence: &Evidence) -> (Outcome, Option<String>) {
    let name = quantity.name.replace('_', " ");
    let Some((low, high)) = quantity.low.zip(quantity.high) else {
        return (Outcome::NotFound, Some(format!("{name} has no interval: the motion does not determine it")));
    };
    let half = (high - low) / 2.0;
    let relative = half / quantity.value.abs().max(f64::MIN_POSITIVE);
    if relative > NARROW {
        let outcome = if relative > WIDE { Outcome::NotFound } else { Outcome::Doubtful };
        let reason = if low <= ALMOST_ZERO * high && high >= ALMOST_ZERO * low {
            let [low, high] = [low, high].map(|end| significant(end, 3));
            format!("{name} cannot be told from 0: it lies between {low} and {high}")
        } else {
            format!("{name} is known to {:.0} % only", 100.0 * relative)
        };
        return (outcome, Some(reason));
    }
    let differs = |other: f64| {
        let apart = (other - quantity.value).abs();
        apart > AGREE * half && apart > NEARLY_EQUAL * quantity.value.abs()
    };
    let explains = |missing: &&MissingTerm| missing.residual[1] < (1.0 - TAKES) * missing.residual[0];
    if let Some((missing, factor)) =
        evidence.missing.filter(explains).and_then(|it| Some((it, it.factors.get(&quantity.name)?)))
        && differs(factor * quantity.value)
    {
        return (
            Outcome::Doubtful,
            Some(format!(
                "{name} would be {:.3} times as large with the missing term ({}): measure with it",
                factor, missing.name
            )),
        );
    }
    if let Some(other) = quantity.by_tracker.filter(|other| evidence.checked && differs(*other)) {
        let percent = 100.0 * (other - quantity.value).abs() / quantity.value.abs();
        return (Outcome::Doubtful, Some(format!("{name} differs by {percent:.0} % from the other observation's")));
    }
    if let Some(reason) = evidence.parts.iter().find_map(|part| disagreement(quantity, half, part)) {
        return (Outcome::Doubtful, Some(reason));
    }
    (Outcome::Found, None)
}

/// How another part of the video contradicts a quantity with an interval of this half-width; none where it does not.
fn disagreement(quantity: &Quantity, half: f64, PartEstimate { part, quantities }: &PartEstimate) -> Option<String> {
    let other = quantities.iter().find(|other| other.name == quantity.name)?;
    let (low, high) = other.low.zip(other.high)?;
    let apart = (other.value - quantity.value).abs();
    let differs = apart > PARTS_AGREE * half.hypot((high - low) / 2.0)
        && apart > PARTS_NEARLY_EQUAL * quantity.value.abs().max(other.value.abs());
    let [value, low, high] = [other.value, low, high].map(|number| significant(number, 3));
    differs.then(|| {
        format!(
            "{} is {value} [{low}, {high}] in {part}, which the equation explains as well: the object comes nearer or goes away, the \
             speed of the video changes, or a term is missing in the equation",
            quantity.name.replace('_', " ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::super::results::QuantityKind;
    use super::*;

    /// A quantity with an interval of this share of its value to each side.
    fn quantity(name: &str, share: f64) -> Quantity {
        Quantity::new(name, 1.0, vec![1.0 - share, 1.0 + share])
    }

    #[test]
    fn the_verdict_rests_on_what_drives_the_motion() {
        let held_out = HeldOut {
            frames: 10,
            unit: "px".into(),
            error: 0.1,
            constant_velocity: 9.0,
            tracker_fit: None,
            percent_of_amplitude: 0.1,
            metres_per_unit: None,
        };
        let residuals = Residuals {
            unit: "px".into(),
            usual: 0.1,
            usual_in_pieces: None,
            distance: 0.1,
            autocorrelation: Vec::new(),
            frames_in_one: 1.0,
            block: 1,
        };
        let evidence = Evidence {
            doubts: &[],
            seen: 1.0,
            chance: Some(0.01),
            held_out: &held_out,
            residuals: &residuals,
            amplitude: 100.0,
            noise: 0.1,
            missing: None,
            checked: false,
            parts: &[],
        };
        let outcome = |shares: &[(QuantityKind, f64)]| {
            let quantities = shares.iter().map(|(kind, share)| quantity("l", *share).of_kind(*kind));
            judge(&evidence, &mut quantities.collect::<Vec<_>>()).outcome
        };
        let (force, other, place) = (QuantityKind::Force, QuantityKind::Other, QuantityKind::Place);
        assert_eq!(outcome(&[(force, 0.9), (other, 0.01), (place, 0.01)]), Outcome::NotFound);
        assert_eq!(outcome(&[(place, 0.01), (force, 0.3)]), Outcome::Doubtful);
        assert_eq!(outcome(&[(force, 0.01), (other, 0.9), (place, 0.9)]), Outcome::Found);
        // Equations without a force.
        assert_eq!(outcome(&[(other, 0.01), (place, 0.9)]), Outcome::Found);
        assert_eq!(outcome(&[(place, 0.01)]), Outcome::Found);
        // Held-out frames in which nothing is seen are predicted without any error.
        let unseen =
            HeldOut { frames: 0, error: 0.0, constant_velocity: 0.0, percent_of_amplitude: 0.0, ..held_out.clone() };
        let evidence = Evidence { held_out: &unseen, ..evidence.clone() };
        let judged = judge(&evidence, &mut [quantity("l", 0.01).of_kind(force)]);
        assert_eq!(judged.outcome, Outcome::Doubtful);
        assert!(judged.reasons[0].contains("seen in 0 of the held-out frames"), "{:?}", judged.reasons);
    }

    /// Half-widths of 10 % each make 14 % together, of which half as much again may be between two parts.
    #[test]
    fn a_part_that_says_otherwise_is_a_doubt() {
        let part = |value: f64| PartEstimate {
            part: "throw.mp4 7..65".into(),
            quantities: vec![Quantity::new("g", value, vec![value - 0.1, value + 0.1])],
        };
        let own = |half: f64| Quantity::new("g", 1.0, vec![1.0 - half, 1.0 + half]);
        assert_eq!(disagreement(&own(0.1), 0.1, &part(1.19)), None);
        let reason = disagreement(&own(0.1), 0.1, &part(1.23)).unwrap();
        assert!(reason.starts_with("g is 1.23 [1.13, 1.33] in throw.mp4 7..65, which"), "{reason}");
        // Parts that nearly agree do, however narrow their intervals are, and what only one determines is compared with nothing.
        let narrow = PartEstimate { quantities: vec![Quantity::new("g", 1.04, vec![1.0399, 1.0401])], ..part(1.0) };
        assert_eq!(disagreement(&own(1e-4), 1e-4, &narrow), None);
        assert_eq!(disagreement(&quantity("l", 0.1), 0.1, &part(2.0)), None);
    }
}
