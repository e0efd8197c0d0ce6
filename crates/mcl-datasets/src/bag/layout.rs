//! What a description of a message says: fields, their types and their numbers.

/// Nesting accepted. Messages of sensors and poses nest five deep.
pub(super) const MAX_DEPTH: usize = 32;
/// Longest name of a module, message or field accepted, in bytes. Names of messages are made of those of
/// the modules around them, so that without a limit a long one would be repeated many times.
pub(super) const MAX_NAME_BYTES: usize = 255;
/// Why a description cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SchemaError {
    /// Not in a language that is read.
    #[error("is written in {0:?}, expected ros2msg, ros2idl or ros1msg")]
    Language(String),
    /// Not text.
    #[error("is not UTF-8")]
    NotText,
    /// A line that says nothing known.
    #[error("line {line}: {found:?} is not {expected}")]
    Syntax {
        /// Line, from 1.
        line: usize,
        /// What stands there.
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
    /// Types that hold themselves, or nest without end.
    #[error("{0} holds itself or nests more than {MAX_DEPTH} deep")]
    Nesting(String),
    /// The message's own type is not described.
    #[error("no description of {0} in it")]
    NoRoot(String),
    /// A field that is needed is not there.
    #[error("{definition} has no field {field}, which is needed")]
    MissingField {
        /// The message that should have it.
        definition: String,
        /// The field.
        field: String,
    },
    /// A field that is needed is of another type.
    #[error("field {field} of {definition} is {found}, expected {expected}")]
    FieldType {
        /// The message that has the field.
        definition: String,
        /// The field.
        field: String,
        /// What it is.
        found: &'static str,
        /// What it should be.
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
    /// A text.
    Text,
    /// A text of wide characters; its layout depends on the middleware, so it is not read.
    WideText,
    /// A message.
    Message(M),
}

/// How many elements a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Count {
    /// One, not an array.
    One,
    /// As many as the description says.
    Fixed(u64),
    /// As many as the message says.
    Sequence,
}

/// A field: name, element and number of elements. `M` names the message of the element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field<M> {
    /// Its name.
    pub name: String,
    /// Type of its elements.
    pub element: ElementType<M>,
    /// How many there are.
    pub count: Count,
}

/// A message as its text describes it: types of fields are still names.
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
    /// Fields in the order they are encoded in.
    pub fields: Vec<Field<usize>>,
    /// Bytes that any encoded message of it takes at least.
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
