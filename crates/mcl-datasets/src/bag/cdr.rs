//! Decodes messages as their schema describes them: Common Data Representation (OMG DDS-XTypes 1.3, 7.4.1:
//! XCDR version 1, plain) of ROS 2, and the serialization of ROS 1, which has no header and no alignment, is
//! little-endian, and does not end strings with NUL.

use super::layout::{Count, Definition, ElementType, NumberType, SchemaError};
use super::schema::MessageSchema;

/// A decoded message, or a part of one. Strings and arrays borrow the message's bytes.
#[derive(Debug, Clone, PartialEq)]
pub enum Value<'a> {
    /// A number; integers beyond 2⁵³ are rounded.
    Number(f64),
    /// A string.
    Text(&'a str),
    /// An array of numbers.
    Numbers(Numbers<'a>),
    /// An array of `uint8`: images and point clouds.
    Bytes(&'a [u8]),
    /// An array of strings or messages.
    List(Vec<Value<'a>>),
    /// A message: its fields in order.
    Message(Vec<Value<'a>>),
}

/// An array of numbers, still encoded: most bytes of a bag are readings, and not all of them are used.
#[derive(Debug, Clone, Copy)]
pub struct Numbers<'a> {
    number: NumberType,
    bytes: &'a [u8],
    is_little: bool,
}

impl Numbers<'_> {
    /// The first number, if there is any.
    pub fn first(&self) -> Option<f64> {
        let first = self.bytes.get(..self.number.width())?;
        Some(value(self.number, first, self.is_little))
    }

    /// All of them; integers beyond 2⁵³ are rounded.
    pub fn to_vec(&self) -> Vec<f64> {
        match (self.number, self.is_little) {
            (NumberType::Float(4), true) => {
                let (numbers, _) = self.bytes.as_chunks::<4>();
                numbers.iter().map(|&bytes| f64::from(f32::from_le_bytes(bytes))).collect()
            }
            (NumberType::Float(8), true) => {
                let (numbers, _) = self.bytes.as_chunks::<8>();
                numbers.iter().map(|&bytes| f64::from_le_bytes(bytes)).collect()
            }
            (number, is_little) => {
                let numbers = self.bytes.chunks_exact(number.width());
                numbers.map(|bytes| value(number, bytes, is_little)).collect()
            }
        }
    }
}

impl PartialEq for Numbers<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.to_vec() == other.to_vec()
    }
}

/// Why bytes do not decode as a message of their schema.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CdrError {
    /// The bytes end before the message does.
    #[error("the message ends at byte {length}, {missing} bytes before the end of field {field}")]
    TooShort {
        /// Field at fault.
        field: String,
        /// Bytes of the message.
        length: usize,
        /// Bytes that are missing, at least.
        missing: u64,
    },
    /// An array or string longer than the message.
    #[error(
        "field {field} says that it has {count} elements, but {left} bytes are left of the message"
    )]
    Length {
        /// Field at fault.
        field: String,
        /// Number of elements that the message states.
        count: u64,
        /// Bytes left.
        left: usize,
    },
    /// A string that is not UTF-8.
    #[error("field {field} is not UTF-8 text")]
    NotText {
        /// Field at fault.
        field: String,
    },
    /// An unsupported representation.
    #[error(
        "its representation is {0:#06x}, expected 0x0000 or 0x0001 (plain CDR, big- or little-endian)"
    )]
    Representation(u16),
    /// A string of wide characters.
    #[error("field {field} is a wstring, which is not read")]
    WideText {
        /// Field at fault.
        field: String,
    },
}

/// Decodes a message with its 4-byte encapsulation header. Bytes after its end (padding) are ignored.
///
/// # Errors
/// [`CdrError`] when the bytes do not decode as a message of this schema.
pub fn decode<'a>(schema: &MessageSchema, bytes: &'a [u8]) -> Result<Value<'a>, CdrError> {
    decode_prefix(schema, bytes).map(|(value, _)| value)
}

