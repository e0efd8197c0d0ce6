//! The comparison of refinements, as a user runs it.

mod office;

use std::fs;
use std::path::Path;

use mcl_eval::experiment::{RefinementRow, RefinementSummaryRow, Split, read_rows};
use office::Bench;

const REFINEMENT: &str = r#"
    kind = "refinement"
    seed = 3
    repeats = 2
    splits = ["same", "held-out"]
    sizes = [1, 2, 4]
    plain_sizes = [4, 30]
    methods = [
      { method = "fkm" },
      { method = "exchange", sweeps = 3 },
      { method = "best", rounds = 4, sweeps = 3 },
    ]
    sigma = 0.05
    tolerance = 1e-4
    max_iterations = 200
"#;

fn bench() -> Bench {
    Bench::with_scans(60, &[("refinement", REFINEMENT)])
}

fn summary(folder: &Path) -> Vec<RefinementSummaryRow> {
    read_rows(&folder.join("summary.csv")).unwrap()
}

#[test]
fn the_same_bytes_for_any_number_of_threads_and_after_an_interruption() {
    let bench = bench();
    let rows: Vec<RefinementRow> =
        read_rows(&bench.reproduced("refinement").join("trials.csv")).unwrap();
    // Initial map and three methods at three sizes, initial map and fuzzy k-means at one more.
    assert_eq!(rows.len(), 2 * 2 * (3 * 4 + 2));
}

#[test]
fn refined_maps_are_likelier_and_stand_for_larger_plain_ones() {
    let bench = bench();
    let rows = summary(&bench.experiment("refinement", "results", &[]));
    let of = |split: Split, method: &str, size: f64| {
        rows.iter()
            .find(|row| (row.split, row.method.as_str(), row.size_percent) == (split, method, size))
            .unwrap()
    };
    for size in [1.0, 2.0, 4.0] {
        let [gbs, fkm, exchange, best] =
            ["gbs", "fkm", "exchange", "best"].map(|method| of(Split::Same, method, size));
        assert!(fkm.log_likelihood > gbs.log_likelihood, "{size}");
        assert!(exchange.log_likelihood > fkm.log_likelihood, "{size}");
        assert!(best.log_likelihood > exchange.log_likelihood, "{size}");
        assert!(best.mean_map_points <= gbs.mean_map_points);
        assert!(gbs.held_out_log_likelihood.is_none());
        // Other points are less likely than those that the map is built from.
        let other = of(Split::HeldOut, "fkm", size);
        assert!(other.held_out_log_likelihood.unwrap() < other.log_likelihood);
    }
    // By definition 1 for the method that others are measured by.
    let factor = |method, size| of(Split::Same, method, size).plain_size_factor;
    assert!((factor("fkm", 2.0).unwrap() - 1.0).abs() < 1e-12);
    let factors = [1.0, 2.0, 4.0].map(|size| factor("best", size).unwrap());
    assert!(factors.iter().all(|&factor| factor > 1.0), "{factors:?}");
}

#[test]
fn a_data_set_may_name_some_of_the_methods() {
    let named = format!("{REFINEMENT}\n[[dataset]]\nname = \"office.log\"\n");
    let refused = named.clone() + "methods = [\"annealed\"]";
    let bench = Bench::with_scans(60, &[("refused", &refused)]);
    let output = bench.run(&["run", "refused.toml", "--dataset", "office.log", "-o", "results"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(
        stderr.contains("names annealed, expected one of") && stderr.contains("fkm"),
        "{stderr}"
    );
}

/// Points in space are refined like those in the plane, but there are no scans to hold out.
#[test]
fn point_clouds_are_refined_on_all_their_points() {
    let same = REFINEMENT.replace("[\"same\", \"held-out\"]", "[\"same\"]");
    let bench = Bench::new(&[("refinement", REFINEMENT), ("same", &same)]);
    let mut cloud = "x,y,z\n".to_owned();
    for index in 0..2000 {
        let [x, y] = [index % 50, index / 50].map(|cell| 0.05 * f64::from(cell));
        cloud += &format!("{x},{y},{}\n", (3.0 * x).sin() * (2.0 * y).cos());
    }
    fs::write(bench.path("hills.csv"), cloud).unwrap();
    let run = |name: &str| bench.run(&["run", name, "--dataset", "hills.csv", "-o", "results"]);
    let output = run("same.toml");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let folder = bench.path("results/same/hills");
    assert!(folder.join("figures/refinement.svg").is_file());
    let rows = summary(&folder);
    assert_eq!(rows.len(), 3 * 4 + 2);
    let likelihood =
        |method: &str| rows.iter().find(|row| row.method == method).unwrap().log_likelihood;
    assert!(likelihood("best") > likelihood("fkm") && likelihood("fkm") > likelihood("gbs"));

    let output = run("refinement.toml");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(stderr.contains("needs no scans") && stderr.contains("point cloud"), "{stderr}");
}
