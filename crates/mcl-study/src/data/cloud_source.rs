//! Points without scans: from a point cloud file, the point clouds of a bag, or a simulated cloud.

use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_core::{Point, Seed};
use mcl_datasets::bag::{CloudOptions, is_in_range};
use mcl_datasets::log::{ReadReport, is_bag, is_bag_folder, read_clouds};
use mcl_datasets::registry::{Dataset, Facts, Origin, Registry};
use mcl_datasets::simulator::{LidarSettings, OfficeSettings, simulate_cloud};
use mcl_maps::files::read_cloud;
use sha2::{Digest, Sha256};

use crate::data::options::{SourceOptions, stem};

/// Points in their own dimension, or the requested one.
#[derive(Debug, Clone, PartialEq)]
pub enum Points {
    /// In the plane.
    Planar(Vec<Point<2>>),
    /// In space.
    Spatial(Vec<Point<3>>),
}

impl Points {
    /// 2 or 3.
    pub fn dimensions(&self) -> usize {
        match self {
            Points::Planar(_) => 2,
            Points::Spatial(_) => 3,
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        match self {
            Points::Planar(points) => points.len(),
            Points::Spatial(points) => points.len(),
        }
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Points without scans, opened under a name: maps can be built from them, but no robot can be localized.
#[derive(Debug, Clone)]
pub struct CloudSource {
    /// Name of the data set, or the file's name without its ending: names the results.
    pub name: String,
    /// Title for figures and tables.
    pub title: String,
    /// The points, in the file's order.
    pub points: Points,
    /// The kind of file.
    pub kind: &'static str,
    /// Number of clouds that were joined.
    pub clouds: usize,
    /// Points of the file, usable or not.
    pub readings: usize,
    /// Points left out because a coordinate was NaN or infinite.
    pub not_finite: usize,
    /// Largest distance from the origin of a cloud's frame that counts, in metres, inclusive; then points at
    /// the origin do not count either. `None`: all points count.
    pub max_range: Option<f64>,
    /// What was ignored or skipped of a bag.
    pub report: ReadReport,
    /// How a bag was read, a line each.
    pub notes: Vec<String>,
    /// What a bag leaves open, and what was assumed, a line each.
    pub assumptions: Vec<String>,
}

/// Points in space as returned by a reader.
#[derive(Default)]
struct ReadCloud {
    points: Vec<Point<3>>,
    /// The dimension they have.
    dimensions: usize,
    kind: &'static str,
    clouds: usize,
    readings: usize,
    not_finite: usize,
    report: ReadReport,
    notes: Vec<String>,
    assumptions: Vec<String>,
}

impl CloudSource {
    /// Opens a file: a point cloud (.ply, .pcd, .csv), or a bag with point clouds.
    ///
    /// # Errors
    /// When it cannot be read or holds no usable point.
    pub fn open(path: &Path, options: &SourceOptions) -> Result<Self> {
        let name = stem(path);
        let read = read(path, options.max_range, options)?;
        Self::new(name.clone(), name, read, options.max_range, options.dimensions)
    }

    /// Opens a data set of a registry that is a point cloud.
    ///
    /// # Errors
    /// When its file is not available or cannot be read.
    pub fn open_dataset(
        registry: &Registry,
        dataset: &Dataset,
        options: &SourceOptions,
    ) -> Result<Self> {
        let max_range = options.max_range.unwrap_or(dataset.max_range);
        let read = match &dataset.source {
            Origin::File(_) => read(&registry.locate(dataset)?, Some(max_range), options)?,
            Origin::Simulated { seed } => {
                // The lidar has the same range; its points are in the map's frame.
                let lidar = LidarSettings { max_range, ..LidarSettings::default() };
                let points = simulate_cloud(&OfficeSettings::default(), &lidar, Seed::new(*seed))?;
                let readings = points.len();
                let kind = "simulation";
                ReadCloud {
                    points,
                    dimensions: 3,
                    kind,
                    clouds: 1,
                    readings,
                    ..ReadCloud::default()
                }
            }
        };
        let (name, title) = (dataset.name.clone(), dataset.title.clone());
        Self::new(name, title, read, Some(max_range), options.dimensions)
    }

    fn new(
        name: String,
        title: String,
        read: ReadCloud,
        max_range: Option<f64>,
        dimensions: Option<usize>,
    ) -> Result<Self> {
        let ReadCloud {
            points,
            kind,
            clouds,
            readings,
            not_finite,
            report,
            notes,
            assumptions,
            ..
        } = read;
        if points.is_empty() {
            let range = max_range.map_or(String::new(), |m| format!(" with 0 < r ≤ {m} m"));
            bail!("{name}: no point is usable: none of {readings} is finite{range}");
        }
        let points = match dimensions.unwrap_or(read.dimensions) {
            2 => Points::Planar(points.into_iter().map(|[x, y, _]| [x, y]).collect()),
            _ => Points::Spatial(points),
        };
        Ok(CloudSource {
            name,
            title,
            points,
            kind,
            clouds,
            readings,
            not_finite,
            max_range,
            report,
            notes,
            assumptions,
        })
    }

    /// The facts of a data set that is a point cloud, computed from one of its files.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn facts(path: &Path, max_range: f64) -> Result<Facts> {
        let read = read(path, Some(max_range), &SourceOptions::default())?;
        Ok(Facts { scans: read.clouds, readings: read.readings, points: read.points.len() })
    }

    /// SHA-256 of the points, whatever the file they came from.
    pub fn digest(&self) -> String {
        let mut hash = Sha256::new();
        let mut number = |value: f64| hash.update(value.to_bits().to_le_bytes());
        match &self.points {
            Points::Planar(points) => points.iter().flatten().for_each(|&value| number(value)),
            Points::Spatial(points) => points.iter().flatten().for_each(|&value| number(value)),
        }
        number(self.points.dimensions() as f64);
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

fn read(path: &Path, max_range: Option<f64>, options: &SourceOptions) -> Result<ReadCloud> {
    if is_bag_folder(path) || is_bag(path)? {
        let cloud = CloudOptions {
            topic: options.cloud_topic.clone(),
            odometry: options.read.topics.odometry.clone(),
            max_range,
        };
        let found = read_clouds(path, &cloud)?;
        return Ok(ReadCloud {
            dimensions: dimensions(&found.points),
            kind: "ROS 2 bag, point clouds",
            clouds: found.clouds,
            readings: found.points.len() + found.not_finite + found.out_of_range,
            not_finite: found.not_finite,
            points: found.points,
            report: found.report,
            notes: found.notes,
            assumptions: found.assumptions,
        });
    }
    if options.cloud_topic.is_some() {
        bail!("{}: a point cloud file has no topics; leave out --cloud-topic", path.display());
    }
    let cloud = read_cloud(path)?;
    if options.dimensions == Some(3) && !cloud.has_z {
        bail!("{}: no column \"z\", which --dimensions 3 needs", path.display());
    }
    let (dimensions, not_finite) = (cloud.dimensions(), cloud.not_finite);
    let mut points = cloud.points;
    let readings = points.len() + not_finite;
    if let Some(max_range) = max_range {
        points.retain(|point| is_in_range(point, max_range));
    }
    let kind = "point cloud";
    Ok(ReadCloud {
        points,
        dimensions,
        kind,
        clouds: 1,
        readings,
        not_finite,
        ..ReadCloud::default()
    })
}

/// 3 when the points differ in height, else 2.
fn dimensions(points: &[Point<3>]) -> usize {
    if points.iter().any(|point| point[2] != points[0][2]) { 3 } else { 2 }
}

/// The usage error for a point cloud where a log is needed.
pub fn refuse_cloud<T>(name: &str) -> Result<T> {
    None.with_context(|| {
        format!(
            "{name} is a point cloud: it has no scans, poses or odometry; expected a laser log (CARMEN, or a ROS 2 \
             bag with LaserScan messages). Point clouds are accepted by inspect, map, likelihood and \
             studies without runs of the filter"
        )
    })
}
