//! From values to positions along an axis, and where its ticks stand.
//!
//! One type is the coordinate of every axis, because the scale of an axis is a setting. plotters has no
//! symlog scale, and its ticks on a logarithmic one are powers of ten, however short the axis.

use std::ops::Range;

use plotters::coord::ranged1d::{
    KeyPointHint, KeyPointWeight, NoDefaultFormatting, Ranged, ValueFormatter,
};

/// How values are laid out along an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// Evenly, with ticks at whole numbers only: places in a list.
    Places,
    /// By decimal logarithm; values that are not positive are left out.
    Log,
    /// By logarithm in both directions, and evenly around 0: arsinh(v / (2·`linear_below`)).
    Symlog {
        /// Magnitude up to which the scale is about linear; at least 10⁻⁹.
        linear_below: f64,
    },
}

impl Scale {
    /// Whether a value has a place on this scale.
    pub(crate) fn holds(self, value: f64) -> bool {
        value.abs() < LARGEST && (self != Scale::Log || value > 0.0)
    }

    fn apply(self, value: f64) -> f64 {
        match self {
            Scale::Linear | Scale::Places => value,
            Scale::Log => value.log10(),
            Scale::Symlog { linear_below } => {
                (value / (2.0 * linear_part(linear_below))).asinh() / std::f64::consts::LN_10
            }
        }
    }
}

/// The linear part of a symlog scale, in the range of numbers that can be drawn.
fn linear_part(linear_below: f64) -> f64 {
    linear_below.clamp(1e-9, LARGEST)
}

/// Far beyond any measurement, sums and ratios overflow.
const LARGEST: f64 = 1e200;

/// Most ticks on a linear axis.
const MOST_TICKS: usize = 8;
/// Powers of ten from one tick to the next, where not each has one.
const STRIDES: [i32; 6] = [2, 5, 10, 20, 50, 100];

/// A labelled tick.
#[derive(Debug, Clone, PartialEq)]
struct Tick {
    value: f64,
    label: String,
}

/// An axis with room for given values.
#[derive(Debug, Clone)]
pub(crate) struct Axis {
    scale: Scale,
    /// The ends, on the scale.
    low: f64,
    high: f64,
    ticks: Vec<Tick>,
    /// Values with a faint grid line and no label.
    minor: Vec<f64>,
}

impl Axis {
    /// An axis from `range[0]` to `range[1]`, without ticks.
    pub(crate) fn over(range: [f64; 2], scale: Scale) -> Self {
        let [low, high] = range.map(|end| scale.apply(end));
        Axis::between(low.min(high), low.max(high), scale)
    }

