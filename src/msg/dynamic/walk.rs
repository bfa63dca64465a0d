//! Compiles a path to steps: skip the fields before, enter arrays, read the field.

use super::condition::{Condition, Wanted};
use super::leaf::Leaf;
use super::path::{self, Segment, Select};
use super::skip::{self, Len, Op, Skipper, WideTextInTheWay};
use super::{FieldError, FieldKind};
use crate::msg::cdr::{CdrError, CdrReader};
use crate::msg::definition::{BaseType, FieldDefinition, MessageDefinition, Primitive, TypeTree};

/// Steps from a position in a message to the fields of a path.
#[derive(Debug, Clone)]
pub(super) struct Walk {
    lead: Vec<Op>,
    target: Target,
}

#[derive(Debug, Clone)]
enum Target {
    Leaf(Leaf),
    Element { len: Len, index: usize, skip: Vec<Op>, then: Box<Walk> },
    Every { len: Len, skip: Vec<Op>, then: Box<Walk> },
    Where { len: Len, condition: Box<Condition>, skip: Vec<Op>, then: Box<Walk> },
}

impl Walk {
    pub(super) fn run<'a>(
        &self,
        reader: &mut CdrReader<'a>,
        visit: &mut impl FnMut(&Leaf, &mut CdrReader<'a>) -> Result<(), CdrError>,
    ) -> Result<(), CdrError> {
        skip::run(&self.lead, reader)?;
        match &self.target {
            Target::Leaf(leaf) => visit(leaf, reader),
            Target::Element { len, index, skip, then } => {
                let len = len.read(reader)?;
                if *index >= len {
                    return Err(CdrError::NoElement { index: *index, len });
                }
                for _ in 0..*index {
                    skip::run(skip, reader)?;
                }
                then.run(reader, visit)
            }
            Target::Every { len, skip, then } => {
                for _ in 0..len.read(reader)? {
                    then.run(&mut reader.clone(), visit)?;
                    skip::run(skip, reader)?;
                }
                Ok(())
            }
            Target::Where { len, condition, skip, then } => {
                let len = len.read(reader)?;
                let (mut first, mut is_met) = (reader.clone(), false);
                for _ in 0..len {
                    if condition.holds(&mut reader.clone())? {
                        is_met = true;
                        then.run(&mut reader.clone(), visit)?;
                    }
                    skip::run(skip, reader)?;
                }
                if is_met { Ok(()) } else { Err(condition.unmet(len, skip, &mut first)) }
            }
        }
    }
}

/// Compiles a path. Returns the steps and the type of the field.
pub(super) fn compile(tree: &TypeTree, path: &str) -> Result<(Walk, FieldKind), FieldError> {
    compile_as(tree, path, None)
}

/// Compiles a path to a message whose numbers, with those of the messages in it, have these paths in this order, and are
/// all it has.
pub(super) fn compile_block(tree: &TypeTree, path: &str, numbers: &[&str]) -> Result<(Walk, FieldKind), FieldError> {
    compile_as(tree, path, Some(numbers))
}

fn compile_as(tree: &TypeTree, path: &str, block: Option<&[&str]>) -> Result<(Walk, FieldKind), FieldError> {
    let segments = path::parse(path)?;
    let mut compiler = Compiler { tree, segments: &segments, block, within_every: false, leaf: None };
    let walk = compiler.message(tree.root(), 0, Skipper::at_start())?;
    let leaf = compiler.leaf.expect("a walk that was compiled ends at a leaf");
    Ok((walk, leaf.kind(compiler.within_every)))
}

/// The type of the numbers of a message, if all of it is numbers of one type. Their paths are appended to `paths`.
fn uniform(tree: &TypeTree, message: &MessageDefinition, within: &str, paths: &mut Vec<String>) -> Option<Primitive> {
    let mut of_all = None;
    for field in &message.fields {
        if Len::of(field.ty.arity).is_some() {
            return None;
        }
        let path = format!("{within}{}", field.name);
        let primitive = match &field.ty.base {
            BaseType::Primitive(primitive) => {
                paths.push(path);
                *primitive
            }
            BaseType::Message(name) => uniform(tree, tree.message(name), &format!("{path}."), paths)?,
            BaseType::Text { .. } | BaseType::WideText { .. } => return None,
        };
        if of_all.is_some_and(|of_all| of_all != primitive) {
            return None;
        }
        of_all = Some(primitive);
    }
    of_all
}

struct Compiler<'a> {
    tree: &'a TypeTree,
    segments: &'a [Segment],
    /// The numbers of the message at the end of the path, if it must be one.
    block: Option<&'a [&'a str]>,
    within_every: bool,
    leaf: Option<Leaf>,
}

