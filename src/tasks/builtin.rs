//! The tasks that come with the program.

use super::Task;

/// Each by its name.
const FILES: [(&str, &str); 9] = [
    ("bouncing_balls", include_str!("../../configs/tasks/bouncing_balls.toml")),
    ("spring_color", include_str!("../../configs/tasks/spring_color.toml")),
    ("spring_color_half", include_str!("../../configs/tasks/spring_color_half.toml")),
    ("damped_spring", include_str!("../../configs/tasks/damped_spring.toml")),
    ("mnist_spring_color", include_str!("../../configs/tasks/mnist_spring_color.toml")),
    ("3bp_color", include_str!("../../configs/tasks/3bp_color.toml")),
    ("pendulum", include_str!("../../configs/tasks/pendulum.toml")),
    ("falling", include_str!("../../configs/tasks/falling.toml")),
    ("falling_bouncing", include_str!("../../configs/tasks/falling_bouncing.toml")),
];

/// All of them, in the order of the report.
pub fn all() -> impl Iterator<Item = Task> {
    FILES.into_iter().map(|(_, text)| parsed(text))
}

/// The one of this name.
pub fn builtin(name: &str) -> Option<Task> {
    text(name).map(parsed)
}

/// The text of the one of this name.
pub(super) fn text(name: &str) -> Option<&'static str> {
    FILES.into_iter().find(|(known, _)| *known == name).map(|(_, text)| text)
}

fn parsed(text: &str) -> Task {
    Task::from_toml(text).expect("the built-in tasks are sound, by a test")
}

/// Their names, for people to read.
pub fn names() -> String {
    FILES.map(|(name, _)| name).join(", ")
}

#[cfg(test)]
mod tests {
    use super::{FILES, builtin};

    #[test]
    fn each_file_holds_the_task_of_its_name() {
        for (name, _) in FILES {
            assert_eq!(builtin(name).unwrap().name, name);
        }
    }

    /// Frames, clips, cuts, equations, rates and true values as in the original's README and `run_physics.py`.
    #[test]
    fn the_papers_tasks_have_the_originals_numbers() {
        let springs = ("spring", 0.3, [("k", 4.0), ("l", 6.0)].to_vec());
        let digits = ("spring", 0.3, [("k", 2.0), ("l", 12.0)].to_vec());
        let bodies = ("gravity", 0.5, [("g", 60.0), ("m", 1.0)].to_vec());
        for (name, [side, objects, input, predicted, train, test], (equation, dt, truth), [base_lr, alpha]) in [
            ("bouncing_balls", [32, 2, 4, 6, 12, 30], ("bouncing", 0.3, vec![]), [3e-4, 2.0]),
            ("spring_color", [32, 2, 4, 6, 12, 30], springs.clone(), [6e-4, 3.0]),
            ("spring_color_half", [32, 2, 4, 6, 12, 30], springs, [6e-4, 3.0]),
            ("mnist_spring_color", [64, 2, 3, 7, 12, 30], digits, [6e-4, 3.0]),
            ("3bp_color", [36, 3, 4, 12, 20, 40], bodies, [1e-3, 5.0]),
        ] {
            let task = builtin(name).unwrap();
            let system = &task.system;
            assert_eq!(
                [system.side, system.objects, system.input_steps, system.pred_steps],
                [side, objects, input, predicted]
            );
            assert_eq!(([task.train_frames, task.test_frames], system.channels), ([train, test], 3), "{name}");
            assert_eq!((system.cell.name, system.dt), (equation, dt), "{name}");
            assert_eq!([task.base_lr, task.alpha], [base_lr, alpha], "{name}");
            for (symbol, value) in truth {
                let fixed =
                    system.cell.parameters.iter().find(|parameter| parameter.name == symbol).and_then(|it| it.fixed);
                assert_eq!(task.truth_of(symbol).or(fixed), Some(value), "{name}: {symbol}");
            }
        }
    }
}