    /// An axis with some room around the smallest and largest of `values`, all of which the scale
    /// holds, without ticks; `None` without values.
    pub(crate) fn around(values: impl Iterator<Item = f64>, scale: Scale) -> Option<Self> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values {
            low = low.min(value);
            high = high.max(value);
        }
        if low > high {
            return None;
        }
        let never_negative = low >= 0.0 && scale == Scale::Linear;
        let [mut low, mut high] = [low, high].map(|end| scale.apply(end));
        let room = 0.05 * (high - low);
        low -= room;
        high += room;
        if never_negative {
            low = low.max(0.0);
        }
        Some(Axis::between(low, high, scale))
    }

    fn between(mut low: f64, mut high: f64, scale: Scale) -> Self {
        // Equal values, or so close that labels could not tell them apart.
        let largest = low.abs().max(high.abs());
        if high - low <= 1e-9 * largest || high - low < 1e-200 {
            let room = if scale == Scale::Linear && largest > 1e-200 { 0.1 * largest } else { 0.5 };
            low -= room;
            high += room;
        }
        Axis { scale, low, high, ticks: Vec::new(), minor: Vec::new() }
    }

    /// Puts a name at each of the places 0, 1, ….
    pub(crate) fn with_names(mut self, names: impl Iterator<Item = String>) -> Self {
        let tick = |(place, label)| Tick { value: place as f64, label };
        self.ticks = names.enumerate().map(tick).collect();
        self
    }

    /// Puts as many ticks on the axis as a `length` has room for; `extent` is the length that a
    /// label takes up, with its distance to the next.
    pub(crate) fn with_ticks(mut self, length: f64, extent: impl Fn(&str) -> f64) -> Self {
        let fits = |ticks: &Vec<Tick>| {
            let apart = |pair: &[Tick]| {
                let [from, to] = [&pair[0], &pair[1]].map(|tick| self.fraction(tick.value));
                (to - from) * length >= 0.5 * (extent(&pair[0].label) + extent(&pair[1].label))
            };
            ticks.len() > 1 && ticks.windows(2).all(apart)
        };
        let fullest = |candidates: Vec<Vec<Tick>>| {
            candidates.into_iter().filter(fits).max_by_key(|ticks| ticks.len())
        };
        // Of an axis too short for two labels, the first.
        let one = || self.linear().pop().map(|ticks| ticks.into_iter().take(1).collect());
        // Two ticks do not say how an axis goes on between them.
        let (round, linear) = (fullest(self.round()), fullest(self.linear()));
        let number = |ticks: &Option<Vec<Tick>>| ticks.as_ref().map_or(0, Vec::len);
        let is_enough = number(&round) > 2 || number(&round) >= number(&linear);
        let ticks = if is_enough { round } else { linear };
        self.ticks = ticks.or_else(one).unwrap_or_default();
        if self.scale == Scale::Log && self.high - self.low <= 5.0 {
            let minor = self.decimals(&[2, 3, 4, 5, 6, 7, 8, 9], 1, self.low.floor() as i32);
            self.minor = minor.into_iter().filter(|&value| self.contains(value)).collect();
        }
        self
    }

    /// Keeps the ticks, but not their labels.
    pub(crate) fn without_labels(mut self) -> Self {
        self.ticks.iter_mut().for_each(|tick| tick.label.clear());
        self
    }

    pub(crate) fn labels(&self) -> impl Iterator<Item = &str> {
        self.ticks.iter().map(|tick| tick.label.as_str())
    }

    /// Ticks at round numbers of every or some powers of ten; at every or some places.
    fn round(&self) -> Vec<Vec<Tick>> {
        let sets: [(&[i32], i32); 3] = [(&[1, 2, 3, 4, 5, 6, 8], 1), (&[1, 2, 5], 1), (&[1], 1)];
        let sets = sets.into_iter().chain(STRIDES.map(|stride| (&[1][..], stride)));
        let lowest = self.low.floor() as i32;
        match self.scale {
            Scale::Linear => Vec::new(),
            Scale::Places => [1, 2, 5, 10, 20, 50, 100]
                .map(|stride| {
                    let places = self.low.ceil() as i64..=self.high.floor() as i64;
                    self.ticks(
                        places.step_by(stride).take(1000).map(|place| place as f64).collect(),
                    )
                })
                .to_vec(),
            Scale::Log => sets
                .map(|(steps, stride)| self.ticks(self.decimals(steps, stride, lowest)))
                .collect(),
            Scale::Symlog { linear_below } => {
                // The numbers next to 0 crowd it on a short axis, and are left out first.
                let first = linear_part(linear_below).log10().ceil() as i32;
                let least = [1, 2, 5, 10].map(|step| decimal(step, first));
                sets.flat_map(|set| least.map(|least| (set, least)))
                    .map(|((steps, stride), least)| {
                        let mut values = self.decimals(steps, stride, first);
                        values.retain(|value| value.abs() >= least);
                        values.push(0.0);
                        values.sort_by(f64::total_cmp);
                        self.ticks(values)
                    })
                    .collect()
            }
        }
    }

    /// Ticks at even distances, without sets that have none.
    fn linear(&self) -> Vec<Vec<Tick>> {
        let [low, high] = [self.low, self.high].map(|end| self.invert(end));
        let on_axis = |mut ticks: Vec<Tick>| {
            ticks.retain(|tick| self.contains(tick.value));
            ticks
        };
        let sets = (1..=MOST_TICKS).map(|count| on_axis(linear_ticks(low, high, count)));
        sets.filter(|ticks| !ticks.is_empty()).collect()
    }

    /// Positive and negative `steps` of 10^k up to the axis' ends, for every `stride`-th k from `first`.
    fn decimals(&self, steps: &[i32], stride: i32, first: i32) -> Vec<f64> {
        let largest = self.invert(self.low).abs().max(self.invert(self.high).abs());
        (first..=largest.log10().floor() as i32)
            .filter(|decade| decade.rem_euclid(stride) == 0)
            .flat_map(|decade| steps.iter().map(move |&step| decimal(step, decade)))
            .flat_map(|value| [value, -value])
            .collect()
    }

    fn ticks(&self, values: Vec<f64>) -> Vec<Tick> {
        values
            .into_iter()
            .filter(|&value| self.contains(value))
            .map(|value| Tick { value, label: plain(value) })
            .collect()
    }

    fn invert(&self, position: f64) -> f64 {
        match self.scale {
            Scale::Linear | Scale::Places => position,
            Scale::Log => 10_f64.powf(position),
            Scale::Symlog { linear_below } => {
                2.0 * linear_part(linear_below) * (position * std::f64::consts::LN_10).sinh()
            }
        }
    }

    /// Place of a value along the axis: 0 at its lower, 1 at its upper end.
    pub(crate) fn fraction(&self, value: f64) -> f64 {
        // Far outside, where lines are clipped, coordinates must still be numbers that renderers
        // can handle.
        ((self.scale.apply(value) - self.low) / (self.high - self.low)).clamp(-100.0, 100.0)
    }

    /// Whether a value lies on the axis, ends included.
    pub(crate) fn contains(&self, value: f64) -> bool {
        self.scale.holds(value) && (-1e-9..=1.0 + 1e-9).contains(&self.fraction(value))
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        from + (f64::from(to - from) * self.fraction(*value)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        match hint.weight() {
            KeyPointWeight::Bold => self.ticks.iter().map(|tick| tick.value).collect(),
            KeyPointWeight::Any => self.minor.clone(),
        }
    }

    fn range(&self) -> Range<f64> {
        self.invert(self.low)..self.invert(self.high)
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        let tick = self.ticks.iter().find(|tick| tick.value == *value);
        tick.map_or_else(|| plain(*value), |tick| tick.label.clone())
    }
}

