//! The page that plotters draws on; it becomes an SVG document.
//!
//! plotters' own SVG backend rounds to whole pixels, guesses the width of text and knows no dashes.
//! This one counts in hundredths of an SVG unit and measures text with the font it is drawn in.

use std::ops::Range;

use base64::Engine;
use plotters::style::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
    FontTransform,
};
use resvg::tiny_skia::Pixmap;
use svg::node::element::{
    Circle, ClipPath, Definitions, Group, Image, Polygon, Polyline, Rectangle,
};
use svg::{Document, Node};

use crate::text::{FONT_FAMILY, text_node, text_size};
use crate::units::{PIXELS_PER_UNIT, svg_units, units};

/// Height of the page while it is drawn; in the end it is cut where the drawing ends.
const ENDLESS: f64 = 1e6;

/// Why something could not be put on the page.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct CanvasError(pub(crate) String);

type Drawn = Result<(), DrawingErrorKind<CanvasError>>;

pub(crate) struct Canvas {
    /// Width of the page (SVG units).
    width: f64,
    content: Group,
    /// What is being drawn inside of a clipping box.
    clipped: Option<Group>,
    clips: usize,
    /// Lengths of dashes and gaps (SVG units) of the lines that follow; plotters' styles have none.
    pub(crate) dashes: &'static [f32],
}

impl Canvas {
    /// An empty page of this width (SVG units).
    pub(crate) fn new(width: f64) -> Self {
        let content = Group::default();
        Canvas { width, content, clipped: None, clips: 0, dashes: &[] }
    }

    /// The finished document, on white paper.
    pub(crate) fn into_svg(self, height: f64) -> String {
        let width = self.width;
        let height = height.ceil();
        let paper = Rectangle::new().set("width", width).set("height", height).set("fill", "white");
        let document = Document::new()
            .set("width", width)
            .set("height", height)
            .set("viewBox", format!("0 0 {width} {height}"))
            .set("font-family", FONT_FAMILY)
            .add(paper)
            .add(self.content);
        format!("{document}\n")
    }

    /// From here to [`Canvas::unclip`], only what lies in this box is seen.
    pub(crate) fn clip(&mut self, (x, y): (Range<i32>, Range<i32>)) {
        self.unclip();
        self.clips += 1;
        let id = format!("window{}", self.clips);
        let clip = ClipPath::new()
            .set("id", id.as_str())
            .add(rectangle((x.start, y.start), (x.end, y.end)));
        self.content.append(Definitions::new().add(clip));
        self.clipped = Some(Group::new().set("clip-path", format!("url(#{id})")));
    }

    pub(crate) fn unclip(&mut self) {
        if let Some(clipped) = self.clipped.take() {
            self.content.append(clipped);
        }
    }

    fn append(&mut self, node: impl Node) {
        self.clipped.as_mut().unwrap_or(&mut self.content).append(node);
    }

    /// Draws a shape's outline, or fills it.
    fn shape<S: BackendStyle>(&mut self, mut shape: impl Node, style: &S, fill: bool) {
        let color = style.color();
        if color.alpha <= 0.0 {
            return;
        }
        let paint = if fill { "fill" } else { "stroke" };
        if !fill {
            shape.assign("fill", "none");
            shape.assign("stroke-width", svg_units(style.stroke_width()));
            shape.assign("stroke-linejoin", "round");
            if !self.dashes.is_empty() {
                let dashes: Vec<_> = self.dashes.iter().map(f32::to_string).collect();
                shape.assign("stroke-dasharray", dashes.join(" "));
            }
        }
        shape.assign(paint, hex(color));
        if color.alpha < 1.0 {
            shape.assign(format!("{paint}-opacity"), color.alpha);
        }
        self.append(shape);
    }
}

impl DrawingBackend for Canvas {
    type ErrorType = CanvasError;