/// [`decode`], with the number of bytes that the message takes, header included.
///
/// # Errors
/// As [`decode`].
pub fn decode_prefix<'a>(
    schema: &MessageSchema,
    bytes: &'a [u8],
) -> Result<(Value<'a>, usize), CdrError> {
    let Some((&[high, low, _, _], body)) = bytes.split_first_chunk() else {
        let missing = (4 - bytes.len()) as u64;
        return Err(CdrError::TooShort { field: "head".to_owned(), length: bytes.len(), missing });
    };
    let representation = u16::from_be_bytes([high, low]);
    if representation > 1 {
        return Err(CdrError::Representation(representation));
    }
    let is_little = representation == 1;
    let mut decoder = Decoder { schema, body, head: 4, at: 0, is_little, is_ros1: false };
    let value = decoder.message(schema.root())?;
    Ok((value, decoder.head + decoder.at))
}

/// How messages are encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Of ROS 2.
    Cdr,
    /// Of ROS 1.
    Ros1,
}

impl Encoding {
    /// The encoding of this name in a bag (`cdr`, `ros1`).
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "cdr" => Some(Encoding::Cdr),
            "ros1" => Some(Encoding::Ros1),
            _ => None,
        }
    }

    /// Decodes a message.
    ///
    /// # Errors
    /// [`CdrError`] when the bytes do not decode as a message of this schema.
    pub fn decode<'a>(
        self,
        schema: &MessageSchema,
        bytes: &'a [u8],
    ) -> Result<Value<'a>, CdrError> {
        match self {
            Encoding::Cdr => decode(schema, bytes),
            Encoding::Ros1 => {
                let mut decoder =
                    Decoder { schema, body: bytes, head: 0, at: 0, is_little: true, is_ros1: true };
                decoder.message(schema.root())
            }
        }
    }
}

struct Decoder<'s, 'a> {
    schema: &'s MessageSchema,
    /// The bytes after the header; alignment counts from here.
    body: &'a [u8],
    /// Length of the header in bytes.
    head: usize,
    at: usize,
    is_little: bool,
    is_ros1: bool,
}

impl<'s, 'a> Decoder<'s, 'a> {
    fn message(&mut self, definition: &'s Definition) -> Result<Value<'a>, CdrError> {
        if definition.fields.is_empty() && !self.is_ros1 {
            self.take(1, "(message without fields)")?;
        }
        let mut values = Vec::with_capacity(definition.fields.len());
        for field in &definition.fields {
            values.push(match field.count {
                Count::One => self.element(&field.element, &field.name)?,
                Count::Fixed(count) => self.array(&field.element, count, &field.name)?,
                Count::Sequence => {
                    let count = self.length(&field.name)?;
                    self.array(&field.element, u64::from(count), &field.name)?
                }
            });
        }
        Ok(Value::Message(values))
    }

    fn element(
        &mut self,
        element: &ElementType<usize>,
        field: &str,
    ) -> Result<Value<'a>, CdrError> {
        match element {
            ElementType::Number(number) => self.number(*number, field).map(Value::Number),
            ElementType::Text => self.text(field).map(Value::Text),
            ElementType::WideText => Err(CdrError::WideText { field: field.to_owned() }),
            ElementType::Message(index) => self.message(self.schema.definition(*index)),
        }
    }

