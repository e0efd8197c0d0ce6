//! The part of OMG IDL 4.2 that ROS 2 generates for messages: modules, structures, constants, type
//! definitions and enumerations; annotations and comments are skipped.

use std::collections::BTreeMap;

use super::layout::{
    Count, Described, ElementType, Field, MAX_NAME_BYTES, NumberType, SchemaError, plain_name,
};

type Element = ElementType<String>;

/// All structures in the text.
pub(super) fn parse(text: &str) -> Result<Vec<Described>, SchemaError> {
    let tokens = tokens(text)?;
    let mut parser = Parser { tokens: &tokens, scope: Vec::new(), known: Known::default() };
    while !parser.tokens.is_empty() {
        parser.declaration(0)?;
    }
    Ok(parser.known.structures)
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Token {
    line: usize,
    text: String,
}

/// Splits the text into words (with `::` inside), numbers, strings and single characters. Lines that separate
/// the files of a bundle (`====`, `IDL: package/msg/Name`) and preprocessor lines are left out.
fn tokens(text: &str) -> Result<Vec<Token>, SchemaError> {
    let mut tokens = Vec::new();
    let mut rest = text;
    let mut line = 1;
    let mut is_line_start = true;
    while let Some(first) = rest.chars().next() {
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.';
        let length = if is_line_start
            && (first == '#' || rest.starts_with("===") || rest.starts_with("IDL:"))
            || rest.starts_with("//")
        {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |end| end + 2)
        } else if first.is_whitespace() {
            first.len_utf8()
        } else if first == '"' {
            let mut is_escaped = false;
            let end = rest[1..].find(|c| {
                let is_end = c == '"' && !is_escaped;
                is_escaped = c == '\\' && !is_escaped;
                is_end
            });
            let length = end.ok_or_else(|| syntax(line, "\"", "a text that ends"))? + 2;
            tokens.push(Token { line, text: rest[..length].to_owned() });
            length
        } else if is_word(first) || rest.starts_with("::") {
            let mut end = 0;
            loop {
                end += rest[end..].find(|c| !is_word(c)).unwrap_or(rest.len() - end);
                if !rest[end..].starts_with("::") {
                    break;
                }
                end += 2;
            }
            tokens.push(Token { line, text: rest[..end].to_owned() });
            end
        } else {
            tokens.push(Token { line, text: first.to_string() });
            first.len_utf8()
        };
        let passed = &rest[..length];
        is_line_start = match passed.rfind('\n') {
            Some(end) => passed[end..].trim().is_empty(),
            None => is_line_start && passed.trim().is_empty(),
        };
        line += passed.matches('\n').count();
        rest = &rest[length..];
    }
    Ok(tokens)
}

fn syntax(line: usize, found: &str, expected: &'static str) -> SchemaError {
    SchemaError::Syntax { line, found: found.chars().take(60).collect(), expected }
}

#[derive(Default)]
struct Known {
    structures: Vec<Described>,
    /// Type aliases by name.
    aliases: BTreeMap<String, (Element, Count)>,
    constants: BTreeMap<String, u64>,
}

struct Parser<'a> {
    tokens: &'a [Token],
    scope: Vec<String>,
    known: Known,
}

/// Nesting depth of modules accepted; ROS has two or three.
const MAX_MODULES: usize = 16;

