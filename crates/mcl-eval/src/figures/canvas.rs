//! The few SVG shapes that figures are made of.

use base64::Engine;
use svg::node::element::{
    ClipPath, Definitions, Group, Image, Line, Path as Shape, Polyline, Rectangle,
    Text as TextElement,
};
use svg::{Document, Node};

use super::text::FONT_FAMILY;

/// A position in SVG units, y downwards.
pub(super) type Position = [f64; 2];

/// A box in SVG units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rect {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Rect {
    pub(super) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stroke<'a> {
    pub(super) color: &'a str,
    pub(super) width: f64,
    /// Lengths of dashes and gaps; empty for a solid line.
    pub(super) dashes: &'a [f32],
}

/// Which part of a text stands at its position.
#[derive(Debug, Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// How a text is drawn; its position is on the baseline.
#[derive(Debug, Clone, Copy)]
pub(super) struct Text<'a> {
    pub(super) size: f64,
    pub(super) bold: bool,
    pub(super) anchor: Anchor,
    pub(super) color: &'a str,
    /// Turned to read upwards.
    pub(super) upwards: bool,
    /// With a white rim, to stay legible over lines.
    pub(super) rim: bool,
}

impl Default for Text<'_> {
    fn default() -> Self {
        Text {
            size: 12.0,
            bold: false,
            anchor: Anchor::Start,
            color: "#222222",
            upwards: false,
            rim: false,
        }
    }
}

/// Hundredths are plenty, and keep files small.
fn rounded(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}

pub(super) struct Canvas {
    content: Group,
    clips: usize,
}

impl Canvas {
    pub(super) fn new() -> Self {
        Canvas { content: Group::new(), clips: 0 }
    }

    /// The finished document, on white paper.
    pub(super) fn into_page(mut self, width: f64, height: f64) -> String {
        let (width, height) = (width.ceil(), height.ceil());
        let paper = Rectangle::new().set("width", width).set("height", height).set("fill", "white");
        let drawn = std::mem::take(&mut self.content);
        self.content.append(paper);
        self.content.append(drawn);
        self.into_svg(width, height)
    }

    /// The document without paper.
    pub(super) fn into_svg(self, width: f64, height: f64) -> String {
        let document = Document::new()
            .set("width", width)
            .set("height", height)
            .set("viewBox", format!("0 0 {width} {height}"))
            .set("font-family", FONT_FAMILY)
            .add(self.content);
        format!("{document}\n")
    }

    pub(super) fn line(&mut self, from: Position, to: Position, stroke: Stroke) {
        let line = Line::new()
            .set("x1", rounded(from[0]))
            .set("y1", rounded(from[1]))
            .set("x2", rounded(to[0]))
            .set("y2", rounded(to[1]));
        self.content.append(stroked(line, stroke));
    }

    pub(super) fn polyline(&mut self, points: &[Position], stroke: Stroke) {
        let line = Polyline::new()
            .set("points", joined(points))
            .set("fill", "none")
            .set("stroke-linejoin", "round");
        self.content.append(stroked(line, stroke));
    }

    /// A filled area without outline.
    pub(super) fn area(&mut self, corners: &[Position], color: &str, opacity: f64) {
        let area = svg::node::element::Polygon::new()
            .set("points", joined(corners))
            .set("fill", color)
            .set("fill-opacity", opacity);
        self.content.append(area);
    }

    /// A closed shape given as SVG path data around the origin.
    pub(super) fn symbol(&mut self, data: &str, at: Position, fill: &str, stroke: Stroke) {
        let shape = Shape::new()
            .set("d", data)
            .set("transform", format!("translate({} {})", rounded(at[0]), rounded(at[1])))
            .set("fill", fill);
        self.content.append(stroked(shape, stroke));
    }

    pub(super) fn text(&mut self, text: &str, at: Position, style: Text) {
        // XML allows neither control characters nor U+FFFE and U+FFFF.
        let forbidden = |c: char| c.is_control() || c == '\u{fffe}' || c == '\u{ffff}';
        let text = text.replace(forbidden, "\u{fffd}");
        let (x, y) = (rounded(at[0]), rounded(at[1]));
        let mut element = TextElement::new(text)
            .set("x", x)
            .set("y", y)
            .set("font-size", style.size)
            .set("fill", style.color);
        match style.anchor {
            Anchor::Start => {}
            Anchor::Middle => element.assign("text-anchor", "middle"),
            Anchor::End => element.assign("text-anchor", "end"),
        }
        if style.bold {
            element.assign("font-weight", "bold");
        }
        if style.upwards {
            element.assign("transform", format!("rotate(-90 {x} {y})"));
        }
        if style.rim {
            element.assign("stroke", "white");
            element.assign("stroke-width", 3);
            element.assign("stroke-linejoin", "round");
            element.assign("paint-order", "stroke");
        }
        self.content.append(element);
    }

    /// A PNG, embedded.
    pub(super) fn picture(&mut self, png: &[u8], at: Rect) {
        let data = base64::engine::general_purpose::STANDARD.encode(png);
        let image = Image::new()
            .set("x", rounded(at.left))
            .set("y", rounded(at.top))
            .set("width", rounded(at.width))
            .set("height", rounded(at.height))
            .set("href", format!("data:image/png;base64,{data}"));
        self.content.append(image);
    }

    /// Draws something of which only the part inside `window` is seen.
    pub(super) fn clipped(&mut self, window: Rect, draw: impl FnOnce(&mut Canvas)) {
        self.clips += 1;
        let id = format!("window{}", self.clips);
        let rectangle = Rectangle::new()
            .set("x", rounded(window.left))
            .set("y", rounded(window.top))
            .set("width", rounded(window.width))
            .set("height", rounded(window.height));
        let clip = ClipPath::new().set("id", id.as_str()).add(rectangle);
        self.content.append(Definitions::new().add(clip));
        let mut inside = Canvas::new();
        draw(&mut inside);
        self.content.append(inside.content.set("clip-path", format!("url(#{id})")));
    }
}

fn joined(points: &[Position]) -> String {
    let points: Vec<_> =
        points.iter().map(|&[x, y]| format!("{},{}", rounded(x), rounded(y))).collect();
    points.join(" ")
}

fn stroked<N: Node>(mut node: N, stroke: Stroke) -> N {
    node.assign("stroke", stroke.color);
    node.assign("stroke-width", stroke.width);
    if !stroke.dashes.is_empty() {
        let dashes: Vec<_> = stroke.dashes.iter().map(f32::to_string).collect();
        node.assign("stroke-dasharray", dashes.join(" "));
    }
    node
}
