//! Parses OMG IDL as rosidl writes it: modules, structs, constants, enums and typedefs. Skips annotations and comments.

mod token;

use std::collections::BTreeMap;
use std::rc::Rc;

use super::{
    Arity, BaseType, DefinitionError, FieldDefinition, FieldType, MAX_FIELDS, MessageDefinition, Primitive,
    checked_type_name, shortened,
};
use token::{Token, tokens};

/// Maximum nesting of modules, and of types in angle brackets.
const MAX_NESTING: usize = 32;

/// Longest text that is read, bytes. Real texts, with all types that they contain, are smaller than 1 MB.
const MAX_TEXT: usize = 2 << 20;

/// All structs of a schema, by canonical name.
pub(super) type Structs = BTreeMap<String, MessageDefinition>;

/// Parses a schema as in a bag: the text of one `.idl` file, or of several, each after a separator line and
/// `IDL: name`.
///
/// # Errors
/// [`DefinitionError::Line`], which names `type_name`, the type of the schema.
pub(super) fn parse(type_name: &str, text: &str) -> Result<Structs, DefinitionError> {
    if text.len() > MAX_TEXT {
        return Err(DefinitionError::TooLong { type_name: type_name.to_owned(), n_bytes: text.len(), limit: MAX_TEXT });
    }
    let mut parser =
        Parser { tokens: tokens(text), at: 0, scope: Rc::default(), names: BTreeMap::new(), structs: vec![] };
    let parsed = parser.definitions().and_then(|()| parser.into_structs());
    parsed.map_err(|Fault { line, reason }| DefinitionError::Line {
        type_name: type_name.to_owned(),
        line,
        text: shortened(text.lines().nth(line.saturating_sub(1)).unwrap_or_default().trim()),
        reason,
    })
}

struct Fault {
    line: usize,
    reason: String,
}

/// Meaning of a scoped name.
#[derive(Clone)]
enum Named {
    Alias(Mentioned),
    Struct,
    /// rosidl generates no code for enums, so no ROS message has a field of this type.
    Enum,
    Number(u32),
}

/// Type of a struct's field. Structs may be defined further down.
#[derive(Clone)]
enum Mentioned {
    Known(FieldType),
    /// The name, the scope in which it is used, its line, and the number of elements.
    Later(String, Rc<Vec<String>>, usize, Arity),
}

fn not_an_enum(name: &str) -> String {
    format!("'{}' is an enum, which is no field of a ROS message: expected an integer type", shortened(name))
}

struct Struct {
    name: String,
    line: usize,
    fields: Vec<(String, Mentioned)>,
}

struct Parser<'a> {
    tokens: Vec<(usize, Token<'a>)>,
    at: usize,
    scope: Rc<Vec<String>>,
    names: BTreeMap<String, Named>,
    structs: Vec<Struct>,
}

impl<'a> Parser<'a> {
    /// Parses definitions up to the end of the module or of the text.
    fn definitions(&mut self) -> Result<(), Fault> {
        loop {
            self.annotations()?;
            match self.peek() {
                None if self.scope.is_empty() => return Ok(()),
                Some(Token::Sign(';')) => self.at += 1,
                Some(Token::Sign('}')) if !self.scope.is_empty() => {
                    self.at += 1;
                    Rc::make_mut(&mut self.scope).pop();
                    if self.peek() == Some(&Token::Sign(';')) {
                        self.at += 1;
                    }
                }
                _ => self.definition()?,
            }
        }
    }

    fn definition(&mut self) -> Result<(), Fault> {
        match self.word("module, struct, enum, typedef or const")? {
            "module" => {
                let name = self.name()?;
                if self.scope.len() >= MAX_NESTING {
                    return self.fault("modules are nested too deep");
                }
                Rc::make_mut(&mut self.scope).push(name);
                self.sign('{')
            }
            "struct" => self.structure(),
            "enum" => self.enumeration(),
            "typedef" => {
                let base = self.type_spec(0)?;
                self.declarators(base, |parser, name, ty| {
                    let name = parser.scoped(&name);
                    parser.names.insert(name, Named::Alias(ty));
                    Ok(())
                })
            }
            "const" => {
                self.type_spec(0)?;
                let name = self.name()?;
                self.sign('=')?;
                let value = match (self.next(), self.peek()) {
                    (Some(Token::Word(word)), Some(Token::Sign(';'))) => self.number_of(word),
                    _ => None,
                };
                let name = self.scoped(&name);
                if let Some(value) = value {
                    self.names.insert(name, Named::Number(value));
                }
                while self.next().ok_or_else(|| self.at_end())? != Token::Sign(';') {}
                Ok(())
            }
            other => self
                .fault(&format!("'{}' is not read: expected module, struct, enum, typedef or const", shortened(other))),
        }
    }