impl<'a> Parser<'a> {
    fn peek(&self) -> &'a str {
        self.tokens.first().map_or("", |token| &token.text)
    }

    fn next(&mut self) -> &'a str {
        let text = self.peek();
        self.tokens = self.tokens.get(1..).unwrap_or_default();
        text
    }

    fn wrong(&self, expected: &'static str) -> SchemaError {
        match self.tokens.first() {
            Some(token) => syntax(token.line, &token.text, expected),
            None => syntax(0, "the end of the text", expected),
        }
    }

    fn expect(&mut self, text: &str, expected: &'static str) -> Result<(), SchemaError> {
        if self.peek() != text {
            return Err(self.wrong(expected));
        }
        self.next();
        Ok(())
    }

    fn name(&mut self, expected: &'static str) -> Result<&'a str, SchemaError> {
        let text = self.peek();
        if !text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_' || c == ':') {
            return Err(self.wrong(expected));
        }
        if text.len() > MAX_NAME_BYTES {
            return Err(self.wrong("a name of at most 255 bytes"));
        }
        Ok(self.next())
    }

    /// The fully qualified name.
    fn full(&self, name: &str) -> String {
        let mut parts: Vec<&str> = self.scope.iter().map(String::as_str).collect();
        parts.push(name);
        parts.join("::")
    }

    /// `@name` with its parameters.
    fn annotations(&mut self) -> Result<(), SchemaError> {
        while self.peek() == "@" {
            self.next();
            self.name("the name of an annotation")?;
            if self.peek() == "(" {
                let mut open = 0_usize;
                loop {
                    match self.next() {
                        "(" => open += 1,
                        ")" => open -= 1,
                        "" => return Err(self.wrong("the end of an annotation")),
                        _ => {}
                    }
                    if open == 0 {
                        break;
                    }
                }
            }
        }
        Ok(())
    }

    fn declaration(&mut self, depth: usize) -> Result<(), SchemaError> {
        const KINDS: &str = "module, struct, const, typedef or enum";
        self.annotations()?;
        match self.peek() {
            "module" if depth < MAX_MODULES => {
                self.next();
                let name = self.name("the name of a module")?.to_owned();
                self.scope.push(name);
                self.expect("{", "{")?;
                while self.peek() != "}" {
                    self.declaration(depth + 1)?;
                }
                self.next();
                self.scope.pop();
            }
            "struct" => self.structure()?,
            "const" => self.constant()?,
            "typedef" => {
                self.next();
                let (element, count) = self.type_of()?;
                let (name, count) = self.declarator(count)?;
                let name = self.full(&name);
                self.known.aliases.insert(name, (element, count));
            }
            "enum" => {
                self.next();
                let name = self.name("the name of an enumeration")?;
                let name = self.full(name);
                self.known
                    .aliases
                    .insert(name, (ElementType::Number(NumberType::Unsigned(4)), Count::One));
                while !["}", ""].contains(&self.next()) {}
            }
            _ => return Err(self.wrong(KINDS)),
        }
        if self.peek() == ";" {
            self.next();
        }
        Ok(())
    }

    fn constant(&mut self) -> Result<(), SchemaError> {
        self.next();
        self.type_of()?;
        let name = self.name("the name of a constant")?;
        let name = self.full(name);
        self.expect("=", "=")?;
        if let Ok(value) = self.peek().parse() {
            self.known.constants.insert(name, value);
        }
        while !matches!(self.peek(), ";" | "") {
            self.next();
        }
        Ok(())
    }

    fn structure(&mut self) -> Result<(), SchemaError> {
        self.next();
        let name = self.name("the name of a structure")?;
        let name = plain_name(&self.full(name));
        self.expect("{", "{")?;
        let mut fields = Vec::new();
        loop {
            self.annotations()?;
            if self.peek() == "}" {
                self.next();
                break;
            }
            let (element, count) = self.type_of()?;
            loop {
                let (name, count) = self.declarator(count)?;
                fields.push(Field { name, element: element.clone(), count });
                if self.peek() != "," {
                    break;
                }
                self.next();
            }
            self.expect(";", "; after a field")?;
        }
        // The placeholder that the generator adds to a message without fields; it takes one byte either way.
        fields.retain(|field| field.name != "structure_needs_at_least_one_member");
        self.known.structures.push(Described { name, fields });
        Ok(())
    }

    /// A name, and the sizes of an array after it.
    fn declarator(&mut self, count: Count) -> Result<(String, Count), SchemaError> {
        let name = self.name("the name of a field")?.to_owned();
        let mut size: Option<u64> = None;
        while self.peek() == "[" {
            self.next();
            let found = self.tokens;
            let number = self.number()?;
            if number == 0 {
                // Empty messages could nest without end; IDL has no empty arrays either.
                self.tokens = found;
                return Err(self.wrong("the size of an array, at least 1"));
            }
            size = Some(size.unwrap_or(1).saturating_mul(number));
            self.expect("]", "]")?;
        }
        match (count, size) {
            (count, None) => Ok((name, count)),
            (Count::One, Some(size)) => Ok((name, Count::Fixed(size))),
            _ => Err(self.wrong("a field other than an array of arrays")),
        }
    }

    fn number(&mut self) -> Result<u64, SchemaError> {
        let text = self.peek();
        let value = text.parse().ok().or_else(|| self.find(&self.known.constants, text).copied());
        let value = value.ok_or_else(|| self.wrong("a size"))?;
        self.next();
        Ok(value)
    }

    /// Resolves a name, from the innermost module outwards.
    fn find<'k, T>(&self, known: &'k BTreeMap<String, T>, name: &str) -> Option<&'k T> {
        let name = name.trim_start_matches("::");
        (0..=self.scope.len()).rev().find_map(|depth| {
            let scope = self.scope[..depth].iter().map(|part| format!("{part}::"));
            known.get(&(scope.collect::<String>() + name))
        })
    }

    fn type_of(&mut self) -> Result<(Element, Count), SchemaError> {
        use NumberType::{Bool, Float, Signed, Unsigned};
        let name = self.name("a type")?;
        let number = |number| Ok((ElementType::Number(number), Count::One));
        match name {
            "boolean" => number(Bool),
            "octet" | "char" | "uint8" => number(Unsigned(1)),
            "int8" => number(Signed(1)),
            "int16" | "short" => number(Signed(2)),
            "int32" => number(Signed(4)),
            "int64" => number(Signed(8)),
            "uint16" => number(Unsigned(2)),
            "uint32" => number(Unsigned(4)),
            "uint64" => number(Unsigned(8)),
            "float" => number(Float(4)),
            "double" => number(Float(8)),
            "long" => number(Signed(self.long())),
            "unsigned" => match self.name("short or long")? {
                "short" => number(Unsigned(2)),
                "long" => number(Unsigned(self.long())),
                _ => Err(self.wrong("short or long after unsigned")),
            },
            "string" | "wstring" => {
                if self.peek() == "<" {
                    self.next();
                    self.number()?;
                    self.expect(">", ">")?;
                }
                let element =
                    if name == "string" { ElementType::Text } else { ElementType::WideText };
                Ok((element, Count::One))
            }
            "sequence" => {
                self.expect("<", "<")?;
                // Not recursive: a sequence of sequences does not occur, and could nest without end.
                if self.peek() == "sequence" {
                    return Err(self.wrong("a type other than a sequence"));
                }
                let (element, count) = self.type_of()?;
                if count != Count::One {
                    return Err(self.wrong("a sequence of single elements"));
                }
                if self.peek() == "," {
                    self.next();
                    self.number()?;
                }
                self.expect(">", ">")?;
                Ok((element, Count::Sequence))
            }
            "union" | "bitmask" | "map" | "any" | "fixed" | "wchar" => {
                Err(self.wrong("a field of another type (unions and the like are not read)"))
            }
            _ => Ok(match self.find(&self.known.aliases, name) {
                Some(known) => known.clone(),
                None => (ElementType::Message(name.to_owned()), Count::One),
            }),
        }
    }

    /// Width of `long` or `long long`.
    fn long(&mut self) -> u8 {
        if self.peek() != "long" {
            return 4;
        }
        self.next();
        8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
================================================================================
IDL: p/msg/A
// generated from rosidl_adapter
#include "q/msg/B.idl"

module p {
  module msg {
    module A_Constants { const uint8 MANY = 3; };
    typedef double double__36[36];
    enum Kind { ONE, TWO };
    @verbatim (language="comment", text=
      "It says \"hello (\"." "\n" "More.")
    struct A {
      @unit (value="m") @default (value=0.5)
      float range_min;
      double__36 covariance;
      sequence<float> ranges;
      sequence<q::msg::B, 5> few;
      string<10> label;
      unsigned long long big, bigger;
      long x[2][3];
      Kind kind;
    };
  };
};
================================================================================
IDL: q/msg/B
module q { module msg { struct B { uint8 structure_needs_at_least_one_member; }; }; };
"#;

    #[test]
    fn a_bundle_of_two_files() {
        let found = parse(TEXT).unwrap();
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].name.as_str(), found[1].name.as_str()), ("p/A", "q/B"));
        assert!(found[1].fields.is_empty());
        let fields: Vec<_> =
            found[0].fields.iter().map(|f| (f.name.as_str(), f.element.clone(), f.count)).collect();
        let number = ElementType::Number;
        assert_eq!(
            fields,
            [
                ("range_min", number(NumberType::Float(4)), Count::One),
                ("covariance", number(NumberType::Float(8)), Count::Fixed(36)),
                ("ranges", number(NumberType::Float(4)), Count::Sequence),
                ("few", ElementType::Message("q::msg::B".into()), Count::Sequence),
                ("label", ElementType::Text, Count::One),
                ("big", number(NumberType::Unsigned(8)), Count::One),
                ("bigger", number(NumberType::Unsigned(8)), Count::One),
                ("x", number(NumberType::Signed(4)), Count::Fixed(6)),
                ("kind", number(NumberType::Unsigned(4)), Count::One),
            ]
        );
    }

    #[test]
    fn broken_text_is_an_error_not_a_panic() {
        for end in 0..TEXT.len() {
            if TEXT.is_char_boundary(end) {
                let _ = parse(&TEXT[..end]);
            }
        }
        for text in
            ["struct", "struct A {", "module p { struct A { long", "@a(", "union U {};", "\"a"]
        {
            assert!(parse(text).is_err(), "{text}");
        }
        assert!(parse(&"module a { ".repeat(100_000)).is_err());
        // Found by the fuzz target: each structure repeats the names of the modules around it.
        let long =
            format!("module {} {{ {} }};", "a".repeat(100_000), "struct b { };".repeat(1_000));
        assert!(parse(&long).unwrap_err().to_string().contains("at most 255 bytes"));
        assert!(parse(&("struct A { ".to_owned() + &"sequence<".repeat(100_000))).is_err());
    }
}
