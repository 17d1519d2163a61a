//! What an equation lacks: terms are added to its accelerations one at a time, and ways in which the camera changes what is seen
//! ([`ViewDistortion`]) are tried; the one is named that the recording asks for.
//!
//! A term counts where the Bayesian criterion is better by more than 10 with the effective number of residuals, and the held-out
//! part is predicted better: it must hold over time, not only where it was fitted.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::Serialize;

use paig::network::System;
use paig::network::cells::text::{Accelerations, EquationTable, ParameterTable};
use paig::network::cells::{CellKind, PhysicalParameter};

use super::dynamics::Dynamics;
use super::explain::{Explained, explain};
use super::fit::{Observations, Start};
use super::fits::frames_in_one_of_best;
use super::recording::{RecordedSystem, whole};
use super::results::{MissingTerm, Quantity};
use super::view::{Corrected, ViewDistortion};

/// Gain of the Bayesian criterion, and share of the held-out error that must go.
const CLEARLY_BETTER: f64 = 10.0;
const PREDICTS_BETTER: f64 = 0.1;
/// Largest size of a term in units of the usual acceleration.
const LARGEST: f64 = 10.0;
/// Speed below which dry friction fades, as a share of the usual speed.
const SLOW: f64 = 0.05;

/// A term that may be missing.
struct ExtraTerm {
    name: &'static str,
    /// Added to an acceleration.
    text: &'static str,
    /// Parameters that are learned with it, with their units.
    parameters: &'static [(&'static str, [i32; 2])],
}

const TERMS: [ExtraTerm; 6] = [
    ExtraTerm { name: "linear friction", text: "- missing * v", parameters: &[("missing", [0, -1])] },
    ExtraTerm {
        name: "quadratic friction (drag)",
        text: "- missing * norm(v) * v",
        parameters: &[("missing", [-1, 0])],
    },
    ExtraTerm {
        name: "dry friction",
        text: "- missing * tanh(norm(v) / missing_slow) * unit(v)",
        parameters: &[("missing", [1, -2])],
    },
    ExtraTerm {
        name: "constant force (or a tilted camera)",
        text: "+ vec(missing_x, missing_y)",
        parameters: &[("missing_x", [1, -2]), ("missing_y", [1, -2])],
    },
    ExtraTerm {
        name: "force across the velocity (Magnus)",
        text: "+ missing * perp(v)",
        parameters: &[("missing", [0, -1])],
    },
    ExtraTerm {
        name: "spring",
        text: "+ vec(missing_x, missing_y) - missing * p",
        parameters: &[("missing", [0, -2]), ("missing_x", [1, -2]), ("missing_y", [1, -2])],
    },
];

/// A fit with one term more.
struct Extended {
    what: ModelExtension,
    explained: Explained,
    /// The Bayesian criterion, and the held-out error as it is seen.
    criterion: f64,
    held_out: f64,
    learned: f64,
}