    fn structure(&mut self) -> Result<(), Fault> {
        let line = self.line();
        let name = self.name()?;
        let scoped = self.scoped(&name);
        match self.next() {
            Some(Token::Sign(';')) => return Ok(()), // a forward declaration
            Some(Token::Sign('{')) => {}
            Some(Token::Sign(':')) => return self.fault("a struct that extends another is no ROS message"),
            _ => return self.fault("expected '{'"),
        }
        self.names.insert(scoped.clone(), Named::Struct);
        let mut fields = Vec::new();
        loop {
            self.annotations()?;
            if self.peek() == Some(&Token::Sign('}')) {
                self.at += 1;
                break;
            }
            let base = self.type_spec(0)?;
            self.declarators(base, |parser, name, ty| {
                fields.push((name, ty));
                if fields.len() > MAX_FIELDS {
                    return parser.fault(&format!("a struct of more than {MAX_FIELDS} fields"));
                }
                Ok(())
            })?;
        }
        // The member that IDL requires and rosidl writes for a message without fields.
        if let [(only, Mentioned::Known(FieldType { base: BaseType::Primitive(Primitive::UInt8), arity: Arity::One }))] =
            &fields[..]
            && only == "structure_needs_at_least_one_member"
        {
            fields.clear();
        }
        self.structs.push(Struct { name: scoped, line, fields });
        Ok(())
    }

    fn enumeration(&mut self) -> Result<(), Fault> {
        let name = self.name()?;
        self.sign('{')?;
        while self.next().ok_or_else(|| self.at_end())? != Token::Sign('}') {}
        let name = self.scoped(&name);
        self.names.insert(name, Named::Enum);
        Ok(())
    }

    /// Parses names with their array bounds, separated by commas, up to the semicolon.
    fn declarators(
        &mut self,
        base: Mentioned,
        mut add: impl FnMut(&mut Self, String, Mentioned) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        loop {
            self.annotations()?;
            let name = self.name()?;
            let mut n_elements: Option<u32> = None;
            while self.peek() == Some(&Token::Sign('[')) {
                self.at += 1;
                let bound = self.bound()?;
                self.sign(']')?;
                match n_elements.unwrap_or(1).checked_mul(bound) {
                    Some(n) => n_elements = Some(n),
                    None => return self.fault("an array of more than 4294967295 elements"),
                }
            }
            let mut ty = base.clone();
            let (Mentioned::Known(FieldType { arity, .. }) | Mentioned::Later(.., arity)) = &mut ty;
            match (*arity, n_elements) {
                (_, None) => {}
                (Arity::One, Some(n)) => *arity = Arity::Fixed(n),
                // The elements of nested arrays follow one another.
                (Arity::Fixed(inner), Some(n)) => match inner.checked_mul(n) {
                    Some(n) => *arity = Arity::Fixed(n),
                    None => return self.fault("an array of more than 4294967295 elements"),
                },
                _ => return self.fault("an array of sequences is no field of a ROS message"),
            }
            add(self, name, ty)?;
            match self.next() {
                Some(Token::Sign(',')) => {}
                Some(Token::Sign(';')) => return Ok(()),
                _ => return self.fault("expected ';'"),
            }
        }
    }

