//! The real Intel log against figures of an independent NumPy/SciPy computation. Ignored where
//! `MCL_DATA_DIR` does not hold the log.

use mcl_core::PointMap;
use mcl_maps::sampling::{GridOffset, sample_grid, sample_grid_of_size};
use mcl_maps::{FkmSettings, PointSet, fuzzy_k_means, mixture_log_likelihood, snap_to_data};
use mcl_study::data::options::SourceOptions;
use mcl_study::data::source::LogSource;

/// One grid-based map (offset 0) of the Intel data. Source: independent NumPy/SciPy computation.
struct Golden {
    cell: f64,
    map_points: usize,
    index_sum: usize,
    coordinate_sums: [f64; 2],
    /// At σ = 0.05 m and 0.1 m, per point.
    log_likelihoods: [f64; 2],
    /// Per point at σ = 0.05 m, of the model after 0 … 10 updates.
    trace: [f64; 11],
    mean_sums: [f64; 2],
    snapped_points: usize,
    snapped_index_sum: usize,
    snapped_log_likelihood: f64,
}

const GOLDEN: [Golden; 2] = [
    Golden {
        cell: 1.3,
        map_points: 409,
        index_sum: 31_389_521,
        coordinate_sums: [1479.1066192711974, -3449.7424948344546],
        log_likelihoods: [-28.479532846946732, -9.878907005353023],
        trace: [
            -28.479532846946732,
            -25.013463291737207,
            -23.647022195606304,
            -23.008183975015765,
            -22.638645202924874,
            -22.400386397943077,
            -22.228045174547947,
            -22.097810996101607,
            -21.99615742947078,
            -21.920807954623086,
            -21.86186468736519,
        ],
        mean_sums: [1475.2568917903159, -3454.3100118930015],
        snapped_points: 409,
        snapped_index_sum: 30_907_540,
        snapped_log_likelihood: -22.162985993243538,
    },
    Golden {
        cell: 0.5,
        map_points: 1534,
        index_sum: 118_107_287,
        coordinate_sums: [5144.650515228529, -12981.402294416966],
        log_likelihoods: [-6.797450703813076, -5.297503942513535],
        trace: [
            -6.797450703813076,
            -6.13611946086044,
            -5.910689851123089,
            -5.802499776759558,
            -5.731058371791851,
            -5.682188962294565,
            -5.647429577712053,
            -5.622077171341106,
            -5.602335248939913,
            -5.585937871168213,
            -5.569869191323296,
        ],
        mean_sums: [5141.693438296563, -12974.798564813722],
        snapped_points: 1523,
        snapped_index_sum: 118_060_382,
        snapped_log_likelihood: -5.592159301161831,
    },
];

/// The Intel data.
fn intel() -> PointSet<2> {
    let source = LogSource::open("intel-lab", &SourceOptions::default()).unwrap();
    PointSet::new(source.points().unwrap()).unwrap()
}

fn sums(points: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|axis| points.iter().map(|point| point[axis]).sum())
}

/// To ten significant digits.
#[track_caller]
fn assert_close(found: f64, expected: f64) {
    assert!((found - expected).abs() <= 1e-10 * expected.abs(), "{found} instead of {expected}");
}

#[test]
#[cfg_attr(not(real_data = "intel-lab"), ignore = "needs intel-lab in MCL_DATA_DIR")]
fn grid_maps_likelihoods_and_fuzzy_k_means_agree() {
    let data = intel();
    assert_eq!(data.len(), 155_648);
    for golden in GOLDEN {
        let sample = sample_grid(data.points(), golden.cell, GridOffset::ORIGIN).unwrap();
        assert_eq!(sample.indices.len(), golden.map_points);
        assert_eq!(sample.indices.iter().sum::<usize>(), golden.index_sum);
        let points_of = |indices: &[usize]| indices.iter().map(|&i| data.points()[i]).collect();
        let map = PointMap::new(points_of(&sample.indices)).unwrap();
        for (found, expected) in sums(map.points()).iter().zip(golden.coordinate_sums) {
            assert_close(*found, expected);
        }
        for (sigma, expected) in [0.05, 0.1].into_iter().zip(golden.log_likelihoods) {
            assert_close(mixture_log_likelihood(&data, &map, sigma).unwrap().per_point, expected);
        }

        let settings = FkmSettings { max_iterations: 10, ..FkmSettings::default() };
        let (means, report) = fuzzy_k_means(&data, &map, &settings, |_, _| {}).unwrap();
        assert_eq!((report.iterations, report.converged), (10, false));
        for (found, expected) in report.log_likelihood_trace.iter().zip(golden.trace) {
            assert_close(*found, expected);
        }
        for (found, expected) in sums(&means).iter().zip(golden.mean_sums) {
            assert_close(*found, expected);
        }

        let snapped = snap_to_data(&data, &means);
        assert_eq!(snapped.len(), golden.snapped_points);
        assert_eq!(snapped.iter().sum::<usize>(), golden.snapped_index_sum);
        let snapped = PointMap::new(points_of(&snapped)).unwrap();
        let found = mixture_log_likelihood(&data, &snapped, 0.05).unwrap().per_point;
        assert_close(found, golden.snapped_log_likelihood);
    }
}

/// Figure 2 of the paper shows grid-based and random maps of 389 points.
#[test]
#[cfg_attr(not(real_data = "intel-lab"), ignore = "needs intel-lab in MCL_DATA_DIR")]
fn a_grid_map_of_the_papers_389_points() {
    let data = intel();
    let sample = sample_grid_of_size(data.points(), 389, GridOffset::ORIGIN).unwrap();
    assert_eq!(sample.indices.len(), 389);
    assert!((1.2..1.5).contains(&sample.cell), "cells of {} m", sample.cell);
}
