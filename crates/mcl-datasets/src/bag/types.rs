//! Descriptions of the messages that are written, and of those read from bags without descriptions, as `.msg`
//! texts without comments.
//!
//! The fields are those of the packages `builtin_interfaces`, `std_msgs`, `geometry_msgs`,
//! `sensor_msgs`, `nav_msgs` and `tf2_msgs`, the same in every ROS 2 distribution so far.

/// A message type: its name, its fields, and the types that these use.
pub struct MessageType {
    /// `package/msg/Name`.
    pub name: &'static str,
    fields: &'static str,
    parts: &'static [&'static MessageType],
}

impl MessageType {
    /// [`MessageType::description`] for ROS 1, whose headers also have a sequence number.
    pub fn description_of_ros1(&self) -> String {
        let of_ros1 = |line: &str| match line {
            "builtin_interfaces/Time stamp" => "uint32 seq\ntime stamp\n".to_owned(),
            line => format!("{line}\n"),
        };
        self.description().lines().map(of_ros1).collect()
    }

    /// The description as stored in bags: the fields, then those of every type used, each once.
    pub fn description(&self) -> String {
        let mut text = self.fields.to_owned();
        let mut described: Vec<&str> = Vec::new();
        let mut queue: Vec<&MessageType> = self.parts.to_vec();
        while let Some(part) = (!queue.is_empty()).then(|| queue.remove(0)) {
            if described.contains(&part.name) {
                continue;
            }
            described.push(part.name);
            let name = part.name.replace("/msg/", "/");
            text += &format!("{}\nMSG: {name}\n{}", "=".repeat(80), part.fields);
            queue.extend(part.parts);
        }
        text
    }
}

/// The supported types, by their names without `msg`.
pub fn named(plain_name: &str) -> Option<&'static MessageType> {
    if plain_name == "tf/tfMessage" {
        return Some(&TF_MESSAGE);
    }
    let all = [
        &LASER_SCAN,
        &MULTI_ECHO_LASER_SCAN,
        &ODOMETRY,
        &POSE_STAMPED,
        &POSE_WITH_COVARIANCE_STAMPED,
        &TRANSFORM_STAMPED,
        &PATH,
        &TF_MESSAGE,
        &POINT_CLOUD2,
    ];
    all.into_iter().find(|message| message.name.replace("/msg/", "/") == plain_name)
}

/// `std_msgs/msg/String`
pub static STRING: MessageType =
    MessageType { name: "std_msgs/msg/String", fields: "string data\n", parts: &[] };

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

/// `sensor_msgs/msg/LaserEcho`
pub static LASER_ECHO: MessageType =
    MessageType { name: "sensor_msgs/msg/LaserEcho", fields: "float32[] echoes\n", parts: &[] };

/// `sensor_msgs/msg/MultiEchoLaserScan`
pub static MULTI_ECHO_LASER_SCAN: MessageType = MessageType {
    name: "sensor_msgs/msg/MultiEchoLaserScan",
    fields: "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\n\
             float32 angle_increment\nfloat32 time_increment\nfloat32 scan_time\n\
             float32 range_min\nfloat32 range_max\nLaserEcho[] ranges\nLaserEcho[] intensities\n",
    parts: &[&HEADER, &LASER_ECHO],
};

/// `nav_msgs/msg/Path`
pub static PATH: MessageType = MessageType {
    name: "nav_msgs/msg/Path",
    fields: "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n",
    parts: &[&HEADER, &POSE_STAMPED],
};

/// `geometry_msgs/msg/PoseWithCovarianceStamped`
pub static POSE_WITH_COVARIANCE_STAMPED: MessageType = MessageType {
    name: "geometry_msgs/msg/PoseWithCovarianceStamped",
    fields: "std_msgs/Header header\nPoseWithCovariance pose\n",
    parts: &[&HEADER, &POSE_WITH_COVARIANCE],
};

/// `geometry_msgs/msg/PoseArray`
pub static POSE_ARRAY: MessageType = MessageType {
    name: "geometry_msgs/msg/PoseArray",
    fields: "std_msgs/Header header\nPose[] poses\n",
    parts: &[&HEADER, &POSE],
};

/// `sensor_msgs/msg/PointField`
pub static POINT_FIELD: MessageType = MessageType {
    name: "sensor_msgs/msg/PointField",
    fields: "uint8 INT8 = 1\nuint8 UINT8 = 2\nuint8 INT16 = 3\nuint8 UINT16 = 4\n\
             uint8 INT32 = 5\nuint8 UINT32 = 6\nuint8 FLOAT32 = 7\nuint8 FLOAT64 = 8\n\
             string name\nuint32 offset\nuint8 datatype\nuint32 count\n",
    parts: &[],
};

/// `sensor_msgs/msg/PointCloud2`
pub static POINT_CLOUD2: MessageType = MessageType {
    name: "sensor_msgs/msg/PointCloud2",
    fields: "std_msgs/Header header\nuint32 height\nuint32 width\nPointField[] fields\n\
             bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\n\
             bool is_dense\n",
    parts: &[&HEADER, &POINT_FIELD],
};

/// `std_msgs/msg/Float64`
pub static FLOAT64: MessageType =
    MessageType { name: "std_msgs/msg/Float64", fields: "float64 data\n", parts: &[] };

#[cfg(test)]
mod tests {
    use super::super::schema::MessageSchema;
    use super::*;

    #[test]
    fn every_description_is_complete() {
        for name in [
            "sensor_msgs/LaserScan",
            "sensor_msgs/MultiEchoLaserScan",
            "sensor_msgs/PointCloud2",
            "nav_msgs/Odometry",
            "nav_msgs/Path",
            "tf/tfMessage",
            "geometry_msgs/PoseStamped",
            "geometry_msgs/PoseWithCovarianceStamped",
            "geometry_msgs/TransformStamped",
        ] {
            let message = named(name).unwrap();
            for (language, text, fields) in [
                ("ros2msg", message.description(), 2),
                ("ros1msg", message.description_of_ros1(), 3),
            ] {
                let schema = MessageSchema::parse(message.name, language, text.as_bytes()).unwrap();
                assert!(!schema.root().fields.is_empty());
                let count = text.split("MSG: std_msgs/Header\n").nth(1).unwrap();
                let count = count.lines().take_while(|line| !line.starts_with("===")).count();
                assert_eq!(count, fields, "{language}");
            }
        }
    }
}
