//! The layout of a message: the description in a bag, with its types resolved.

use std::collections::BTreeMap;

pub use super::layout::{Count, Definition, ElementType, Field, NumberType, SchemaError};
use super::layout::{Described, MAX_DEPTH, plain_name};
use super::{idl_text, msg_text};

/// The two types that every `.msg` may use without a description in the bag.
const BUILTIN: [&str; 2] = ["builtin_interfaces/Time", "builtin_interfaces/Duration"];

/// A message type with all types that it contains.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MessageSchema {
    definitions: Vec<Definition>,
    root: usize,
}

impl MessageSchema {
    /// Parses a description in a bag: `encoding` is `ros2msg`, `ros2idl` or `ros1msg`, `name` the message's
    /// type (`sensor_msgs/msg/LaserScan`).
    ///
    /// # Errors
    /// [`SchemaError`] with the line that is wrong, or what is missing.
    pub fn parse(name: &str, encoding: &str, text: &[u8]) -> Result<Self, SchemaError> {
        if !matches!(encoding, "ros2msg" | "ros2idl" | "ros1msg") {
            return Err(SchemaError::Language(encoding.to_owned()));
        }
        let text = std::str::from_utf8(text).map_err(|_| SchemaError::NotText)?;
        let root = plain_name(name);
        let described = match encoding {
            "ros2idl" => idl_text::parse(text)?,
            _ => msg_text::parse(&root, text)?,
        };
        // Seconds of ROS 1 are unsigned.
        let time = match encoding {
            "ros1msg" => "uint32 sec\nuint32 nanosec\n",
            _ => "int32 sec\nuint32 nanosec\n",
        };
        resolve(&root, described, time)
    }

    /// The message itself.
    pub fn root(&self) -> &Definition {
        &self.definitions[self.root]
    }

    /// The message type of a field, by index.
    pub fn definition(&self, index: usize) -> &Definition {
        &self.definitions[index]
    }
}

fn resolve(
    root: &str,
    described: Vec<Described>,
    time: &str,
) -> Result<MessageSchema, SchemaError> {
    let mut by_name: BTreeMap<String, Described> = BTreeMap::new();
    for definition in described {
        by_name.entry(definition.name.clone()).or_insert(definition);
    }
    for builtin in BUILTIN {
        if !by_name.contains_key(builtin) {
            let described = msg_text::parse(builtin, time)?;
            by_name.extend(described.into_iter().map(|found| (found.name.clone(), found)));
        }
    }
    let mut resolver = Resolver { by_name, done: BTreeMap::new(), definitions: Vec::new() };
    if !resolver.by_name.contains_key(root) {
        return Err(SchemaError::NoRoot(root.to_owned()));
    }
    let root = resolver.resolve(root, 0)?;
    Ok(MessageSchema { definitions: resolver.definitions, root })
}

struct Resolver {
    by_name: BTreeMap<String, Described>,
    done: BTreeMap<String, usize>,
    definitions: Vec<Definition>,
}

impl Resolver {
    /// Index of the resolved definition of `name`, which must be described.
    fn resolve(&mut self, name: &str, depth: usize) -> Result<usize, SchemaError> {
        if let Some(&index) = self.done.get(name) {
            return Ok(index);
        }
        if depth > MAX_DEPTH {
            return Err(SchemaError::Nesting(name.to_owned()));
        }
        let described = self.by_name[name].clone();
        let mut fields = Vec::with_capacity(described.fields.len());
        let mut min_bytes: u64 = 0;
        for field in described.fields {
            let (element, element_bytes) = match field.element {
                ElementType::Number(number) => (ElementType::Number(number), number.width() as u64),
                ElementType::Text => (ElementType::Text, 4),
                ElementType::WideText => (ElementType::WideText, 4),
                ElementType::Message(found) => {
                    let found = self.find(&described.name, &field.name, &found)?;
                    let index = self.resolve(&found, depth + 1)?;
                    (ElementType::Message(index), self.definitions[index].min_bytes)
                }
            };
            min_bytes = min_bytes.saturating_add(match field.count {
                Count::One => element_bytes,
                Count::Fixed(count) => element_bytes.saturating_mul(count),
                Count::Sequence => 4,
            });
            fields.push(Field { name: field.name, element, count: field.count });
        }
        // A message without fields is encoded as one byte.
        let min_bytes = min_bytes.max(1);
        self.definitions.push(Definition { name: described.name, fields, min_bytes });
        let index = self.definitions.len() - 1;
        self.done.insert(name.to_owned(), index);
        Ok(index)
    }

    /// The full name of a type used in `definition`: of the same package, where it names none.
    fn find(&self, definition: &str, field: &str, found: &str) -> Result<String, SchemaError> {
        let name = plain_name(found);
        let package = definition.split('/').next().unwrap_or_default();
        let candidates = match name.as_str() {
            "Header" => vec!["std_msgs/Header".to_owned(), format!("{package}/Header")],
            "time" | "Time" => {
                vec![format!("{package}/Time"), "builtin_interfaces/Time".to_owned()]
            }
            "duration" | "Duration" => {
                vec![format!("{package}/Duration"), "builtin_interfaces/Duration".to_owned()]
            }
            _ if name.contains('/') => vec![name.clone()],
            _ => vec![format!("{package}/{name}")],
        };
        candidates.into_iter().find(|name| self.by_name.contains_key(name)).ok_or_else(|| {
            SchemaError::UnknownType {
                definition: definition.to_owned(),
                field: field.to_owned(),
                found: name,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<MessageSchema, SchemaError> {
        MessageSchema::parse("p/msg/A", "ros2msg", text.as_bytes())
    }

    #[test]
    fn names_are_looked_up_in_the_package_first() {
        let text = "B b\nstd_msgs/Header h\nbuiltin_interfaces/Time t\n===\nMSG: p/B\nfloat64[3] x\n\
                    =====\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
        let schema = parse(text).unwrap();
        let root = schema.root();
        assert_eq!(root.fields.len(), 3);
        assert_eq!(root.min_bytes, 24 + 12 + 8);
        let ElementType::Message(b) = root.fields[0].element else { panic!() };
        assert_eq!(schema.definition(b).fields[0].count, Count::Fixed(3));
    }

    #[test]
    fn descriptions_that_lead_nowhere_are_refused() {
        assert!(matches!(parse("B b").unwrap_err(), SchemaError::UnknownType { .. }));
        assert!(matches!(parse("A a").unwrap_err(), SchemaError::Nesting(_)));
        let error = MessageSchema::parse("p/A", "omgidl", b"").unwrap_err();
        assert_eq!(error, SchemaError::Language("omgidl".to_owned()));
        assert_eq!(MessageSchema::parse("p/A", "ros2msg", b"\xff"), Err(SchemaError::NotText));
        let error = MessageSchema::parse("p/A", "ros2idl", b"module q { struct B { long x; }; };");
        assert_eq!(error, Err(SchemaError::NoRoot("p/A".to_owned())));
    }
}