    fn type_spec(&mut self, depth: usize) -> Result<Mentioned, Fault> {
        if depth > MAX_NESTING {
            return self.fault("sequences are nested too deep");
        }
        let line = self.line();
        let word = self.word("a type")?;
        let base = match word {
            "sequence" => return self.sequence(depth),
            "string" | "wstring" => {
                let bound = self.bound_in_brackets()?;
                if word == "string" { BaseType::Text { bound } } else { BaseType::WideText { bound } }
            }
            "unsigned" => match self.integer("unsigned")? {
                16 => BaseType::Primitive(Primitive::UInt16),
                32 => BaseType::Primitive(Primitive::UInt32),
                _ => BaseType::Primitive(Primitive::UInt64),
            },
            "short" => BaseType::Primitive(Primitive::Int16),
            "long" => {
                self.at -= 1;
                if self.tokens.get(self.at + 1).map(|(_, token)| token) == Some(&Token::Word("double")) {
                    return self.fault("long double is not read");
                }
                match self.integer("long")? {
                    32 => BaseType::Primitive(Primitive::Int32),
                    _ => BaseType::Primitive(Primitive::Int64),
                }
            }
            "float" => BaseType::Primitive(Primitive::Float32),
            "double" => BaseType::Primitive(Primitive::Float64),
            "boolean" => BaseType::Primitive(Primitive::Bool),
            "octet" => BaseType::Primitive(Primitive::Byte),
            "char" | "uint8" => BaseType::Primitive(Primitive::UInt8),
            "int8" => BaseType::Primitive(Primitive::Int8),
            "int16" => BaseType::Primitive(Primitive::Int16),
            "uint16" => BaseType::Primitive(Primitive::UInt16),
            "int32" => BaseType::Primitive(Primitive::Int32),
            "uint32" => BaseType::Primitive(Primitive::UInt32),
            "int64" => BaseType::Primitive(Primitive::Int64),
            "uint64" => BaseType::Primitive(Primitive::UInt64),
            "wchar" | "any" | "Object" | "fixed" | "map" | "struct" | "union" | "enum" | "bitset" | "bitmask" => {
                return self.fault(&format!("'{word}' is not read as the type of a field"));
            }
            name => {
                return Ok(match self.find(name, &self.scope) {
                    Some((_, Named::Alias(ty))) => ty,
                    Some((_, Named::Enum)) => return self.fault(&not_an_enum(name)),
                    Some((_, Named::Number(_))) => return self.fault(&format!("'{}' is no type", shortened(name))),
                    _ => Mentioned::Later(name.to_owned(), Rc::clone(&self.scope), line, Arity::One),
                });
            }
        };
        Ok(Mentioned::Known(FieldType { base, arity: Arity::One }))
    }

    fn sequence(&mut self, depth: usize) -> Result<Mentioned, Fault> {
        self.sign('<')?;
        let element = self.type_spec(depth + 1)?;
        let arity = match self.next() {
            Some(Token::Sign('>')) => Arity::Unbounded,
            Some(Token::Sign(',')) => {
                let bound = self.bound()?;
                self.sign('>')?;
                Arity::Bounded(bound)
            }
            _ => return self.fault("expected '>'"),
        };
        match element {
            Mentioned::Known(FieldType { base, arity: Arity::One }) => Ok(Mentioned::Known(FieldType { base, arity })),
            Mentioned::Later(name, scope, line, Arity::One) => Ok(Mentioned::Later(name, scope, line, arity)),
            _ => self.fault("a sequence of arrays or sequences is no field of a ROS message"),
        }
    }

    /// Number of bits of `short`, `long` or `long long`.
    fn integer(&mut self, first: &str) -> Result<u32, Fault> {
        match self.word("short or long")? {
            "short" if first == "unsigned" => Ok(16),
            "long" if self.peek() == Some(&Token::Word("long")) => {
                self.at += 1;
                Ok(64)
            }
            "long" => Ok(32),
            _ => self.fault("expected short or long"),
        }
    }

    fn bound_in_brackets(&mut self) -> Result<Option<u32>, Fault> {
        if self.peek() != Some(&Token::Sign('<')) {
            return Ok(None);
        }
        self.at += 1;
        let bound = self.bound()?;
        self.sign('>')?;
        Ok(Some(bound))
    }

    /// A positive number, or the name of a constant.
    fn bound(&mut self) -> Result<u32, Fault> {
        let word = self.word("a bound")?;
        match self.number_of(word).filter(|bound| *bound > 0) {
            Some(bound) => Ok(bound),
            None => self.fault(&format!("'{}' is no bound: expected a number from 1 to 4294967295", shortened(word))),
        }
    }

    fn number_of(&self, word: &str) -> Option<u32> {
        let hex = word.strip_prefix("0x").or_else(|| word.strip_prefix("0X"));
        let number = hex.map_or_else(|| word.parse().ok(), |digits| u32::from_str_radix(digits, 16).ok());
        number.or_else(|| match self.find(word, &self.scope)?.1 {
            Named::Number(number) => Some(number),
            _ => None,
        })
    }

    /// Meaning of a name in a scope: the definition in the innermost module that has it.
    fn find(&self, name: &str, scope: &[String]) -> Option<(String, Named)> {
        if let Some(absolute) = name.strip_prefix("::") {
            return self.names.get_key_value(absolute).map(|(name, named)| (name.clone(), named.clone()));
        }
        (0..=scope.len()).rev().find_map(|n| {
            let scoped = scope[..n].iter().map(String::as_str).chain([name]).collect::<Vec<_>>().join("::");
            self.names.get_key_value(&scoped).map(|(name, named)| (name.clone(), named.clone()))
        })
    }

