//! From values to positions along an axis, and where its ticks stand.

/// How values are laid out along an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// Evenly.
    Linear,
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
    pub(super) fn holds(self, value: f64) -> bool {
        // Far beyond any measurement, sums and ratios overflow.
        value.abs() < 1e200 && (self != Scale::Log || value > 0.0)
    }

    fn apply(self, value: f64) -> f64 {
        match self {
            Scale::Linear => value,
            Scale::Log => value.log10(),
            Scale::Symlog { linear_below } => {
                (value / (2.0 * linear_below.max(LEAST))).asinh() / std::f64::consts::LN_10
            }
        }
    }
}

/// Smallest linear part of a symlog scale.
const LEAST: f64 = 1e-9;

/// A labelled tick.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) label: String,
}

/// An axis with room for given values.
#[derive(Debug)]
pub(super) struct Axis {
    scale: Scale,
    /// The ends, on the scale.
    low: f64,
    high: f64,
    pub(super) ticks: Vec<Tick>,
    /// Ticks without label or grid line.
    pub(super) minor: Vec<f64>,
}

impl Axis {
    /// An axis from `range[0]` to `range[1]`, about `ticks` ticks on it.
    pub(super) fn over(range: [f64; 2], scale: Scale, ticks: usize) -> Self {
        let [low, high] = range.map(|end| scale.apply(end));
        Axis::between(low.min(high), low.max(high), scale, ticks)
    }

    /// An axis with some room around the smallest and largest of `values`, all of which the scale
    /// holds; `None` without values.
    pub(super) fn around(
        values: impl Iterator<Item = f64>,
        scale: Scale,
        ticks: usize,
    ) -> Option<Self> {
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
        Some(Axis::between(low, high, scale, ticks))
    }

    fn between(mut low: f64, mut high: f64, scale: Scale, ticks: usize) -> Self {
        // Equal values, or so close that labels could not tell them apart.
        let largest = low.abs().max(high.abs());
        if high - low <= 1e-9 * largest || high - low < 1e-200 {
            let room = if scale == Scale::Linear && largest > 1e-200 { 0.1 * largest } else { 0.5 };
            low -= room;
            high += room;
        }
        let mut axis = Axis { scale, low, high, ticks: Vec::new(), minor: Vec::new() };
        match scale {
            Scale::Linear => {}
            Scale::Log => axis.add_log_ticks(ticks),
            Scale::Symlog { .. } => axis.add_symlog_ticks(),
        }
        if axis.ticks.len() < 2 {
            axis.minor.clear();
            axis.ticks = linear_ticks(axis.invert(low), axis.invert(high), ticks);
            axis.ticks.retain(|tick| scale.holds(tick.value));
            axis.drop_crowded();
        }
        axis
    }

    fn invert(&self, position: f64) -> f64 {
        match self.scale {
            Scale::Linear => position,
            Scale::Log => 10_f64.powf(position),
            Scale::Symlog { linear_below } => {
                2.0 * linear_below.max(LEAST) * (position * std::f64::consts::LN_10).sinh()
            }
        }
    }

    /// Place of a value along the axis: 0 at its lower, 1 at its upper end.
    pub(super) fn fraction(&self, value: f64) -> f64 {
        // Far outside, where lines are clipped, coordinates must still be numbers that renderers
        // can handle.
        ((self.scale.apply(value) - self.low) / (self.high - self.low)).clamp(-100.0, 100.0)
    }

    /// Whether a value lies on the axis, ends included.
    pub(super) fn contains(&self, value: f64) -> bool {
        self.scale.holds(value) && (-1e-9..=1.0 + 1e-9).contains(&self.fraction(value))
    }

    fn push(&mut self, value: f64, label: impl FnOnce() -> String) {
        if self.contains(value) {
            self.ticks.push(Tick { value, label: label() });
        }
    }

    fn add_log_ticks(&mut self, ticks: usize) {
        let (first, last) = (self.low.floor() as i32, self.high.ceil() as i32);
        let decades = self.high - self.low;
        // The shorter the axis, the more of each decade is labelled; beyond that, whole decades only.
        let steps: &[i32] = match 1.5 * ticks as f64 / decades {
            room if room >= 8.0 => &[1, 2, 3, 4, 5, 6, 8],
            room if room >= 3.0 => &[1, 2, 5],
            _ => &[1],
        };
        let stride = (decades / ticks as f64).ceil().max(1.0) as i32;
        for decade in first..=last {
            if decade.rem_euclid(stride) == 0 {
                for &step in steps {
                    let value = decimal(step, decade);
                    self.push(value, || plain(value));
                }
            }
            if decades <= 5.0 {
                for step in 2..10 {
                    let value = decimal(step, decade);
                    if self.contains(value) {
                        self.minor.push(value);
                    }
                }
            }
        }
    }

