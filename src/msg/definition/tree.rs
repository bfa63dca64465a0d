//! A message type with all types that it contains.

use std::collections::BTreeMap;

use super::idl::Structs;
use super::{
    Arity, BaseType, DefinitionError, FieldDefinition, FieldType, MAX_FIELDS, MessageDefinition, checked_type_name,
    shortened,
};
use crate::msg::texts::standard_text;

/// Maximum nesting of messages.
const MAX_DEPTH: usize = 32; // real messages nest about 6 deep

/// Type that the event type of a service needs in addition to the service's own text.
const SERVICE_EVENT_INFO: &str = "service_msgs/msg/ServiceEventInfo";

/// A message type and all types that it contains. Every type of a field is present, none contains itself, and depth and
/// size are limited.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TypeTree {
    root: String,
    types: BTreeMap<String, MessageDefinition>,
}

impl TypeTree {
    /// Resolves a schema as in a bag: the text of the type, then the text of each dependency after a separator line.
    ///
    /// `builtin_interfaces/Time` and `Duration` may be missing. The text of a service defines its types `_Event`,
    /// `_Request` and `_Response`, as rosbag2 records it.
    ///
    /// # Errors
    /// [`DefinitionError`], which names the type and the error.
    pub fn from_schema(type_name: &str, text: &str) -> Result<Self, DefinitionError> {
        Self::resolve(type_name, text, &mut |_| None)
    }

    /// Like [`from_schema`](Self::from_schema), for a schema in the language `encoding`: `ros2msg`, or `ros2idl`, which
    /// rosbag2 uses for packages without `.msg` files.
    ///
    /// # Errors
    /// [`DefinitionError`], which names the type and the error.
    pub fn from_encoded(type_name: &str, encoding: &str, text: &str) -> Result<Self, DefinitionError> {
        match encoding {
            "ros2msg" => Self::from_schema(type_name, text),
            "ros2idl" => Self::from_idl(type_name, text),
            "" => Err(DefinitionError::Missing { type_name: shortened(type_name) }),
            other => Err(DefinitionError::Encoding { type_name: shortened(type_name), got: shortened(other) }),
        }
    }

    fn from_idl(type_name: &str, text: &str) -> Result<Self, DefinitionError> {
        let root = checked_type_name(type_name)?;
        let mut structs = super::idl::parse(&root, text)?;
        let Some(definition) = structs.remove(&root) else {
            return Err(DefinitionError::NotInIdl { type_name: root });
        };
        let (sections, lookup) = (BTreeMap::new(), &mut |_: &str| None);
        let (types, sizes) = (BTreeMap::new(), BTreeMap::new());
        let mut resolver = Resolver { sections, structs, lookup, types, sizes, open: vec![] };
        resolver.add(definition)?;
        let types = resolver.types;
        Ok(TypeTree { root, types })
    }

    /// Like [`from_schema`](Self::from_schema), but asks `lookup` for the `.msg` text of each canonical type name that
    /// `text` doesn't define.
    ///
    /// # Errors
    /// [`DefinitionError`], which names the type and the error.
    pub fn resolve(
        type_name: &str,
        text: &str,
        lookup: &mut dyn FnMut(&str) -> Option<String>,
    ) -> Result<Self, DefinitionError> {
        let root = checked_type_name(type_name)?;
        let (root_text, sections) = sections(&root, text)?;
        let mut resolver = Resolver {
            sections,
            structs: BTreeMap::new(),
            lookup,
            types: BTreeMap::new(),
            sizes: BTreeMap::new(),
            open: vec![],
        };
        let definition = match service_of(&root, &root_text) {
            Some(service) => resolver.add_service(&root, service)?,
            None => MessageDefinition::parse(&root, &root_text)?,
        };
        resolver.add(definition)?;
        let types = resolver.types;
        Ok(TypeTree { root, types })
    }

    /// Canonical name of the type.
    pub fn type_name(&self) -> &str {
        &self.root
    }

