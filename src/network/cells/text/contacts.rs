//! Contacts between the objects of an equation: when discs touch, the share of the closing speed that is left, and masses.

use anyhow::{Result, ensure};
use tch::{Kind, Tensor};

use super::columns::Number;
use super::parameters::Parameters;
use super::table::{EquationTable, TableNumber};
use super::units::Unit;
use super::value::EquationNumber;
use super::walls::LEAST_RESTITUTION;
use crate::network::cells::contact::recoil;
use crate::network::cells::impact::{Impact, Single};
use crate::network::cells::state::Coordinates;

/// The contacts of an equation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TextContacts {
    distance: EquationNumber,
    /// Share of the closing speed that is left; none for all of it.
    pub(super) restitution: Option<EquationNumber>,
    /// Of each object; empty for equal ones.
    pub(super) masses: Vec<EquationNumber>,
}

/// Contacts with the values of their parameters.
#[derive(Debug, Clone)]
pub(super) struct Contacts<I> {
    distance: I,
    left: I,
    /// Of each object.
    masses: Vec<I>,
}

impl TextContacts {
    /// The contacts of a table, if it has any. Parameters that they name are marked as `used`.
    ///
    /// # Errors
    /// Contacts of angles or of a single object, numbers out of range, masses that are not one for each object, and as
    /// [`EquationNumber::read`].
    pub(super) fn of(
        table: &EquationTable,
        objects: usize,
        parameters: &Parameters,
        used: &mut [bool],
    ) -> Result<Option<Self>> {
        let Some(contacts) = &table.contacts else { return Ok(None) };
        ensure!(table.state == Coordinates::Position, "contacts: there are contacts for positions, not for angles");
        ensure!(objects > 1, "contacts: a single object has nothing to collide with");
        let (length, any) = (Unit::Of([1.0, 0.0]), Unit::Any);
        let distance =
            EquationNumber::read(&contacts.distance, ("contacts.distance", length, "a length"), parameters, used)?;
        ensure!(is_positive(distance, parameters), "contacts.distance: must be more than 0");
        let restitution = match &contacts.restitution {
            None | Some(TableNumber::Number(1.0)) => None,
            Some(given) => Some(EquationNumber::restitution(given, "contacts.restitution", parameters, used)?),
        };
        let masses = contacts.masses.iter().flatten();
        let mut mass = |given| {
            let value = EquationNumber::read(given, ("contacts.masses", any, "a mass"), parameters, used)?;
            ensure!(is_positive(value, parameters), "contacts.masses: each must be more than 0");
            Ok(value)
        };
        let masses: Vec<EquationNumber> = masses.map(&mut mass).collect::<Result<_>>()?;
        ensure!(
            masses.is_empty() && contacts.masses.is_none() || masses.len() == objects,
            "contacts.masses: expected one for each of {objects} objects, found {}",
            masses.len()
        );
        Ok(Some(TextContacts { distance, restitution, masses }))
    }

    /// In plain numbers.
    pub(super) fn numbers<F: Number>(&self, objects: usize, parameters: impl Fn(usize) -> f64) -> Contacts<Single<F>> {
        self.values(objects, |value| Single(F::of(value.among(&parameters))))
    }

    /// As scalar tensors, differentiable by the parameters.
    pub(super) fn tensors(
        &self,
        objects: usize,
        parameters: &[Tensor],
        options: (Kind, tch::Device),
    ) -> Contacts<Tensor> {
        self.values(objects, |value| value.tensor(parameters, options))
    }

    fn values<I>(&self, objects: usize, value: impl Fn(EquationNumber) -> I) -> Contacts<I> {
        let or_one = |given: Option<EquationNumber>| value(given.unwrap_or(EquationNumber::Number(1.0)));
        Contacts {
            distance: value(self.distance),
            left: or_one(self.restitution),
            masses: (0..objects).map(|object| or_one(self.masses.get(object).copied())).collect(),
        }
    }
}

/// Whether a value is above 0 whatever is learned.
fn is_positive(value: EquationNumber, parameters: &Parameters) -> bool {
    match value {
        EquationNumber::Number(number) => number > 0.0 && number.is_finite(),
        EquationNumber::Parameter(place) => parameters.all[place].range()[0] >= 0.0,
    }
}

impl<I: Impact> Contacts<I> {
    /// The state after the contacts of a substep of length `h`, coordinate by coordinate: positions and velocities where it began
    /// and where it ended. Of several contacts of one object the pairs count in their order.
    pub(super) fn after(&self, before: [&[I]; 2], [pos, vel]: [&mut [I]; 2], h: f64, number: impl Fn(&I, f64) -> I) {
        let objects = self.masses.len();
        // Back in time a contact gives what it took.
        let left = if h < 0.0 {
            let one = self.left.one_like();
            one.over(&self.left.between(&number(&one, LEAST_RESTITUTION), &one))
        } else {
            self.left.copy()
        };
        for one in 0..objects {
            for two in one + 1..objects {
                let apart = |of: &[I], axis: usize| of[2 * two + axis].minus(&of[2 * one + axis]);
                let relative = |of: &[I]| [apart(of, 0), apart(of, 1)];
                let states = [[before[0], before[1]], [&*pos, &*vel]].map(|[pos, vel]| (relative(pos), relative(vel)));
                let [begin, end] = &states;
                let h = number(&end.0[0], h);
                let states = [begin, end].map(|(pos, vel)| (pos.each_ref(), vel.each_ref()));
                let recoil = recoil(states, &self.distance, &left, &h);
                let total = self.masses[one].plus(&self.masses[two]);
                // The heavier one moves less.
                let [of_one, of_two] = [two, one].map(|other| self.masses[other].over(&total));
                for axis in 0..2 {
                    for (object, share, forward) in [(one, &of_one, false), (two, &of_two, true)] {
                        for (values, change) in
                            [(&mut *pos, &recoil.position[axis]), (&mut *vel, &recoil.velocity[axis])]
                        {
                            let part = change.times(share);
                            let value = &mut values[2 * object + axis];
                            *value = if forward { value.plus(&part) } else { value.minus(&part) };
                        }
                    }
                }
            }
        }
    }
}