    fn array(
        &mut self,
        element: &ElementType<usize>,
        count: u64,
        field: &str,
    ) -> Result<Value<'a>, CdrError> {
        let element_bytes = match element {
            ElementType::Number(number) => number.width() as u64,
            ElementType::Text | ElementType::WideText => 4,
            ElementType::Message(index) => self.schema.definition(*index).min_bytes,
        };
        // Checked before anything is allocated for them.
        let left = self.body.len() - self.at;
        if count.saturating_mul(element_bytes) > left as u64 {
            return Err(CdrError::Length { field: field.to_owned(), count, left });
        }
        if let ElementType::Number(NumberType::Unsigned(1)) = element {
            return self.take(count as usize, field).map(Value::Bytes);
        }
        if let &ElementType::Number(number) = element {
            let width = number.width();
            if count > 0 {
                self.align(width);
            }
            let bytes = self.take(count as usize * width, field)?;
            return Ok(Value::Numbers(Numbers { number, bytes, is_little: self.is_little }));
        }
        let values = (0..count).map(|_| self.element(element, field));
        values.collect::<Result<_, _>>().map(Value::List)
    }

    fn number(&mut self, number: NumberType, field: &str) -> Result<f64, CdrError> {
        let width = number.width();
        self.align(width);
        Ok(value(number, self.take(width, field)?, self.is_little))
    }

    fn length(&mut self, field: &str) -> Result<u32, CdrError> {
        self.number(NumberType::Unsigned(4), field).map(|length| length as u32)
    }

    /// A string after its length, which counts the NUL at its end.
    fn text(&mut self, field: &str) -> Result<&'a str, CdrError> {
        let length = self.length(field)?;
        let left = self.body.len() - self.at;
        if length as usize > left {
            let count = u64::from(length);
            return Err(CdrError::Length { field: field.to_owned(), count, left });
        }
        let bytes = self.take(length as usize, field)?;
        let bytes = bytes.strip_suffix(b"\0").unwrap_or(bytes);
        std::str::from_utf8(bytes).map_err(|_| CdrError::NotText { field: field.to_owned() })
    }

    fn align(&mut self, width: usize) {
        if self.is_ros1 {
            return;
        }
        self.at = self.at.next_multiple_of(width).min(self.body.len());
    }

    fn take(&mut self, length: usize, field: &str) -> Result<&'a [u8], CdrError> {
        let bytes = self.body.get(self.at..self.at + length).ok_or_else(|| CdrError::TooShort {
            field: field.to_owned(),
            length: self.head + self.body.len(),
            missing: (self.at + length - self.body.len()) as u64,
        })?;
        self.at += length;
        Ok(bytes)
    }
}

/// A number from the bytes of its type.
fn value(number: NumberType, bytes: &[u8], is_little: bool) -> f64 {
    let width = bytes.len();
    let mut wide = [0; 8];
    wide[..width].copy_from_slice(bytes);
    if !is_little {
        wide[..width].reverse();
    }
    let bits = u64::from_le_bytes(wide);
    let unused = 64 - 8 * width as u32;
    match number {
        NumberType::Bool => f64::from(u8::from(bits != 0)),
        NumberType::Unsigned(_) => bits as f64,
        // Shifted up and down again to extend the sign.
        NumberType::Signed(_) => (((bits << unused) as i64) >> unused) as f64,
        NumberType::Float(4) => f64::from(f32::from_bits(bits as u32)),
        NumberType::Float(_) => f64::from_bits(bits),
    }
}

/// A decoded message with the names of its fields.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    schema: &'a MessageSchema,
    definition: &'a Definition,
    values: &'a [Value<'a>],
}

impl<'a> View<'a> {
    /// A view of a whole message of this schema, as returned by [`decode`].
    pub fn new(schema: &'a MessageSchema, value: &'a Value<'a>) -> Self {
        View { schema, definition: schema.root(), values: fields_of(value) }
    }

    fn field(&self, name: &str) -> Result<(&'a ElementType<usize>, &'a Value<'a>), SchemaError> {
        let index = self.definition.fields.iter().position(|field| field.name == name);
        index
            .and_then(|index| {
                Some((&self.definition.fields.get(index)?.element, self.values.get(index)?))
            })
            .ok_or_else(|| SchemaError::MissingField {
                definition: self.definition.name.clone(),
                field: name.to_owned(),
            })
    }

    fn wrong(&self, name: &str, found: &Value<'_>, expected: &'static str) -> SchemaError {
        SchemaError::FieldType {
            definition: self.definition.name.clone(),
            field: name.to_owned(),
            found: match found {
                Value::Number(_) => "a number",
                Value::Text(_) => "a text",
                Value::Numbers(_) => "an array of numbers",
                Value::Bytes(_) => "an array of bytes",
                Value::List(_) => "an array",
                Value::Message(_) => "a message",
            },
            expected,
        }
    }

    /// A number.
    ///
    /// # Errors
    /// When the schema lacks the field or gives it another type; the same holds for the methods below.
    pub fn number(&self, name: &str) -> Result<f64, SchemaError> {
        match self.field(name)?.1 {
            Value::Number(number) => Ok(*number),
            other => Err(self.wrong(name, other, "a number")),
        }
    }

