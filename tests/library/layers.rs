//! The layers of the source: each folder of a crate imports only from those that stand before it, and no two files import
//! from each other in a circle. Between crates the compiler sees to it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The folders of the sources of each library with more than one, in the order of their imports. `lib.rs` sees all of them.
const LAYERS: [(&str, &[&str]); 3] = [
    ("src", &["support", "network", "tasks", "datasets", "generators", "runs", "evaluation", "training", "viz", "run"]),
    ("crates/video/src", &["calibration", "import", "reference_track", "track", "measure", "batch", "run"]),
    ("crates/experiments/src", &["sweep", "stress", "baselines", "control", "comparison"]),
];
/// Libraries that never print, and programs' code, which does.
const SILENT: [&str; 6] = [
    "src",
    "crates/kernels/src",
    "crates/report/src",
    "crates/video/src",
    "crates/experiments/src",
    "crates/studio/src",
];
const PRINTING: [&str; 2] = ["crates/terminal/src", "crates/cli/src"];

/// All source files by their module's path: `network::cells::spring` and its text without tests and comments.
fn modules(sources: &str) -> BTreeMap<String, String> {
    fn search(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { search(&path, files) } else { files.push(path) }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(sources);
    let mut files = Vec::new();
    search(&root, &mut files);
    let rust = files.iter().filter(|path| path.extension().is_some_and(|it| it == "rs") && !path.ends_with("lib.rs"));
    rust.map(|path| {
        let parts = path.strip_prefix(&root).unwrap().with_extension("");
        let parts: Vec<_> = parts.iter().map(|part| part.to_str().unwrap()).filter(|part| *part != "mod").collect();
        let text = fs::read_to_string(path).unwrap();
        let (code, _) = text.split_once("#[cfg(test)]\nmod tests").unwrap_or((&text, ""));
        let code = code.lines().map(|line| line.split("//").next().unwrap());
        (parts.join("::"), code.collect::<Vec<_>>().join("\n"))
    })
    .collect()
}

/// What stands in the braces of an import, one path each: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn expanded(path: &str) -> Vec<String> {
    let Some((prefix, rest)) = path.split_once('{') else { return vec![path.trim().to_string()] };
    let inside = rest.rsplit_once('}').map_or(rest, |(inside, _)| inside);
    let (mut depth, mut part, mut parts) = (0, String::new(), Vec::new());
    for c in inside.chars() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(std::mem::take(&mut part));
                continue;
            }
            _ => {}
        }
        part.push(c);
    }
    parts.push(part);
    let whole = |part: &String| expanded(&format!("{}{}", prefix.trim(), part.trim()));
    parts.iter().filter(|part| !part.trim().is_empty()).flat_map(whole).collect()
}

/// The paths that a module's code names, from the crate's root: those of `use`, and `crate::..` elsewhere.
fn paths(module: &str, code: &str) -> Vec<String> {
    let mut paths = Vec::new();
    for statement in code.split(';') {
        let Some((_, path)) = statement.rsplit_once("use ").filter(|(before, _)| {
            before.trim_end().ends_with(['\n', '{', '}', ']']) || before.trim().is_empty() || before.ends_with("pub ")
        }) else {
            continue;
        };
        paths.extend(expanded(path));
    }
    let words = code.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
    paths.extend(words.filter(|word| word.starts_with("crate::") || word.starts_with("super::")).map(String::from));
    let own: Vec<&str> = module.split("::").collect();
    let absolute = |path: String| {
        let mut parts: Vec<&str> = path.split("::").map(str::trim).collect();
        let ups = parts.iter().take_while(|part| **part == "super").count();
        match parts[0] {
            "crate" => Some(parts[1..].join("::")),
            "self" => Some([&own[..], &parts[1..]].concat().join("::")),
            "super" => Some([&own[..own.len() - ups], &parts.split_off(ups)[..]].concat().join("::")),
            _ => None,
        }
    };
    paths.into_iter().filter_map(absolute).collect()
}

/// The module in which a path ends: the longest known beginning of it.
fn module_of<'a>(path: &str, known: &'a BTreeMap<String, String>) -> Option<&'a str> {
    let parts: Vec<&str> = path.split("::").collect();
    let beginnings = (1..=parts.len()).rev().map(|length| parts[..length].join("::"));
    beginnings.filter_map(|name| known.get_key_value(&name)).map(|(name, _)| name.as_str()).next()
}

