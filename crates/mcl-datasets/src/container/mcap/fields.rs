//! Little-endian fields of an MCAP record, read in order.
//!
//! The `mcap` crate's own parser reserves memory by a string's length field before it checks that these bytes
//! exist; this one never allocates more than the record holds.

use crate::container::problem::BadRecord;

/// The fields of one record.
pub(super) struct BinaryFields<'a> {
    record: &'static str,
    rest: &'a [u8],
}

impl<'a> BinaryFields<'a> {
    pub fn new(record: &'static str, body: &'a [u8]) -> Self {
        BinaryFields { record, rest: body }
    }

    fn bad(&self, field: &'static str, found: &'static str) -> BadRecord {
        BadRecord { record: self.record, field, found }
    }

    pub fn bytes(&mut self, field: &'static str, length: usize) -> Result<&'a [u8], BadRecord> {
        match self.rest.split_at_checked(length) {
            Some((head, rest)) => {
                self.rest = rest;
                Ok(head)
            }
            None => Err(self.bad(field, "longer than the record")),
        }
    }

    fn array<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], BadRecord> {
        match self.rest.split_first_chunk::<N>() {
            Some((head, rest)) => {
                self.rest = rest;
                Ok(*head)
            }
            None => Err(self.bad(field, "missing: the record is too short")),
        }
    }

    pub fn u16(&mut self, field: &'static str) -> Result<u16, BadRecord> {
        self.array(field).map(u16::from_le_bytes)
    }

    pub fn u32(&mut self, field: &'static str) -> Result<u32, BadRecord> {
        self.array(field).map(u32::from_le_bytes)
    }

    pub fn u64(&mut self, field: &'static str) -> Result<u64, BadRecord> {
        self.array(field).map(u64::from_le_bytes)
    }

    /// Bytes after their length, a `u32`.
    pub fn blob(&mut self, field: &'static str) -> Result<&'a [u8], BadRecord> {
        let length = self.u32(field)?;
        self.bytes(field, length as usize)
    }

    /// A UTF-8 string after its length, a `u32`.
    pub fn text(&mut self, field: &'static str) -> Result<&'a str, BadRecord> {
        let bytes = self.blob(field)?;
        std::str::from_utf8(bytes).map_err(|_| self.bad(field, "not UTF-8"))
    }

    /// Pairs of strings after the length of all of them in bytes, a `u32`.
    pub fn map(&mut self, field: &'static str) -> Result<Vec<(&'a str, &'a str)>, BadRecord> {
        let mut inner = BinaryFields { record: self.record, rest: self.blob(field)? };
        let mut pairs = Vec::new();
        while !inner.rest.is_empty() {
            pairs.push((inner.text(field)?, inner.text(field)?));
        }
        Ok(pairs)
    }

    /// What is left.
    pub fn rest(self) -> &'a [u8] {
        self.rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_field_reaches_beyond_its_record() {
        let huge = [0xff, 0xff, 0xff, 0xff, b'a'];
        assert_eq!(BinaryFields::new("Schema", &huge).text("name").unwrap_err().field, "name");
        assert!(BinaryFields::new("Channel", &huge).map("metadata").is_err());
        assert!(BinaryFields::new("Schema", &[1]).u16("id").is_err());
        let mut fields = BinaryFields::new("Schema", &[7, 0, 2, 0, 0, 0, b'o', b'k', 9]);
        assert_eq!(fields.u16("id"), Ok(7));
        assert_eq!(fields.text("name"), Ok("ok"));
        assert_eq!(fields.rest(), [9]);
    }
}
