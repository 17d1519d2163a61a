//! The template engine: it fills numbers into the report's words, and evaluates the rules of hypotheses.

use std::sync::LazyLock;

use anyhow::{Context, Result};
use minijinja::{AutoEscape, Environment, Error, ErrorKind, UndefinedBehavior, Value};
use serde::Deserialize;

use paig::support::significant::significant;
use paig::support::statistics::Spread;

/// By which a report is known.
pub(super) const TITLE: &str = "Physics-as-Inverse-Graphics: report of runs";
/// All words and tables of report.md.
const PAGE: &str = "report.md.jinja";
/// What stands for a number that there is not.
const NONE: &str = "–";

/// How a number is written.
type Digits = fn(f64) -> String;

static ENGINE: LazyLock<Environment> = LazyLock::new(|| engine().expect("a test reads the report's template"));

fn engine() -> Result<Environment<'static>, Error> {
    let mut engine = Environment::new();
    engine.set_undefined_behavior(UndefinedBehavior::Strict);
    engine.set_auto_escape_callback(|_| AutoEscape::None);
    engine.set_syntax(engine.syntax().to_builder().trim_blocks(true).lstrip_blocks(true).build()?);
    let numbers: [(&str, Digits); 7] = [
        ("significant", |number| significant(number, 4)),
        // Never broken across lines.
        ("percent", |percent| format!("{percent:+.2}\u{a0}%")),
        ("plain", |number| number.to_string()),
        ("one_digit", |number| format!("{number:.1}")),
        ("four_digits", |number| format!("{number:.4}")),
        ("minutes", |seconds| format!("{:.1} min", seconds / 60.0)),
        ("seconds", |seconds| format!("{seconds:.0} s")),
    ];
    for (name, digits) in numbers {
        engine.add_filter(name, move |value: &Value| written(value, digits));
    }
    engine.add_filter("code", code);
    engine.add_filter("cell", cell);
    engine.add_filter("text", text);
    engine.add_template(PAGE, include_str!("../../../reports/report.md.jinja"))?;
    Ok(engine)
}

/// A number, the median and range of some, or a text as it is.
fn written(value: &Value, digits: Digits) -> Result<String, Error> {
    if value.is_undefined() {
        return Err(Error::new(ErrorKind::UndefinedError, "there is no number of this name"));
    }
    if let Ok(spread) = Spread::deserialize(value.clone()) {
        return Ok(spread.text(digits));
    }
    match (value.as_str(), f64::try_from(value.clone())) {
        (Some(text), _) => Ok(text.into()),
        (None, Ok(number)) if !number.is_nan() => Ok(digits(number)),
        _ => Ok(NONE.into()),
    }
}

/// Text from outside as code.
pub fn code(text: &str) -> String {
    format!("`{}`", text.replace('`', "'").replace('\n', " "))
}

/// Text in a cell of a table.
pub fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

/// Text from outside in which nothing may be taken for markup. (An underscore within a word is none.)
fn text(text: &str) -> String {
    text.chars().flat_map(|c| "\\`*[]<>&#~".contains(c).then_some('\\').into_iter().chain([c])).collect()
}

/// report.md.
pub(super) fn page(view: &Value) -> Result<String> {
    ENGINE.get_template(PAGE)?.render(view.clone()).context("the report's template")
}

/// A text with words in braces filled in.
pub(super) fn fill(text: &str, words: &Value) -> Result<String> {
    ENGINE.render_str(text, words.clone()).with_context(|| format!("{text:?}"))
}

/// A page of a template with numbers by their names.
///
/// # Errors
/// A template that is damaged or has a name without a number.
pub fn fill_template(template: &str, numbers: &serde_json::Value) -> Result<String> {
    fill(template, &Value::from(minijinja::value::Serde(numbers)))
}

/// What an expression amounts to.
pub(super) fn evaluate(expression: &str, words: &Value) -> Result<Value> {
    let value = ENGINE.compile_expression(expression).and_then(|expression| expression.eval(words.clone()));
    value.with_context(|| format!("{expression:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_digits() {
        let written = [3.99079, 60.0, 0.0360549, 123.456, 1632.85, 0.0, 1e-7].map(|number| significant(number, 4));
        assert_eq!(written, ["3.991", "60.00", "0.03605", "123.5", "1633", "0.000", "1.000e-7"]);
    }

    #[test]
    fn an_unknown_name_is_an_error_and_a_missing_number_a_dash() {
        let numbers = minijinja::context! { known => Option::<f64>::None };
        assert_eq!(fill("{{ known|significant }}", &numbers).unwrap(), NONE);
        assert!(fill("{{ unknown|significant }}", &numbers).is_err());
    }
}
