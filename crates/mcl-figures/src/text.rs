//! The figures' font: styles, measuring and wrapping.

use std::borrow::Cow;
use std::sync::{Arc, LazyLock};

use mcl_core::text::printable;
use plotters::style::{Color, FontDesc, FontFamily, FontStyle, TextStyle};
use plotters_backend::BackendTextStyle;
use resvg::usvg;
use svg::node::element::{SVG, Text};

use crate::style::{CAPTION, INK};
use crate::units::{svg_units, units};

/// Size of letters (SVG units).
pub(crate) const TEXT: f64 = 12.0;
/// From line to line, in sizes.
pub(crate) const LINE_HEIGHT: f64 = 1.35;

/// The font that the program carries, then what a viewer without it may use.
pub(crate) const FONT_FAMILY: &str = "DejaVu Sans, Verdana, Helvetica, Arial, sans-serif";

/// The faces that figures use.
pub(crate) const FONTS: [fn() -> &'static [u8]; 2] = [dejavu::sans::regular, dejavu::sans::bold];

static DATABASE: LazyLock<Arc<usvg::fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = usvg::fontdb::Database::new();
    // As it lies in the program: a copy is a megabyte and a half.
    FONTS.iter().for_each(|font| {
        fonts.load_font_source(usvg::fontdb::Source::Binary(Arc::new(font())));
    });
    Arc::new(fonts)
});

pub(crate) fn svg_options() -> usvg::Options<'static> {
    usvg::Options {
        fontdb: Arc::clone(&DATABASE),
        font_family: "DejaVu Sans".to_owned(),
        ..usvg::Options::default()
    }
}

/// Labels and legends.
pub(crate) fn plain() -> TextStyle<'static> {
    style(TEXT, FontStyle::Normal, &INK)
}

/// Titles of panels.
pub(crate) fn title() -> TextStyle<'static> {
    style(TEXT + 1.0, FontStyle::Bold, &INK)
}

/// The text beneath a figure, and remarks in place of data.
pub(crate) fn caption() -> TextStyle<'static> {
    style(TEXT, FontStyle::Normal, &CAPTION)
}

pub(crate) fn style(size: f64, weight: FontStyle, color: &impl Color) -> TextStyle<'static> {
    // The page names the family.
    let font = FontDesc::new(FontFamily::SansSerif, f64::from(units(size)), weight);
    TextStyle { color: color.to_backend_color(), ..TextStyle::from(font) }
}

/// The text as SVG, without its place; text of any kind is safe here.
pub(crate) fn text_node<S: BackendTextStyle>(text: &str, style: &S) -> Text {
    let node = Text::new(printable(text)).set("font-size", svg_units(style.size()));
    match style.style() {
        FontStyle::Bold => node.set("font-weight", "bold"),
        _ => node,
    }
}

/// Width and height of a line of text (SVG units).
pub(crate) fn text_size<S: BackendTextStyle>(text: &str, style: &S) -> [f64; 2] {
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

/// The text, with "…" in place of its middle where it is wider than `width` (SVG units): values and units stand at the
/// end.
pub(crate) fn fitted<'a>(text: &'a str, style: &impl BackendTextStyle, width: f64) -> Cow<'a, str> {
    /// No line of a page holds more letters.
    const MOST: usize = 300;
    let places =
        |of: &mut dyn Iterator<Item = (usize, char)>| of.map(|(at, _)| at).take(MOST + 1).collect();
    let starts: Vec<usize> = places(&mut text.char_indices());
    if starts.len() <= MOST && text_size(text, style)[0] <= width {
        return Cow::Borrowed(text);
    }
    let from_end: Vec<usize> = places(&mut text.char_indices().rev());
    // So many characters, a third of them from the end.
    let cut = |kept: usize| {
        let tail = if kept < 3 { text.len() } else { from_end[kept / 3 - 1] };
        let head = starts.get(kept - kept / 3).copied().unwrap_or_default();
        format!("{}…{}", &text[..head], &text[tail..])
    };
    let kept: Vec<usize> = (0..starts.len()).collect();
    let fits = kept.partition_point(|&kept| kept == 0 || text_size(&cut(kept), style)[0] <= width);
    Cow::Owned(cut(fits.saturating_sub(1)))
}

/// Breaks text into lines no wider than `width`, between words; a longer word stands alone, and is cut.
pub(crate) fn wrap(text: &str, style: &TextStyle, width: f64) -> Vec<String> {
    // A number and its percent sign are one word.
    const GLUE: char = '\u{a0}';
    let text = text.replace(" %", &format!("{GLUE}%"));
    let words = text.split(|c: char| c.is_whitespace() && c != GLUE).filter(|w| !w.is_empty());
    let mut lines: Vec<String> = Vec::new();
    for word in words {
        let word = fitted(word, style, width);
        if let Some(line) = lines.last_mut() {
            let longer = format!("{line} {word}");
            if text_size(&longer, style)[0] <= width {
                *line = longer;
                continue;
            }
        }
        lines.push(word.into_owned());
    }
    lines.iter_mut().for_each(|line| *line = line.replace(GLUE, " "));
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

    /// A name of 10,000 letters ran far beyond the page, over whatever stood beside it.
    #[test]
    fn long_text_is_cut() {
        let endless = "m".repeat(10_000);
        for text in [endless.as_str(), "a much longer label", &"\u{301}".repeat(9999)] {
            let cut = fitted(text, &plain(), 60.0);
            let (head, tail) = cut.split_once('…').expect("a sign that it was cut");
            assert!(text.starts_with(head) && text.ends_with(tail), "{cut}");
            let (width, letter) = (text_size(&cut, &plain())[0], text_size("m", &plain())[0]);
            assert!((0.0..=60.0).contains(&width), "{cut}");
            assert!(cut.len() > 300 || width + letter > 60.0, "{cut} had room for one more");
        }
        for text in ["", "short"] {
            assert!(matches!(fitted(text, &plain(), 60.0), Cow::Borrowed(same) if same == text));
        }
        let curves = ["z_rand = 0.8, outlier fraction = 0.9", "z_rand = 0.8, outlier fraction = 1"];
        let [a, b] = curves.map(|text| fitted(text, &plain(), 120.0));
        assert!(a != b && a.ends_with("= 0.9"), "{a} {b}");
        assert_eq!(fitted("none", &plain(), -1.0), "…");
        assert_eq!(fitted("", &plain(), -1.0), "…");
    }

    #[test]
    fn wraps_between_words() {
        let text = "a caption that says which data set and which settings were used";
        let lines = wrap(text, &plain(), 150.0);
        assert!(lines.len() > 2);
        assert_eq!(lines.join(" "), text);
        assert!(lines.iter().all(|line| text_size(line, &plain())[0] <= 150.0));
        assert_eq!(wrap("an unbreakable one", &plain(), 50.0), ["an", "unbr…e", "one"]);
        assert_eq!(wrap("unbreakable", &plain(), 0.0), ["…"]);
        assert!(wrap("  ", &plain(), 100.0).is_empty());
        assert_eq!(wrap("585 points (0.80 %)", &plain(), 95.0), ["585 points", "(0.80 %)"]);
    }
}
