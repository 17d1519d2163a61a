//! Unilateral constraints of an equation: surfaces that objects bounce off and strings that go slack, with what their numbers are.

use anyhow::{Result, ensure};
use tch::{Kind, Tensor};

use super::columns::Number;
use super::parameters::Parameters;
use super::surface_table::{StringTable, SurfaceTable};
use super::table::EquationTable;
use super::table_number::TableNumber;
use super::units::Unit;
use super::value::EquationNumber;
use crate::network::cells::impact::{Impact, Single};
use crate::network::cells::state::Coordinates;
use crate::network::cells::unilateral::{AllowedRegion, Held, UnilateralConstraint, UnilateralConstraints};

const LENGTH: Unit = Unit::Of([1.0, 0.0]);

/// The unilateral constraints of an equation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TextConstraints(Vec<TextConstraint>);

/// One of them, for one object or a pair.
#[derive(Debug, Clone, PartialEq)]
struct TextConstraint {
    region: TextRegion,
    distance: EquationNumber,
    restitution: EquationNumber,
    friction: Option<EquationNumber>,
    held: TextHeld,
    /// Whether the table names the object.
    named: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum TextRegion {
    HalfPlane { point: [EquationNumber; 2], angle: EquationNumber },
    Circle { centre: [EquationNumber; 2], outside: bool },
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum TextHeld {
    Object(usize),
    Pair { objects: [usize; 2], masses: [EquationNumber; 2] },
}

/// Reads the numbers of one entry.
struct EntryReader<'a> {
    /// Its place in the table, for messages.
    key: String,
    objects: usize,
    parameters: &'a Parameters,
    used: &'a mut [bool],
}

impl EntryReader<'_> {
    fn number(&mut self, given: &TableNumber, key: &str, unit: Unit, what: &str) -> Result<EquationNumber> {
        let key = format!("{}.{key}", self.key);
        let value = EquationNumber::read(given, (&key, unit, what), self.parameters, self.used)?;
        let finite = !matches!(value, EquationNumber::Number(number) if !number.is_finite());
        ensure!(finite, "{key}: expected a finite number, found {given:?}");
        Ok(value)
    }

    fn point(&mut self, [x, y]: &[TableNumber; 2], key: &str) -> Result<[EquationNumber; 2]> {
        Ok([self.number(x, key, LENGTH, "a position")?, self.number(y, key, LENGTH, "a position")?])
    }

    fn positive(&mut self, given: &TableNumber, key: &str) -> Result<EquationNumber> {
        let value = self.number(given, key, LENGTH, "a length")?;
        ensure!(value.is_positive(self.parameters), "{}.{key}: must be more than 0", self.key);
        Ok(value)
    }

    fn restitution(&mut self, given: Option<&TableNumber>, default: f64) -> Result<EquationNumber> {
        let key = format!("{}.restitution", self.key);
        let read = |given| EquationNumber::restitution(given, &key, self.parameters, self.used);
        given.map_or(Ok(EquationNumber::Number(default)), read)
    }

    /// The places of the objects that an entry is about.
    fn objects(&self, named: Option<usize>) -> Result<std::ops::Range<usize>> {
        match named {
            None => Ok(0..self.objects),
            Some(number) => self.object(number, "object").map(|place| place..place + 1),
        }
    }

    fn object(&self, number: usize, key: &str) -> Result<usize> {
        let Self { key: entry, objects, .. } = self;
        ensure!((1..=*objects).contains(&number), "{entry}.{key} = {number}: expected 1 to {objects}");
        Ok(number - 1)
    }

    fn surface(&mut self, table: &SurfaceTable) -> Result<Vec<TextConstraint>> {
        let key = &self.key;
        let SurfaceTable { line, bowl, bump, angle, distance, restitution, friction, object } = table;
        let region = match (line, bowl, bump) {
            (Some(point), None, None) => {
                let angle = angle.as_ref().unwrap_or(&TableNumber::Number(0.0));
                let angle = self.number(angle, "angle", Unit::NONE, "an angle in radians")?;
                TextRegion::HalfPlane { point: self.point(point, "line")?, angle }
            }
            (None, Some(centre), None) | (None, None, Some(centre)) => {
                ensure!(angle.is_none(), "{key}.angle: a circle has none; take it out");
                let outside = bump.is_some();
                let which = if outside { "bump" } else { "bowl" };
                TextRegion::Circle { centre: self.point(centre, which)?, outside }
            }
            _ => anyhow::bail!("{key}: expected one of line, bowl and bump, each a point [x, y]"),
        };
        let distance = match (distance, region) {
            (None, TextRegion::HalfPlane { .. }) => EquationNumber::Number(0.0),
            (None, _) => anyhow::bail!("{}: a circle needs a distance of the object's centre from its own", self.key),
            (Some(given), TextRegion::HalfPlane { .. }) => self.number(given, "distance", LENGTH, "a length")?,
            (Some(given), _) => self.positive(given, "distance")?,
        };
        let restitution = self.restitution(restitution.as_ref(), 1.0)?;
        let key = format!("{}.friction", self.key);
        let friction = friction.as_ref();
        let friction = friction.map(|given| EquationNumber::friction(given, &key, self.parameters, self.used));
        let friction = friction.transpose()?;
        let of_object = |place| TextConstraint {
            region,
            distance,
            restitution,
            friction,
            held: TextHeld::Object(place),
            named: object.is_some(),
        };
        Ok(self.objects(*object)?.map(of_object).collect())
    }

