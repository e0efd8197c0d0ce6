//! The `.msg` language: one field per line; further messages follow lines of `=` and `MSG: package/Name`.

use super::layout::{Count, Described, ElementType, Field, NumberType, SchemaError, plain_name};

/// Parses the message `root` and those it depends on.
pub(super) fn parse(root: &str, text: &str) -> Result<Vec<Described>, SchemaError> {
    let mut definitions = vec![Described { name: root.to_owned(), fields: Vec::new() }];
    let mut is_after_rule = false;
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        let is_rule = line.len() >= 3 && line.bytes().all(|byte| byte == b'=');
        if is_rule {
            is_after_rule = true;
        } else if let Some(name) = line.strip_prefix("MSG:").filter(|_| is_after_rule) {
            definitions.push(Described { name: plain_name(name.trim()), fields: Vec::new() });
            is_after_rule = false;
        } else if let Some(field) = field(line).map_err(|expected| SchemaError::Syntax {
            line: index + 1,
            found: line.chars().take(60).collect(),
            expected,
        })? && let Some(definition) = definitions.last_mut()
        {
            definition.fields.push(field);
        }
    }
    Ok(definitions)
}

/// The field described by a line; `None` for comments, blank lines and constants.
fn field(line: &str) -> Result<Option<Field<String>>, &'static str> {
    const FIELD: &str = "a field: its type and its name";
    if line.is_empty() || line.starts_with('#') {
        return Ok(None);
    }
    let (type_text, rest) = line.split_once(char::is_whitespace).ok_or(FIELD)?;
    let rest = rest.trim_start();
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let name_end = rest.find(|c| !is_name(c)).unwrap_or(rest.len());
    let (name, after) = rest.split_at(name_end);
    if name.is_empty() {
        return Err(FIELD);
    }
    if after.trim_start().starts_with('=') {
        return Ok(None);
    }
    if !after.is_empty() && !after.starts_with(char::is_whitespace) && !after.starts_with('#') {
        return Err(FIELD);
    }
    let (base, count) = match type_text.strip_suffix(']') {
        None => (type_text, Count::One),
        Some(array) => {
            let (base, size) = array.rsplit_once('[').ok_or("a type")?;
            let count = match size {
                "" => Count::Sequence,
                bound if bound.starts_with("<=") => Count::Sequence,
                // Empty messages could nest without end; ROS has no empty arrays either.
                fixed => match fixed.parse() {
                    Ok(size @ 1..) => Count::Fixed(size),
                    _ => return Err("the size of an array, at least 1"),
                },
            };
            (base, count)
        }
    };
    // `string<=10` is encoded like a string.
    let base = base.split_once("<=").map_or(base, |(base, _)| base);
    let is_type = |c: char| is_name(c) || c == '/';
    if base.is_empty() || !base.chars().all(is_type) {
        return Err("a type");
    }
    let element = match base {
        "string" => ElementType::Text,
        "wstring" => ElementType::WideText,
        _ => match number(base) {
            Some(number) => ElementType::Number(number),
            None => ElementType::Message(base.to_owned()),
        },
    };
    Ok(Some(Field { name: name.to_owned(), element, count }))
}

fn number(name: &str) -> Option<NumberType> {
    Some(match name {
        "bool" => NumberType::Bool,
        "byte" | "char" | "uint8" => NumberType::Unsigned(1),
        "uint16" => NumberType::Unsigned(2),
        "uint32" => NumberType::Unsigned(4),
        "uint64" => NumberType::Unsigned(8),
        "int8" => NumberType::Signed(1),
        "int16" => NumberType::Signed(2),
        "int32" => NumberType::Signed(4),
        "int64" => NumberType::Signed(8),
        "float32" => NumberType::Float(4),
        "float64" => NumberType::Float(8),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(text: &str) -> Vec<(String, ElementType<String>, Count)> {
        let definitions = parse("p/A", text).unwrap();
        let fields = definitions[0].fields.iter();
        fields.map(|f| (f.name.clone(), f.element.clone(), f.count)).collect()
    }

    #[test]
    fn fields_constants_defaults_and_comments() {
        let text = "# A comment\nbyte DEBUG=10\nuint8 WARN = 30 # thirty\nstring NAME=\"a # b\"\n\
                    float32[] ranges # metres\nfloat64[36] covariance\nint32[<=5] few 3\n\
                    string<=10 label \"a=b\"\nstring<=10[<=3] labels\nwstring w\nbool flag true\n\
                    geometry_msgs/msg/Pose pose\n";
        let number = ElementType::Number;
        assert_eq!(
            fields(text),
            [
                ("ranges".into(), number(NumberType::Float(4)), Count::Sequence),
                ("covariance".into(), number(NumberType::Float(8)), Count::Fixed(36)),
                ("few".into(), number(NumberType::Signed(4)), Count::Sequence),
                ("label".into(), ElementType::Text, Count::One),
                ("labels".into(), ElementType::Text, Count::Sequence),
                ("w".into(), ElementType::WideText, Count::One),
                ("flag".into(), number(NumberType::Bool), Count::One),
                ("pose".into(), ElementType::Message("geometry_msgs/msg/Pose".into()), Count::One),
            ]
        );
    }

    #[test]
    fn invalid_fields_are_named_with_their_line() {
        for line in [
            "float32",
            "float32[0] a",
            "float32[x] a",
            "float32[ a",
            "fl%at a",
            "float32 a-b",
            "float32 -",
        ] {
            let error = parse("p/A", &format!("bool ok\n{line}\n")).unwrap_err();
            assert!(matches!(error, SchemaError::Syntax { line: 2, .. }), "{line}: {error}");
        }
    }
}
