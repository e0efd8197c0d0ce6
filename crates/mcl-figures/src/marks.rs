//! Where the texts beside marked points stand: off the curves and off each other.

use plotters_backend::BackendCoord;

use crate::units::units;

/// Steps from a point to the texts around it, best first; y downwards.
const DIRECTIONS: [[i32; 2]; 8] =
    [[1, -1], [-1, -1], [1, 1], [-1, 1], [0, -1], [0, 1], [1, 0], [-1, 0]];

/// A box in plotters' units.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TextBox {
    pub(crate) left: i32,
    pub(crate) top: i32,
    pub(crate) right: i32,
    pub(crate) bottom: i32,
}

impl TextBox {
    fn holds(&self, (x, y): BackendCoord) -> bool {
        (self.left..=self.right).contains(&x) && (self.top..=self.bottom).contains(&y)
    }

    fn meets(&self, other: &TextBox) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }
}

/// What a chart already shows.
pub(crate) struct OccupiedAreas {
    window: TextBox,
    /// Places along lines and symbols.
    ink: Vec<BackendCoord>,
    texts: Vec<TextBox>,
}

impl OccupiedAreas {
    pub(crate) fn new(window: TextBox) -> Self {
        OccupiedAreas { window, ink: Vec::new(), texts: Vec::new() }
    }

    pub(crate) fn add_line(&mut self, from: BackendCoord, to: BackendCoord) {
        let (dx, dy) = (f64::from(to.0 - from.0), f64::from(to.1 - from.1));
        let steps = (dx.hypot(dy) / f64::from(units(2.0))).ceil().max(1.0);
        self.ink.extend((0..=steps as i32).map(|step| {
            let part = f64::from(step) / steps;
            (from.0 + (part * dx) as i32, from.1 + (part * dy) as i32)
        }));
    }

    pub(crate) fn add_symbol(&mut self, (x, y): BackendCoord) {
        let reach = [-1, 0, 1].map(|step| step * units(4.0));
        self.ink.extend(reach.iter().flat_map(|dx| reach.map(|dy| (x + dx, y + dy))));
    }

    /// Finds a place for a text beside a point, and takes it; `None` where it would stand over another text or beyond
    /// the edge.
    pub(crate) fn place(
        &mut self,
        at: BackendCoord,
        (width, height): (i32, i32),
    ) -> Option<TextBox> {
        const AVOID: usize = 1000;
        let candidates = [1, 2, 3].into_iter().flat_map(|ring| {
            DIRECTIONS.map(|[dx, dy]| {
                // Beside and above or beneath, a text may come closer.
                let gap = units(if dx != 0 && dy != 0 { 4.0 } else { 6.0 }) * ring;
                let x = at.0 + dx * (gap + width / 2);
                let y = at.1 + dy * (gap + height / 2);
                let (left, top) = (x - width / 2, y - height / 2);
                TextBox { left, top, right: left + width, bottom: top + height }
            })
        });
        let cost = |text: &TextBox| {
            let inside = self.window.holds((text.left, text.top))
                && self.window.holds((text.right, text.bottom));
            let met = self.texts.iter().filter(|other| text.meets(other)).count();
            let crossed = self.ink.iter().filter(|&&place| text.holds(place)).count();
            AVOID * (met + usize::from(!inside)) + crossed.min(AVOID - 1)
        };
        let best = candidates.min_by_key(cost).filter(|text| cost(text) < AVOID)?;
        self.texts.push(best);
        Some(best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: TextBox = TextBox { left: 0, top: 0, right: 50_000, bottom: 20_000 };
    const SIZE: (i32, i32) = (3000, 1000);

    #[test]
    fn a_text_stands_above_to_the_right_where_that_is_free() {
        let text = OccupiedAreas::new(WINDOW).place((20_000, 10_000), SIZE).unwrap();
        assert!(text.left > 20_000 && text.bottom < 10_000);
    }

    #[test]
    fn texts_keep_off_lines_each_other_and_the_edge() {
        let mut taken = OccupiedAreas::new(WINDOW);
        let points = [(300, 300), (300, 900), (700, 1500), (49_900, 10_000)];
        taken.add_line((20_000, 10_000), (30_000, 5000));
        taken.add_line((20_000, 10_000), (20_000, 12_000));
        let beside_line = taken.place((20_000, 10_000), SIZE).unwrap();
        assert!(taken.ink.iter().all(|&place| !beside_line.holds(place)));
        let mut texts = vec![beside_line];
        for point in points {
            taken.add_symbol(point);
            let text = taken.place(point, SIZE).unwrap();
            assert!(WINDOW.holds((text.left, text.top)), "{text:?}");
            assert!(WINDOW.holds((text.right, text.bottom)), "{text:?}");
            assert!(texts.iter().all(|other| !text.meets(other)), "{text:?} {texts:?}");
            texts.push(text);
        }
    }

    /// Fault: on small maps, where every run was lost, labels stood over each other.
    #[test]
    fn labels_without_room_are_left_out() {
        let mut taken = OccupiedAreas::new(WINDOW);
        let places: Vec<TextBox> =
            (0..100).filter_map(|_| taken.place((20_000, 10_000), SIZE)).collect();
        assert!((4..100).contains(&places.len()), "{}", places.len());
        for (place, text) in places.iter().enumerate() {
            assert!(places[..place].iter().all(|other| !text.meets(other)), "{text:?}");
        }
    }
}
