//! Contacts between the objects of an equation: when discs touch, the share of the closing speed that is left, and masses.

use anyhow::{Result, ensure};
use tch::{Kind, Tensor};

use super::columns::Number;
use super::parameters::Parameters;
use super::table::EquationTable;
use super::table_number::TableNumber;
use super::units::Unit;
use super::value::EquationNumber;
use crate::network::cells::contact::recoil;
use crate::network::cells::impact::{Impact, Single, left_after};
use crate::network::cells::state::Coordinates;

/// The contacts of an equation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TextContacts {
    distance: EquationNumber,
    /// Share of the closing speed that is left; none for all of it.
    restitution: Option<EquationNumber>,
    /// Coulomb's coefficient; none for smooth discs.
    friction: Option<EquationNumber>,
    /// Of each object; empty for equal ones.
    pub(super) masses: Vec<EquationNumber>,
}

/// Contacts with the values of their parameters.
#[derive(Debug, Clone)]
pub(super) struct Contacts<I> {
    distance: I,
    left: I,
    friction: Option<I>,
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
        let length = Unit::Of([1.0, 0.0]);
        let distance =
            EquationNumber::read(&contacts.distance, ("contacts.distance", length, "a length"), parameters, used)?;
        ensure!(distance.is_positive(parameters), "contacts.distance: must be more than 0");
        let restitution = match &contacts.restitution {
            None | Some(TableNumber::Number(1.0)) => None,
            Some(given) => Some(EquationNumber::restitution(given, "contacts.restitution", parameters, used)?),
        };
        let friction = contacts.friction.as_ref();
        let friction =
            friction.map(|given| EquationNumber::friction(given, "contacts.friction", parameters, used)).transpose()?;
        let masses = contacts.masses.iter().flatten();
        let masses: Vec<EquationNumber> = masses
            .map(|given| EquationNumber::mass(given, "contacts.masses", parameters, used))
            .collect::<Result<_>>()?;
        ensure!(
            masses.is_empty() && contacts.masses.is_none() || masses.len() == objects,
            "contacts.masses: expected one for each of {objects} objects, found {}",
            masses.len()
        );
        Ok(Some(TextContacts { distance, restitution, friction, masses }))
    }

    /// Whether steps back in time are steps forward of another sign.
    pub(super) fn are_reversible(&self) -> bool {
        self.restitution.is_none() && self.friction.is_none()
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
            friction: self.friction.map(&value),
            masses: (0..objects).map(|object| or_one(self.masses.get(object).copied())).collect(),
        }
    }
}

impl<I: Impact> Contacts<I> {
    /// The state after the contacts of a substep of length `h`, coordinate by coordinate: positions and velocities where it began
    /// and where it ended. Of several contacts of one object the pairs count in their order.
    pub(super) fn after(&self, before: [&[I]; 2], [pos, vel]: [&mut [I]; 2], h: f64) {
        let objects = self.masses.len();
        let left = left_after(&self.left, h);
        for one in 0..objects {
            for two in one + 1..objects {
                let apart = |of: &[I], axis: usize| of[2 * two + axis].minus(&of[2 * one + axis]);
                let relative = |of: &[I]| [apart(of, 0), apart(of, 1)];
                let states = [[before[0], before[1]], [&*pos, &*vel]].map(|[pos, vel]| (relative(pos), relative(vel)));
                let [begin, end] = &states;
                let h = end.0[0].one_like().scaled(h);
                let states = [begin, end].map(|(pos, vel)| (pos.each_ref(), vel.each_ref()));
                let recoil = recoil(states, &self.distance, (&left, self.friction.as_ref()), &h);
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
