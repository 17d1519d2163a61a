//! The parameters that a text can name, one for each object where each has its own.

use std::collections::BTreeMap;

use anyhow::{Context, Result, ensure};

use super::operation::FUNCTIONS;
use super::table::ParameterTable;
use super::units::Unit;
use crate::network::cells::parameter::{Bounds, PhysicalParameter};

/// Most parameters, those of each object counted apart.
const MOST: usize = 64;
/// Names that mean something else.
const RESERVED: [&str; 10] = ["p", "v", "q", "w", "u", "t", "pi", "other", "angle", "spin"];

/// A parameter as the text knows it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Declared {
    pub name: String,
    pub unit: Unit,
    pub length_power: i32,
    pub time_power: Option<i32>,
    pub unit_name: Option<String>,
    pub bounds: Bounds,
    pub start: Option<f64>,
    pub fixed: Option<f64>,
}

impl Declared {
    /// The least and the most that its value can be.
    pub(super) fn range(&self) -> [f64; 2] {
        match (self.fixed, self.bounds) {
            (Some(value), _) => [value, value],
            (None, Bounds::Between(low, high)) => [low, high],
            (None, Bounds::Above(low)) => [low, f64::INFINITY],
        }
    }
}

/// All of them, and which names stand for a whole row.
#[derive(Debug, Default)]
pub(super) struct Parameters {
    pub all: Vec<Declared>,
    /// The place of the first object's, by the name that each object's shares.
    pub each: BTreeMap<String, usize>,
}

impl Parameters {
    /// Those in the `order` first, then the others by name.
    ///
    /// # Errors
    /// A name that cannot be one or is taken, bounds without room between them, a value outside of them, too many.
    pub(super) fn of(table: &BTreeMap<String, ParameterTable>, objects: usize, order: &[&str]) -> Result<Self> {
        let mut parameters = Parameters::default();
        let mut entries: Vec<_> = table.iter().collect();
        entries.sort_by_key(|(name, _)| order.iter().position(|first| first == name).unwrap_or(order.len()));
        for (name, entry) in entries {
            let of_name = || format!("parameters.{name}");
            check_name(name).with_context(of_name)?;
            let declared = declared(name, entry).with_context(of_name)?;
            if entry.each {
                parameters.each.insert(name.clone(), parameters.all.len());
                let own = |object: usize| Declared { name: format!("{name}{object}"), ..declared.clone() };
                parameters.all.extend((1..=objects).map(own));
            } else {
                parameters.all.push(declared);
            }
        }
        ensure!(
            parameters.all.len() <= MOST,
            "parameters: there are {}, those of each object counted apart; at most {MOST} can be",
            parameters.all.len()
        );
        for (place, Declared { name, .. }) in parameters.all.iter().enumerate() {
            let taken = parameters.all[..place].iter().any(|other| other.name == *name);
            ensure!(!taken && !parameters.each.contains_key(name), "parameters: two are called {name}; rename one");
        }
        Ok(parameters)
    }

    /// The place of the one with this name.
    pub(super) fn place(&self, name: &str) -> Option<usize> {
        self.all.iter().position(|declared| declared.name == name)
    }

    /// As the network knows them.
    pub(super) fn physical(&self) -> Vec<PhysicalParameter> {
        let physical = self.all.iter().map(|declared| PhysicalParameter {
            name: declared.name.clone().into(),
            variable: format!("log_{}", declared.name).into(),
            length_power: declared.length_power,
            time_power: declared.time_power,
            unit_name: declared.unit_name.clone().map(Into::into),
            fixed: declared.fixed,
            bounds: declared.bounds,
            start: declared.start,
        });
        physical.collect()
    }
}

/// Whether a name is that of an object's position or velocity, such as p2.
pub(super) fn of_object(name: &str) -> Option<(char, &str)> {
    let letter = name.chars().next().filter(|letter| ['p', 'v'].contains(letter))?;
    let number = &name[1..];
    (!number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit())).then_some((letter, number))
}

/// Whether a parameter or a definition can have a name.
pub(super) fn check_name(name: &str) -> Result<()> {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    ensure!(
        name.starts_with(|c: char| c.is_ascii_lowercase()) && name.chars().all(plain) && name.len() <= 32,
        "the name must be a lower-case letter and then at most 31 of a-z, 0-9 and _"
    );
    let function = FUNCTIONS.iter().any(|(function, _)| *function == name);
    ensure!(
        !RESERVED.contains(&name) && !function && of_object(name).is_none(),
        "the name means something else in an acceleration; choose another"
    );
    Ok(())
}

fn declared(name: &str, entry: &ParameterTable) -> Result<Declared> {
    let ParameterTable { unit, unit_name, start, low, high, fixed, .. } = entry;
    for (key, value) in [("low", low), ("high", high), ("start", start), ("fixed", fixed)] {
        ensure!(value.is_none_or(f64::is_finite), "{key} must be a finite number");
    }
    let low = low.unwrap_or(0.0);
    let bounds = match *high {
        Some(high) => {
            ensure!(low < high, "low = {low} must be less than high = {high}");
            Bounds::Between(low, high)
        }
        None => Bounds::Above(low),
    };
    ensure!(start.is_none() || fixed.is_none(), "start and fixed are both given; a fixed parameter starts nowhere");
    for (key, value) in [("start", start), ("fixed", fixed)] {
        if let Some(value) = value {
            ensure!(bounds.contain(*value), "{key} = {value}: must be {bounds}; low and high say so");
        }
    }
    ensure!(unit.is_none_or(|powers| powers.iter().all(|power| power.abs() <= 12)), "unit: powers of -12 to 12 can be");
    ensure!(
        unit.is_none() || unit_name.is_none(),
        "unit and unit_name are both given; unit_name is of a value that no scale changes"
    );
    if let Some(unit) = unit_name {
        ensure!(
            (1..=16).contains(&unit.chars().count()) && !unit.contains(char::is_control),
            "unit_name = {unit:?}: 1 to 16 characters, none of control, such as \"m\" or \"kg\""
        );
    }
    Ok(Declared {
        name: name.into(),
        unit: unit.map_or(Unit::Any, |powers| Unit::Of(powers.map(f64::from))),
        length_power: unit.map_or(0, |powers| powers[0]),
        time_power: unit.map(|powers| powers[1]),
        unit_name: unit_name.clone(),
        bounds,
        start: *start,
        fixed: *fixed,
    })
}
