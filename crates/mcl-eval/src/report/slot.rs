//! Slots on the page that another script fills: runs to watch and maps to compare.

use anyhow::Result;
use mcl_core::text::printable;
use serde::Serialize;

use crate::report::text::shown;

/// The kind of content of a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SlotKind {
    /// A run: `<div class="watch" data-run="ID"></div>`.
    Watch,
    /// Maps on top of each other: `<div class="compare-maps" data-maps="ID"></div>`.
    CompareMaps,
}

/// A slot in the section of a result folder. The page gives it an ID, and adds `<script
/// type="application/json" id="ID">` with its data; `watch.js` mounts every such element.
#[derive(Debug, Clone)]
pub struct Slot {
    /// Its kind.
    pub kind: SlotKind,
    /// Its heading.
    pub title: String,
    /// A text description for readers who cannot see it.
    pub text: String,
    /// Its data, safe within a script element.
    pub json: String,
}

impl Slot {
    /// A slot with its data.
    ///
    /// # Errors
    /// When the data cannot be written as JSON.
    pub fn new(kind: SlotKind, title: &str, text: &str, data: &impl Serialize) -> Result<Self> {
        let json = script_safe(&serde_json::to_string(data)?);
        Ok(Slot { kind, title: shown(title), text: printable(text).into_owned(), json })
    }

    /// Name of the element's class.
    pub fn class(&self) -> &'static str {
        match self.kind {
            SlotKind::Watch => "watch",
            SlotKind::CompareMaps => "compare-maps",
        }
    }

    /// The attribute that names its data.
    pub fn attribute(&self) -> &'static str {
        match self.kind {
            SlotKind::Watch => "data-run",
            SlotKind::CompareMaps => "data-maps",
        }
    }
}

/// JSON that cannot end a script element or begin a comment in it: in JSON, `<` occurs in strings only.
pub fn script_safe(json: &str) -> String {
    json.replace('<', r"\u003c")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_does_not_close_its_element() {
        let slot = Slot::new(SlotKind::Watch, "", "", &["</script><!--"]).unwrap();
        assert!(!slot.json.contains('<'), "{}", slot.json);
        assert_eq!(serde_json::from_str::<[String; 1]>(&slot.json).unwrap(), ["</script><!--"]);
    }
}
