//! A map builder on its own: points in, a map of a twentieth of them out, as a file that viewers of point clouds open.

use mcl_maps::files::{Encoding, write_map};
use mcl_maps::{
    FkmSettings, GridOffset, InitialMap, MapSettings, MapSize, PointSet, RefineSettings, build_map,
    mixture_log_likelihood,
};

/// Standard deviation of a component of the mixture (m).
const SIGMA: f64 = 0.05;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The walls of a room of 6 m × 4 m, seen with an error of a few centimetres.
    let wall = |i: u32| {
        let along = f64::from(i) * 0.01;
        let error = 0.03 * (f64::from(i) * 2.4).sin();
        [
            [along % 6.0, error],
            [error, along % 4.0],
            [along % 6.0, 4.0 + error],
            [6.0 + error, along % 4.0],
        ]
    };
    let data = PointSet::new((0..1800).flat_map(wall).collect())?;
    let initial = InitialMap::GridSize { size: MapSize::Percent(5.0), offset: GridOffset::ORIGIN };
    for refinement in
        [None, Some(RefineSettings::fkm(FkmSettings { sigma: SIGMA, ..FkmSettings::default() }))]
    {
        let built = build_map(&data, &MapSettings { initial, refinement })?;
        let likelihood = mixture_log_likelihood(&data, &built.map, SIGMA)?;
        println!(
            "{} of {} points: {:.3} nats per point",
            built.map.len(),
            data.len(),
            likelihood.per_point
        );
        if refinement.is_some() {
            let path = std::env::temp_dir().join("room.ply");
            write_map(&path, &built.map, Encoding::Binary)?;
            println!("{}", path.display());
        }
    }
    Ok(())
}
