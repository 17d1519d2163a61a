//! Numbers as tables show them.

/// So many significant digits, without an exponent for numbers of everyday size.
pub fn significant(value: f64, digits: i32) -> String {
    if value != 0.0 && !(1e-4..1e6).contains(&value.abs()) {
        return format!("{value:.*e}", (digits - 1) as usize);
    }
    let before = if value == 0.0 { 1 } else { value.abs().log10().floor() as i32 + 1 };
    format!("{value:.*}", (digits - before).clamp(0, 6) as usize)
}

/// With six decimals; a small number with an exponent instead, so that it keeps its digits.
pub fn six_digits(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-2 { format!("{value:.5e}") } else { format!("{value:.6}") }
}

#[cfg(test)]
mod tests {
    use super::{significant, six_digits};

    #[test]
    fn small_numbers_keep_their_digits() {
        let numbers = [0.0, 12.5, -0.25, 5.0e-7, -8.333_333_3e-5].map(six_digits);
        assert_eq!(numbers, ["0.000000", "12.500000", "-0.250000", "5.00000e-7", "-8.33333e-5"]);
    }

    #[test]
    fn everyday_numbers_have_no_exponent() {
        for (value, digits, text) in [
            (0.0, 4, "0.000"),
            (3.21987, 4, "3.220"),
            (-3.21987, 5, "-3.2199"),
            (123_456.7, 4, "123457"),
            (0.000_123_456, 5, "0.000123"),
            (1.234_567e-5, 4, "1.235e-5"),
            (-1.234_567e7, 5, "-1.2346e7"),
        ] {
            assert_eq!(significant(value, digits), text);
        }
    }
}
