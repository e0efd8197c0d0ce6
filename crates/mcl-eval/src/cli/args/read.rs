use clap::Args;
use mcl_core::Pose2;
use mcl_datasets::log::{LaserPose, ReadOptions, TopicChoice};
use mcl_study::data::options::{ReferenceSource, SourceOptions};

use super::{numbers, positive};

/// What the content of a log or bag leaves open.
#[derive(Debug, Args)]
pub struct ReadArgs {
    /// Where the ground truth is from: auto (decided from the log; of a bag a topic of reference poses, if there
    /// is one), recorded (the laser poses in the log; of a bag: insist on a topic), none, or a file: TUM, a
    /// bag, a CARMEN log.
    #[arg(long, value_name = "WHICH|FILE")]
    pub reference: Option<ReferenceSource>,
    /// Topic of the reference poses in the bag, or in the bag that --reference names: PoseStamped,
    /// PoseWithCovarianceStamped, TransformStamped, Odometry or Path, or two frames as /tf:map.base_link
    /// [default: the only topic of poses but estimates, or the one named as ground truth].
    #[arg(long, value_name = "TOPIC")]
    pub reference_topic: Option<String>,
    /// Whose poses the reference has: robot, laser, or the name of a frame of the bag [default: as its topic
    /// says, else robot].
    #[arg(long, value_name = "WHOSE")]
    pub reference_frame: Option<String>,
    /// Topic of a bag's scans [default: the only LaserScan or MultiEchoLaserScan topic, or /scan]. Of a
    /// CARMEN log, the kind of its records: RLASER, ROBOTLASER2.
    #[arg(long, value_name = "TOPIC")]
    pub scan_topic: Option<String>,
    /// Topic of a bag's odometry [default: the only Odometry topic, or /odom].
    #[arg(long, value_name = "TOPIC")]
    pub odom_topic: Option<String>,
    /// Make scans of a bag's point clouds: of the points between two heights in the robot's frame, in metres.
    #[arg(long, value_name = "Z1,Z2", value_parser = heights, allow_hyphen_values = true)]
    pub slice: Option<[f64; 2]>,
    /// The robot's frame in a bag [default: that of the odometry, or what the laser moves with].
    #[arg(long, value_name = "FRAME")]
    pub base_frame: Option<String>,
    /// The frame of the odometry in a bag that has it in /tf alone [default: the parent of the robot's].
    #[arg(long, value_name = "FRAME")]
    pub odom_frame: Option<String>,
    /// Where the laser is on the robot of a bag, in metres and radians, whatever its transforms say; with a
    /// roll of 3.14159 it is upside down.
    #[arg(long, value_name = "X,Y,THETA[,ROLL]", value_parser = laser_pose, allow_hyphen_values = true)]
    pub laser_pose: Option<LaserPose>,
    /// Take the beams of a scan as measured at once, although the bag says how long a scan takes.
    #[arg(long)]
    pub no_deskew: bool,
    /// Interpolate between two poses of odometry or reference that are at most so many seconds apart
    /// [default: five usual intervals, at least 0.2].
    #[arg(long, value_name = "S", value_parser = positive)]
    pub longest_gap: Option<f64>,
}

impl ReadArgs {
    pub fn options(&self, max_range: Option<f64>) -> SourceOptions {
        let topics = TopicChoice {
            scan: self.scan_topic.clone(),
            odometry: self.odom_topic.clone(),
            reference: self.reference_topic.clone(),
        };
        let read = ReadOptions {
            topics,
            slice: self.slice.map(|[low, high]| (low, high)),
            base_frame: self.base_frame.clone(),
            odometry_frame: self.odom_frame.clone(),
            reference_frame: self.reference_frame.clone(),
            laser_pose: self.laser_pose,
            longest_gap: self.longest_gap,
            no_deskew: self.no_deskew,
            ..ReadOptions::default()
        };
        let reference = self.reference.clone();
        SourceOptions { max_range, reference, read, ..SourceOptions::default() }
    }

    /// The file of the reference, if it is one of its own.
    pub fn reference_file(&self) -> Option<&str> {
        match &self.reference {
            Some(ReferenceSource::File(path)) => path.to_str(),
            _ => None,
        }
    }
}

fn heights(text: &str) -> Result<[f64; 2], String> {
    let [low, high] = numbers(text)?;
    match low < high {
        true => Ok([low, high]),
        false => Err("expected a height and a greater one".to_owned()),
    }
}

fn laser_pose(text: &str) -> Result<LaserPose, String> {
    let ([x, y, theta], roll) = match text.matches(',').count() {
        3 => numbers(text).map(|[x, y, theta, roll]| ([x, y, theta], roll))?,
        _ => (numbers(text)?, 0.0),
    };
    Ok(LaserPose { robot_from_laser: Pose2::new(x, y, theta), roll })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mounts_and_heights() {
        let mount = laser_pose("0.1,-0.2,1.5").unwrap();
        assert_eq!((mount.robot_from_laser, mount.roll), (Pose2::new(0.1, -0.2, 1.5), 0.0));
        assert_eq!(laser_pose("0,0,0,2.5").unwrap().roll, 2.5);
        for text in ["0,0", "0,0,0,0,0", "0,0,x", ""] {
            assert!(laser_pose(text).is_err(), "{text}");
        }
        assert_eq!(heights("-0.2,1"), Ok([-0.2, 1.0]));
        assert!(heights("1,0").is_err() && heights("1").is_err());
    }
}