    /// A string.
    ///
    /// # Errors
    /// As [`View::number`].
    pub fn text(&self, name: &str) -> Result<&'a str, SchemaError> {
        match self.field(name)?.1 {
            Value::Text(text) => Ok(text),
            other => Err(self.wrong(name, other, "a text")),
        }
    }

    /// An array of numbers.
    ///
    /// # Errors
    /// As [`View::number`].
    pub fn numbers(&self, name: &str) -> Result<Numbers<'a>, SchemaError> {
        match self.field(name)?.1 {
            Value::Numbers(numbers) => Ok(*numbers),
            other => Err(self.wrong(name, other, "an array of numbers")),
        }
    }

    /// An array of `uint8`.
    ///
    /// # Errors
    /// As [`View::number`].
    pub fn bytes(&self, name: &str) -> Result<&'a [u8], SchemaError> {
        match self.field(name)?.1 {
            Value::Bytes(bytes) => Ok(bytes),
            other => Err(self.wrong(name, other, "an array of bytes (uint8[])")),
        }
    }

    /// A message.
    ///
    /// # Errors
    /// As [`View::number`].
    pub fn message(&self, name: &str) -> Result<View<'a>, SchemaError> {
        match self.field(name)? {
            (ElementType::Message(index), value @ Value::Message(_)) => Ok(View {
                schema: self.schema,
                definition: self.schema.definition(*index),
                values: fields_of(value),
            }),
            (_, other) => Err(self.wrong(name, other, "a message")),
        }
    }

    /// An array of messages.
    ///
    /// # Errors
    /// As [`View::number`].
    pub fn messages(&self, name: &str) -> Result<Vec<View<'a>>, SchemaError> {
        match self.field(name)? {
            (ElementType::Message(index), Value::List(values)) => {
                let definition = self.schema.definition(*index);
                let view =
                    |value| View { schema: self.schema, definition, values: fields_of(value) };
                Ok(values.iter().map(view).collect())
            }
            (_, other) => Err(self.wrong(name, other, "an array of messages")),
        }
    }
}

