//! What columns are called in figures, with their units.

/// Column (or setting of several columns), name, unit.
const LABELS: [(&str, &str, &str); 67] = [
    ("size_percent", "requested map size", "% of the points that build the map"),
    ("size_points", "requested map size", "points"),
    ("resolution_m", "resolution", "m"),
    ("size_by", "size by", ""),
    ("sigma_m", "σ", "m"),
    ("sigma_by", "σ by", ""),
    ("used_sigma_m", "σ", "m"),
    ("max_iterations", "most updates", ""),
    ("map_points", "size of the map", "points"),
    ("requested_points", "requested map size", "points"),
    ("real_percent", "map size", "% of the points that build the map"),
    ("elements", "elements of the map", ""),
    ("cell_m", "cell", "m"),
    ("log_likelihood", "log-likelihood", "nats per point"),
    ("held_out_log_likelihood", "held-out log-likelihood", "nats/point"),
    ("fitted_log_likelihood", "fitted log-likelihood", "nats/point"),
    ("iterations", "updates of EM", ""),
    ("evaluations", "evaluations of the likelihood", ""),
    ("bic", "BIC", "nats per point"),
    ("mdl", "description length", "nats per point"),
    ("held_out", "held-out score", "nats per point"),
    ("kilobytes", "size of the map", "kB"),
    ("run_length_kilobytes", "run lengths", "kB"),
    ("weighted", "mean weighted error d", "–"),
    ("translation", "mean translation error", "m"),
    ("heading", "mean heading error", "rad"),
    ("translation_max", "largest translation error", "m"),
    ("diverged", "share of diverged runs", "–"),
    ("lost_share", "share of scans while lost", "–"),
    ("lost_episodes", "times lost per run", ""),
    ("recovered_episodes", "times found again per run", ""),
    ("found_after_scans", "scans until found", ""),
    ("found", "found", "share of runs"),
    ("found_within_30", "found within 30 scans", "share of runs"),
    ("scans_until_found", "scans until found", ""),
    ("found_again", "found again", "share of runs"),
    ("found_again_within_50", "found again within 50 scans", "share"),
    ("scans_until_found_again", "scans until found again", ""),
    ("mean_particles", "mean number of particles", ""),
    ("start", "begins", ""),
    ("length", "scans of a run", ""),
    ("people_share", "share of the readings that end at people", ""),
    ("lost_beams", "share of lost readings", ""),
    ("kidnapped_at", "carried off after this share of the scans", ""),
    ("kidnapped_distance", "carried off at least", "m"),
    ("slip_share", "share of steps with slipping wheels", ""),
    ("slip_factor", "odometry of slipping wheels", "times the translation"),
    ("recover", "recovery", ""),
    ("mean_effective_sample_size", "mean effective sample size", ""),
    ("smallest_effective_sample_size", "smallest effective sample size", ""),
    ("nees", "mean NEES", "–"),
    ("median_nees", "median NEES", "–"),
    ("inside_95", "share in the 95 % ellipsoid", "–"),
    ("initial_pose_kind", "start", ""),
    ("initial_pose_std", "spread of the start", "m, m, rad"),
    ("alpha", "α", ""),
    ("sigma_hit", "σ_hit", "m"),
    ("z_rand", "z_rand", ""),
    ("beam_floor", "floor of a beam", "of its peak"),
    ("outlier_fraction", "share of particles that makes a beam improbable", ""),
    ("max_distance", "distances cut at", "m"),
    ("likelihood_exponent", "exponent on the likelihood", ""),
    ("ess_fraction", "effective share that is resampled", ""),
    ("resample_distance", "path until resampling", "m"),
    ("noise", "noise added to the odometry", "m, rad"),
    ("noise_xy", "noise added to the odometry", "m"),
    ("noise_theta", "noise added to the odometry", "rad"),
];

/// Name and unit of a column; what is not known goes by the column's name.
pub fn name_and_unit(column: &str) -> (String, &'static str) {
    match LABELS.iter().find(|(known, ..)| *known == column) {
        Some((_, name, unit)) => ((*name).to_owned(), unit),
        None => (column.replace('_', " "), ""),
    }
}

/// For an axis: "σ_hit \[m\]".
pub fn axis_label(column: &str) -> String {
    match name_and_unit(column) {
        (name, "") => name,
        (name, unit) => format!("{name} [{unit}]"),
    }
}
