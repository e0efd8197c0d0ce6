//! The Rust side of crates/mcl-py/bench/speed.py: the same functions, called without Python. Takes the folder with the
//! points and the map, as little-endian doubles, and prints seconds by name as one JSON object.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use mcl_core::{NearestNeighbors, Point, PointMap};
use mcl_eval::library::build_map;
use mcl_maps::{PointSet, mixture_log_likelihood};
use rayon::prelude::*;

const REPETITIONS: usize = 5;

fn main() -> Result<()> {
    let folder = std::env::args().nth(1).context("usage: speed FOLDER")?;
    let folder = Path::new(&folder);
    let (points, map) = (read(&folder.join("points"))?, read(&folder.join("map"))?);
    let map = PointMap::new(map)?;
    let index = NearestNeighbors::new(map.points())?;
    let built = |options: &[&str]| {
        let options: Vec<String> = options.iter().map(|&option| option.to_owned()).collect();
        build_map(points.clone(), None, &options, &|| Ok(())).map(|_| ())
    };
    let mut measured = BTreeMap::new();
    measured.insert(
        "distances",
        median(|| {
            let nearest = |point| index.nearest(point).distance_squared.sqrt();
            let found: Vec<f64> = points.par_iter().map(nearest).collect();
            std::hint::black_box(found);
            Ok(())
        })?,
    );
    measured.insert(
        "likelihood",
        median(|| {
            mixture_log_likelihood(&PointSet::new(points.clone())?, &map, 0.05)?;
            Ok(())
        })?,
    );
    measured.insert("map: grid", median(|| built(&["--init=grid", "--cell=0.5"]))?);
    let fkm = ["--init=grid", "--cell=0.5", "--refine=fkm", "--tolerance=0", "--max-iterations=5"];
    measured.insert("map: fkm", median(|| built(&fkm))?);
    println!("{}", serde_json::to_string(&measured)?);
    Ok(())
}

/// The median time in seconds of some work.
fn median(work: impl Fn() -> Result<()>) -> Result<f64> {
    let mut seconds = Vec::new();
    for _ in 0..REPETITIONS {
        let since = Instant::now();
        work()?;
        seconds.push(since.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    Ok(seconds[REPETITIONS / 2])
}

fn read(path: &Path) -> Result<Vec<Point<2>>> {
    let bytes = std::fs::read(path)?;
    let numbers = bytes.as_chunks().0.iter().map(|&bytes| f64::from_le_bytes(bytes));
    let numbers: Vec<f64> = numbers.collect();
    Ok(numbers.as_chunks().0.to_vec())
}