    fn get_size(&self) -> (u32, u32) {
        (units(self.width).unsigned_abs(), units(ENDLESS).unsigned_abs())
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, at: BackendCoord, color: BackendColor) -> Drawn {
        self.draw_rect(at, (at.0 + 1, at.1 + 1), &color, true)
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Drawn {
        self.draw_path([from, to], style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn {
        self.shape(rectangle(upper_left, bottom_right), style, fill);
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        self.shape(Polyline::new().set("points", joined(path)), style, false);
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        center: BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Drawn {
        let circle = Circle::new()
            .set("cx", svg_units(center.0))
            .set("cy", svg_units(center.1))
            .set("r", svg_units(radius));
        self.shape(circle, style, fill);
        Ok(())
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        self.shape(Polygon::new().set("points", joined(corners)), style, true);
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn {
        if text.is_empty() {
            return Ok(());
        }
        // From the anchor to the baseline, by the heights of the font's letters.
        let size = svg_units(style.size());
        let down = match style.anchor().v_pos {
            VPos::Top => 0.76,
            VPos::Center => 0.36,
            VPos::Bottom => -0.24,
        };
        let (x, y) = (svg_units(at.0), svg_units(at.1));
        let mut node = text_node(text, style)
            .set("x", x)
            .set("y", svg_units(units(y + down * size)))
            .set("fill", hex(style.color()));
        match style.anchor().h_pos {
            HPos::Left => {}
            HPos::Center => node.assign("text-anchor", "middle"),
            HPos::Right => node.assign("text-anchor", "end"),
        }
        let turn = match style.transform() {
            FontTransform::None => 0,
            FontTransform::Rotate90 => 90,
            FontTransform::Rotate180 => 180,
            FontTransform::Rotate270 => 270,
        };
        if turn != 0 {
            node.assign("transform", format!("rotate({turn} {x} {y})"));
        }
        self.append(node);
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<CanvasError>> {
        Ok(text_size(text, style).map(|length| units(length).unsigned_abs()).into())
    }

    /// Embeds a picture of RGB pixels as a PNG; they are those of the rendered figure.
    fn blit_bitmap(&mut self, at: BackendCoord, (width, height): (u32, u32), rgb: &[u8]) -> Drawn {
        let failed = |reason: &str| DrawingErrorKind::DrawingError(CanvasError(reason.to_owned()));
        let mut picture = Pixmap::new(width, height).ok_or_else(|| failed("a picture's size"))?;
        for (to, from) in picture.data_mut().chunks_exact_mut(4).zip(rgb.chunks_exact(3)) {
            to[..3].copy_from_slice(from);
            to[3] = u8::MAX;
        }
        let png = picture.encode_png().map_err(|error| failed(&error.to_string()))?;
        let data = base64::engine::general_purpose::STANDARD.encode(png);
        let length = |pixels: u32| svg_units(units(f64::from(pixels) / f64::from(PIXELS_PER_UNIT)));
        let image = Image::new()
            .set("x", svg_units(at.0))
            .set("y", svg_units(at.1))
            .set("width", length(width))
            .set("height", length(height))
            .set("href", format!("data:image/png;base64,{data}"));
        self.append(image);
        Ok(())
    }
}

fn rectangle(upper_left: BackendCoord, bottom_right: BackendCoord) -> Rectangle {
    Rectangle::new()
        .set("x", svg_units(upper_left.0))
        .set("y", svg_units(upper_left.1))
        .set("width", svg_units(bottom_right.0 - upper_left.0))
        .set("height", svg_units(bottom_right.1 - upper_left.1))
}

fn joined(points: impl IntoIterator<Item = BackendCoord>) -> String {
    let points: Vec<_> =
        points.into_iter().map(|(x, y)| format!("{},{}", svg_units(x), svg_units(y))).collect();
    points.join(" ")
}

fn hex(color: BackendColor) -> String {
    let (red, green, blue) = color.rgb;
    format!("#{red:02X}{green:02X}{blue:02X}")
}
