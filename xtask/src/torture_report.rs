//! Writes `reports/torture` from what the parts of `make torture` printed, which it finds in `target/torture`. A part that
//! is not there is left out of the page.
//!
//! `cargo xtask torture-report`

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde_json::{Map, Value, json};

/// # Errors
/// A folder that cannot be written.
pub fn run() -> Result<()> {
    let project = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let parts = PrintedParts { folder: project.join("target/torture") };
    let out = project.join("reports/torture");
    fs::create_dir_all(&out)?;
    let results = parts.results()?;
    fs::write(out.join("results.json"), serde_json::to_string_pretty(&results)? + "\n")?;
    let page = page(&results);
    fs::write(out.join("report.md"), &page)?;
    println!("{page}");
    Ok(())
}

/// What the parts printed.
struct PrintedParts {
    folder: PathBuf,
}

impl PrintedParts {
    fn said(&self, name: &str) -> String {
        fs::read_to_string(self.folder.join(name)).unwrap_or_default()
    }

    /// The lines of JSON in it.
    fn records(&self, name: &str) -> Result<Vec<Value>> {
        let text = self.said(name);
        let lines = text.lines().filter(|line| line.starts_with('{'));
        lines.map(|line| Ok(serde_json::from_str(line)?)).collect()
    }

    /// All keys of its lines of JSON, the last value of each.
    fn merged(&self, name: &str) -> Result<Map<String, Value>> {
        let objects = self.records(name)?.into_iter();
        Ok(objects.filter_map(|record| record.as_object().cloned()).flatten().collect())
    }

    /// The numbers before a word at the ends of its lines, together.
    fn sum(&self, name: &str, word: &str) -> u64 {
        let text = self.said(name);
        text.lines().filter_map(|line| line.strip_suffix(word)?.rsplit(' ').next()?.parse::<u64>().ok()).sum()
    }

    /// Whether it is of tests of which one failed or none ended.
    fn failed(&self, name: &str) -> bool {
        let text = self.said(name);
        !text.is_empty() && (text.contains("FAILED") || !text.contains("test result: ok"))
    }

    fn results(&self) -> Result<Value> {
        let last = |name: &str| Ok::<_, anyhow::Error>(self.records(name)?.pop().unwrap_or(json!({})));
        let (torn, fuzz) = (last("kills.txt")?, last("fuzz.txt")?);
        let of_programs = torn["kills"].as_object().cloned().unwrap_or_default();
        let mut results = json!({
            "kills": of_programs.values().filter_map(Value::as_u64).sum::<u64>(),
            "kills_of": of_programs,
            "kill_seconds": torn["seconds"],
            "lost": torn["lost"].as_array().map_or(0, Vec::len),
            "what_was_lost": torn["lost"],
            "not_tried": torn["not_tried"],
            "faults_injected": self.sum("faults.txt", " faults"),
            "violations": u64::from(self.failed("faults.txt")),
            "fuzz_executions": fuzz["fuzz_executions"].as_u64().unwrap_or(0),
            "crashes": fuzz["crashes"].as_u64().unwrap_or(0),
            "bad_invocations": self.sum("invocations.txt", " bad invocations"),
            "wrong": u64::from(self.failed("invocations.txt")),
            "resources": last("resources.txt")?,
            "engines": self.records("engines.txt")?,
        });
        let all = results.as_object_mut().expect("it was written as an object");
        for part in ["sanitize.txt", "fuzz_coverage.txt", "server.txt"] {
            all.extend(self.merged(part)?);
        }
        Ok(results)
    }
}

fn page(results: &Value) -> String {
    [
        "# Torture\n\nWritten by `make torture`; what is tried and what is promised: \
         [docs/reliability.md](../../docs/reliability.md).\n"
            .to_string(),
        kills(results),
        list("Lost or wrong", &results["what_was_lost"]),
        list("Not tried", &results["not_tried"]),
        tried("Faults of the storage", results, "faults_injected", "violations", "promises broken"),
        tried("Inputs of the fuzzer", results, "fuzz_executions", "crashes", "that broke a reader"),
        tried("Bad invocations", results, "bad_invocations", "wrong", "tests failed"),
        sanitizers(results),
        server(results),
        resources(&results["resources"]),
        engines(&results["engines"]),
    ]
    .into_iter()
    .filter(|part| !part.is_empty())
    .collect::<Vec<_>>()
    .join("\n")
}

