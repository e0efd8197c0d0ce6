//! Which curve is drawn how, by the labels of a figure's curves.

use std::collections::HashMap;

use crate::style::{CurveStyle, Dash, Marker, PALETTE};

/// The kinds of maps of the suite; together they have every marker.
const KNOWN: [(&str, usize, Marker); 6] = [
    ("rnd", 0, Marker::Circle),
    ("gbs", 1, Marker::Square),
    ("occupancy", 2, Marker::Pentagon),
    ("ndt", 3, Marker::TriangleUp),
    ("all", 5, Marker::TriangleDown),
    ("segments", 6, Marker::Diamond),
];

/// The style of each curve of a figure, by its label.
///
/// Labels that agree up to the first `+` are a family, with one marker and one colour. Its plain
/// curve ("gbs") is dashed if there are refined ones, the first refined one ("gbs+f-km") is solid.
/// Each further one ("gbs+best") has a colour of its own, and is dotted or dash-dotted. The suite's
/// kinds of maps have the same colours and markers in every figure, other families the first that
/// are left, in the order of `labels`. Equal labels have equal styles. There are seven colours and
/// six markers; beyond, they repeat.
pub fn styles<S: AsRef<str>>(labels: &[S]) -> Vec<CurveStyle> {
    let labels: Vec<&str> = labels.iter().map(AsRef::as_ref).collect();
    let known = KNOWN.iter().filter(|known| labels.iter().any(|label| family(label) == known.0));
    let (mut colors, mut markers) = (Vec::new(), Vec::new());
    let mut families = HashMap::new();
    for &(name, color, marker) in known {
        colors.push(color);
        markers.push(marker);
        families.insert(name, (color, marker));
    }
    for label in &labels {
        families.entry(family(label)).or_insert_with(|| {
            colors.push(free(0..PALETTE.len(), &colors));
            markers.push(free(KNOWN.iter().map(|known| known.2), &markers));
            (colors[colors.len() - 1], markers[markers.len() - 1])
        });
    }
    let mut styles: HashMap<&str, CurveStyle> = HashMap::new();
    for &label in &labels {
        let family_of = family(label);
        let refined = |other: &&str| family(other) == family_of && *other != family_of;
        let place = styles.keys().copied().filter(refined).count();
        styles.entry(label).or_insert_with(|| {
            let (mut color, marker) = families[family_of];
            let mut dash = Dash::Solid;
            if label == family_of && labels.iter().any(refined) {
                dash = Dash::Dashed;
            } else if label != family_of && place > 0 {
                color = free(0..PALETTE.len(), &colors);
                colors.push(color);
                dash = [Dash::Dotted, Dash::DashDot][place % 2];
            }
            CurveStyle { color, dash, marker: Some(marker) }
        });
    }
    labels.iter().map(|label| styles[label]).collect()
}

fn family(label: &str) -> &str {
    label.split_once('+').map_or(label, |(family, _)| family)
}

/// The first of `all` that is not taken; when none is left, they begin again.
fn free<T: PartialEq>(all: impl Iterator<Item = T> + Clone, taken: &[T]) -> T {
    let unused = all.clone().find(|one| !taken.contains(one));
    unused.or_else(|| all.cycle().nth(taken.len())).expect("there are colours and markers")
}

#[cfg(test)]
mod tests {
    use super::*;

    const CURVES: [&str; 10] =
        ["carmen", "gbs", "gbs+f-km", "gbs+best", "gbs+x", "rnd+f-km", "rnd", "ndt", "book", "a+b"];

    #[test]
    fn a_family_has_one_marker_and_distinguishable_refinements() {
        let [plain, refined, best] = styles(&["gbs", "gbs+f-km", "gbs+best"])[..] else { panic!() };
        let square = Some(Marker::Square);
        assert_eq!(plain, CurveStyle { color: 1, dash: Dash::Dashed, marker: square });
        assert_eq!(refined, CurveStyle { dash: Dash::Solid, ..plain });
        assert_eq!(best, CurveStyle { color: 0, dash: Dash::DashDot, marker: square });
        assert_eq!(styles(&["gbs"])[0].dash, Dash::Solid, "nothing to distinguish it from");
    }

    #[test]
    fn ten_curves_differ_in_colour_and_also_without() {
        let styles = styles(&CURVES);
        for (index, style) in styles.iter().enumerate() {
            for other in &styles[..index] {
                assert_ne!((style.dash, style.marker), (other.dash, other.marker), "{styles:?}");
            }
        }
    }

    #[test]
    fn known_kinds_of_maps_look_the_same_in_every_figure() {
        let all = styles(&CURVES);
        let some = styles(&["unknown", "ndt", "rnd+f-km", "unknown", "gbs+f-km"]);
        assert_eq!([some[1], some[2], some[4]], [all[7], all[5], all[2]]);
        assert_eq!(some[0], some[3]);
        assert_eq!(
            some[0],
            CurveStyle { color: 2, dash: Dash::Solid, marker: Some(Marker::Pentagon) }
        );
    }

    #[test]
    fn any_number_of_curves_of_any_labels_has_styles() {
        let odd: Vec<_> = (0..100).map(|i| format!("{}+{}", "+".repeat(i % 3), i / 3)).collect();
        assert_eq!(styles(&odd).len(), 100);
        let families: Vec<_> = (0..42).map(|i| i.to_string()).collect();
        let mut different = styles(&families);
        different.sort_by_key(|style| format!("{style:?}"));
        different.dedup();
        assert_eq!(different.len(), 42, "colours and markers repeat, but not together");
        assert!(styles::<&str>(&[]).is_empty());
    }
}