    /// Skips `@name` and `@name(...)`.
    fn annotations(&mut self) -> Result<(), Fault> {
        while self.peek() == Some(&Token::Sign('@')) {
            self.at += 1;
            self.word("the name of an annotation")?;
            if self.peek() != Some(&Token::Sign('(')) {
                continue;
            }
            let mut depth = 0_usize;
            loop {
                match self.next() {
                    Some(Token::Sign('(')) => depth += 1,
                    Some(Token::Sign(')')) if depth == 1 => break,
                    Some(Token::Sign(')')) => depth -= 1,
                    Some(_) => {}
                    None => return Err(self.at_end()),
                }
            }
        }
        Ok(())
    }

    /// Returns the structs with resolved types. A name that no part of the text defines is that of another message.
    fn into_structs(self) -> Result<Structs, Fault> {
        let mut structs = Structs::new();
        for Struct { name, line, fields } in &self.structs {
            let at_line = |reason: String| Fault { line: *line, reason };
            let type_name = checked_type_name(&name.replace("::", "/")).map_err(|error| at_line(error.to_string()))?;
            let mut definition = MessageDefinition { type_name: type_name.clone(), ..Default::default() };
            for (name, ty) in fields {
                if definition.field(name).is_some() {
                    return Err(at_line(format!("field '{}' is defined twice", shortened(name))));
                }
                let ty = match ty {
                    Mentioned::Known(ty) => ty.clone(),
                    Mentioned::Later(other, scope, line, arity) => {
                        let found = self.find(other, scope);
                        if let Some((_, Named::Enum)) = found {
                            return Err(Fault { line: *line, reason: not_an_enum(other) });
                        }
                        let known = found.map_or_else(|| other.clone(), |(name, _)| name);
                        let canonical = checked_type_name(&known.trim_start_matches("::").replace("::", "/"));
                        let base = canonical.map_err(|error| Fault { line: *line, reason: error.to_string() })?;
                        FieldType { base: BaseType::Message(base), arity: *arity }
                    }
                };
                definition.fields.push(FieldDefinition { name: name.clone(), ty, default: None });
            }
            // If a type is defined twice, the first definition counts, as with .msg.
            structs.entry(type_name).or_insert(definition);
        }
        Ok(structs)
    }

    fn scoped(&self, name: &str) -> String {
        self.scope.iter().map(String::as_str).chain([name]).collect::<Vec<_>>().join("::")
    }

    fn peek(&self) -> Option<&Token<'a>> {
        self.tokens.get(self.at).map(|(_, token)| token)
    }

    fn next(&mut self) -> Option<Token<'a>> {
        let token = self.peek().cloned();
        self.at += usize::from(token.is_some());
        token
    }

    fn word(&mut self, expected: &str) -> Result<&'a str, Fault> {
        match self.next() {
            Some(Token::Word(word)) => Ok(word),
            Some(_) => self.fault(&format!("expected {expected}")),
            None => Err(self.at_end()),
        }
    }

    fn name(&mut self) -> Result<String, Fault> {
        let word = self.word("a name")?;
        // A name that is also a keyword has an underscore in front.
        let name = word.strip_prefix('_').unwrap_or(word);
        if super::line::is_identifier(name) {
            return Ok(name.to_owned());
        }
        self.fault(&format!("'{}' is not a name", shortened(word)))
    }

    fn sign(&mut self, sign: char) -> Result<(), Fault> {
        match self.next() {
            Some(Token::Sign(got)) if got == sign => Ok(()),
            Some(_) => self.fault(&format!("expected '{sign}'")),
            None => Err(self.at_end()),
        }
    }

    /// Line of the next token, or of the last one.
    fn line(&self) -> usize {
        self.tokens.get(self.at).or(self.tokens.last()).map_or(1, |(line, _)| *line)
    }

    fn at_end(&self) -> Fault {
        Fault { line: self.line(), reason: "the text ends within a definition".to_owned() }
    }

    /// An error at the token that was read last.
    fn fault<T>(&self, reason: &str) -> Result<T, Fault> {
        let line = self.tokens.get(self.at.saturating_sub(1)).map_or(1, |(line, _)| *line);
        Err(Fault { line, reason: reason.to_owned() })
    }
}
