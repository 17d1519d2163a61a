//! An equation of one's own, defined outside the crate: a ball that falls through a medium that resists, `v' = g - c v`.
//!
//! The clips are drawn here, too, so that the answer is known. `cargo run --release --example own_equation` takes some
//! two minutes on a core.

use std::sync::Arc;

use anyhow::Result;
use ndarray::Array5;
use paig::datasets::iterators::Clips;
use paig::generators::render::Balls;
use paig::network::System;
use paig::network::cells::plain::{AccelerationLaw, Euler, PlainCell, columns, columns_mut};
use paig::network::cells::{Actions, Build, Cell, CellKind, Coordinates, PhysicalParameter, State, Walls, scalars};
use paig::network::physics_models::PhysicsNet;
use paig::support::random::named_generator;
use paig::tasks::Task;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use paig::training::trainer::Trainer;
use rand::Rng;
use tch::{Device, Tensor};

/// What the network, a task file and a run's config need to know of the equation.
fn falling_with_drag() -> CellKind {
    CellKind {
        name: "falling_with_drag".into(),
        scope: "falling_with_drag_ode_cell",
        objects: Some(1),
        coordinates: Coordinates::Position,
        walls: false,
        actions: false,
        parameters: vec![PhysicalParameter::learned("g", "log_g", 1), PhysicalParameter::learned("c", "log_c", 0)]
            .into(),
        build: Build::Rust(|logs, _walls| {
            let [log_g, log_c] = scalars(logs);
            Box::new(FallingWithDrag { log_g, log_c })
        }),
        text: None,
    }
}

#[derive(Debug)]
struct FallingWithDrag {
    log_g: Tensor,
    log_c: Tensor,
}

impl Cell for FallingWithDrag {
    fn substep(&self, state: &State, _action: Option<&Tensor>, h: f64) -> State {
        // (0, 1): y points down.
        let down = Tensor::arange(2, (state.vel.kind(), state.vel.device()));
        let vel = &state.vel + (self.log_g.exp() * down - self.log_c.exp() * &state.vel) * h;
        State { pos: &state.pos + &vel * h, vel }
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        let [g, c] = [&self.log_g, &self.log_c].map(|log| log.double_value(&[]).exp());
        Some(Box::new(Euler::new(DragLaw { g, c })))
    }
}

/// The same in plain numbers: with it the parameters are fitted without tensors, several times as fast. It may be left out.
#[derive(Debug)]
struct DragLaw {
    g: f64,
    c: f64,
}

impl AccelerationLaw for DragLaw {
    fn accelerate(&self, _positions: &[f64], velocities: &[f64], _action: &[f64], into: &mut [f64]) {
        let [vx, vy] = columns(velocities);
        let [ax, ay] = columns_mut(into);
        for i in 0..vx.len() {
            (ax[i], ay[i]) = (-self.c * vx[i], self.g - self.c * vy[i]);
        }
    }
}

/// Clips of a white ball of radius 3 px, uint8 `[clips, frames, 32, 32, 1]`, with g = 3 and c = 0.5.
fn film(system: &System, clips: usize, frames: usize, purpose: &str) -> Array5<u8> {
    let _guard = tch::no_grad_guard();
    let truth = [3.0f64.ln(), 0.5f64.ln()].map(Tensor::from);
    let cell = system.build_cell(&truth);
    let balls = Balls::new(system.side, 3.0, system.channels);
    let mut random = named_generator(0, purpose);
    let mut film = Array5::zeros((clips, frames, system.side, system.side, system.channels));
    for mut clip in film.outer_iter_mut() {
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        let pos = Tensor::from_slice(&[between(8.0, 24.0), between(14.0, 26.0)]).reshape([1, 2]);
        let vel = Tensor::from_slice(&[between(-4.0, 4.0), between(-9.0, -3.0)]).reshape([1, 2]);
        let first = State { pos, vel };
        let rolled = cell.roll_out(&first, &Actions::none(), system.dt, frames - 1);
        for (state, mut frame) in std::iter::once(&first).chain(&rolled).zip(clip.outer_iter_mut()) {
            let place = [state.pos.double_value(&[0, 0]), state.pos.double_value(&[0, 1])];
            balls.draw(&[place], frame.as_slice_mut().expect("a frame lies in one piece"));
        }
    }
    film
}

fn main() -> Result<()> {
    let system = System {
        side: 32,
        channels: 1,
        objects: 1,
        input_steps: 4,
        pred_steps: 6,
        dt: 0.3,
        cell: Arc::new(falling_with_drag()),
        walls: Walls::new(32, 0.0),
        halved: false,
    };
    let task = Task::of_system("falling_with_drag", &system, 12, 12)?;
    let set =
        ["discover.max_steps=250", "discover.guide.full_until=80", "discover.guide.zero_from=160", "join.max_steps=40"];
    let overrides = Overrides { set: set.map(String::from).to_vec(), ..Overrides::default() };
    let config = Config::load_task(task, None, &overrides)?;
    let clips = |count, purpose| Clips::new(&film(&system, count, 12, purpose), None, Device::Cpu);
    let (train, valid) = (clips(500, "training clips"), clips(50, "validation clips"));
    let model = PhysicsNet::new(&system, &config.model, Device::Cpu, config.seed)?;
    Trainer::new(&config, &model, &train, &valid)?.run()?;
    for (symbol, value) in model.parameter_values() {
        println!("{symbol} = {value:.3}");
    }
    println!("true: g = 3, c = 0.5");
    Ok(())
}
