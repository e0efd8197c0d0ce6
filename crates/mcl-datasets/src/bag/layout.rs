//! The description of a message type: its fields with their types and element counts.

/// Nesting depth accepted. Messages of sensors and poses nest five deep.
pub(super) const MAX_DEPTH: usize = 32;
/// Longest name of a module, message or field accepted, in bytes. A message's name repeats those of the
/// modules around it, so that a long one could otherwise be repeated many times.
pub(super) const MAX_NAME_BYTES: usize = 255;
/// Why a description cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SchemaError {
    /// The description language is not supported.
    #[error("is written in {0:?}, expected ros2msg, ros2idl or ros1msg")]
    Language(String),
    /// Not text.
    #[error("is not UTF-8")]
    NotText,
    /// A line that cannot be parsed.
    #[error("line {line}: {found:?} is not {expected}")]
    Syntax {
        /// Line, from 1.
        line: usize,
        /// What was found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A type that is used but not described.
    #[error("field {field} of {definition} is of type {found}, which is not described")]
    UnknownType {
        /// The message that has the field.
        definition: String,
        /// The field.
        field: String,
        /// Its type.
        found: String,
    },
    /// Types that contain themselves, or nest too deep.
    #[error("{0} holds itself or nests more than {MAX_DEPTH} deep")]
    Nesting(String),
    /// The message's own type is not described.
    #[error("no description of {0} in it")]
    NoRoot(String),
    /// A required field is missing.
    #[error("{definition} has no field {field}, which is needed")]
    MissingField {
        /// The message that should have it.
        definition: String,
        /// The field.
        field: String,
    },
    /// A required field has another type.
    #[error("field {field} of {definition} is {found}, expected {expected}")]
    FieldType {
        /// The message that has the field.
        definition: String,
        /// The field.
        field: String,
        /// The type found.
        found: &'static str,
        /// The type expected.
        expected: &'static str,
    },
}

/// Types of numbers, by their width in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberType {
    /// One byte that is zero or not.
    Bool,
    /// Signed integer of 1, 2, 4 or 8 bytes.
    Signed(u8),
    /// Unsigned integer of 1, 2, 4 or 8 bytes.
    Unsigned(u8),
    /// Floating point number of 4 or 8 bytes.
    Float(u8),
}

impl NumberType {
    /// Width in bytes.
    pub fn width(self) -> usize {
        match self {
            NumberType::Bool => 1,
            NumberType::Signed(width) | NumberType::Unsigned(width) | NumberType::Float(width) => {
                usize::from(width)
            }
        }
    }
}

/// Type of a field's element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ElementType<M> {
    /// A number.
    Number(NumberType),
    /// A string.
    Text,
    /// A string of wide characters; not supported, as its layout depends on the middleware.
    WideText,
    /// A message.
    Message(M),
}

/// How many elements a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Count {
    /// One element, not an array.
    One,
    /// A fixed number of elements.
    Fixed(u64),
    /// A variable number of elements, stated in the message.
    Sequence,
}

/// A field: name, element type and number of elements. `M` identifies the message type of the elements.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field<M> {
    /// Its name.
    pub name: String,
    /// Type of its elements.
    pub element: ElementType<M>,
    /// How many there are.
    pub count: Count,
}

/// A message as parsed from its text: types of fields are still names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Described {
    /// `package/Name`.
    pub name: String,
    pub fields: Vec<Field<String>>,
}

/// A message, its fields in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Definition {
    /// `package/Name`.
    pub name: String,
    /// Fields in the order of their encoding.
    pub fields: Vec<Field<usize>>,
    /// Smallest size of an encoded message, in bytes.
    pub min_bytes: u64,
}

/// `sensor_msgs/msg/LaserScan` and `sensor_msgs::msg::LaserScan` as `sensor_msgs/LaserScan`.
pub(super) fn plain_name(name: &str) -> String {
    let name = name.replace("::", "/");
    let parts: Vec<&str> = name.split('/').filter(|part| !part.is_empty()).collect();
    match parts.as_slice() {
        [package, "msg", message] => format!("{package}/{message}"),
        _ => parts.join("/"),
    }
}
