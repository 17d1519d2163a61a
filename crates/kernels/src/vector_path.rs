//! The vector path of the process: the instructions that the kernels compute with.

use std::env;
use std::sync::OnceLock;

use super::simd::Instructions;

/// Environment variable that replaces the widest vector path: one of [`NAMES`]. For tests, and to compare processors.
const VARIABLE: &str = "PAIG_INSTRUCTIONS";
/// Values of the variable. With the last one libtorch computes what the kernels otherwise do.
const NAMES: [&str; 4] = ["avx512", "avx2", "portable", LIBTORCH];
const LIBTORCH: &str = "libtorch";

/// The instructions that the kernels of this process compute with, read once; `None` where libtorch replaces the kernels.
///
/// # Errors
/// A variable with an unknown name, or with instructions that this processor lacks.
pub fn vector_path() -> &'static Result<Option<Instructions>, String> {
    static PATH: OnceLock<Result<Option<Instructions>, String>> = OnceLock::new();
    PATH.get_or_init(|| {
        let value = env::var_os(VARIABLE).map(|value| value.to_string_lossy().into_owned());
        chosen(value.as_deref(), &Instructions::all())
    })
}

/// The instructions that `value` names among `available`, which begin with the widest.
fn chosen(value: Option<&str>, available: &[Instructions]) -> Result<Option<Instructions>, String> {
    let Some(value) = value else { return Ok(Some(available[0])) };
    if value == LIBTORCH {
        return Ok(None);
    }
    if !NAMES.contains(&value) {
        return Err(format!("{VARIABLE}: expected {}, found {value:?}", NAMES.join(", ")));
    }
    let found = available.iter().find(|instructions| instructions.name() == value);
    found.copied().map(Some).ok_or_else(|| {
        let names: Vec<_> = available.iter().map(|instructions| instructions.name()).collect();
        format!("{VARIABLE}={value}: this processor has {} only", names.join(", "))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_selects_its_instructions() {
        let all = Instructions::all();
        assert_eq!(chosen(None, &all), Ok(Some(all[0])));
        assert_eq!(chosen(Some(LIBTORCH), &all), Ok(None));
        for instructions in &all {
            assert_eq!(chosen(Some(instructions.name()), &all), Ok(Some(*instructions)));
        }
    }

    #[test]
    fn unknown_names_and_missing_instructions_are_refused() {
        let portable = [*Instructions::all().last().unwrap()];
        let unknown = chosen(Some("sse"), &portable).unwrap_err();
        assert_eq!(unknown, "PAIG_INSTRUCTIONS: expected avx512, avx2, portable, libtorch, found \"sse\"");
        let missing = chosen(Some("avx512"), &portable).unwrap_err();
        assert_eq!(missing, "PAIG_INSTRUCTIONS=avx512: this processor has portable only");
    }
}
