//! The tasks that come with the program.

use super::Task;

const FILES: [&str; 9] = [
    include_str!("../../configs/tasks/bouncing_balls.toml"),
    include_str!("../../configs/tasks/spring_color.toml"),
    include_str!("../../configs/tasks/spring_color_half.toml"),
    include_str!("../../configs/tasks/damped_spring.toml"),
    include_str!("../../configs/tasks/mnist_spring_color.toml"),
    include_str!("../../configs/tasks/3bp_color.toml"),
    include_str!("../../configs/tasks/pendulum.toml"),
    include_str!("../../configs/tasks/falling.toml"),
    include_str!("../../configs/tasks/falling_bouncing.toml"),
];

/// All of them, in the order of the report.
pub fn all() -> impl Iterator<Item = Task> {
    FILES.into_iter().map(|text| Task::from_toml(text).expect("the built-in tasks are sound, by a test"))
}

/// The one of this name.
pub fn builtin(name: &str) -> Option<Task> {
    all().find(|task| task.name == name)
}

/// Their names, for people to read.
pub fn names() -> String {
    all().map(|task| task.name).collect::<Vec<_>>().join(", ")
}
