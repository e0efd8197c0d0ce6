//! The experiment on kinds of maps, as a user runs it.

mod office;

use std::fs;
use std::path::Path;

use mcl_eval::experiment::{
    Representation, RepresentationRow, RepresentationSummaryRow, Split, read_rows,
};
use office::Bench;

const REPRESENTATIONS: &str = r#"
    kind = "representations"
    seed = 3
    runs = 2
    maps = 2
    splits = ["same", "held-out"]
    odometry_noise = { xy = 0.01, theta = 0.01 }
    sigma = 0.05
    tolerance = 1e-3
    max_iterations = 50
    points = { builders = ["rnd", "gbs", "rnd+f-km", "gbs+f-km", "gbs+best"], sizes = [10] }
    grids = [0.05, 0.2]
    ndt = [0.5, 1]
    segments = [0.05, 0.2]
    filter = { particles = 200, beams = 60 }
"#;

fn bench() -> Bench {
    Bench::new(&[("representations", REPRESENTATIONS)])
}

fn trials(folder: &Path) -> Vec<RepresentationRow> {
    read_rows(&folder.join("trials.csv")).unwrap()
}

#[test]
fn the_same_bytes_for_any_number_of_threads_and_after_an_interruption() {
    let bench = bench();
    let one = bench.reproduced("representations");
    let rows = trials(&one);
    // Per split 2 runs on 5 point maps, all points, 2 grids, 2 NDT maps read in 2 ways, and 2 of segments.
    assert_eq!(rows.len(), 2 * 2 * (5 + 1 + 2 + 4 + 2));
    let summary: Vec<RepresentationSummaryRow> = read_rows(&one.join("summary.csv")).unwrap();
    assert_eq!(summary.len(), rows.len() / 2);
    for ending in ["svg", "png"] {
        assert!(one.join(format!("figures/representations.{ending}")).is_file());
    }

    // The figure is drawn again from saved rows alone, and more maps may be added to them.
    let figure = one.join("figures/representations.svg");
    let before = fs::read(&figure).unwrap();
    fs::remove_file(&figure).unwrap();
    bench.mcl_eval(&["plot", "one"]);
    assert_eq!(fs::read(&figure).unwrap(), before);
    let more = REPRESENTATIONS.replace("grids = [0.05, 0.2]", "grids = [0.05, 0.1, 0.2]");
    fs::write(bench.path("representations.toml"), more).unwrap();
    bench.experiment("representations", "one", &[]);
    let added = trials(&one);
    assert_eq!(added.len(), rows.len() + 2 * 2);
    assert!(rows.iter().all(|row| added.contains(row)));
}

/// The robot is tracked on each kind of map, and bytes are those of the definitions.
#[test]
fn every_kind_of_map_localizes() {
    let bench = bench();
    let rows = trials(&bench.experiment("representations", "results", &[]));
    for row in &rows {
        let name = format!("{:?} {} {:?}", row.representation, row.parameter, row.split);
        // Gaussians as wide as walls are too sharp for the steps of every other scan: such runs are lost.
        if (row.representation, row.split) != (Representation::Ndt, Split::HeldOut) {
            assert!(!row.diverged && row.lost_episodes == 0, "{name}");
            assert!(row.weighted < 0.1, "{name}: {}", row.weighted);
        }
        let per_element = match row.representation {
            Representation::Occupancy => 1,
            Representation::Ndt | Representation::NdtWide => 24,
            Representation::Segments => 16,
            _ => 8,
        };
        assert_eq!(row.bytes_raw, per_element * row.elements, "{name}");
        let is_grid = row.representation == Representation::Occupancy;
        assert_eq!(row.bytes_run_length.is_some_and(|bytes| bytes < row.bytes_raw), is_grid);
    }
    let of = |representation: Representation, parameter: f64| {
        let mut found = rows.iter().filter(move |row| {
            row.split == Split::Same
                && row.representation == representation
                && row.parameter == parameter
        });
        found.next().unwrap()
    };
    // Smaller cells are more, and both readings are of the same NDT map, but not the same.
    let [fine, coarse] = [0.05, 0.2].map(|cell| of(Representation::Occupancy, cell).elements);
    assert!(fine > 10 * coarse);
    let [as_is, wide] = [Representation::Ndt, Representation::NdtWide].map(|kind| of(kind, 0.5));
    assert_eq!(as_is.elements, wide.elements);
    assert!(as_is.weighted != wide.weighted);
    // The walls of a few rooms take fewer segments than a tenth of the points, and fewer with more tolerance.
    let [fine, coarse] = [0.05, 0.2].map(|m| of(Representation::Segments, m).elements);
    assert!(coarse <= fine && fine < of(Representation::Grid, 10.0).elements / 10);
}

/// Definitions without line segments still run, and going on with them later changes no row.
#[test]
fn segments_may_be_added_later() {
    let bench = bench();
    let few = REPRESENTATIONS
        .replace("[\"rnd\", \"gbs\", \"rnd+f-km\", \"gbs+f-km\", \"gbs+best\"]", "[\"gbs\"]")
        .replace("[0.05, 0.2]\n    ndt = [0.5, 1]", "[0.2]\n    ndt = [1]");
    let path = bench.path("representations.toml");
    fs::write(&path, few.replace("    segments = [0.05, 0.2]\n", "")).unwrap();
    let folder = bench.experiment("representations", "results", &[]);
    let before = fs::read_to_string(folder.join("trials.csv")).unwrap();
    assert!(!fs::read_to_string(folder.join("manifest.json")).unwrap().contains("segments"));
    fs::write(&path, few).unwrap();
    bench.experiment("representations", "results", &[]);
    let after = fs::read_to_string(folder.join("trials.csv")).unwrap();
    let others: Vec<&str> = after.lines().filter(|line| !line.contains(",segments,")).collect();
    assert_eq!(others, before.lines().collect::<Vec<_>>());
    assert_eq!(after.lines().count() - others.len(), 2 * 2 * 2);
}