    fn string(&mut self, table: &StringTable) -> Result<Vec<TextConstraint>> {
        let StringTable { at, between, length, restitution, masses, object } = table;
        let distance = self.positive(length, "length")?;
        let restitution = self.restitution(restitution.as_ref(), 0.0)?;
        let entry = self.key.clone();
        let string = |centre: [EquationNumber; 2], held: TextHeld, named: bool| {
            let region = TextRegion::Circle { centre, outside: false };
            TextConstraint { region, distance, restitution, friction: None, held, named }
        };
        match (at, between) {
            (Some(at), None) => {
                ensure!(
                    masses.is_none(),
                    "{entry}.masses: only a string between two objects asks for them; take it out"
                );
                let centre = self.point(at, "at")?;
                let objects = self.objects(*object)?;
                Ok(objects.map(|place| string(centre, TextHeld::Object(place), object.is_some())).collect())
            }
            (None, Some(pair)) => {
                ensure!(object.is_none(), "{entry}.object: between names the objects; take it out");
                let objects = [self.object(pair[0], "between")?, self.object(pair[1], "between")?];
                ensure!(objects[0] != objects[1], "{entry}.between: expected two objects, found one twice");
                let key = format!("{entry}.masses");
                let mut mass = |place: usize| match masses {
                    None => Ok(EquationNumber::Number(1.0)),
                    Some(masses) => EquationNumber::mass(&masses[place], &key, self.parameters, self.used),
                };
                let masses = [mass(0)?, mass(1)?];
                let named = self.objects > 2 || table.masses.is_some();
                let centre = [EquationNumber::Number(0.0); 2];
                Ok(vec![string(centre, TextHeld::Pair { objects, masses }, named)])
            }
            _ => anyhow::bail!("{entry}: expected one of at, a point [x, y], and between, two objects [1, 2]"),
        }
    }
}

impl TextConstraints {
    /// The surfaces and strings of a table, if it has any. Parameters that they name are marked as `used`.
    ///
    /// # Errors
    /// Those of angles, an entry without a place or with two, numbers out of range, an object that is not there, and as
    /// [`EquationNumber::read`].
    pub(super) fn of(
        table: &EquationTable,
        objects: usize,
        parameters: &Parameters,
        used: &mut [bool],
    ) -> Result<Option<Self>> {
        let EquationTable { surfaces, strings, state, .. } = table;
        if surfaces.is_empty() && strings.is_empty() {
            return Ok(None);
        }
        let key = if surfaces.is_empty() { "strings" } else { "surfaces" };
        ensure!(*state == Coordinates::Position, "{key}: there are {key} for positions, not for angles");
        let mut constraints = Vec::new();
        let mut reader = EntryReader { key: String::new(), objects, parameters, used };
        for (place, surface) in surfaces.iter().enumerate() {
            reader.key = format!("surfaces[{}]", place + 1);
            constraints.extend(reader.surface(surface)?);
        }
        for (place, string) in strings.iter().enumerate() {
            reader.key = format!("strings[{}]", place + 1);
            constraints.extend(reader.string(string)?);
        }
        Ok(Some(TextConstraints(constraints)))
    }

    /// Whether they hold some objects otherwise than others.
    pub(super) fn tell_objects_apart(&self) -> bool {
        self.0.iter().any(|constraint| constraint.named)
    }

    /// Whether steps back in time are steps forward of another sign.
    pub(super) fn are_reversible(&self) -> bool {
        self.0.iter().all(|it| it.restitution == EquationNumber::Number(1.0) && it.friction.is_none())
    }

    /// In plain numbers.
    pub(super) fn numbers<F: Number>(&self, parameters: impl Fn(usize) -> f64) -> UnilateralConstraints<Single<F>> {
        self.values(|value| Single(F::of(value.among(&parameters))))
    }

    /// As scalar tensors, differentiable by the parameters.
    pub(super) fn tensors(&self, parameters: &[Tensor], options: (Kind, tch::Device)) -> UnilateralConstraints<Tensor> {
        self.values(|value| value.tensor(parameters, options))
    }

    fn values<I: Impact>(&self, value: impl Fn(EquationNumber) -> I) -> UnilateralConstraints<I> {
        let constraint = |it: &TextConstraint| UnilateralConstraint {
            region: match it.region {
                TextRegion::HalfPlane { point, angle } => {
                    let angle = value(angle);
                    AllowedRegion::HalfPlane {
                        point: point.map(&value),
                        normal: [angle.sine(), angle.cosine().negative()],
                    }
                }
                TextRegion::Circle { centre, outside } => AllowedRegion::Circle { centre: centre.map(&value), outside },
            },
            distance: value(it.distance),
            restitution: value(it.restitution),
            friction: it.friction.map(&value),
            held: match it.held {
                TextHeld::Object(place) => Held::Object(place),
                TextHeld::Pair { objects, masses } => {
                    let [first, second] = masses.map(&value);
                    let total = first.plus(&second);
                    // The heavier one moves less.
                    Held::Pair { objects, shares: [second.over(&total), first.over(&total)] }
                }
            },
        };
        UnilateralConstraints(self.0.iter().map(constraint).collect())
    }
}
