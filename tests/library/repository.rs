//! The repository: the size of its files, and links of its pages to files that are in it.
//!
//! Only files that git tracks count. A packaged crate has no repository: there the tests print so and check nothing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const MEGABYTE: u64 = 1_000_000;
/// All tracked files together.
const LARGEST_TREE: u64 = 30 * MEGABYTE;
const LARGEST_FILE: u64 = MEGABYTE;
/// Larger files: float32 tensors of whole models, which hardly compress and must stay as the original computed them.
const LARGER_FILES: [&str; 7] = [
    "compare/goldens/3bp_color_spread_train.npz",
    "compare/goldens/3bp_color_train.npz",
    "compare/goldens/mnist_spring_color_train.npz",
    "compare/goldens/spring_color_adam_train.npz",
    "compare/goldens/spring_color_altvel_train.npz",
    "compare/goldens/spring_color_spread_train.npz",
    "compare/goldens/spring_color_train.npz",
];

pub(super) fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The tracked files, relative to the root; `None` outside a git repository or without git.
pub(super) fn tracked_files() -> Option<Vec<String>> {
    if !root().join(".git").exists() {
        eprintln!("not checked: {} is no git repository", root().display());
        return None;
    }
    // The checkout may belong to another user, as in a container.
    let mut git = Command::new("git");
    git.arg("-C").arg(root()).args(["-c", "safe.directory=*", "ls-files", "-z"]);
    let Ok(listed) = git.output() else {
        eprintln!("not checked: git cannot be started");
        return None;
    };
    assert!(listed.status.success(), "git ls-files: {}", String::from_utf8_lossy(&listed.stderr));
    let paths = String::from_utf8(listed.stdout).expect("paths are UTF-8");
    Some(paths.split_terminator('\0').map(String::from).collect())
}

/// Tracked Markdown files with their text.
fn pages(files: &[String]) -> impl Iterator<Item = (&String, String)> {
    let pages = files.iter().filter(|file| file.ends_with(".md"));
    pages.filter_map(|page| Some((page, fs::read_to_string(root().join(page)).ok()?)))
}

/// Targets of a page's relative links and pictures, without their fragments. Links in code are none.
fn relative_links(page: &str) -> Vec<&str> {
    let mut links = Vec::new();
    // Every second part is the inside of a block of code.
    for text in page.split("```").step_by(2) {
        let targets = text.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target);
        let files = targets.filter(|target| !target.contains("://")).map(|target| target.split('#').next().unwrap());
        links.extend(files.filter(|file| !file.is_empty()));
    }
    links
}

/// A path relative to the root from one relative to a page.
fn resolved(page: &str, target: &str) -> String {
    let mut parts: Vec<&str> = Path::new(page).parent().unwrap().iter().map(|part| part.to_str().unwrap()).collect();
    for part in target.split('/').filter(|part| !["", "."].contains(part)) {
        match part {
            ".." => _ = parts.pop().unwrap_or_else(|| panic!("{page}: {target} leads out of the repository")),
            part => parts.push(part),
        }
    }
    parts.join("/")
}

/// A tracked file, or a folder that holds some.
fn is_tracked(files: &[String], path: &str) -> bool {
    let path = path.trim_end_matches('/');
    files.iter().any(|file| file.strip_prefix(path).is_some_and(|rest| rest.is_empty() || rest.starts_with('/')))
}

#[test]
fn no_file_is_large_and_all_together_are_not() {
    let Some(files) = tracked_files() else { return };
    let size = |file: &String| fs::symlink_metadata(root().join(file)).map_or(0, |entry| entry.len());
    let (mut total, mut large) = (0, Vec::new());
    for file in &files {
        total += size(file);
        if size(file) > LARGEST_FILE {
            large.push(file.as_str());
        }
    }
    assert_eq!(large, LARGER_FILES, "left: files of more than {LARGEST_FILE} bytes, right: those that may be as large");
    assert!(total < LARGEST_TREE, "the tracked files have {total} bytes, expected less than {LARGEST_TREE}");
}

#[test]
fn links_lead_to_tracked_files() {
    let Some(files) = tracked_files() else { return };
    let mut broken = Vec::new();
    for (page, text) in pages(&files) {
        let targets = relative_links(&text).into_iter().map(|target| resolved(page, target));
        broken.extend(targets.filter(|target| !is_tracked(&files, target)).map(|target| format!("{page}: {target}")));
    }
    assert!(broken.is_empty(), "links to files that are not tracked:\n{}", broken.join("\n"));
}

/// The commands of a report name configs of its records: only with these can its runs be made again.
#[test]
fn configs_that_commands_name_are_tracked() {
    let Some(files) = tracked_files() else { return };
    let mut missing = Vec::new();
    for (page, text) in pages(&files).filter(|(page, _)| page.starts_with("reports/")) {
        let words = text.split(|c: char| c.is_whitespace() || "'`,".contains(c));
        let configs = words.filter(|word| word.starts_with("reports/") && word.ends_with("/config.toml"));
        missing.extend(configs.filter(|path| !is_tracked(&files, path)).map(|path| format!("{page}: {path}")));
    }
    assert!(missing.is_empty(), "configs that are not tracked:\n{}", missing.join("\n"));
}

#[test]
fn links_are_found_and_resolved() {
    let page = "[a](b.md#c), [d](#e) and [f](https://g.h/i)\n```\n[j](k)\n```\n![l](../m/n=0.png) [o](./p/)";
    assert_eq!(relative_links(page), ["b.md", "../m/n=0.png", "./p/"]);
    assert_eq!(resolved("docs/a.md", "../m/n=0.png"), "m/n=0.png");
    assert_eq!(resolved("README.md", "./p/"), "p");
    let files = ["p/q.md".to_string(), "r.md".to_string()];
    assert_eq!(
        ["p", "p/", "p/q.md", "r.md", "p/q", "r"].map(|path| is_tracked(&files, path)),
        [true, true, true, true, false, false]
    );
}