    /// The type itself.
    pub fn root(&self) -> &MessageDefinition {
        self.message(&self.root)
    }

    /// A type in this tree, by canonical name.
    pub fn definition(&self, type_name: &str) -> Option<&MessageDefinition> {
        self.types.get(type_name)
    }

    /// All types in this tree except the root, sorted by name.
    pub fn dependencies(&self) -> impl Iterator<Item = &MessageDefinition> {
        self.types.values().filter(|definition| definition.type_name != self.root)
    }

    /// Definition of a type that a field of this tree has.
    pub(in crate::msg) fn message(&self, type_name: &str) -> &MessageDefinition {
        self.types.get(type_name).expect("resolving put every type that a field mentions into the tree")
    }
}

struct Resolver<'a> {
    sections: BTreeMap<String, String>,
    structs: Structs,
    lookup: &'a mut dyn FnMut(&str) -> Option<String>,
    types: BTreeMap<String, MessageDefinition>,
    sizes: BTreeMap<String, usize>, // number of fields, with those of nested messages
    open: Vec<String>,
}

impl Resolver<'_> {
    /// Adds `definition` and all types that it contains. Returns its number of fields, with nested ones.
    fn add(&mut self, mut definition: MessageDefinition) -> Result<usize, DefinitionError> {
        let type_name = definition.type_name.clone();
        if self.open.len() >= MAX_DEPTH {
            return Err(DefinitionError::TooDeep { type_name: self.open.swap_remove(0), limit: MAX_DEPTH });
        }
        self.open.push(type_name.clone());
        let mut n_fields = 0_usize;
        for field in &mut definition.fields {
            let inside = match &mut field.ty.base {
                BaseType::Message(name) => self.add_named(name, &type_name)?,
                _ => 1,
            };
            n_fields = n_fields.saturating_add(inside.max(1));
            if n_fields > MAX_FIELDS {
                return Err(DefinitionError::TooLarge { type_name, limit: MAX_FIELDS });
            }
        }
        self.open.pop();
        self.sizes.insert(type_name.clone(), n_fields);
        self.types.insert(type_name, definition);
        Ok(n_fields)
    }

    fn add_named(&mut self, name: &mut String, user: &str) -> Result<usize, DefinitionError> {
        if let Some(size) = self.sizes.get(name.as_str()) {
            return Ok(*size);
        }
        if self.open.contains(name) {
            return Err(DefinitionError::Recursive { type_name: name.clone(), through: user.to_owned() });
        }
        if let Some(definition) = self.structs.remove(name.as_str()) {
            return self.add(definition);
        }
        match self.text(name) {
            Some(text) => {
                let definition = MessageDefinition::parse(name, &text)?;
                self.add(definition)
            }
            // In ROS 1, 'Header' without a package meant std_msgs. Definitions that were ported from ROS 1 still use
            // it.
            None if name.ends_with("/msg/Header") && name != "std_msgs/msg/Header" => {
                let stated = std::mem::replace(name, "std_msgs/msg/Header".to_owned());
                self.add_named(name, user).map_err(|error| match error {
                    DefinitionError::UnknownDependency { type_name, .. } if type_name == user => {
                        DefinitionError::UnknownDependency { type_name, dependency: stated }
                    }
                    error => error,
                })
            }
            None => Err(DefinitionError::UnknownDependency { type_name: user.to_owned(), dependency: name.clone() }),
        }
    }

    fn text(&mut self, name: &str) -> Option<String> {
        let part_of_ros = name.starts_with("builtin_interfaces/msg/") || name == SERVICE_EVENT_INFO;
        self.sections
            .get(name)
            .cloned()
            .or_else(|| (self.lookup)(name))
            .or_else(|| if part_of_ros { standard_text(name).map(str::to_owned) } else { None })
    }

    /// Adds request and response of a service, and returns the type `type_name`.
    fn add_service(&mut self, type_name: &str, service: Service) -> Result<MessageDefinition, DefinitionError> {
        let Service { part, stem, request, response } = service;
        let half = |name: &str, text: &str| MessageDefinition::parse(&format!("{stem}_{name}"), text);
        match part {
            ServicePart::Request => half("Request", &request),
            ServicePart::Response => half("Response", &response),
            ServicePart::Event => {
                let field = |name: &str, base: String, arity| FieldDefinition {
                    name: name.to_owned(),
                    ty: FieldType { base: BaseType::Message(base), arity },
                    default: None,
                };
                self.add(half("Request", &request)?)?;
                self.add(half("Response", &response)?)?;
                Ok(MessageDefinition {
                    type_name: type_name.to_owned(),
                    fields: vec![
                        field("info", SERVICE_EVENT_INFO.to_owned(), Arity::One),
                        field("request", format!("{stem}_Request"), Arity::Bounded(1)),
                        field("response", format!("{stem}_Response"), Arity::Bounded(1)),
                    ],
                    constants: vec![],
                })
            }
        }
    }
}