impl Compiler<'_> {
    /// Compiles the segments from `depth` on. `skip` is at the start of `message`.
    fn message(&mut self, message: &MessageDefinition, depth: usize, mut skip: Skipper) -> Result<Walk, FieldError> {
        let name = &self.segments[depth].name;
        let Some(field) = message.field(name) else {
            let fields: Vec<&str> = message.fields.iter().map(|field| field.name.as_str()).collect();
            return Err(FieldError::Missing {
                field: path::display(&self.segments[..=depth]),
                type_name: message.type_name.clone(),
                fields: if fields.is_empty() { "no fields".to_owned() } else { fields.join(", ") },
            });
        };
        for before in message.fields.iter().take_while(|before| before.name != *name) {
            skip.field(self.tree, before).map_err(|wide| self.wide_text(wide))?;
        }
        self.field(field, depth, skip)
    }

    fn field(&mut self, field: &FieldDefinition, depth: usize, skip: Skipper) -> Result<Walk, FieldError> {
        let base = &field.ty.base;
        match (Len::of(field.ty.arity), &self.segments[depth].select) {
            (None, Select::Whole) => self.element(field, depth, skip),
            (None, _) => Err(self.shape(field, depth, "it is no array, so leave the brackets out".to_owned())),
            (Some(len), Select::Whole | Select::Every) if !matches!(base, BaseType::Message(_)) => match base {
                _ if depth + 1 < self.segments.len() => Err(self.shape(field, depth, self.end_here(depth))),
                BaseType::Primitive(primitive) => Ok(self.leaf(Leaf::Numbers(*primitive, len), skip)),
                BaseType::Text { .. } => Ok(self.leaf(Leaf::Texts(len), skip)),
                _ => Err(self.wide_text(WideTextInTheWay(field.name.clone()))),
            },
            (Some(_), Select::Whole) => {
                let name = path::display(&self.segments[..=depth]);
                Err(self.shape(field, depth, format!("write {name}[] for all elements or {name}[0] for one")))
            }
            (Some(Len::Fixed(len)), Select::Element(index)) if *index >= len => {
                Err(self.shape(field, depth, format!("there is no element {index}")))
            }
            (Some(len), select) => {
                let mut past = Skipper::anywhere();
                past.element(self.tree, &field.name, base).map_err(|wide| self.wide_text(wide))?;
                let past = past.into_ops();
                self.within_every |= *select == Select::Every;
                let then = Box::new(self.element(field, depth, Skipper::anywhere())?);
                let target = match select {
                    Select::Element(index) => Target::Element { len, index: *index, skip: past, then },
                    Select::Where { field: of, value } => {
                        let condition = Box::new(self.condition(field, depth, of, value)?);
                        Target::Where { len, condition, skip: past, then }
                    }
                    Select::Every | Select::Whole => Target::Every { len, skip: past, then },
                };
                Ok(Walk { lead: skip.into_ops(), target })
            }
        }
    }

    /// Compiles the condition that selects elements of `array` by their field `of`.
    fn condition(
        &self,
        array: &FieldDefinition,
        depth: usize,
        of: &[Segment],
        value: &str,
    ) -> Result<Condition, FieldError> {
        let BaseType::Message(name) = &array.ty.base else {
            return Err(self.shape(array, depth, "its elements have no fields to pick them by".to_owned()));
        };
        let mut inner = Compiler { tree: self.tree, segments: of, block: None, within_every: false, leaf: None };
        let walk = inner.message(self.tree.message(name), 0, Skipper::anywhere())?;
        let leaf = inner.leaf.expect("a walk that was compiled ends at a leaf");
        let kind = leaf.kind(inner.within_every);
        let text = format!("{}={value}", path::display(of));
        match Wanted::of(kind, value) {
            Some(wanted) => Ok(Condition { text, lead: walk.lead, leaf, wanted }),
            None => Err(FieldError::Kind {
                path: text,
                type_name: name.clone(),
                found: kind.to_string(),
                wanted: Wanted::EXPECTED,
            }),
        }
    }

    /// Compiles one element of `field`. `skip` is at its start.
    fn element(&mut self, field: &FieldDefinition, depth: usize, skip: Skipper) -> Result<Walk, FieldError> {
        let ends = depth + 1 == self.segments.len();
        match &field.ty.base {
            BaseType::Message(name) if !ends => self.message(self.tree.message(name), depth + 1, skip),
            BaseType::Message(name) => match name.as_str() {
                "builtin_interfaces/msg/Time" => Ok(self.leaf(Leaf::Time, skip)),
                "builtin_interfaces/msg/Duration" => Ok(self.leaf(Leaf::Duration, skip)),
                name => {
                    let mut paths = Vec::new();
                    if let Some(wanted) = self.block
                        && let Some(primitive) = uniform(self.tree, self.tree.message(name), "", &mut paths)
                        && paths == wanted
                    {
                        return Ok(self.leaf(Leaf::Block(primitive, paths.len()), skip));
                    }
                    let fields: Vec<&str> =
                        self.tree.message(name).fields.iter().map(|field| field.name.as_str()).collect();
                    Err(self.shape(field, depth, format!("go on to one of its fields: {}", fields.join(", "))))
                }
            },
            _ if !ends => Err(self.shape(field, depth, self.end_here(depth))),
            BaseType::Primitive(primitive) => Ok(self.leaf(Leaf::Number(*primitive), skip)),
            BaseType::Text { .. } => Ok(self.leaf(Leaf::Text, skip)),
            BaseType::WideText { .. } => Err(self.wide_text(WideTextInTheWay(field.name.clone()))),
        }
    }

    fn leaf(&mut self, leaf: Leaf, skip: Skipper) -> Walk {
        self.leaf = Some(leaf);
        Walk { lead: skip.into_ops(), target: Target::Leaf(leaf) }
    }

    fn end_here(&self, depth: usize) -> String {
        format!("it has no fields, so leave out '.{}'", path::display(&self.segments[depth + 1..]))
    }

    fn shape(&self, field: &FieldDefinition, depth: usize, remedy: String) -> FieldError {
        let mut upto = self.segments[..=depth].to_vec();
        if let Some(last) = upto.last_mut() {
            last.select = Select::Whole;
        }
        FieldError::Shape {
            field: path::display(&upto),
            type_name: self.tree.type_name().to_owned(),
            found: field.ty.to_string(),
            remedy,
        }
    }

    fn wide_text(&self, WideTextInTheWay(field): WideTextInTheWay) -> FieldError {
        let type_name = self.tree.type_name().to_owned();
        FieldError::WideText { path: path::display(self.segments), type_name, field }
    }
}
