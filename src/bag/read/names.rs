//! The order of the files of a recording by their names.

use std::cmp::Ordering;

/// Order of names in which `bag_2` comes before `bag_10`.
pub(super) fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    while !left.is_empty() && !right.is_empty() {
        let (left_run, left_rest) = split_run(left);
        let (right_run, right_rest) = split_run(right);
        let by_run = match (left_run.as_bytes()[0].is_ascii_digit(), right_run.as_bytes()[0].is_ascii_digit()) {
            (true, true) => {
                let (left_digits, right_digits) = (left_run.trim_start_matches('0'), right_run.trim_start_matches('0'));
                left_digits.len().cmp(&right_digits.len()).then_with(|| left_digits.cmp(right_digits))
            }
            _ => left_run.cmp(right_run),
        };
        if by_run != Ordering::Equal {
            return by_run;
        }
        (left, right) = (left_rest, right_rest);
    }
    left.len().cmp(&right.len()).then_with(|| a.cmp(b))
}

/// The leading digits of a text that is not empty, or all that stands in front of its first digit; and the rest.
fn split_run(text: &str) -> (&str, &str) {
    let starts_with_digit = text.starts_with(|c: char| c.is_ascii_digit());
    let end = text.find(|c: char| c.is_ascii_digit() != starts_with_digit).unwrap_or(text.len());
    text.split_at(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_split_bag_sort_by_their_numbers() {
        let mut names = ["b_10.mcap", "b_2.mcap", "b.mcap", "b_1.mcap", "a_3.mcap", "b_02.mcap"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ["a_3.mcap", "b.mcap", "b_1.mcap", "b_02.mcap", "b_2.mcap", "b_10.mcap"]);
    }
}
