//! Tables of named columns: the common form of everything that a study measures.

use std::cmp::Ordering;
use std::fmt;

use mcl_core::text::as_cell;
use serde::de::Visitor;
use serde::{Deserialize, Deserializer, Serialize};

/// A cell of a table. A value that is not known is empty, never zero.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// Not known, or not applicable.
    Empty,
    /// Yes or no.
    Bool(bool),
    /// A count, or a seed: exact.
    Count(u64),
    /// A finite number.
    Number(f64),
    /// Text.
    Text(String),
}

/// Decided by the type of the JSON value; derived code, which tries each variant in turn, read rows at half
/// the speed.
impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Cell;
        impl Visitor<'_> for Cell {
            type Value = Value;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("nothing, a truth value, a number or text")
            }

            fn visit_unit<E>(self) -> Result<Value, E> {
                Ok(Value::Empty)
            }

            fn visit_bool<E>(self, truth: bool) -> Result<Value, E> {
                Ok(Value::Bool(truth))
            }

            fn visit_u64<E>(self, count: u64) -> Result<Value, E> {
                Ok(Value::Count(count))
            }

            fn visit_i64<E>(self, number: i64) -> Result<Value, E> {
                Ok(Value::Number(number as f64))
            }

            fn visit_f64<E>(self, number: f64) -> Result<Value, E> {
                Ok(Value::Number(number))
            }

            fn visit_str<E>(self, text: &str) -> Result<Value, E> {
                Ok(Value::Text(text.to_owned()))
            }

            fn visit_string<E>(self, text: String) -> Result<Value, E> {
                Ok(Value::Text(text))
            }
        }
        deserializer.deserialize_any(Cell)
    }
}

impl Value {
    /// The numeric value of a count, a number or a truth value (1 or 0).
    pub fn number(&self) -> Option<f64> {
        match self {
            Value::Count(count) => Some(*count as f64),
            Value::Number(number) => Some(*number),
            Value::Bool(truth) => Some(f64::from(u8::from(*truth))),
            Value::Empty | Value::Text(_) => None,
        }
    }

    /// The text, if it is one.
    pub fn text(&self) -> Option<&str> {
        match self {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Whether it is empty.
    pub fn is_empty(&self) -> bool {
        *self == Value::Empty
    }

    /// An order in which equal values are adjacent: empty, truth values, numbers, text.
    pub fn order(&self, other: &Value) -> Ordering {
        let rank = |value: &Value| match value {
            Value::Empty => 0,
            Value::Bool(_) => 1,
            Value::Count(_) | Value::Number(_) => 2,
            Value::Text(_) => 3,
        };
        rank(self).cmp(&rank(other)).then_with(|| match (self, other) {
            (Value::Count(a), Value::Count(b)) => a.cmp(b),
            (Value::Text(a), Value::Text(b)) => a.cmp(b),
            _ => self.number().unwrap_or(0.0).total_cmp(&other.number().unwrap_or(0.0)),
        })
    }
}

/// As in a CSV file: numbers with the fewest digits that read back to the same bits.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Empty => Ok(()),
            Value::Bool(truth) => truth.fmt(f),
            Value::Count(count) => count.fmt(f),
            // Large and small numbers would be written with hundreds of digits.
            Value::Number(number) if *number != 0.0 && !(1e-5..1e16).contains(&number.abs()) => {
                write!(f, "{number:e}")
            }
            Value::Number(number) => number.fmt(f),
            Value::Text(text) => f.write_str(text),
        }
    }
}

impl From<bool> for Value {
    fn from(truth: bool) -> Self {
        Value::Bool(truth)
    }
}

impl From<u64> for Value {
    fn from(count: u64) -> Self {
        Value::Count(count)
    }
}

impl From<u32> for Value {
    fn from(count: u32) -> Self {
        Value::Count(count.into())
    }
}

impl From<usize> for Value {
    fn from(count: usize) -> Self {
        Value::Count(count as u64)
    }
}

/// NaN and infinite numbers become empty.
impl From<f64> for Value {
    fn from(number: f64) -> Self {
        if number.is_finite() { Value::Number(number) } else { Value::Empty }
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Value::Text(text.to_owned())
    }
}

impl From<String> for Value {
    fn from(text: String) -> Self {
        Value::Text(text)
    }
}

impl<T: Into<Value>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Self {
        value.map_or(Value::Empty, Into::into)
    }
}

/// Values by name, in the order of the columns.
pub type Cells = Vec<(String, Value)>;

/// Rows that share their columns.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<Value>>,
}

