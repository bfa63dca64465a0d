//! Parses one line of `.msg` text.

use super::{Arity, BaseType, ConstantDefinition, FieldDefinition, FieldType, MessageDefinition, Primitive, shortened};

/// Longest name of a package, type or field. Types are files, and no file system has longer names.
const MAX_NAME: usize = 255;

/// Adds the definition in `line` to `definition`. Comments and empty lines add nothing.
pub(super) fn parse(line: &str, definition: &mut MessageDefinition) -> Result<(), String> {
    let line = line.trim();
    if line.is_empty() || line.starts_with('#') {
        return Ok(());
    }
    let (type_text, rest) = split_type(line)?;
    let rest = rest.trim_start();
    let name_len = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
    let (name, rest) = rest.split_at(name_len);
    if name.is_empty() {
        return Err("expected a field name after the type".to_owned());
    }
    if !is_identifier(name) {
        return Err(format!("'{}' is not a field name", shortened(name)));
    }
    let ty = field_type(type_text, &definition.type_name)?;
    let divided = rest.is_empty() || rest.starts_with(char::is_whitespace) || rest.starts_with(['#', '=']);
    if !divided {
        return Err(format!("unexpected text after '{name}'"));
    }
    match rest.trim_start().strip_prefix('=') {
        Some(value) => add_constant(name, ty, value, definition),
        None => add_field(name, ty, rest, definition),
    }
}

/// True if `text` is a valid name of a package, type or field.
pub(super) fn is_identifier(text: &str) -> bool {
    text.len() <= MAX_NAME
        && text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

/// Splits a line after its type. A type may contain spaces only within brackets.
fn split_type(line: &str) -> Result<(&str, &str), String> {
    let mut in_brackets = false;
    for (idx, c) in line.char_indices() {
        match c {
            '[' => in_brackets = true,
            ']' => in_brackets = false,
            '#' => break,
            c if c.is_whitespace() && !in_brackets => return Ok(line.split_at(idx)),
            _ => {}
        }
    }
    Err("expected a type and a name".to_owned())
}

fn add_constant(name: &str, ty: FieldType, value: &str, definition: &mut MessageDefinition) -> Result<(), String> {
    let FieldType { base: ty, arity: Arity::One } = ty else {
        return Err(format!("constant '{name}' can't be an array"));
    };
    if matches!(ty, BaseType::Message(_)) {
        return Err(format!("constant '{name}' must be a primitive or a string"));
    }
    let value = value_text(value)?.ok_or_else(|| format!("constant '{name}' has no value"))?;
    if definition.constants.iter().any(|constant| constant.name == name) {
        return Err(format!("a second constant '{name}'"));
    }
    definition.constants.push(ConstantDefinition { name: name.to_owned(), ty, value });
    Ok(())
}

fn add_field(name: &str, ty: FieldType, rest: &str, definition: &mut MessageDefinition) -> Result<(), String> {
    if definition.field(name).is_some() {
        return Err(format!("a second field '{name}'"));
    }
    let default = value_text(rest)?;
    definition.fields.push(FieldDefinition { name: name.to_owned(), ty, default });
    Ok(())
}

fn field_type(text: &str, owner: &str) -> Result<FieldType, String> {
    let (base_text, arity) = match text.split_once('[') {
        None => (text, Arity::One),
        Some((base, brackets)) => {
            let inside = brackets
                .strip_suffix(']')
                .ok_or_else(|| format!("brackets left open in '{}'", shortened(text)))?
                .trim();
            let arity = if inside.is_empty() {
                Arity::Unbounded
            } else if let Some(bound) = inside.strip_prefix("<=") {
                Arity::Bounded(count(bound)?)
            } else {
                Arity::Fixed(count(inside)?)
            };
            (base.trim_end(), arity)
        }
    };
    Ok(FieldType { base: base_type(base_text, owner)?, arity })
}

fn base_type(text: &str, owner: &str) -> Result<BaseType, String> {
    if let Some(primitive) = Primitive::from_name(text) {
        return Ok(BaseType::Primitive(primitive));
    }
    let (word, bound) = match text.split_once("<=") {
        Some((word, bound)) => (word, Some(count(bound)?)),
        None => (text, None),
    };
    match (word, bound) {
        ("string", bound) => Ok(BaseType::Text { bound }),
        ("wstring", bound) => Ok(BaseType::WideText { bound }),
        (word, Some(_)) => Err(format!("'{}' can't have a bound; only strings can", shortened(word))),
        // Primitives of ROS 1, which rosidl still accepts.
        ("time", None) => Ok(BaseType::Message("builtin_interfaces/msg/Time".to_owned())),
        ("duration", None) => Ok(BaseType::Message("builtin_interfaces/msg/Duration".to_owned())),
        (name, None) => message_name(name, owner).map(BaseType::Message),
    }
}

/// Canonical name of a type in a definition of `owner`. Without a package, it is in the owner's package.
fn message_name(name: &str, owner: &str) -> Result<String, String> {
    let parts: Vec<&str> = name.split('/').collect();
    if parts.len() > 3 || !parts.iter().all(|part| is_identifier(part)) {
        return Err(format!("'{}' is not a type", shortened(name)));
    }
    let package = owner.split('/').next().unwrap_or_default();
    Ok(match parts.as_slice() {
        [short] => format!("{package}/msg/{short}"),
        _ => super::canonical_type_name(name),
    })
}

fn count(text: &str) -> Result<u32, String> {
    match text.trim().parse() {
        Ok(0) => Err("an array or bound of 0".to_owned()),
        Ok(count) => Ok(count),
        Err(_) => Err(format!("'{}' is not a count", shortened(text.trim()))),
    }
}

/// The value at the start of `text`, without quotes. `None` if there is only a comment.
fn value_text(text: &str) -> Result<Option<String>, String> {
    let text = text.trim();
    match text.chars().next() {
        None | Some('#') => Ok(None),
        Some(quote @ ('"' | '\'')) => {
            let end = quoted_len(text, quote).ok_or("a string without its closing quote")?;
            only_comment_after(&text[end..])?;
            Ok(Some(unescaped(&text[1..end - 1])))
        }
        Some('[') => {
            let end = list_len(text).ok_or("a list without its closing bracket")?;
            only_comment_after(&text[end..])?;
            Ok(Some(text[..end].to_owned()))
        }
        Some(_) => Ok(Some(text.split('#').next().unwrap_or_default().trim_end().to_owned())),
    }
}

fn only_comment_after(rest: &str) -> Result<(), String> {
    match rest.trim_start().chars().next() {
        None | Some('#') => Ok(()),
        Some(_) => Err("unexpected text after the value".to_owned()),
    }
}

/// Length of the quoted string at the start of `text`, with quotes, bytes.
fn quoted_len(text: &str, quote: char) -> Option<usize> {
    let mut escaped = false;
    for (idx, c) in text.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            c if c == quote => return Some(idx + 1),
            _ => {}
        }
    }
    None
}

/// Length of the list at the start of `text`, with brackets, bytes. Brackets in strings don't count.
fn list_len(text: &str) -> Option<usize> {
    let mut idx = 1;
    while let Some(c) = text[idx..].chars().next() {
        match c {
            ']' => return Some(idx + 1),
            '"' | '\'' => idx += quoted_len(&text[idx..], c)?,
            c => idx += c.len_utf8(),
        }
    }
    None
}

/// The text without the backslashes that escape a quote or another backslash.
fn unescaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match (c, chars.peek()) {
            ('\\', Some(&next @ ('\\' | '"' | '\''))) => {
                out.push(next);
                chars.next();
            }
            _ => out.push(c),
        }
    }
    out
}
