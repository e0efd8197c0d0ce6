//! Results do not depend on the processor. glibc chooses its sines, exponentials and logarithms by it, and
//! `GLIBC_TUNABLES` takes fused multiplication and AVX2 away from that choice, as an older processor would.
use std::env;
use std::fs;
use std::hint::black_box;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use crate::office::{Bench, assert_same};

/// Every kind of map, all that builds maps of points, both motion models and both proposals, and what is
/// computed of the rows.
const STUDY: &str = r#"
seed = 5
measures = ["likelihood", "criteria", "bytes", "consistency"]
[base]
tolerance = 1e-3
max_iterations = 50
odometry_noise = { xy = 0.01, theta = 0.01 }
particles = 60
[[trials]]
name = "points"
sigma = [0.05]
map = ["all", "gbs", "gbs+f-km", "rnd", "rnd+f-km", "gbs+best"]
size = [5, 20]
motion = ["gaussian", "book"]
proposal = ["motion", "adaptive"]
draws = 2
runs = 2
[[trials]]
name = "chosen"
map = "gbs+f-km"
sigma = "likelihood"
size = 10
preset = ["default", "carmen"]
draws = 1
runs = 1
[[trials]]
name = "grids"
map = "occupancy"
resolution = 0.1
draws = 1
runs = 1
[[trials]]
name = "cells"
map = ["ndt", "ndt+sigma"]
resolution = 0.5
draws = 1
runs = 1
[[trials]]
name = "lines"
map = "segments"
resolution = 0.1
draws = 1
runs = 1
[views.summary]
columns = ["map_points", "weighted", "translation", "heading", "diverged", "nees", "log_likelihood"]
[[views.tests]]
of = "points"
y = "weighted"
ratio = true
pairs = [["gbs+f-km", "gbs"], ["rnd+f-km", "rnd"]]
"#;

const MASK: &str = "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-FMA_Usable,-FMA4_Usable,-AVX2_Usable";
const TUNABLES: &str = "GLIBC_TUNABLES";
const PRINTED: &str = "MCL_TEST_PRINT_BITS";

#[test]
fn a_processor_without_fused_multiplication_computes_the_same_bytes() {
    assert_mask_counts();
    let bench = Bench::with_scans(60, &[("processors", STUDY)]);
    let own = made(&bench, "own", None);
    let masked = made(&bench, "masked", Some(MASK));
    for (masked, own) in masked.iter().zip(&own) {
        assert_same(masked, own);
    }
    // Parts of processors of both kinds, merged on either.
    let share = |share: &str, mask: Option<&str>| {
        let command = format!("run processors.toml --dataset office.log -o parts {share} -q");
        let arguments: Vec<&str> = command.split(' ').collect();
        let output =
            bench.command(&arguments).envs(mask.map(|mask| (TUNABLES, mask))).output().unwrap();
        assert!(output.status.success(), "{share}: {}", String::from_utf8_lossy(&output.stderr));
    };
    share("--part 1/2", Some(MASK));
    share("--part 2/2", None);
    share("--merge", Some(MASK));
    assert_same(&bench.path("parts/processors/office"), &own[0]);
}

/// Two folders that the program made of the log: of results of the study, and of other files.
fn made(bench: &Bench, name: &str, mask: Option<&str>) -> [PathBuf; 2] {
    let files = bench.path(name).join("files");
    fs::create_dir_all(&files).unwrap();
    let run = |arguments: &str| {
        let arguments = arguments.replace("FILES", &format!("{name}/files"));
        let arguments: Vec<&str> = arguments.split(' ').collect();
        let mut command = bench.command(&arguments);
        let output = command.envs(mask.map(|mask| (TUNABLES, mask))).output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {stderr}");
    };
    run("simulate -o FILES/office.log --seed 2 --people 3");
    run("simulate -o FILES/office.csv --three-dimensional");
    run("convert office.log FILES/office.mcap");
    run("map office.log --init grid --cell 0.2 -o FILES/map.csv");
    // From nowhere.
    run("localize office.log --map FILES/map.csv --initial scan --runs 2 -o FILES/runs");
    // It has the times in it, and figures that are those of the runs.
    fs::remove_file(files.join("runs/summary.json")).unwrap();
    run(&format!("run processors.toml --dataset office.log -o {name}"));
    [bench.path(name).join("processors/office"), files]
}

/// Else the test above could not fail.
fn assert_mask_counts() {
    if !std::arch::is_x86_feature_detected!("fma") {
        eprintln!("this processor has no fused multiplication to mask");
        return;
    }
    let bits = |mask: Option<&str>| {
        let mut command = Command::new(env::current_exe().unwrap());
        command
            .args(["--exact", "processors::bits_of_the_c_library", "--nocapture"])
            .env(PRINTED, "yes");
        command.envs(mask.map(|mask| (TUNABLES, mask))).stderr(Stdio::inherit());
        String::from_utf8(command.output().unwrap().stdout).unwrap()
    };
    assert!(bits(None).contains("bits of"), "{}", bits(None));
    assert_ne!(bits(None), bits(Some(MASK)), "the mask changes nothing; has glibc other names?");
}

/// Printed for [`assert_mask_counts`], which calls this program.
#[test]
fn bits_of_the_c_library() {
    if env::var_os(PRINTED).is_none() {
        return;
    }
    for (name, function) in
        [("sin", f64::sin as fn(f64) -> f64), ("exp", f64::exp), ("ln", f64::ln)]
    {
        let bits = (1..10_000).map(|i| function(black_box(f64::from(i) * 1e-3)).to_bits());
        println!("bits of {name}: {:x}", bits.fold(0, |sum: u64, bits| sum.rotate_left(1) ^ bits));
    }
}
