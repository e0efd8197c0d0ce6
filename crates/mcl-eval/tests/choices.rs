//! The experiment on automatic sizes and σ, as a user runs it.

mod office;

use std::fs;
use std::path::Path;

use mcl_eval::auto::{Criterion, Verdict};
use mcl_eval::experiment::{ChoiceRow, ChoiceSummaryRow, Origin, Quantity, read_rows};
use office::Bench;

const CHOICES: &str = r#"
    kind = "choices"
    seed = 3
    size_by = ["held-out", "bic", "mdl", "localization"]
    sizes = { from = 1, to = 16, factor = 2 }
    sigma_by = ["likelihood", "held-out"]
    sigma_sizes = [2]
    sigmas = { from = 0.02, to = 0.2, factor = 3 }
    refine = { method = "fkm" }
    sigma = 0.05
    tolerance = 1e-3
    max_iterations = 10
    runs = 4
    odometry_noise = { xy = 0.01, theta = 0.01 }
    filter = { particles = 100, beams = 30 }
"#;

fn bench() -> Bench {
    Bench::with_scans(60, &[("choices", CHOICES)])
}

fn summary(folder: &Path) -> Vec<ChoiceSummaryRow> {
    read_rows(&folder.join("summary.csv")).unwrap()
}

#[test]
fn the_same_bytes_for_any_number_of_threads_and_after_an_interruption() {
    let bench = bench();
    let one = bench.reproduced("choices");
    // The figure is drawn again from saved rows.
    let figure = one.join("figures/choices.svg");
    let before = fs::read(&figure).unwrap();
    fs::remove_file(&figure).unwrap();
    bench.mcl_eval(&["plot", "one"]);
    assert_eq!(fs::read(&figure).unwrap(), before);
}

#[test]
fn choices_stand_beside_the_best_of_the_sweep() {
    let bench = bench();
    let folder = bench.experiment("choices", "results", &[]);
    let rows = summary(&folder);
    // Four sizes; at one size two σ that are chosen and the given one.
    assert_eq!(rows.len(), 4 + 3);
    let sweeps: Vec<ChoiceRow> = read_rows(&folder.join("sweeps.csv")).unwrap();
    for row in &rows {
        let name = format!("{:?} by {:?}", row.quantity, row.by);
        assert!(row.weighted.unwrap() > 0.0 && row.runs == Some(4), "{name}");
        if row.origin == Origin::Given {
            assert_eq!((row.value, row.excess), (0.05, None));
            continue;
        }
        let swept: Vec<&ChoiceRow> = sweeps
            .iter()
            .filter(|other| (other.quantity, other.by) == (row.quantity, row.by))
            .collect();
        assert_eq!(row.swept, Some(swept.len()), "{name}");
        if row.by == Criterion::Localization {
            let within = swept.iter().filter(|row| row.verdict == Some(Verdict::Within));
            let smallest = within.map(|row| row.value).reduce(f64::min);
            assert_eq!(row.best_swept, smallest, "{name}");
            // The race is stricter: it looks several times.
            assert!(row.value >= smallest.unwrap(), "{name}");
            continue;
        }
        let best = swept.iter().filter_map(|row| row.score).reduce(f64::min).unwrap();
        assert_eq!(row.best_swept_score, Some(best), "{name}");
        assert!((row.excess.unwrap() - (row.score.unwrap() - best)).abs() < 1e-12, "{name}");
        // The search is finer than these sweeps and loses little to any of their values.
        assert!(row.excess.unwrap() < 0.05, "{name}: {:?}", row.excess);
    }
    // What `map --size auto` chooses.
    let args = "map office.log --init grid --size auto --auto-by bic --refine fkm \
                --tolerance 1e-3 --max-iterations 10 -o map.ply --json";
    let built: serde_json::Value =
        serde_json::from_str(&bench.mcl_eval(&args.split_whitespace().collect::<Vec<_>>()))
            .unwrap();
    let is_bic =
        |row: &&ChoiceSummaryRow| row.quantity == Quantity::Size && row.by == Criterion::Bic;
    assert_eq!(built["auto_size"]["value"], rows.iter().find(is_bic).unwrap().value);
}
