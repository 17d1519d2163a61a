//! Physics cells: the differential equations, each in a file of its own, behind one trait.
//!
//! Original: `nn/network/cells.py`; paper: section 3.2. A frame is integrated in [`SUBSTEPS`] Euler steps. A state holds
//! a position and a velocity for each object: `[batch, 2 * objects]` as `(x0, y0, x1, y1, ..)`, in pixels and pixels per
//! time unit, or one angle each, `[batch, objects]`, in radians (see [`Coordinates`]).
//!
//! A new equation is a few lines of [`text`] in a task file; or, in Rust, a [`Cell`] and its [`CellKind`], here or in a
//! program of one's own that calls [`register`]: `docs/own-equation.md` goes through both.

mod actions;
mod bouncing;
mod damped_spring;
mod falling;
mod gravity;
mod impact;
mod on_gpu;
mod parameter;
mod pendulum;
pub mod plain;
mod spring;
pub mod text;

use std::fmt::Debug;
use std::sync::{Mutex, PoisonError};

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Tensor};

pub use actions::Actions;
pub use bouncing::BOUNCING;
pub use damped_spring::DAMPED_SPRING;
pub use falling::{FALLING, FALLING_BOUNCING};
pub use gravity::GRAVITY;
pub use on_gpu::OnGpu;
pub use parameter::{Bounds, PhysicalParameter};
pub use pendulum::{PENDULUM, PlainPendulum};
pub use spring::SPRING;

use plain::PlainCell;
use text::Equation;

/// Euler steps for one frame.
pub const SUBSTEPS: usize = 5;
/// Most objects of a system.
pub const MOST_OBJECTS: usize = 32;

/// What an equation calls the position of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coordinates {
    /// x and y, pixels.
    Position,
    /// The angle about the frame's centre: 0 is up, positive is clockwise on the screen; radians.
    Angle,
}

impl Coordinates {
    /// Numbers for one object.
    pub fn per_object(self) -> usize {
        match self {
            Coordinates::Position => 2,
            Coordinates::Angle => 1,
        }
    }

    /// Short name of the unit they are measured in.
    pub fn unit(self) -> &'static str {
        match self {
            Coordinates::Position => "px",
            Coordinates::Angle => "rad",
        }
    }
}

/// Positions and velocities of all objects, each `[batch, coordinates * objects]`.
#[derive(Debug)]
pub struct State {
    pub pos: Tensor,
    pub vel: Tensor,
}

impl State {
    /// Splits `[batch, 2 * coordinates * objects]`, positions then velocities.
    pub fn from_joined(joined: &Tensor) -> Self {
        let halves = joined.chunk(2, 1);
        State { pos: halves[0].shallow_clone(), vel: halves[1].shallow_clone() }
    }

    /// `[batch, 2 * coordinates * objects]`, positions then velocities.
    pub fn joined(&self) -> Tensor {
        Tensor::cat(&[&self.pos, &self.vel], 1)
    }

    /// States after each other, `[batch, time, 2 * coordinates * objects]`.
    pub fn sequence<'s>(states: impl IntoIterator<Item = &'s State>) -> Tensor {
        Tensor::stack(&states.into_iter().map(State::joined).collect::<Vec<_>>(), 1)
    }

    /// Their positions alone, `[batch, time, coordinates * objects]`.
    pub fn positions(states: &[State]) -> Tensor {
        Tensor::stack(&states.iter().map(|state| &state.pos).collect::<Vec<_>>(), 1)
    }

    pub fn detach(&self) -> Self {
        State { pos: self.pos.detach(), vel: self.vel.detach() }
    }

    /// Position of one object in the plane, `[batch, 2]`.
    pub fn position(&self, object: i64) -> Tensor {
        self.pos.narrow(1, 2 * object, 2)
    }
}

/// The walls of a square frame, the same on both axes: where a ball's centre turns, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Walls {
    pub near: f64,
    pub far: f64,
}

impl Walls {
    /// In a frame of side `side`, both `margin` pixels from its edges.
    pub fn new(side: usize, margin: f64) -> Self {
        Walls { near: margin, far: side as f64 - margin }
    }

    /// Near and far, `[1]` each.
    fn tensors(self, options: (Kind, Device)) -> [Tensor; 2] {
        [self.near, self.far].map(|place| Tensor::full([1], place, options))
    }
}

/// An equation: what it is called, what it is about, and how a cell of it is made.
#[derive(Debug)]
pub struct CellKind {
    /// Name in a task file, such as `spring`.
    pub name: &'static str,
    /// Name of the scope that holds the cell's variables; ends in `_cell`.
    pub scope: &'static str,
    /// The number of objects that it is written for; none if any number will do.
    pub objects: Option<usize>,
    pub coordinates: Coordinates,
    /// Whether it depends on where the walls are.
    pub walls: bool,
    /// Whether something acts from outside in every frame, or the equation names the time: the dataset must hold it.
    pub actions: bool,
    /// In the order in which `build` takes them.
    pub parameters: &'static [PhysicalParameter],
    pub build: Build,
}

