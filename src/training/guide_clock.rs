//! How long the guides of `discover` act: at full weight until the objects are found, then less and less, then no more.

/// A guide's course over the steps of a phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuideClock {
    /// Steps with full weight, at least.
    pub full_until: u64,
    /// The step from which there is no weight, if it was full for no more steps than that.
    pub zero_from: u64,
    /// The score from which on the objects are found.
    pub found_at: f64,
    /// The step from which the weight falls though they are not.
    pub at_the_latest: u64,
    /// Steps from one validation to the next.
    pub validate_every: u64,
}

impl GuideClock {
    /// Without guides.
    pub const NONE: GuideClock =
        GuideClock { full_until: 0, zero_from: 0, found_at: f64::INFINITY, at_the_latest: 0, validate_every: 1 };

    /// By how many steps the course is late.
    fn delay(&self, step: u64, validations: &[f64]) -> u64 {
        let found = validations.iter().position(|score| *score <= self.found_at);
        let until = found.map_or(step, |place| place as u64 * self.validate_every);
        until.min(self.at_the_latest).saturating_sub(self.full_until)
    }

    /// The guides' weight at a step: 1, then a half cosine down to 0.
    pub fn weight(&self, step: u64, validations: &[f64]) -> f64 {
        let step = step - self.delay(step, validations).min(step);
        // A course that waits for the objects stands at the last step with full weight.
        if step <= self.full_until && self.zero_from > 0 {
            1.0
        } else if step >= self.zero_from {
            0.0
        } else {
            let share = (step - self.full_until) as f64 / (self.zero_from - self.full_until) as f64;
            0.5 * (1.0 + (std::f64::consts::PI * share).cos())
        }
    }

    /// How many of these validations, from the first, were made under the guides.
    pub(crate) fn guided(&self, validations: &[f64]) -> usize {
        let end = self.zero_from + self.delay(u64::MAX, validations);
        (end.div_ceil(self.validate_every) as usize).min(validations.len())
    }
}

#[cfg(test)]
mod tests {
    use super::GuideClock;

    const CLOCK: GuideClock =
        GuideClock { full_until: 100, zero_from: 200, found_at: 2.0, at_the_latest: 500, validate_every: 50 };

    fn weights(steps: [u64; 4], validations: &[f64]) -> [f64; 4] {
        steps.map(|step| (CLOCK.weight(step, validations) * 1e6).round() / 1e6)
    }

    #[test]
    fn guides_fade_from_where_the_objects_are_found() {
        // At step 100 they are, as soon as the weight may fall.
        let found = [9.0, 5.0, 2.0, 1.0, 1.0, 1.0, 1.0];
        assert_eq!(weights([99, 100, 150, 200], &found), [1.0, 1.0, 0.5, 0.0]);
        assert_eq!(CLOCK.guided(&found), 4);
        // At step 250; a worse score after it changes nothing.
        let late = [9.0, 8.0, 7.0, 6.0, 3.0, 2.0, 4.0, 1.0, 1.0, 1.0];
        assert_eq!(weights([200, 250, 300, 350], &late), [1.0, 1.0, 0.5, 0.0]);
        assert_eq!(CLOCK.guided(&late), 7);
        // As long as nothing is known of that, the weight is full.
        assert_eq!(weights([100, 150, 200, 249], &late[..5]), [1.0; 4]);
        assert_eq!(CLOCK.guided(&late[..5]), 5);
    }

    #[test]
    fn guides_end_though_nothing_is_found() {
        let never = [9.0; 15];
        assert_eq!(weights([499, 500, 550, 600], &never), [1.0, 1.0, 0.5, 0.0]);
        assert_eq!(CLOCK.guided(&never), 12);
    }

    #[test]
    fn guides_without_a_fade_wait_for_the_objects_too() {
        let clock = GuideClock { zero_from: 100, ..CLOCK };
        let late = [9.0, 8.0, 7.0, 6.0, 3.0, 2.0];
        assert_eq!([100, 249, 250, 251].map(|step| clock.weight(step, &late)), [1.0, 1.0, 1.0, 0.0]);
    }

    #[test]
    fn without_guides_there_are_none() {
        assert_eq!((GuideClock::NONE.weight(0, &[]), GuideClock::NONE.guided(&[3.0; 4])), (0.0, 0));
    }
}
