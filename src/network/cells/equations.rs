//! The equations that a name in a file stands for.

use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::bouncing::BOUNCING;
use super::damped_spring::DAMPED_SPRING;
use super::falling::{FALLING, FALLING_BOUNCING};
use super::gravity::GRAVITY;
use super::kind::{Build, CellKind};
use super::pendulum::PENDULUM;
use super::spring::SPRING;

/// Equations by name: those that come with the program, and those that a program adds.
#[derive(Debug, Clone, PartialEq)]
pub struct Equations(Vec<Arc<CellKind>>);

impl Default for Equations {
    /// Those that come with the program.
    fn default() -> Self {
        let built_in = [&BOUNCING, &SPRING, &DAMPED_SPRING, &GRAVITY, &PENDULUM, &FALLING, &FALLING_BOUNCING];
        Equations(built_in.map(|kind| Arc::new(kind.clone())).to_vec())
    }
}

impl Equations {
    /// Those that come with the program, and that one. A text stands in its file and needs no name.
    ///
    /// # Errors
    /// A name or a scope that another equation has, a scope that does not end in `_cell`.
    pub fn with(mut self, kind: &Arc<CellKind>) -> Result<Self> {
        if matches!(kind.build, Build::Text(_)) || self.0.contains(kind) {
            return Ok(self);
        }
        ensure!(kind.scope.ends_with("_cell"), "equation {}: its scope {:?} must end in _cell", kind.name, kind.scope);
        let same = |other: &Arc<CellKind>| other.name == kind.name || other.scope == kind.scope;
        ensure!(!self.0.iter().any(same), "equation {} (scope {}): name or scope is taken", kind.name, kind.scope);
        self.0.push(kind.clone());
        Ok(self)
    }

    /// The equation of this name.
    ///
    /// # Errors
    /// An unknown name, with the list of those there are.
    pub fn find(&self, name: &str) -> Result<Arc<CellKind>> {
        let found = self.0.iter().find(|kind| kind.name == name).cloned();
        found.with_context(|| format!("unknown equation {name:?}; the equations are {}", self.names()))
    }

    /// Their names, for people to read.
    pub fn names(&self) -> String {
        self.0.iter().map(|kind| &*kind.name).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Another spring under a name and a scope of its own, or under those of the built-in one.
    fn spring(name: &'static str, scope: &'static str) -> Arc<CellKind> {
        Arc::new(CellKind { name: name.into(), scope, ..SPRING.clone() })
    }

    #[test]
    fn an_equation_of_ones_own_is_found_and_names_are_not_taken_twice() {
        let own = spring("own", "own_ode_cell");
        let known = Equations::default().with(&own).unwrap();
        assert!(known.find("own").unwrap() == own && *known.find("spring").unwrap() == SPRING);
        assert_eq!(known.clone().with(&own).unwrap(), known);
        for (name, scope) in [("spring", "other_cell"), ("other", "spring_ode_cell"), ("other", "scope")] {
            assert!(Equations::default().with(&spring(name, scope)).is_err(), "{name}, {scope}");
        }
        let unknown = Equations::default().find("own").unwrap_err().to_string();
        assert!(unknown.starts_with("unknown equation \"own\"; the equations are bouncing, spring,"), "{unknown}");
    }

    #[test]
    fn equations_of_one_name_may_differ() {
        assert_eq!(SPRING, SPRING.clone());
        assert_ne!(SPRING, CellKind { objects: None, ..SPRING.clone() });
        assert_ne!(SPRING, CellKind { build: GRAVITY.build.clone(), ..SPRING.clone() });
        assert_ne!(SPRING, CellKind { parameters: GRAVITY.parameters.clone(), ..SPRING.clone() });
    }
}