/// How a cell of an equation is made.
#[derive(Debug)]
pub enum Build {
    /// By this function, from the raw numbers of the parameters (scalars, one for each; see [`Bounds`]: of a positive one its
    /// logarithm) and the walls.
    Rust(fn(&[Tensor], Walls) -> Box<dyn Cell>),
    /// From the text of a task file.
    Text(&'static Equation),
}

impl CellKind {
    /// Whether what the dataset holds for each frame is its time, and nothing acts.
    pub fn tells_time(&self) -> bool {
        matches!(&self.build, Build::Text(equation) if equation.tells_time())
    }

    /// Whether it matters which object is which: a text names a given one, there is one for each, or of a parameter that each
    /// object has some are held at other values than the rest. `held`: of each parameter the raw number, if it is not learned.
    pub(crate) fn tells_objects_apart(&self, held: &[Option<f64>]) -> bool {
        matches!(&self.build, Build::Text(equation) if equation.tells_objects_apart(held))
    }

    /// Of the parameters that each object has of its own, the first object's places; those of the other objects follow each.
    pub fn of_each(&self) -> &[usize] {
        match &self.build {
            Build::Text(equation) => equation.of_each(),
            Build::Rust(_) => &[],
        }
    }

    /// Whether something acts that may be chosen.
    pub fn can_be_driven(&self) -> bool {
        self.actions && !self.tells_time()
    }

    /// The cell with these raw parameters (scalars, one for each of `parameters`): of those that are positive, the
    /// logarithms.
    pub fn cell(&self, raw: &[Tensor], walls: Walls) -> Box<dyn Cell> {
        match &self.build {
            Build::Rust(build) => build(raw, walls),
            Build::Text(equation) => equation.cell(raw, walls),
        }
    }
}

/// Equations are told apart by their names. That of a text holds a checksum of it.
impl PartialEq for CellKind {
    fn eq(&self, other: &CellKind) -> bool {
        self.name == other.name
    }
}

/// The equations that come with the program.
const BUILT_IN: [&CellKind; 7] = [&BOUNCING, &SPRING, &DAMPED_SPRING, &GRAVITY, &PENDULUM, &FALLING, &FALLING_BOUNCING];
/// Those that a program added.
static REGISTERED: Mutex<Vec<&CellKind>> = Mutex::new(Vec::new());

/// All equations that a task file may name.
pub fn kinds() -> Vec<&'static CellKind> {
    let registered = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
    BUILT_IN.into_iter().chain(registered.iter().copied()).collect()
}

/// Makes an equation of one's own known by its name, so that task files and saved runs can name it. To be called at the
/// start of a program.
///
/// # Errors
/// A name or a scope that another equation has, a scope that does not end in `_cell`.
pub fn register(kind: &'static CellKind) -> Result<()> {
    ensure!(kind.scope.ends_with("_cell"), "equation {}: its scope {:?} must end in _cell", kind.name, kind.scope);
    let known = kinds();
    let same = |other: &&CellKind| other.name == kind.name || other.scope == kind.scope;
    ensure!(!known.iter().any(same), "equation {} (scope {}): name or scope is taken", kind.name, kind.scope);
    REGISTERED.lock().unwrap_or_else(PoisonError::into_inner).push(kind);
    Ok(())
}

/// The equation of this name.
///
/// # Errors
/// An unknown name, with the list of those there are.
pub fn find(name: &str) -> Result<&'static CellKind> {
    let known = kinds();
    let names = || known.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
    let found = known.iter().copied().find(|kind| kind.name == name);
    found.ok_or_else(|| anyhow::anyhow!("unknown equation {name:?}; the equations are {}", names()))
}

/// A differential equation, integrated by Euler steps.
pub trait Cell: Debug {
    /// The state a time `h` later; a negative `h` goes back (to the order of the method). `action` (`[batch, 1]`) acts
    /// meanwhile; without one nothing does.
    fn substep(&self, state: &State, action: Option<&Tensor>, h: f64) -> State;

    /// The state one frame (`dt` time units) later.
    fn step(&self, state: &State, action: Option<&Tensor>, dt: f64) -> State {
        let h = dt / SUBSTEPS as f64;
        let mut state = self.substep(state, action, h);
        for _ in 1..SUBSTEPS {
            state = self.substep(&state, action, h);
        }
        state
    }

    /// The states of the next `frames` frames, the initial one not included; `actions` begin at the initial state's frame.
    fn roll_out(&self, initial: &State, actions: &Actions, dt: f64, frames: usize) -> Vec<State> {
        let mut states: Vec<State> = Vec::with_capacity(frames);
        for frame in 0..frames {
            let next = self.step(states.last().unwrap_or(initial), actions.at(frame).as_ref(), dt);
            states.push(next);
        }
        states
    }

    /// The same equation with the parameters as they are now, in plain numbers; none where there is no such form.
    fn plain(&self) -> Option<Box<dyn PlainCell>> {
        None
    }

    /// The same in double precision.
    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        None
    }
}

/// The raw numbers that `build` was given, scalars, one for each of `N` parameters.
///
/// # Panics
/// Another number of them: a mistake in the program, never in its input.
pub fn scalars<const N: usize>(raw: &[Tensor]) -> [Tensor; N] {
    let raw: &[Tensor; N] = raw.try_into().expect("one raw number for each parameter of the cell");
    raw.each_ref().map(Tensor::shallow_clone)
}