enum ModelExtension {
    Term(&'static ExtraTerm, Box<EquationTable>),
    View(ViewDistortion, Vec<f64>),
}

/// The term that explains most of what a fit leaves; none where no term does. `judged` is fitted to `tracks` without what is held
/// out.
pub(super) fn missing_term(
    scene: &RecordedSystem,
    tracks: &[Observations],
    judged: &Explained,
    seed: u64,
) -> Option<MissingTerm> {
    let system = &judged.dynamics.system;
    let table = system.cell.table()?;
    let sizes = MotionScales::of(judged, tracks);
    let fitted = |term: &ExtraTerm| {
        let table = term.added_to(&table, &sizes);
        let extended = with(system, &table)?;
        let dynamics = Dynamics::new(extended, judged.dynamics.dt).ok()?;
        let start = term.start(&dynamics, judged, scene.piece);
        Some((table, explain(&dynamics, tracks, &[start]).ok()?))
    };
    let terms = || TERMS.par_iter().filter_map(|term| Some((term, fitted(term)?)));
    let views = || ViewDistortion::ALL.par_iter().filter_map(|view| view.fitted(scene, tracks, judged));
    let (terms, views): (Vec<_>, Vec<_>) = rayon::join(|| terms().collect(), || views().collect());
    let all =
        terms.iter().map(|(_, (_, it))| it).chain(views.iter().map(|it: &Corrected| &it.explained)).chain([judged]);
    let frames_in_one = frames_in_one_of_best(all);
    let criterion = |it: &Explained| it.criteria(frames_in_one, 0.0).bic;
    let of_term = |(term, (table, explained)): (&'static ExtraTerm, (EquationTable, Explained))| Extended {
        what: ModelExtension::Term(term, Box::new(table)),
        criterion: criterion(&explained),
        held_out: explained.errors.held_out,
        learned: explained.errors.learned,
        explained,
    };
    let of_view = |it: Corrected| {
        let independent = it.explained.independent(frames_in_one);
        // Of residuals as they are seen, with the coefficients as further unknowns.
        let seen =
            independent * (it.coefficients.len() as f64 * independent.ln() / independent - 2.0 * it.magnification.ln());
        Extended {
            criterion: criterion(&it.explained) + seen,
            held_out: it.explained.errors.held_out / it.magnification,
            learned: it.explained.errors.learned / it.magnification,
            what: ModelExtension::View(it.view, it.coefficients),
            explained: it.explained,
        }
    };
    let before = judged.errors;
    let helps = |it: &Extended| {
        criterion(judged) - it.criterion > CLEARLY_BETTER && it.held_out < (1.0 - PREDICTS_BETTER) * before.held_out
    };
    let best = terms.into_iter().map(of_term).chain(views.into_iter().map(of_view)).filter(helps);
    let best = best.min_by(|a, b| a.criterion.total_cmp(&b.criterion))?;
    let (times, _) = scene.per_coordinate();
    let factors = factors(judged, &best.explained);
    let (name, quantities, equation) = match best.what {
        ModelExtension::Term(term, table) => {
            (term.name, quantities(scene, tracks, &best.explained, term, seed)?, file(scene, system, &table))
        }
        ModelExtension::View(view, values) => {
            let values = view.coefficients().iter().zip(values);
            (view.name(), values.map(|(name, value)| Quantity::new(name, value, Vec::new())).collect(), None)
        }
    };
    Some(MissingTerm {
        name: name.into(),
        quantities,
        gain: criterion(judged) - best.criterion,
        residual: [before.learned, best.learned].map(|error| times * error),
        held_out_error: [before.held_out, best.held_out].map(|error| times * error),
        factors,
        equation,
    })
}

/// By which factor each learned parameter changes from one fit to another.
fn factors(before: &Explained, after: &Explained) -> BTreeMap<String, f64> {
    let value = |it: &Explained, name: &str| {
        let place = it.dynamics.system.cell.parameters.iter().position(|parameter| parameter.name == name)?;
        let parameter = &it.dynamics.system.cell.parameters[place];
        it.learned[place].then(|| parameter.bounds.value(it.fitted.unconstrained[place]))
    };
    let parameters = before.dynamics.system.cell.parameters.iter();
    // Of a parameter that is 0 there is none.
    let factor = |name: &str| Some(value(after, name)? / value(before, name)?).filter(|factor| factor.is_finite());
    parameters.filter_map(|parameter| Some((parameter.name.to_string(), factor(&parameter.name)?))).collect()
}

/// The parameters of a term with their intervals, fitted to all frames.
fn quantities(
    scene: &RecordedSystem,
    tracks: &[Observations],
    best: &Explained,
    term: &ExtraTerm,
    seed: u64,
) -> Option<Vec<Quantity>> {
    let tracks = whole(tracks);
    let whole = scene.go_on(best, &tracks).ok()?;
    let all = scene.quantities_alone(&tracks, &whole, seed).ok()?.into_iter();
    let of_term = |quantity: &Quantity| term.parameters.iter().any(|(name, _)| *name == quantity.name);
    Some(all.filter(of_term).collect())
}

/// The same system with another equation.
fn with(system: &System, table: &EquationTable) -> Option<System> {
    let cell = CellKind::of_text(table, system.objects).ok()?;
    Some(System { cell: cell.into(), ..system.clone() })
}

/// An equation as a file: starts and bounds are those of its frames.
fn file(scene: &RecordedSystem, system: &System, table: &EquationTable) -> Option<String> {
    #[derive(Serialize)]
    struct EquationToml<'a> {
        system: SystemToml<'a>,
    }
    #[derive(Serialize)]
    struct SystemToml<'a> {
        side: usize,
        objects: usize,
        dt: f64,
        equation: &'a EquationTable,
    }
    let dt = scene.scale.seconds * scene.dt;
    toml::to_string(&EquationToml {
        system: SystemToml { side: system.side, objects: system.objects, dt, equation: table },
    })
    .ok()
}

