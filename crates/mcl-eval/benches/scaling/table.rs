//! Measuring in turns, fitting exponents, printing and saving.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};

/// Work is repeated until a measurement takes about this long.
const MEASUREMENT: Duration = Duration::from_millis(30);
const MOST_REPEATS: f64 = 1000.0;

/// How much to measure.
#[derive(Clone, Copy)]
pub struct Scale {
    pub rounds: usize,
    /// Sizes are those up to this fraction of the largest.
    pub largest: f64,
}

impl Scale {
    /// Two sizes per decade from `smallest` to `largest`, as far as the scale goes.
    pub fn sizes(self, smallest: usize, largest: usize) -> Vec<usize> {
        let limit = largest as f64 * self.largest * 1.001;
        (0..)
            .map(|step| smallest as f64 * 10f64.powf(0.5 * f64::from(step)))
            .take_while(|&size| size <= limit)
            .map(|size| size.round() as usize)
            .collect()
    }
}

/// Work of one size, for one number of threads.
pub struct Cell<'a> {
    pub size: usize,
    pub threads: usize,
    /// Points, or particles times beams: what a unit of work works through.
    pub items: usize,
    /// Does that many units of work (or fewer, if it ends earlier); returns how many, and the time.
    pub work: Box<dyn FnMut(usize) -> (usize, Duration) + 'a>,
}

/// What a table is about.
pub struct Title {
    /// Name in the CSV file.
    pub id: &'static str,
    pub text: &'static str,
    /// Name of the sizes.
    pub size: &'static str,
    /// Name of an item.
    pub item: &'static str,
}

/// The tables as they come in.
pub struct Report {
    csv: Option<BufWriter<File>>,
}

impl Report {
    /// Opens the CSV file, so that a bad path is reported before the measurements.
    pub fn new(csv: Option<&Path>) -> Result<Self> {
        let Some(path) = csv else { return Ok(Report { csv: None }) };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("cannot make {}", folder.display()))?;
        }
        let file =
            File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        let mut csv = BufWriter::new(file);
        writeln!(csv, "table,size_of,size,threads,round,seconds,items")?;
        Ok(Report { csv: Some(csv) })
    }

    /// Measures the cells, all sizes once per round, and prints the table with its fit.
    pub fn measure(&mut self, title: &Title, mut cells: Vec<Cell>, scale: Scale) -> Result<()> {
        // Warms up, too.
        let repeats: Vec<usize> = cells
            .iter_mut()
            .map(|cell| {
                let (done, time) = (cell.work)(1);
                let each = time.as_secs_f64() / done.max(1) as f64;
                (MEASUREMENT.as_secs_f64() / each).clamp(1.0, MOST_REPEATS) as usize
            })
            .collect();
        let mut best = vec![f64::INFINITY; cells.len()];
        for round in 0..scale.rounds {
            for (index, cell) in cells.iter_mut().enumerate() {
                let (done, time) = (cell.work)(repeats[index]);
                let seconds = time.as_secs_f64() / done.max(1) as f64;
                best[index] = best[index].min(seconds);
                if let Some(csv) = &mut self.csv {
                    let Cell { size, threads, items, .. } = cell;
                    let Title { id, size: size_of, .. } = title;
                    writeln!(csv, "{id},{size_of},{size},{threads},{round},{seconds:e},{items}")?;
                }
            }
        }
        print(title, &cells, &best);
        Ok(())
    }

    /// Writes what is still buffered.
    pub fn finish(self) -> Result<()> {
        match self.csv {
            Some(mut csv) => csv.flush().context("cannot write the CSV file"),
            None => Ok(()),
        }
    }
}

fn print(title: &Title, cells: &[Cell], best: &[f64]) {
    println!("\n{}", title.text);
    println!(
        "{:>12}{:>14}{:>14}{:>10}{:>14}{:>10}",
        title.size,
        "1 thread, ms",
        format!("ns/{}", title.item),
        "exponent",
        "2 threads, ms",
        "speed-up"
    );
    let of = |threads: usize| -> Vec<(usize, f64, usize)> {
        let measured = cells.iter().zip(best).filter(|(cell, _)| cell.threads == threads);
        measured.map(|(cell, &seconds)| (cell.size, seconds, cell.items)).collect()
    };
    let (one, two) = (of(1), of(2));
    for (index, &(size, seconds, items)) in one.iter().enumerate() {
        let exponent = match index.checked_sub(1).map(|before| one[before]) {
            Some((smaller, before, _)) => {
                let exponent = (seconds / before).ln() / (size as f64 / smaller as f64).ln();
                format!("{exponent:.2}")
            }
            None => String::new(),
        };
        let per_item = 1e9 * seconds / items as f64;
        print!("{size:>12}{:>14.3}{per_item:>14.2}{exponent:>10}", 1e3 * seconds);
        match two.iter().find(|other| other.0 == size) {
            Some(&(_, other, _)) => println!("{:>14.3}{:>10.2}", 1e3 * other, seconds / other),
            None => println!("{:>14}{:>10}", "-", "-"),
        }
    }
    for (threads, measured) in [(1, &one), (2, &two)] {
        let Some(fit) = Fit::of(measured) else { continue };
        println!(
            "fit on {threads} thread{}: time ~ {}^{:.3} from {} to {}; largest deviation {:.0} %",
            if threads == 1 { "" } else { "s" },
            title.size,
            fit.exponent,
            measured[0].0,
            measured[measured.len() - 1].0,
            100.0 * fit.deviation
        );
    }
}

/// Least squares of ln time over ln size.
struct Fit {
    exponent: f64,
    /// The largest ratio of a time to its fit, or of the fit to the time, less one.
    deviation: f64,
}

impl Fit {
    /// `None` with fewer than two sizes.
    fn of(measured: &[(usize, f64, usize)]) -> Option<Self> {
        let points: Vec<(f64, f64)> =
            measured.iter().map(|&(size, seconds, _)| ((size as f64).ln(), seconds.ln())).collect();
        let count = points.len() as f64;
        let (sum_x, sum_y) = points.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0, sum.1 + p.1));
        let (mean_x, mean_y) = (sum_x / count, sum_y / count);
        let spread: f64 = points.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
        if points.len() < 2 || spread == 0.0 {
            return None;
        }
        let exponent = points.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum::<f64>() / spread;
        let deviation = points
            .iter()
            .map(|p| (p.1 - mean_y - exponent * (p.0 - mean_x)).abs().exp() - 1.0)
            .fold(0.0, f64::max);
        Some(Fit { exponent, deviation })
    }
}