enum ServicePart {
    Request,
    Response,
    Event,
}

struct Service {
    part: ServicePart,
    stem: String,
    request: String,
    response: String,
}

/// The service that `text` defines, if `text` is one and `type_name` is one of its types.
fn service_of(type_name: &str, text: &str) -> Option<Service> {
    let divider = |line: &&str| line.trim_end() == "---";
    if !type_name.contains("/srv/") || text.lines().filter(divider).count() != 1 {
        return None;
    }
    let (stem, part) =
        [("_Event", ServicePart::Event), ("_Request", ServicePart::Request), ("_Response", ServicePart::Response)]
            .into_iter()
            .find_map(|(suffix, part)| Some((type_name.strip_suffix(suffix)?.to_owned(), part)))?;
    let request: Vec<&str> = text.lines().take_while(|line| !divider(line)).collect();
    let response: Vec<&str> = text.lines().skip(request.len() + 1).collect();
    Some(Service { part, stem, request: request.join("\n"), response: response.join("\n") })
}

/// Splits a concatenated schema into the text of the root and the texts of its dependencies.
///
/// If a type is defined twice, the first definition counts: rosbag2 of 2022 repeated definitions.
fn sections(root: &str, text: &str) -> Result<(String, BTreeMap<String, String>), DefinitionError> {
    let mut root_text = String::new();
    let mut others: BTreeMap<String, String> = BTreeMap::new();
    let mut current: Option<(String, String)> = None; // None: within the text of the root
    let mut awaiting_name = false;
    for (line_idx, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let is_separator = line.trim_end().len() >= 3 && line.trim_end().bytes().all(|byte| byte == b'=');
        if is_separator {
            keep(&mut others, current.take());
            awaiting_name = true;
        } else if awaiting_name && !line.trim().is_empty() {
            let named = line.split_once(':').filter(|(kind, _)| matches!(kind.trim(), "MSG" | "SRV"));
            let name = named.and_then(|(_, name)| checked_type_name(name).ok()).ok_or_else(|| {
                DefinitionError::Section { type_name: root.to_owned(), line: line_idx + 1, text: shortened(line) }
            })?;
            let is_root = name == root && root_text.trim().is_empty();
            current = (!is_root).then(|| (name, String::new()));
            awaiting_name = false;
        } else if !awaiting_name {
            let target = current.as_mut().map_or(&mut root_text, |(_, text)| text);
            target.push_str(line);
            target.push('\n');
        }
    }
    keep(&mut others, current);
    if !root.contains("/srv/") && root_text.lines().any(|line| line.trim_end() == "---") {
        return Err(DefinitionError::NotAMessage { type_name: root.to_owned() });
    }
    Ok((root_text, others))
}

fn keep(sections: &mut BTreeMap<String, String>, section: Option<(String, String)>) {
    if let Some((name, text)) = section {
        sections.entry(name).or_insert(text);
    }
}