fn fields_of<'a>(value: &'a Value<'a>) -> &'a [Value<'a>] {
    match value {
        Value::Message(values) => values,
        _ => &[],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn schema(text: &str) -> MessageSchema {
        MessageSchema::parse("p/A", "ros2msg", text.as_bytes()).unwrap()
    }

    fn numbers(number: NumberType, bytes: &[u8]) -> Value<'_> {
        Value::Numbers(Numbers { number, bytes, is_little: true })
    }

    #[test]
    fn alignment_counts_from_the_end_of_the_head() {
        let schema = schema("uint8 a\nfloat64 b\nint16 c\nstring s\nint8[] d\n");
        let mut bytes = vec![0, 1, 0, 0, 7];
        bytes.extend([0; 7]);
        bytes.extend(1.5_f64.to_le_bytes());
        bytes.extend((-2_i16).to_le_bytes());
        bytes.extend([0, 0, 3, 0, 0, 0, b'o', b'k', 0, 0]);
        bytes.extend([2, 0, 0, 0, 0xff, 1]);
        let expected = Value::Message(vec![
            Value::Number(7.0),
            Value::Number(1.5),
            Value::Number(-2.0),
            Value::Text("ok"),
            numbers(NumberType::Signed(1), &[0xff, 1]),
        ]);
        assert_eq!(decode_prefix(&schema, &bytes), Ok((expected, bytes.len())));
        for end in 0..bytes.len() {
            assert!(decode(&schema, &bytes[..end]).is_err(), "{end}");
        }
    }

    #[test]
    fn messages_of_ros_1_have_neither_head_nor_alignment() {
        let text = "Header header\nuint8 a\nfloat64 b\nstring s\nEmpty e\nint16[] d\n===\nMSG: \
                    std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n===\nMSG: p/Empty\n";
        let schema = MessageSchema::parse("p/A", "ros1msg", text.as_bytes()).unwrap();
        let mut bytes = [7_u32, 3_000_000_000, 5, 2].map(u32::to_le_bytes).concat();
        bytes.extend(b"ab\x09");
        bytes.extend(1.5_f64.to_le_bytes());
        bytes.extend([1, 0, 0, 0, b'x', 2, 0, 0, 0, 0xff, 0xff, 1, 0]);
        let value = Encoding::Ros1.decode(&schema, &bytes).unwrap();
        let view = View::new(&schema, &value);
        let header = view.message("header").unwrap();
        assert_eq!(header.message("stamp").unwrap().number("sec"), Ok(3e9));
        assert_eq!(header.text("frame_id"), Ok("ab"));
        assert_eq!(
            (view.number("a"), view.number("b"), view.text("s")),
            (Ok(9.0), Ok(1.5), Ok("x"))
        );
        let d = view.numbers("d").unwrap();
        assert_eq!((d.first(), d.to_vec()), (Some(-1.0), vec![-1.0, 1.0]));
        for end in 0..bytes.len() {
            assert!(Encoding::Ros1.decode(&schema, &bytes[..end]).is_err(), "{end}");
        }
        // Messages of no bytes at all could be any number.
        let many = "Empty[] e\n===\nMSG: p/Empty\n";
        let schema = MessageSchema::parse("p/A", "ros1msg", many.as_bytes()).unwrap();
        let error = Encoding::Ros1.decode(&schema, &[0xff; 4]).unwrap_err();
        assert!(matches!(error, CdrError::Length { left: 0, .. }));
    }

    #[test]
    fn both_byte_orders() {
        let schema = schema("int32 a\nfloat32[2] b");
        let mut little = vec![0, 1, 0, 0];
        let mut big = vec![0, 0, 0, 0];
        little.extend((-5_i32).to_le_bytes());
        big.extend((-5_i32).to_be_bytes());
        for value in [0.5_f32, f32::INFINITY] {
            little.extend(value.to_le_bytes());
            big.extend(value.to_be_bytes());
        }
        assert_eq!(decode(&schema, &little), decode(&schema, &big));
        let value = decode(&schema, &big).unwrap();
        let view = View::new(&schema, &value);
        assert_eq!(view.number("a"), Ok(-5.0));
        assert_eq!(view.numbers("b").unwrap().to_vec(), [0.5, f64::INFINITY]);
        big[1] = 7;
        assert_eq!(decode(&schema, &big), Err(CdrError::Representation(7)));
    }

    #[test]
    fn lengths_are_believed_only_as_far_as_there_are_bytes() {
        let schema = schema("float64[] a");
        let error = decode(&schema, &[0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 1]).unwrap_err();
        assert_eq!(error, CdrError::Length { field: "a".into(), count: 0xffff_ffff, left: 1 });
        let huge = self::schema(
            "B[1000000] b\n===\nMSG: p/B\nC[1000000] c\n===\nMSG: p/C\nD[1000000000] d\n===\nMSG: p/D\nuint8 x",
        );
        assert!(matches!(decode(&huge, &[0; 100]), Err(CdrError::Length { .. })));
        // Found by the fuzz target: arrays of empty elements took no bytes, and doubled with each level of
        // nesting.
        for (language, text) in [
            ("ros2msg", "uint8[0] a"),
            ("ros2idl", "module p { struct A { octet a[0]; }; };"),
            ("ros2idl", "const long NONE = 0; module p { struct A { octet a[2][NONE]; }; };"),
        ] {
            let error = MessageSchema::parse("p/A", language, text.as_bytes()).unwrap_err();
            assert!(error.to_string().contains("size of an array, at least 1"), "{error}");
        }
        let bytes = self::schema("uint8[] a");
        let decoded = decode(&bytes, &[0, 1, 0, 0, 2, 0, 0, 0, 7, 255]);
        assert_eq!(decoded, Ok(Value::Message(vec![Value::Bytes(&[7, 255])])));
        let error = decode(&bytes, &[0, 1, 0, 0, 3, 0, 0, 0x80, 7]).unwrap_err();
        assert_eq!(error, CdrError::Length { field: "a".into(), count: 0x8000_0003, left: 1 });
        let empties = self::schema("B[] b\n===\nMSG: p/B\n");
        assert!(decode(&empties, &[0, 1, 0, 0, 0xff, 0xff, 0xff, 0x7f]).is_err());
    }
}
