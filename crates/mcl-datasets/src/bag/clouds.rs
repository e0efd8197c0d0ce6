//! The point clouds of one topic of a bag, joined in one frame.

use mcl_core::Point;
use mcl_core::text::counted;
use nalgebra::Point3;

use super::content::{Content, MessageKind, Purpose};
use super::decoder::{Decoder, Logged, same_frame, time, tree};
use super::error::BagError;
use super::moment::{Moment, Stretches};
use super::motion::Motion;
use super::point_cloud::CloudMessage;
use super::topics::{cloud_topic, odometry_topic, transform_topics};
use crate::log::report::ReadReport;

/// How to read the clouds of a bag.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CloudOptions {
    /// Topic of the clouds (`sensor_msgs/PointCloud2`), where there are several.
    pub topic: Option<String>,
    /// Topic of the odometry, where there are several and `/tf` does not hold the same poses.
    pub odometry: Option<String>,
    /// Only points with `0 < r ≤ max_range` (m) from the origin of their own frame are taken.
    pub max_range: Option<f64>,
}

/// The point clouds of one topic of a bag.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct BagCloud {
    /// The topic.
    pub topic: String,
    /// The frame of the points.
    pub frame: String,
    /// Number of clouds joined.
    pub clouds: usize,
    /// The points in metres, cloud by cloud in the bag's order.
    pub points: Vec<Point<3>>,
    /// Points left out because a coordinate was NaN or infinite.
    pub not_finite: usize,
    /// Points left out because of their range.
    pub out_of_range: usize,
    /// What was skipped.
    pub report: ReadReport,
    /// How the bag was read, a line each.
    pub notes: Vec<String>,
    /// What the bag leaves open, and what was assumed, a line each.
    pub assumptions: Vec<String>,
}

/// Empty content, prepared for reading clouds.
pub(crate) fn content(options: &CloudOptions) -> Content {
    Content::new(Purpose::Clouds, options.topic.as_deref())
}

pub(crate) fn join(mut content: Content, options: &CloudOptions) -> Result<BagCloud, BagError> {
    let messages = std::mem::take(&mut content.messages);
    let content = &content;
    let topic = cloud_topic(content, options.topic.as_deref())?;
    let mut decoder = Decoder::new(content, messages);
    let mut frame: Option<String> = None;
    let clouds = decoder.topic(
        |name, kind| name == topic && kind == MessageKind::Cloud,
        |_, view, _, _| {
            let cloud = CloudMessage::new(view, options.max_range)?;
            same_frame("header.frame_id", &mut frame, &cloud.header.frame)?;
            Ok(cloud)
        },
    )?;
    let frame = match frame {
        Some(frame) => frame,
        None => {
            let because = (!decoder.report.is_complete()).then(|| decoder.report.to_string());
            return Err(BagError::NoCloud { topics: content.list(), because });
        }
    };
    let motion = motion(&mut decoder, content, topic, options.odometry.as_deref())?;
    let joined = BagCloud {
        topic: topic.to_owned(),
        frame,
        clouds: clouds.len(),
        points: Vec::new(),
        not_finite: clouds.iter().map(|cloud| cloud.value.not_finite).sum(),
        out_of_range: clouds.iter().map(|cloud| cloud.value.out_of_range).sum(),
        report: decoder.report,
        notes: vec![format!("point clouds: {topic}, {}", counted(clouds.len(), "message"))],
        assumptions: Vec::new(),
    };
    joined.with(clouds, &motion)
}

impl BagCloud {
    /// Transforms the clouds into one frame.
    ///
    /// Where transforms lead to a frame in which the scanner moves, each cloud is placed at the scanner's
    /// pose at its stamp. Clouds in a fixed frame are left as they are. A single cloud needs no pose.
    fn with(
        mut self,
        clouds: Vec<Logged<CloudMessage>>,
        motion: &Motion,
    ) -> Result<Self, BagError> {
        let chain = motion.chain(&self.frame);
        let refused = |why: String| BagError::NoPlace {
            topic: self.topic.clone(),
            clouds: clouds.len(),
            frame: self.frame.clone(),
            why,
        };
        if !chain.moves() {
            if clouds.len() > 1 && !motion.is_fixed(chain.root) {
                return Err(refused("nothing says where the scanner was at each".to_owned()));
            }
            self.notes.push(format!("points in frame {:?}, as they are", self.frame));
            self.points = clouds.into_iter().flat_map(|cloud| cloud.value.points).collect();
            return Ok(self);
        }
        let placed = |cloud: &Logged<CloudMessage>| {
            let at = time(cloud.value.header.stamp, cloud.log_time);
            chain.root_from_frame(Moment { stretch: 0, at })
        };
        let outside = clouds.iter().filter(|cloud| placed(cloud).is_none()).count();
        if outside == clouds.len() && outside > 1 {
            return Err(refused(format!(
                "all lie before the first or after the last transform between {:?} and {:?}",
                chain.root, self.frame
            )));
        }
        if outside == clouds.len() {
            self.assumptions.push(format!(
                "no transform covers the time of the cloud, so its points are in frame {:?}",
                self.frame
            ));
            self.points = clouds.into_iter().flat_map(|cloud| cloud.value.points).collect();
            return Ok(self);
        }
        if outside > 0 {
            self.assumptions.push(format!(
                "clouds before the first or after the last transform: {outside}; nothing is extrapolated, so they are left out"
            ));
            self.clouds -= outside;
        }
        for cloud in clouds {
            let Some(root_from_frame) = placed(&cloud) else { continue };
            let place = |[x, y, z]: Point<3>| {
                let placed = root_from_frame * Point3::new(x, y, z);
                [placed.x, placed.y, placed.z]
            };
            self.points.extend(cloud.value.points.into_iter().map(place));
        }
        self.notes.push(format!("points in frame {:?}, from frame {:?}", chain.root, self.frame));
        self.frame = chain.root.to_owned();
        Ok(self)
    }
}

/// The frames of a bag over time: from `/tf_static` and `/tf`, and from the odometry where `/tf` does not
/// have its frame.
fn motion<'a>(
    decoder: &mut Decoder<'a>,
    content: &'a Content,
    cloud_topic: &str,
    odometry: Option<&str>,
) -> Result<Motion, BagError> {
    let topics = transform_topics(content, Some(cloud_topic));
    let transforms = decoder.transforms(&topics)?;
    let mut motion = tree(&transforms, &Stretches::default());
    if let Some(topic) = odometry_topic(content, odometry)? {
        let mut poses = decoder.odometry(topic)?;
        poses.retain(|pose| !pose.value.child.is_empty() && !motion.contains(&pose.value.child));
        for Logged { value, log_time, .. } in poses {
            let at = time(value.header.stamp, log_time);
            motion.insert(value, Moment { stretch: 0, at }, false, topic);
        }
    }
    motion.sort(None);
    Ok(motion)
}
