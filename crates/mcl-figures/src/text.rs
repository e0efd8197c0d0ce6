//! The figures' font: styles, measuring and wrapping.

use std::sync::{Arc, LazyLock};

use plotters::style::{Color, FontDesc, FontFamily, FontStyle, TextStyle};
use plotters_backend::BackendTextStyle;
use resvg::usvg;
use svg::node::element::{SVG, Text};

use super::canvas::{svg_units, units};
use super::style::{CAPTION, INK};

/// Size of letters (SVG units).
pub(super) const TEXT: f64 = 12.0;
/// From line to line, in sizes.
pub(super) const LINE_HEIGHT: f64 = 1.35;

/// The font that the program carries, then what a viewer without it may use.
pub(super) const FONT_FAMILY: &str = "DejaVu Sans, Verdana, Helvetica, Arial, sans-serif";

static FONTS: LazyLock<Arc<usvg::fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.load_font_data(dejavu::sans::bold().to_vec());
    Arc::new(fonts)
});

pub(super) fn svg_options() -> usvg::Options<'static> {
    usvg::Options {
        fontdb: Arc::clone(&FONTS),
        font_family: "DejaVu Sans".to_owned(),
        ..usvg::Options::default()
    }
}

/// Labels and legends.
pub(super) fn plain() -> TextStyle<'static> {
    style(TEXT, FontStyle::Normal, &INK)
}

/// Titles of panels.
pub(super) fn title() -> TextStyle<'static> {
    style(TEXT + 1.0, FontStyle::Bold, &INK)
}

/// The text beneath a figure, and remarks in place of data.
pub(super) fn caption() -> TextStyle<'static> {
    style(TEXT, FontStyle::Normal, &CAPTION)
}

pub(super) fn style(size: f64, weight: FontStyle, color: &impl Color) -> TextStyle<'static> {
    // The page names the family.
    let font = FontDesc::new(FontFamily::SansSerif, f64::from(units(size)), weight);
    TextStyle { color: color.to_backend_color(), ..TextStyle::from(font) }
}

/// The text as SVG, without its place.
pub(super) fn text_node<S: BackendTextStyle>(text: &str, style: &S) -> Text {
    // XML allows neither control characters nor U+FFFE and U+FFFF.
    let forbidden = |c: char| c.is_control() || c == '\u{fffe}' || c == '\u{ffff}';
    let node =
        Text::new(text.replace(forbidden, "\u{fffd}")).set("font-size", svg_units(style.size()));
    match style.style() {
        FontStyle::Bold => node.set("font-weight", "bold"),
        _ => node,
    }
}

/// Width and height of a line of text (SVG units).
pub(super) fn text_size<S: BackendTextStyle>(text: &str, style: &S) -> [f64; 2] {
    let document = SVG::new()
        .set("width", 1)
        .set("height", 1)
        .set("font-family", FONT_FAMILY)
        .add(text_node(text, style));
    // A text that cannot be laid out (no letters of this font) takes no room.
    let width = usvg::Tree::from_str(&document.to_string(), &svg_options())
        .map_or(0.0, |tree| f64::from(tree.root().abs_bounding_box().right()).max(0.0));
    [width, svg_units(style.size())]
}

/// Breaks text into lines no wider than `width`, between words; a longer word stands alone.
pub(super) fn wrap(text: &str, style: &TextStyle, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        if let Some(line) = lines.last_mut() {
            let longer = format!("{line} {word}");
            if text_size(&longer, style)[0] <= width {
                *line = longer;
                continue;
            }
        }
        lines.push(word.to_owned());
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_grow_with_size_and_weight() {
        let width = |text, style: TextStyle| text_size(text, &style)[0];
        let large = style(24.0, FontStyle::Normal, &INK);
        let bold = style(12.0, FontStyle::Bold, &INK);
        let label = width("Intel Research Lab", plain());
        assert!((90.0..130.0).contains(&label), "{label}");
        let digit = width("8", plain());
        assert!((5.0..9.0).contains(&digit), "{digit}");
        assert!((width("Intel Research Lab", large) - 2.0 * label).abs() < 1.0);
        assert!(width("Intel Research Lab", bold) > label);
        assert_eq!(width("", plain()), 0.0);
    }

    #[test]
    fn wraps_between_words() {
        let text = "a caption that says which data set and which settings were used";
        let lines = wrap(text, &plain(), 150.0);
        assert!(lines.len() > 2);
        assert_eq!(lines.join(" "), text);
        assert!(lines.iter().all(|line| text_size(line, &plain())[0] <= 150.0));
        assert_eq!(wrap("unbreakable", &plain(), 5.0), ["unbreakable"]);
        assert!(wrap("  ", &plain(), 100.0).is_empty());
    }
}