/// `digit`·10^`exponent`, rounded correctly: 3·0.1 is not 0.3, and would be labelled so.
fn decimal(digit: i32, exponent: i32) -> f64 {
    format!("{digit}e{exponent}").parse().unwrap_or(f64::NAN)
}

/// Ticks at multiples of 1, 2 or 5 times a power of ten.
fn linear_ticks(low: f64, high: f64, ticks: usize) -> Vec<Tick> {
    let raw = (high - low) / ticks.max(1) as f64;
    let decade = raw.log10().floor() as i32;
    let (multiple, decade) = match raw / decimal(1, decade) {
        ratio if ratio <= 1.0 => (1.0, decade),
        ratio if ratio <= 2.0 => (2.0, decade),
        ratio if ratio <= 5.0 => (5.0, decade),
        _ => (1.0, decade + 1),
    };
    let step = multiple * decimal(1, decade);
    let first = (low / step - 1e-9).ceil();
    let count = ((high / step + 1e-9).floor() - first).clamp(-1.0, 100.0) as i32;
    let digits = (-decade).clamp(0, 300) as usize;
    let largest = low.abs().max(high.abs());
    (0..=count)
        .map(|index| {
            let value = (first + f64::from(index)) * step;
            let label = if digits > 6 || largest >= 1e7 {
                // Enough digits to tell neighbours apart.
                let places = (largest.log10().floor() as i32 - decade).clamp(0, 15) as usize;
                format!("{value:.places$e}")
            } else {
                format!("{value:.digits$}")
            };
            // Zero has no sign here.
            let label = if value == 0.0 { "0".to_owned() } else { label };
            Tick { value, label: label.replace('-', "−") }
        })
        .collect()
}