/// Which modules each module imports from. A folder's `mod.rs` stands for what it passes on: imports of its own children
/// do not count.
fn imports(modules: &BTreeMap<String, String>) -> BTreeMap<&str, BTreeSet<&str>> {
    modules
        .iter()
        .map(|(module, code)| {
            let targets = paths(module, code);
            let targets = targets.iter().filter_map(|path| module_of(path, modules));
            let child = format!("{module}::");
            let counts = |target: &&str| *target != module && !target.starts_with(&child);
            (module.as_str(), targets.filter(counts).collect())
        })
        .collect()
}

#[test]
fn each_folder_imports_only_from_those_before_it() {
    let mut wrong = Vec::new();
    for (sources, layers) in LAYERS {
        let modules = modules(sources);
        let layer = |module: &str| {
            let folder = module.split("::").next().unwrap();
            layers
                .iter()
                .position(|name| *name == folder)
                .unwrap_or_else(|| panic!("{sources}/{folder} is in no layer"))
        };
        for (module, targets) in imports(&modules) {
            for target in targets.into_iter().filter(|target| layer(target) > layer(module)) {
                wrong.push(format!("{sources}: {module} imports from {target}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn no_files_import_from_each_other_in_a_circle() {
    for sources in SILENT.iter().chain(&PRINTING) {
        let modules = modules(sources);
        let imports = imports(&modules);
        // Files from which nothing is imported by those that are left fall away; what remains stands in circles.
        let mut left: BTreeSet<&str> = imports.keys().copied().collect();
        loop {
            let is_free = |module: &&str| imports[module].iter().all(|target| !left.contains(target));
            let free: Vec<_> = left.iter().copied().filter(is_free).collect();
            if free.is_empty() {
                break;
            }
            for module in free {
                left.remove(module);
            }
        }
        let circles: Vec<_> =
            left.iter().map(|module| (module, imports[module].intersection(&left).collect::<Vec<_>>())).collect();
        assert!(circles.is_empty(), "{sources}: {circles:#?}");
    }
}

/// Among the equations not even a folder's `mod.rs` stands in a circle: it passes on what its files hold, and they import from
/// each other's files.
#[test]
fn no_file_of_the_equations_imports_from_the_folder_it_stands_in() {
    let modules = modules("src");
    let mut wrong = Vec::new();
    for (module, code) in modules.iter().filter(|(module, _)| module.starts_with("network::cells::")) {
        let paths = paths(module, code);
        let targets = paths.iter().filter_map(|path| module_of(path, &modules));
        let above = targets.filter(|target| module.starts_with(&format!("{target}::")));
        wrong.extend(above.map(|target| format!("{module} imports from {target}")));
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The test sees what it should: known imports are found, of every form.
#[test]
fn imports_are_found() {
    let library = modules("src");
    let imports = imports(&library);
    assert!(imports["network::cells::damped_spring"].contains("network::cells::spring"));
    assert!(imports["training::base"].contains("runs::checkpoint"));
    assert!(imports["network::system"].contains("network::cells"));
    assert_eq!(expanded("a::{b, c::{d, e}}"), ["a::b", "a::c::d", "a::c::e"]);
    assert!(imports.len() > 80, "{} modules", imports.len());
    // What follows something else that is for tests alone.
    assert!(modules("crates/kernels/src")["gpu"].contains("pub use unet::unet;"));
}

/// What the lints of `lib.rs` do not see: only the programs' code reads arguments and writes to the terminal.
#[test]
fn only_the_programs_code_reads_arguments_and_writes_to_the_terminal() {
    let named = |sources: &[&str], word: &str| -> Vec<String> {
        let all = sources.iter().flat_map(|sources| modules(sources));
        all.filter(|(_, code)| code.contains(word)).map(|(name, _)| name).collect()
    };
    // Arguments are clap's to read.
    for (word, used) in [("env::args", false), ("try_get_matches", true), ("stdout()", true), ("stderr()", true)] {
        let (programs, library) = (named(&PRINTING, word), named(&SILENT, word));
        assert!(programs.is_empty() != used && library.is_empty(), "{word} is in {programs:?} and {library:?}");
    }
}
