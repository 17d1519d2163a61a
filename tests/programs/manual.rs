//! The manual: every command and option that its pages name exists.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use crate::programs::{paig, text};
use crate::project::project;

/// Markdown files in and under a folder.
fn pages(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            pages(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
}

/// Commands in shell blocks, one for each call in a line.
fn of_blocks(page: &str) -> Vec<String> {
    let blocks = page.split("```").skip(1).step_by(2).filter_map(|block| block.strip_prefix("sh\n"));
    let joined = blocks.map(|block| block.replace("\\\n", " "));
    let lines = joined.flat_map(|block| block.lines().map(String::from).collect::<Vec<_>>());
    let calls = lines.flat_map(|line| {
        let line = line.split(" #").next().unwrap();
        line.split([';', '&', '|']).map(String::from).collect::<Vec<_>>()
    });
    calls.collect()
}

/// Commands in spans of code.
fn of_spans(page: &str) -> Vec<String> {
    let prose = page.split("```").step_by(2);
    prose.flat_map(|prose| prose.split('`').skip(1).step_by(2)).map(String::from).collect()
}

/// Command and options of a call of `paig`; `None` for other programs, and for calls without a command.
fn parsed(call: &str) -> Option<(String, Vec<String>)> {
    let mut words = call.split_whitespace().skip_while(|word| *word == "do" || word.contains('='));
    let command = words.next().filter(|program| *program == "paig").and_then(|_| words.next())?;
    if !command.starts_with(|first: char| first.is_ascii_lowercase()) {
        return None;
    }
    let options = words.take_while(|word| *word != "--").filter(|word| word.starts_with("--"));
    Some((command.into(), options.map(|option| option.split('=').next().unwrap().into()).collect()))
}

/// Options in the help of a command; `None` where there is no such command.
fn options(command: &str) -> Option<BTreeSet<String>> {
    let output = paig(command).arg("--help").output().unwrap();
    let help = text(&output);
    let words = help.split(|c: char| !c.is_ascii_alphanumeric() && c != '-').filter(|word| word.starts_with("--"));
    output.status.success().then(|| words.map(String::from).collect())
}

#[test]
fn commands_and_options_of_the_manual_exist() {
    let mut files = vec![project("README.md"), project("CONTRIBUTING.md"), project("data/README.md")];
    pages(&project("docs"), &mut files);
    let (mut known, mut wrong, mut checked) = (BTreeMap::new(), Vec::new(), 0);
    for file in &files {
        let page = fs::read_to_string(file).unwrap();
        // A span may also be a message that begins with the program's name.
        for (calls, is_message) in [(of_blocks(&page), false), (of_spans(&page), true)] {
            for (command, named) in calls.iter().filter_map(|call| parsed(call)) {
                let Some(options) = known.entry(command.clone()).or_insert_with(|| options(&command)) else {
                    if !is_message {
                        wrong.push(format!("{}: no command paig {command}", file.display()));
                    }
                    continue;
                };
                checked += 1;
                let unknown = named.iter().filter(|option| !options.contains(*option));
                wrong.extend(unknown.map(|option| format!("{}: paig {command} has no {option}", file.display())));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(checked > 100, "only {checked} commands were found in {} pages", files.len());
}

#[test]
fn commands_are_found_in_pages() {
    let page = "`paig track clip.mp4 --at 1:2,3` and `paig --help`\n```sh\nX=1 paig measure a.mp4 \\\n    --takes && make b  # paig no\n\
                for t in x; do paig batch d -- --y-up; done\n```\n";
    let found = |calls: Vec<String>| calls.iter().filter_map(|call| parsed(call)).collect::<Vec<_>>();
    assert_eq!(found(of_spans(page)), [("track".into(), vec!["--at".into()])]);
    assert_eq!(found(of_blocks(page)), [("measure".into(), vec!["--takes".into()]), ("batch".into(), vec![])]);
}