/// A round number: plain where that is short, else with an exponent.
fn plain(value: f64) -> String {
    let short = value == 0.0 || (1e-4..1e6).contains(&value.abs());
    let text = if short { value.to_string() } else { format!("{value:e}") };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An axis of this length, each label 10 long.
    fn ticked(range: [f64; 2], scale: Scale, length: f64) -> Axis {
        Axis::over(range, scale).with_ticks(length, |_| 10.0)
    }

    fn labels(axis: &Axis) -> Vec<&str> {
        axis.labels().collect()
    }

    #[test]
    fn linear_ticks_are_round_and_inside() {
        let axis = ticked([0.0, 100.0], Scale::Linear, 60.0);
        assert_eq!(labels(&axis), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(axis.fraction(25.0), 0.25);
        assert_eq!(axis.map(&25.0, (1000, 200)), 800);
        let axis = ticked([-1.3, 0.31], Scale::Linear, 50.0);
        assert_eq!(labels(&axis), ["−1.0", "−0.5", "0"]);
        assert_eq!(axis.format_ext(&-0.5), "−0.5");
    }

    #[test]
    fn log_ticks() {
        let axis = ticked([0.1, 50.0], Scale::Log, 100.0);
        assert_eq!(labels(&axis), ["0.1", "0.2", "0.5", "1", "2", "5", "10", "20", "50"]);
        assert!((axis.fraction(1.0) - 1.0 / 500_f64.log10()).abs() < 1e-12);
        let axis = ticked([0.1, 50.0], Scale::Log, 70.0);
        assert_eq!(labels(&axis), ["0.1", "1", "10"]);
        let axis = ticked([1e-3, 1e9], Scale::Log, 70.0);
        assert_eq!(labels(&axis), ["0.01", "1", "100", "10000", "1e6", "1e8"]);
        let axis = ticked([0.13, 0.65], Scale::Log, 100.0);
        assert_eq!(labels(&axis), ["0.2", "0.3", "0.4", "0.5", "0.6"]);
        assert!(labels(&ticked([2.1, 2.4], Scale::Log, 60.0)).len() > 1);
    }

    #[test]
    fn symlog_ticks_reach_both_ways_from_zero() {
        let symlog = Scale::Symlog { linear_below: 1.0 };
        let axis = ticked([-500.0, 2.0], symlog, 200.0);
        let expected =
            ["−500", "−200", "−100", "−50", "−20", "−10", "−5", "−2", "−1", "0", "1", "2"];
        assert_eq!(labels(&axis), expected);
        // On a shorter axis, 1 and −1 would be crowded by 0 and 2; then there are whole powers only.
        let axis = ticked([-500.0, 2.0], symlog, 160.0);
        let expected = ["−500", "−200", "−100", "−50", "−20", "−10", "−5", "−2", "0", "2"];
        assert_eq!(labels(&axis), expected);
        let axis = ticked([-50000.0, 2.0], symlog, 100.0);
        assert_eq!(labels(&axis), ["−10000", "−1000", "−100", "−10", "0"]);
        assert!(axis.fraction(0.0) > axis.fraction(-1.0));
    }

    #[test]
    fn there_is_room_around_the_values() {
        let axis = Axis::around([2.0, 4.0].into_iter(), Scale::Linear).unwrap();
        assert!(axis.fraction(2.0) > 0.0 && axis.fraction(4.0) < 1.0);
        let axis = Axis::around([0.0, 4.0].into_iter(), Scale::Linear).unwrap();
        assert_eq!(axis.fraction(0.0), 0.0);
        assert!(Axis::around(std::iter::empty(), Scale::Linear).is_none());
    }

    #[test]
    fn odd_ranges_have_ticks_and_places() {
        let odd = [
            [0.0, 0.0],
            [7.0, 7.0],
            [-3.0, -3.0],
            [1e-300, 1e-300],
            [5e-324, 1e-320],
            [-9e199, 9e199],
            [1e12, 1e12 + 1e-4],
            [1e6, 1e6 + 1e-3],
            [0.1, 0.1 + 1e-15],
        ];
        let scales = [
            Scale::Linear,
            Scale::Log,
            Scale::Symlog { linear_below: 1.0 },
            Scale::Symlog { linear_below: 0.0 },
            Scale::Symlog { linear_below: f64::INFINITY },
        ];
        for range in odd {
            for scale in scales {
                if range.iter().any(|&end| !scale.holds(end)) {
                    continue;
                }
                for axis in
                    [Axis::over(range, scale), Axis::around(range.into_iter(), scale).unwrap()]
                {
                    for length in [1.0, 20.0, 235.0, 700.0] {
                        let ticks = axis.clone().with_ticks(length, |_| 20.0).ticks.len();
                        let most = 1 + length as usize / 20;
                        assert!((1..=most).contains(&ticks), "{range:?} {axis:?}");
                    }
                    assert!(axis.fraction(range[0]).is_finite(), "{range:?} {axis:?}");
                }
            }
        }
    }
}