    fn add_symlog_ticks(&mut self) {
        let Scale::Symlog { linear_below } = self.scale else { return };
        let largest = self.invert(self.low).abs().max(self.invert(self.high).abs());
        let first = linear_below.max(LEAST).log10().ceil() as i32;
        let last = largest.log10().floor() as i32;
        self.push(0.0, || "0".to_owned());
        for decade in first..=last {
            for value in [decimal(1, decade), -decimal(1, decade)] {
                self.push(value, || plain(value));
            }
        }
        self.drop_crowded();
    }

    /// Keeps, in the order of the ticks, those whose labels do not run into an earlier one.
    fn drop_crowded(&mut self) {
        let mut kept: Vec<Tick> = Vec::new();
        for tick in std::mem::take(&mut self.ticks) {
            let far = |other: &Tick| {
                (self.fraction(other.value) - self.fraction(tick.value)).abs() > 0.06
            };
            if kept.iter().all(far) {
                kept.push(tick);
            }
        }
        self.ticks = kept;
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
    let text =
        if (1e-4..1e6).contains(&value.abs()) { format!("{value}") } else { format!("{value:e}") };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|tick| tick.label.as_str()).collect()
    }

    #[test]
    fn linear_ticks_are_round_and_inside() {
        let axis = Axis::over([0.0, 100.0], Scale::Linear, 6);
        assert_eq!(labels(&axis), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(axis.fraction(25.0), 0.25);
        let axis = Axis::over([-1.3, 0.31], Scale::Linear, 5);
        assert_eq!(labels(&axis), ["−1.0", "−0.5", "0"]);
    }

    #[test]
    fn log_ticks() {
        let axis = Axis::over([0.1, 50.0], Scale::Log, 6);
        assert_eq!(labels(&axis), ["0.1", "0.2", "0.5", "1", "2", "5", "10", "20", "50"]);
        assert!((axis.fraction(1.0) - 1.0 / 500_f64.log10()).abs() < 1e-12);
        let axis = Axis::over([1e-3, 1e9], Scale::Log, 6);
        assert_eq!(labels(&axis), ["0.01", "1", "100", "10000", "1e6", "1e8"]);
        let axis = Axis::over([0.13, 0.65], Scale::Log, 7);
        assert_eq!(labels(&axis), ["0.2", "0.3", "0.4", "0.5", "0.6"]);
        assert!(Axis::over([2.1, 2.4], Scale::Log, 6).ticks.len() > 1);
    }

    #[test]
    fn symlog_ticks_reach_both_ways_from_zero() {
        let axis = Axis::over([-500.0, 2.0], Scale::Symlog { linear_below: 1.0 }, 5);
        assert_eq!(labels(&axis), ["0", "1", "−1", "−10", "−100"]);
        // Farther out, 1 and −1 would be crowded by 0.
        let axis = Axis::over([-50000.0, 2.0], Scale::Symlog { linear_below: 1.0 }, 5);
        assert_eq!(labels(&axis), ["0", "−10", "−100", "−1000", "−10000"]);
        assert!(axis.fraction(0.0) > axis.fraction(-1.0));
    }

    #[test]
    fn there_is_room_around_the_values() {
        let axis = Axis::around([2.0, 4.0].into_iter(), Scale::Linear, 5).unwrap();
        assert!(axis.fraction(2.0) > 0.0 && axis.fraction(4.0) < 1.0);
        let axis = Axis::around([0.0, 4.0].into_iter(), Scale::Linear, 5).unwrap();
        assert_eq!(axis.fraction(0.0), 0.0);
        assert!(Axis::around(std::iter::empty(), Scale::Linear, 5).is_none());
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
        ];
        for range in odd {
            for scale in scales {
                if range.iter().any(|&end| !scale.holds(end)) {
                    continue;
                }
                for axis in [
                    Axis::over(range, scale, 5),
                    Axis::around(range.into_iter(), scale, 5).unwrap(),
                ] {
                    assert!(!axis.ticks.is_empty(), "{range:?} {axis:?}");
                    assert!(axis.ticks.len() < 40, "{range:?} {axis:?}");
                    assert!(axis.fraction(range[0]).is_finite(), "{range:?} {axis:?}");
                }
            }
        }
    }
}
