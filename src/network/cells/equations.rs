//! The equations that a name in a file stands for.

use std::sync::Arc;

use anyhow::{Result, anyhow, ensure};

use super::bouncing::BOUNCING;
use super::built_in::BuiltIn;
use super::damped_spring::DAMPED_SPRING;
use super::falling::{FALLING, FALLING_BOUNCING};
use super::gravity::GRAVITY;
use super::kind::{Build, CellKind};
use super::pendulum::PENDULUM;
use super::spring::SPRING;

/// Equations by name: those that come with the program, and those that a program adds.
#[derive(Debug, Clone, PartialEq)]
pub struct Equations(Vec<NamedEquation>);

/// An equation that has a name.
#[derive(Debug, Clone, PartialEq)]
enum NamedEquation {
    Text(BuiltIn),
    Rust(Arc<CellKind>),
}

impl NamedEquation {
    fn name(&self) -> &str {
        match self {
            NamedEquation::Text(text) => text.name,
            NamedEquation::Rust(kind) => &kind.name,
        }
    }

    fn scope(&self) -> &str {
        match self {
            NamedEquation::Text(text) => text.scope,
            NamedEquation::Rust(kind) => kind.scope,
        }
    }
}

impl Default for Equations {
    /// Those that come with the program.
    fn default() -> Self {
        use NamedEquation::{Rust, Text};
        Equations(vec![
            Text(BOUNCING),
            Text(SPRING),
            Text(DAMPED_SPRING),
            Rust(Arc::new(GRAVITY.clone())),
            Text(PENDULUM),
            Text(FALLING),
            Text(FALLING_BOUNCING),
        ])
    }
}

impl Equations {
    /// Those that come with the program, and that one. A text stands in its file and needs no name.
    ///
    /// # Errors
    /// A name or a scope that another equation has, a scope that does not end in `_cell`.
    pub fn with(mut self, kind: &Arc<CellKind>) -> Result<Self> {
        let own = NamedEquation::Rust(kind.clone());
        if !matches!(kind.build, Build::Rust(_)) || self.0.contains(&own) {
            return Ok(self);
        }
        ensure!(kind.scope.ends_with("_cell"), "equation {}: its scope {:?} must end in _cell", kind.name, kind.scope);
        let taken = |other: &NamedEquation| other.name() == kind.name || other.scope() == kind.scope;
        ensure!(!self.0.iter().any(taken), "equation {} (scope {}): name or scope is taken", kind.name, kind.scope);
        self.0.push(own);
        Ok(self)
    }

    /// The equation of this name, for so many objects.
    ///
    /// # Errors
    /// An unknown name, with the list of those there are.
    pub fn find(&self, name: &str, objects: usize) -> Result<Arc<CellKind>> {
        match self.0.iter().find(|known| known.name() == name) {
            Some(NamedEquation::Text(text)) => Ok(Arc::new(text.kind(objects))),
            Some(NamedEquation::Rust(kind)) => Ok(kind.clone()),
            None => Err(anyhow!("unknown equation {name:?}; the equations are {}", self.names())),
        }
    }

    /// Their names, for people to read.
    pub fn names(&self) -> String {
        self.0.iter().map(NamedEquation::name).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::super::state::MOST_OBJECTS;
    use super::*;

    /// The bodies under a name and a scope of their own, or under those of another equation.
    fn bodies(name: &'static str, scope: &'static str) -> Arc<CellKind> {
        Arc::new(CellKind { name: name.into(), scope, ..GRAVITY.clone() })
    }

    #[test]
    fn an_equation_of_ones_own_is_found_and_names_are_not_taken_twice() {
        let own = bodies("own", "own_ode_cell");
        let known = Equations::default().with(&own).unwrap();
        assert!(known.find("own", 3).unwrap() == own && *known.find("spring", 2).unwrap() == SPRING.kind(2));
        assert_eq!(known.clone().with(&own).unwrap(), known);
        for (name, scope) in [("spring", "other_cell"), ("other", "spring_ode_cell"), ("other", "scope")] {
            assert!(Equations::default().with(&bodies(name, scope)).is_err(), "{name}, {scope}");
        }
        let unknown = Equations::default().find("own", 3).unwrap_err().to_string();
        assert!(unknown.starts_with("unknown equation \"own\"; the equations are bouncing, spring,"), "{unknown}");
    }

    #[test]
    fn all_texts_are_read_for_few_and_many_objects() {
        for known in Equations::default().0 {
            for objects in [0, 1, 2, MOST_OBJECTS, MOST_OBJECTS + 1] {
                assert_eq!(Equations::default().find(known.name(), objects).unwrap().scope, known.scope());
            }
        }
    }

    #[test]
    fn equations_of_one_name_may_differ() {
        assert_eq!(GRAVITY, GRAVITY.clone());
        assert_eq!(SPRING.kind(2), SPRING.kind(2));
        assert_ne!(FALLING.kind(2), FALLING.kind(3));
        assert_ne!(GRAVITY, CellKind { objects: None, ..GRAVITY.clone() });
        assert_ne!(GRAVITY, CellKind { build: SPRING.kind(2).build, ..GRAVITY.clone() });
        assert_ne!(GRAVITY, CellKind { parameters: SPRING.kind(2).parameters, ..GRAVITY.clone() });
    }
}
