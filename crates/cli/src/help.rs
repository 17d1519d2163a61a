//! The page of `paig --help`: the commands by purpose.

use std::fmt::Write;

use clap::Command;

/// Purposes, and the commands of each.
const GROUPS: [(&str, &[&str]); 5] = [
    ("Learn", &["demo", "train", "generate", "evaluate", "predict", "convert"]),
    ("Your own video", &["studio", "track", "import", "measure", "measurements", "batch", "compare-track"]),
    ("Many runs", &["sweep", "report", "stress", "baselines", "train-baseline"]),
    ("Control", &["control"]),
    ("This build", &["compare", "bench", "completions"]),
];

const EXAMPLES: &str = "Examples:
  paig demo
  paig generate --task spring_color
  paig train --task spring_color --seed 1
  paig import clip.mp4 --out my-scene --equation falling
  paig train --task my-scene/task.toml
  paig completions bash > ~/.local/share/bash-completion/completions/paig
";

/// The page, from the commands' own descriptions.
pub fn text(program: &Command) -> String {
    let about = |name: &str| {
        let command = program.get_subcommands().find(|command| command.get_name() == name);
        command.and_then(Command::get_about).map(ToString::to_string).unwrap_or_default()
    };
    let mut page = program.get_about().map(ToString::to_string).unwrap_or_default();
    page.push_str("\n\nUsage: paig COMMAND [OPTIONS]\n");
    for (purpose, commands) in GROUPS {
        let _ = writeln!(page, "\n{purpose}:");
        for name in commands {
            let _ = writeln!(page, "  {name:<16}{}", about(name));
        }
    }
    page.push_str("\nOptions:\n  -h, --help      Print this page; `paig COMMAND --help` explains a command\n");
    page.push_str("  -V, --version   Print the versions of paig and libtorch, the processor and the GPUs\n\n");
    page + EXAMPLES
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory;

    use super::*;
    use crate::Paig;

    #[test]
    fn each_command_has_a_purpose_and_a_description() {
        let program = Paig::command();
        let all: BTreeSet<_> = program.get_subcommands().map(Command::get_name).collect();
        let listed: Vec<_> = GROUPS.iter().flat_map(|(_, commands)| commands.iter().copied()).collect();
        assert_eq!(all, listed.iter().copied().collect());
        assert_eq!(all.len(), listed.len());
        for command in program.get_subcommands() {
            assert!(command.get_about().is_some(), "{}", command.get_name());
            let examples = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(examples.contains(&format!("paig {}", command.get_name())), "{}", command.get_name());
        }
    }
}