/// What velocities, accelerations and places usually are, in the frame's units.
struct MotionScales {
    speed: f64,
    acceleration: f64,
    length: f64,
}

impl MotionScales {
    fn of(explained: &Explained, tracks: &[Observations]) -> Self {
        let coordinates = explained.dynamics.coordinates();
        let (mut speeds, mut accelerations, mut lengths) = (Mean::default(), Mean::default(), Mean::default());
        for (track, states) in tracks.iter().zip(&explained.states) {
            let states: Vec<&[f64]> = states.chunks(2 * coordinates).collect();
            for (pair, times) in states.windows(2).zip(track.times.windows(2)) {
                for row in 0..coordinates {
                    let (before, after) = (pair[0][coordinates + row], pair[1][coordinates + row]);
                    speeds.add(before);
                    accelerations.add((after - before) / (times[1] - times[0]));
                    lengths.add(pair[0][row]);
                }
            }
        }
        MotionScales { speed: speeds.root(), acceleration: accelerations.root().max(1e-9), length: lengths.root() }
    }

    /// Bound of a parameter with these powers, so that its term is at most [`LARGEST`] times the usual acceleration.
    fn bound(&self, unit: [i32; 2]) -> f64 {
        let beside = match unit {
            [0, -1] => self.speed,
            [-1, 0] => self.speed.powi(2),
            [0, -2] => self.length,
            _ => 1.0,
        };
        LARGEST * self.acceleration / beside.max(1e-9)
    }
}

/// Root mean square.
#[derive(Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, x: f64) {
        self.sum += x * x;
        self.count += 1.0;
    }

    fn root(&self) -> f64 {
        (self.sum / self.count.max(1.0)).sqrt()
    }
}

impl ExtraTerm {
    fn added_to(&self, table: &EquationTable, sizes: &MotionScales) -> EquationTable {
        let mut table = table.clone();
        let added = |text: &String, object: Option<usize>| {
            // In a list of texts each object has names of its own.
            let own = match object {
                Some(number) => self
                    .text
                    .replace("norm(v)", "norm(V)")
                    .replace("perp(v)", "perp(V)")
                    .replace("unit(v)", "unit(V)")
                    .replace("* v", "* V")
                    .replace('V', &format!("v{number}"))
                    .replace("* p", &format!("* p{number}")),
                None => self.text.to_string(),
            };
            format!("{text} {own}")
        };
        table.acceleration = match &table.acceleration {
            Accelerations::ForAll(text) => Accelerations::ForAll(added(text, None)),
            Accelerations::ForEach(texts) => {
                let texts = texts.iter().enumerate().map(|(place, text)| added(text, Some(place + 1)));
                Accelerations::ForEach(texts.collect())
            }
        };
        for (name, unit) in self.parameters {
            let bound = sizes.bound(*unit);
            let parameter = ParameterTable {
                unit: Some(*unit),
                start: Some(0.0),
                low: Some(-bound),
                high: Some(bound),
                ..ParameterTable::default()
            };
            table.parameters.insert((*name).into(), parameter);
        }
        if self.text.contains("missing_slow") {
            let slow =
                ParameterTable { unit: Some([1, -1]), fixed: Some(SLOW * sizes.speed), ..ParameterTable::default() };
            table.parameters.insert("missing_slow".into(), slow);
        }
        table
    }

    /// From where the fit without the term led to, the term at 0.
    fn start(&self, dynamics: &Dynamics, before: &Explained, piece: usize) -> Start {
        let names = before.dynamics.system.cell.parameters.iter().map(|it| &*it.name);
        let known: BTreeMap<&str, (f64, bool)> =
            names.zip(before.fitted.unconstrained.iter().copied().zip(before.learned.iter().copied())).collect();
        let of = |parameter: &PhysicalParameter| {
            known.get(&*parameter.name).copied().unwrap_or_else(|| {
                let value = parameter.fixed.or(parameter.start).unwrap_or(0.0);
                (parameter.bounds.unconstrained(value), parameter.fixed.is_none())
            })
        };
        let (unconstrained, learned) = dynamics.system.cell.parameters.iter().map(of).unzip();
        Start { unconstrained, learned, piece }
    }
}
