//! Splits IDL text into tokens.

/// A token of IDL.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token<'a> {
    /// A name, keyword, number, or scoped name with its `::`.
    Word(&'a str),
    /// A string or character in quotes.
    Quoted,
    Sign(char),
}

/// Tokens with their lines. Comments, preprocessor lines and section separators are skipped.
pub(super) fn tokens(text: &str) -> Vec<(usize, Token<'_>)> {
    let mut tokens = Vec::new();
    let mut in_comment = false;
    for (line_idx, mut rest) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let trimmed = rest.trim();
        let is_separator = trimmed.len() >= 3 && trimmed.bytes().all(|byte| byte == b'=');
        if !in_comment && (is_separator || trimmed.starts_with('#') || trimmed.starts_with("IDL: ")) {
            continue;
        }
        loop {
            if in_comment {
                let Some((_, behind)) = rest.split_once("*/") else { break };
                (in_comment, rest) = (false, behind);
            }
            rest = rest.trim_start();
            let Some(first) = rest.chars().next() else { break };
            if rest.starts_with("//") {
                break;
            }
            if let Some(behind) = rest.strip_prefix("/*") {
                (in_comment, rest) = (true, behind);
                continue;
            }
            let is_word = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '.');
            let len = match first {
                '"' | '\'' => {
                    let len = quoted_len(rest, first);
                    tokens.push((line_idx + 1, Token::Quoted));
                    len
                }
                _ if is_word(first) || rest.starts_with("::") => {
                    let mut len = 0;
                    while let Some(next) = rest[len..].chars().next() {
                        match () {
                            () if is_word(next) => len += 1,
                            () if rest[len..].starts_with("::") => len += 2,
                            () => break,
                        }
                    }
                    tokens.push((line_idx + 1, Token::Word(&rest[..len])));
                    len
                }
                sign => {
                    tokens.push((line_idx + 1, Token::Sign(sign)));
                    sign.len_utf8()
                }
            };
            rest = &rest[len..];
        }
    }
    tokens
}

/// Length of a quoted text, which ends with its line at the latest.
fn quoted_len(text: &str, quote: char) -> usize {
    let mut is_escaped = false;
    for (idx, c) in text.char_indices().skip(1) {
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            c if c == quote => return idx + 1,
            _ => {}
        }
    }
    text.len()
}