impl Table {
    /// A table without rows.
    pub fn new<S: Into<String>>(columns: impl IntoIterator<Item = S>) -> Self {
        Table { columns: columns.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// From rows of cells: the columns are those of all rows, in order of first occurrence.
    pub fn of_cells(rows: impl IntoIterator<Item = Cells>) -> Self {
        let mut table = Table::default();
        for cells in rows {
            let mut row = vec![Value::Empty; table.columns.len()];
            for (name, value) in cells {
                match table.column(&name) {
                    Some(column) => row[column] = value,
                    None => {
                        table.columns.push(name);
                        row.push(value);
                        table.rows.iter_mut().for_each(|row| row.push(Value::Empty));
                    }
                }
            }
            table.rows.push(row);
        }
        table
    }

    /// Adds a row.
    ///
    /// # Panics
    /// When the number of values differs from that of the columns, which is a bug of the caller.
    pub fn push(&mut self, row: Vec<Value>) {
        assert_eq!(row.len(), self.columns.len(), "a row has a value per column");
        self.rows.push(row);
    }

    /// Names of the columns.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Index of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column == name)
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The rows.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = Row<'_>> + Clone {
        self.rows.iter().map(|values| Row { columns: &self.columns, values })
    }

    /// Sorts rows by their columns, from the first on, so that their order does not depend on the order of
    /// insertion.
    pub fn sort(&mut self) {
        self.rows.sort_by(|a, b| {
            let mut orders = a.iter().zip(b).map(|(a, b)| a.order(b));
            orders.find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
        });
    }

    /// The table as CSV with a header.
    ///
    /// # Errors
    /// When memory is exhausted.
    pub fn to_csv(&self) -> anyhow::Result<Vec<u8>> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(&self.columns)?;
        for row in &self.rows {
            writer.write_record(row.iter().map(|value| match value {
                Value::Text(text) => as_cell(text).into_owned(),
                other => other.to_string(),
            }))?;
        }
        Ok(writer.into_inner()?)
    }
}

/// A row of a table.
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    columns: &'a [String],
    values: &'a [Value],
}

impl<'a> Row<'a> {
    /// The value of a column; empty where there is no such column.
    pub fn get(&self, name: &str) -> &'a Value {
        self.at(self.column(name))
    }

    /// Index of a column.
    pub(crate) fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column == name)
    }

    /// The value of a column by its index; empty where there is none.
    pub(crate) fn at(&self, column: Option<usize>) -> &'a Value {
        column.map_or(&Value::Empty, |column| &self.values[column])
    }

    /// The number of a column, if it has one.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.get(name).number()
    }

    /// The text of a column; "" where it has none.
    pub fn text(&self, name: &str) -> &'a str {
        self.get(name).text().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        Table::of_cells([
            vec![("map".to_owned(), "gbs".into()), ("d".to_owned(), 0.5.into())],
            vec![("map".to_owned(), "all".into()), ("run".to_owned(), 3u32.into())],
        ])
    }

    #[test]
    fn columns_are_those_of_all_rows() {
        let mut table = table();
        assert_eq!(table.columns(), ["map", "d", "run"]);
        table.sort();
        let rows: Vec<Row> = table.rows().collect();
        assert_eq!((rows[0].text("map"), rows[0].number("run")), ("all", Some(3.0)));
        assert_eq!((rows[1].number("d"), rows[1].get("run")), (Some(0.5), &Value::Empty));
        assert_eq!(rows[0].get("absent"), &Value::Empty);
        assert_eq!(
            String::from_utf8(table.to_csv().unwrap()).unwrap(),
            "map,d,run\nall,,3\ngbs,0.5,\n"
        );
    }

    #[test]
    fn numbers_survive_json_to_the_last_bit() {
        for number in [0.1 + 0.2, 1.0, 1e300, 5e-324, -0.0, std::f64::consts::PI] {
            let text = serde_json::to_string(&Value::Number(number)).unwrap();
            let back: Value = serde_json::from_str(&text).unwrap();
            assert_eq!(back.number().map(f64::to_bits), Some(number.to_bits()), "{text}");
        }
        for value in [Value::Empty, true.into(), u64::MAX.into(), "7".into()] {
            let text = serde_json::to_string(&value).unwrap();
            assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), value, "{text}");
        }
    }

    /// Field case: a log named =1+1.log gave cells that a spreadsheet evaluates.
    #[test]
    fn names_are_not_formulas() {
        let table = Table::of_cells([vec![
            ("dataset".to_owned(), "=1+1".into()),
            ("x".to_owned(), (-1.5).into()),
        ]]);
        assert_eq!(String::from_utf8(table.to_csv().unwrap()).unwrap(), "dataset,x\n'=1+1,-1.5\n");
    }
}