fn kills(results: &Value) -> String {
    let Some(of_programs) = results["kills_of"].as_object().filter(|kills| !kills.is_empty()) else {
        return String::new();
    };
    let rows: String = of_programs.iter().map(|(program, kills)| format!("| {program} | {kills} |\n")).collect();
    format!(
        "{} kills (SIGKILL and SIGTERM at random moments) in {:.0} minutes; {} times something was lost.\n\n\
         | program | kills |\n|---|---|\n{rows}",
        results["kills"],
        results["kill_seconds"].as_f64().unwrap_or(0.0) / 60.0,
        results["lost"],
    )
}

/// How often something was tried, and how often it went wrong.
fn tried(title: &str, results: &Value, tries: &str, failures: &str, failed: &str) -> String {
    if results[tries] == 0 && results[failures] == 0 {
        String::new()
    } else {
        format!("{title}: {}; {failed}: {}.\n", results[tries], results[failures])
    }
}

fn list(title: &str, items: &Value) -> String {
    let items = items.as_array().map(Vec::as_slice).unwrap_or_default();
    let lines: String = items.iter().filter_map(Value::as_str).map(|item| format!("- {}\n", item.trim())).collect();
    if lines.is_empty() { lines } else { format!("{title}:\n\n{lines}") }
}

/// Tests under each sanitizer, and its reports.
fn sanitizers(results: &Value) -> String {
    const SANITIZERS: [(&str, &str); 5] = [
        ("asan", "AddressSanitizer and LeakSanitizer: decoders, tracker, resizing"),
        ("ubsan", "the same of the kernels, and UndefinedBehaviorSanitizer in their C++"),
        ("tsan", "ThreadSanitizer: decoding ahead"),
        ("miri", "Miri: threads and activations of the kernels"),
        ("valgrind", "valgrind memcheck: `paig import`"),
    ];
    let row = |(key, what): &(&str, &str)| {
        let tests = results[format!("{key}_tests")].as_u64()?;
        Some(format!("| {what} | {tests} | {} |\n", results[format!("{key}_reports")]))
    };
    let rows: String = SANITIZERS.iter().filter_map(row).collect();
    if rows.is_empty() { rows } else { format!("| sanitizer | tests | reports |\n|---|---|---|\n{rows}") }
}

/// The server of `paig studio` under load, and killed.
fn server(results: &Value) -> String {
    if results["server_requests"].is_null() {
        return String::new();
    }
    let number = |key: &str| &results[key];
    format!(
        "Server: {} parallel requests, {} slow and {} idle clients, {} aborted and {} colliding uploads, {} parallel starts \
         of a job, {} kills; lost: {}, orphan processes: {}, wrong in all: {}.\n",
        number("server_requests"),
        number("slow_clients"),
        number("idle_clients"),
        number("aborted_uploads"),
        number("colliding_uploads"),
        number("parallel_starts"),
        number("server_kills"),
        number("server_lost"),
        number("orphans"),
        number("server_wrong"),
    )
}

/// What a long training held, and whether a dataset larger than its memory was learned from.
fn resources(held: &Value) -> String {
    let Some(steps) = held["steps"].as_array() else { return String::new() };
    let row = |at: &Value| format!("| {} | {} | {} | {} |\n", at["step"], at["memory_mb"], at["files"], at["threads"]);
    let rows: String = steps.iter().map(row).collect();
    let larger = &held["larger_than_memory"];
    format!(
        "One training:\n\n| step | memory, MB | open files | threads |\n|---|---|---|---|\n{rows}\n\
         {} MB of frames were learned from under a limit of {} MB of addresses, to the same bits as without: {}. A training \
         that could not fit was refused: {}.\n",
        larger["frames_mb"], larger["limit_mb"], larger["same_bits"], larger["too_large_refused"]
    )
}

/// Sweeps on engines, beside a plain one.
fn engines(records: &Value) -> String {
    let records = records.as_array().map(Vec::as_slice).unwrap_or_default();
    let text = |value: &Value| if value.is_null() { "–".into() } else { value.to_string() };
    let row = |record: &Value| {
        let name = record["engine"].as_str().filter(|name| *name != "none").unwrap_or("a plain sweep");
        let numbers = ["runs", "killed", "other_bits", "seconds"].map(|key| text(&record[key]));
        let overhead =
            record["overhead"].as_f64().map_or("–".into(), |overhead| format!("{:.1} %", 100.0 * overhead));
        format!("| {name} | {} | {overhead} |\n", numbers.join(" | "))
    };
    let rows: String = records.iter().map(row).collect();
    if rows.is_empty() {
        return rows;
    }
    format!(
        "Sweeps of tiny runs. Overhead is the share of the time in which the sweep ran nothing; the plain one has one run \
         at a time, so had Slurm (two threads of one core); the others two.\n\n\
         | engine | runs | killed | other bits than the plain sweep | seconds | overhead |\n|---|---|---|---|---|---|\n{rows}"
    )
}
