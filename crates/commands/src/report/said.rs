//! What is said to a person: results on stdout, notes and failures on stderr.

use std::borrow::Cow;
use std::io::{self, Write as _};

use tactile_pose_fusion::bag;

use super::terminal::{Voice, fitted, stderr_columns, stdout_columns, voice};

/// Writes a result to stdout, at the width of a terminal.
pub(crate) fn print(text: &str) -> io::Result<()> {
    print_as_it_is(&fitted(text, stdout_columns()))
}

/// Writes a result to stdout. A reader that has gone away (`| head`) is no failure of ours.
pub(crate) fn print_as_it_is(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    match stdout.write_all(tame(text).as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(io::Error::new(error.kind(), format!("stdout: {error}")))
        }
        _ => Ok(()),
    }
}

/// Says something to the person at the terminal, unless it is to be quiet.
pub(crate) fn tell(text: &str) {
    if voice() != Voice::Quiet {
        say(text);
    }
}

/// Says something to the person at the terminal, also where it is to be quiet; a closed stderr is nobody to tell.
pub(crate) fn say(text: &str) {
    let words = text.trim_end_matches('\n');
    let end = &text[words.len()..];
    let line = tame(words).replace('\n', "\\u000a");
    let _ = writeln!(io::stderr(), "{}{end}", fitted(&line, stderr_columns()));
}

/// A text whose lines are ours and whose words may be foreign: what would steer a terminal is written out, in a form that
/// JSON takes for the same character.
fn tame(text: &str) -> Cow<'_, str> {
    let is_foreign = |c: char| c != '\n' && c != '\t' && bag::steers(c);
    if !text.contains(is_foreign) {
        return Cow::Borrowed(text);
    }
    let mut tamed = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_foreign(c) {
            let _ = std::fmt::Write::write_fmt(&mut tamed, format_args!("\\u{:04x}", c as u32));
        } else {
            tamed.push(c);
        }
    }
    Cow::Owned(tamed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_words_steer_no_terminal_and_stay_the_same_in_json() {
        assert_eq!(tame("a\tb\nc"), "a\tb\nc");
        assert_eq!(tame("\u{1b}]0;x\u{7}\u{9b}2J\u{202e}\r"), "\\u001b]0;x\\u0007\\u009b2J\\u202e\\u000d");
        let json = serde_json::to_string("\u{1b}[31m\u{9b}\u{2066}\n").unwrap();
        assert_eq!(serde_json::from_str::<String>(&tame(&json)).unwrap(), "\u{1b}[31m\u{9b}\u{2066}\n");
    }
}
