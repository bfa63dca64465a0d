//! Numbers as a person reads them in reasons.

/// A count with its thousands apart: `18,558`.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (idx, digit) in digits.chars().enumerate() {
        if idx > 0 && (digits.len() - idx).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A number with about three digits that count: `0.012`, `1.95`, `12.3`, `301`, `18,558`, `1.2e12`.
pub fn number(value: f64) -> String {
    let size = value.abs();
    // Each bound is where rounding would add a digit.
    match size {
        _ if value == 0.0 => "0".to_owned(),
        _ if !size.is_finite() => value.to_string(),
        _ if size < 0.0005 => format!("{value:.0e}"),
        _ if size < 0.0995 => format!("{value:.3}"),
        _ if size < 9.995 => format!("{value:.2}"),
        _ if size < 99.95 => format!("{value:.1}"),
        _ if size < 1e9 => format!("{}{}", if value < 0.0 { "-" } else { "" }, count(size.round() as u64)),
        _ => format!("{value:.1e}"),
    }
}

/// `5`, or `4 to 6`.
pub fn range([least, most]: [u64; 2]) -> String {
    if least == most { count(least) } else { format!("{} to {}", count(least), count(most)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits_that_count() {
        let shown: Vec<String> =
            [0.0, 0.0123, 0.0996, 1.949, 9.996, 12.34, 99.96, 301.4, 18_558.2, -3.0].map(number).into();
        assert_eq!(shown, ["0", "0.012", "0.10", "1.95", "10.0", "12.3", "100", "301", "18,558", "-3.00"]);
    }
}
