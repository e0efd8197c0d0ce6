//! Descriptions of the ROS 2 messages that are written, as `.msg` texts without their comments.
//!
//! The fields are those of the packages `builtin_interfaces`, `std_msgs`, `geometry_msgs`,
//! `sensor_msgs`, `nav_msgs` and `tf2_msgs`, the same in every ROS 2 distribution so far.

/// A message type: its name, its fields, and the types these are of.
pub struct MessageType {
    /// `package/msg/Name`.
    pub name: &'static str,
    fields: &'static str,
    parts: &'static [&'static MessageType],
}

impl MessageType {
    /// The description as bags carry it: the fields, then those of every type they hold, each once.
    pub fn description(&self) -> String {
        let mut text = self.fields.to_owned();
        let mut told: Vec<&str> = Vec::new();
        let mut queue: Vec<&MessageType> = self.parts.to_vec();
        while let Some(part) = (!queue.is_empty()).then(|| queue.remove(0)) {
            if told.contains(&part.name) {
                continue;
            }
            told.push(part.name);
            let name = part.name.replace("/msg/", "/");
            text += &format!("{}\nMSG: {name}\n{}", "=".repeat(80), part.fields);
            queue.extend(part.parts);
        }
        text
    }
}

/// `builtin_interfaces/msg/Time`
pub static TIME: MessageType = MessageType {
    name: "builtin_interfaces/msg/Time",
    fields: "int32 sec\nuint32 nanosec\n",
    parts: &[],
};

/// `std_msgs/msg/Header`
pub static HEADER: MessageType = MessageType {
    name: "std_msgs/msg/Header",
    fields: "builtin_interfaces/Time stamp\nstring frame_id\n",
    parts: &[&TIME],
};

/// `geometry_msgs/msg/Point`
pub static POINT: MessageType = MessageType {
    name: "geometry_msgs/msg/Point",
    fields: "float64 x\nfloat64 y\nfloat64 z\n",
    parts: &[],
};

/// `geometry_msgs/msg/Vector3`
pub static VECTOR3: MessageType = MessageType {
    name: "geometry_msgs/msg/Vector3",
    fields: "float64 x\nfloat64 y\nfloat64 z\n",
    parts: &[],
};

/// `geometry_msgs/msg/Quaternion`
pub static QUATERNION: MessageType = MessageType {
    name: "geometry_msgs/msg/Quaternion",
    fields: "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    parts: &[],
};

/// `geometry_msgs/msg/Pose`
pub static POSE: MessageType = MessageType {
    name: "geometry_msgs/msg/Pose",
    fields: "Point position\nQuaternion orientation\n",
    parts: &[&POINT, &QUATERNION],
};

/// `geometry_msgs/msg/PoseStamped`
pub static POSE_STAMPED: MessageType = MessageType {
    name: "geometry_msgs/msg/PoseStamped",
    fields: "std_msgs/Header header\nPose pose\n",
    parts: &[&HEADER, &POSE],
};

/// `geometry_msgs/msg/PoseWithCovariance`
pub static POSE_WITH_COVARIANCE: MessageType = MessageType {
    name: "geometry_msgs/msg/PoseWithCovariance",
    fields: "Pose pose\nfloat64[36] covariance\n",
    parts: &[&POSE],
};

/// `geometry_msgs/msg/Twist`
pub static TWIST: MessageType = MessageType {
    name: "geometry_msgs/msg/Twist",
    fields: "Vector3 linear\nVector3 angular\n",
    parts: &[&VECTOR3],
};

/// `geometry_msgs/msg/TwistWithCovariance`
pub static TWIST_WITH_COVARIANCE: MessageType = MessageType {
    name: "geometry_msgs/msg/TwistWithCovariance",
    fields: "Twist twist\nfloat64[36] covariance\n",
    parts: &[&TWIST],
};

/// `geometry_msgs/msg/Transform`
pub static TRANSFORM: MessageType = MessageType {
    name: "geometry_msgs/msg/Transform",
    fields: "Vector3 translation\nQuaternion rotation\n",
    parts: &[&VECTOR3, &QUATERNION],
};

/// `geometry_msgs/msg/TransformStamped`
pub static TRANSFORM_STAMPED: MessageType = MessageType {
    name: "geometry_msgs/msg/TransformStamped",
    fields: "std_msgs/Header header\nstring child_frame_id\nTransform transform\n",
    parts: &[&HEADER, &TRANSFORM],
};

/// `tf2_msgs/msg/TFMessage`
pub static TF_MESSAGE: MessageType = MessageType {
    name: "tf2_msgs/msg/TFMessage",
    fields: "geometry_msgs/TransformStamped[] transforms\n",
    parts: &[&TRANSFORM_STAMPED],
};

/// `nav_msgs/msg/Odometry`
pub static ODOMETRY: MessageType = MessageType {
    name: "nav_msgs/msg/Odometry",
    fields: "std_msgs/Header header\nstring child_frame_id\n\
             geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    parts: &[&HEADER, &POSE_WITH_COVARIANCE, &TWIST_WITH_COVARIANCE],
};

/// `sensor_msgs/msg/LaserScan`
pub static LASER_SCAN: MessageType = MessageType {
    name: "sensor_msgs/msg/LaserScan",
    fields: "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\n\
             float32 angle_increment\nfloat32 time_increment\nfloat32 scan_time\n\
             float32 range_min\nfloat32 range_max\nfloat32[] ranges\nfloat32[] intensities\n",
    parts: &[&HEADER],
};

#[cfg(test)]
mod tests {
    use super::super::schema::MessageSchema;
    use super::*;

    #[test]
    fn every_description_is_complete() {
        for message in [&LASER_SCAN, &ODOMETRY, &TF_MESSAGE, &POSE_STAMPED] {
            let text = message.description();
            let schema = MessageSchema::parse(message.name, "ros2msg", text.as_bytes()).unwrap();
            assert!(!schema.root().fields.is_empty());
        }
    }
}
