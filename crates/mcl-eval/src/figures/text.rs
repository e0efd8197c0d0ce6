//! The figures' font: measuring and wrapping text.

use std::sync::{Arc, LazyLock};

use resvg::usvg;

use super::canvas::{Anchor, Canvas, Text};

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

/// Width of a line of text (SVG units).
pub(super) fn text_width(text: &str, size: f64, bold: bool) -> f64 {
    let mut canvas = Canvas::new();
    canvas.text(text, [0.0, 0.0], Text { size, bold, anchor: Anchor::Start, ..Text::default() });
    // A text that cannot be laid out (no letters of this font) takes no room.
    usvg::Tree::from_str(&canvas.into_svg(100.0, 100.0), &svg_options())
        .map_or(0.0, |tree| f64::from(tree.root().abs_bounding_box().right()).max(0.0))
}

/// Breaks text into lines no wider than `width`, between words; a longer word stands alone.
pub(super) fn wrap(text: &str, size: f64, bold: bool, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        if let Some(line) = lines.last_mut() {
            let longer = format!("{line} {word}");
            if text_width(&longer, size, bold) <= width {
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
        let width = text_width("Intel Research Lab", 12.0, false);
        assert!((90.0..130.0).contains(&width), "{width}");
        let digit = text_width("8", 12.0, false);
        assert!((5.0..9.0).contains(&digit), "{digit}");
        assert!((text_width("Intel Research Lab", 24.0, false) - 2.0 * width).abs() < 1.0);
        assert!(text_width("Intel Research Lab", 12.0, true) > width);
        assert_eq!(text_width("", 12.0, false), 0.0);
    }

    #[test]
    fn wraps_between_words() {
        let text = "a caption that says which data set and which settings were used";
        let lines = wrap(text, 12.0, false, 150.0);
        assert!(lines.len() > 2);
        assert_eq!(lines.join(" "), text);
        assert!(lines.iter().all(|line| text_width(line, 12.0, false) <= 150.0));
        assert_eq!(wrap("unbreakable", 12.0, false, 5.0), ["unbreakable"]);
        assert!(wrap("  ", 12.0, false, 100.0).is_empty());
    }
}
