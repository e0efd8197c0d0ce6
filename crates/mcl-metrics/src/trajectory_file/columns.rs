//! Recognition of the columns of a table by their names.

use mcl_core::text::{list, printable};

/// Whether a text is a number, including NaN and infinity.
pub(super) fn is_number(text: &str) -> bool {
    text.trim().parse::<f64>().is_ok()
}

/// Indices of the columns that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Columns {
    pub time: Time,
    pub x: usize,
    pub y: usize,
    pub z: Option<usize>,
    pub heading: Heading,
    /// Whether the names are those of EuRoC.
    pub is_euroc: bool,
    /// Whether there is an angle besides the quaternion; the angle is not read.
    pub leaves_out_angle: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Time {
    /// One column, with the nanoseconds per unit if the name contains the unit.
    One { column: usize, unit: Option<i64> },
    /// Two columns: seconds, and the remaining nanoseconds.
    Two { seconds: usize, nanoseconds: usize },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Heading {
    Absent,
    Angle {
        column: usize,
        in_degrees: bool,
    },
    /// x, y, z, w.
    Quaternion([usize; 4]),
}

/// The meaning of a column name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Time { unit: Option<i64> },
    Seconds,
    Nanoseconds,
    Position(usize),
    Angle { in_degrees: bool },
    Quaternion(usize),
}

const POSITIONS: [&str; 9] =
    ["", "p", "t", "pos", "position", "translation", "trans", "p_rs_r", "xyz"];
const QUATERNIONS: [&str; 8] =
    ["q", "quat", "quaternion", "orientation", "rotation", "rot", "q_rs", "ori"];
const TIMES: [&str; 5] = ["t", "time", "stamp", "timestamp", "ts"];
const ANGLES: [&str; 4] = ["theta", "yaw", "heading", "th"];

/// A name in lower case without quotes, prefixes and unit, and its unit.
fn normalized(name: &str) -> (String, Option<String>) {
    let name = name.trim().trim_matches('"').trim_start_matches(['#', '%']).to_lowercase();
    let name = name.trim().replace(['/', ' '], ".");
    let (name, mut unit) = match name.find(['[', '(']) {
        Some(at) => {
            let unit = name[at..].trim_matches(['[', ']', '(', ')', '.']).to_owned();
            (name[..at].to_owned(), (!unit.is_empty()).then_some(unit))
        }
        None => (name, None),
    };
    let mut name = name.trim_matches('.').to_owned();
    for suffix in ["ns", "us", "µs", "ms", "s", "deg", "rad", "m"] {
        let shorter = name.strip_suffix(suffix).and_then(|name| name.strip_suffix('_'));
        if let Some(shorter) = shorter.map(str::to_owned) {
            unit.get_or_insert(suffix.to_owned());
            name = shorter;
            break;
        }
    }
    (name, unit)
}

fn role(name: &str) -> Option<Role> {
    let (name, unit) = normalized(name);
    let unit = unit.as_deref();
    let last = name.rsplit('.').next().unwrap_or_default();
    match last {
        // The nanoseconds beside a column of seconds, or the whole time.
        "nsec" | "nsecs" | "nanosec" | "nanosecs" | "nanoseconds" => {
            return Some(Role::Nanoseconds);
        }
        "sec" | "secs" | "seconds" => return Some(Role::Seconds),
        _ => {}
    }
    if TIMES.contains(&last) {
        let unit = match unit {
            Some("ns" | "nsec" | "nanoseconds") => Some(1),
            Some("us" | "µs" | "usec" | "microseconds") => Some(1000),
            Some("ms" | "msec" | "milliseconds") => Some(1_000_000),
            Some("s" | "sec" | "seconds") => Some(1_000_000_000),
            _ => None,
        };
        return Some(Role::Time { unit });
    }
    if ANGLES.contains(&last) {
        let in_degrees = unit.is_some_and(|unit| unit.starts_with("deg") || unit == "°");
        return Some(Role::Angle { in_degrees });
    }
    // `p_x`, `pose.position.x`, `qx`: the quantity and the axis.
    let axis = name.chars().last().and_then(|axis| "xyzw".find(axis))?;
    let of = name[..name.len() - 1].trim_end_matches(['.', '_']);
    let is_one_of = |names: &[&str]| {
        names.iter().any(|&known| {
            let before = of.strip_suffix(known);
            known == of || !known.is_empty() && before.is_some_and(|before| before.ends_with(['.']))
        })
    };
    if axis < 3 && is_one_of(&POSITIONS) {
        return Some(Role::Position(axis));
    }
    is_one_of(&QUATERNIONS).then_some(Role::Quaternion(axis))
}

impl Columns {
    /// Finds the columns of a table; the error is a sentence about what is missing or ambiguous.
    pub fn find(names: &[String]) -> Result<Self, String> {
        let roles: Vec<Option<Role>> = names.iter().map(|name| role(name)).collect();
        let all = |is: &dyn Fn(Role) -> bool| -> Vec<usize> {
            (0..roles.len()).filter(|&column| roles[column].is_some_and(is)).collect()
        };
        let at_most_one = |what: &str, is: &dyn Fn(Role) -> bool| match all(is)[..] {
            [] => Ok(None),
            [column] => Ok(Some(column)),
            ref several => {
                let names: Vec<_> = several.iter().map(|&k| shown(&names[k])).collect();
                Err(format!("{} could each be {what}", list(&names)))
            }
        };
        let one = |what: &str, expected: &str, is: &dyn Fn(Role) -> bool| {
            at_most_one(what, is)?
                .ok_or_else(|| format!("there is no column for {what} ({expected})"))
        };
        let position = |axis| move |role| role == Role::Position(axis);
        let [x, y] = [
            one("x", "x, position.x, p_x", &position(0))?,
            one("y", "y, position.y, p_y", &position(1))?,
        ];
        let z = at_most_one("z", &position(2))?;
        let mut quaternion = [None; 4];
        for (axis, letter) in ["x", "y", "z", "w"].into_iter().enumerate() {
            let what = format!("the {letter} of a quaternion");
            quaternion[axis] = at_most_one(&what, &|role| role == Role::Quaternion(axis))?;
        }
        let angle = at_most_one("the heading", &|role| matches!(role, Role::Angle { .. }))?;
        let heading = match (quaternion, angle) {
            ([Some(x), Some(y), Some(z), Some(w)], _) => Heading::Quaternion([x, y, z, w]),
            ([None, None, None, None], Some(column)) => {
                let in_degrees = roles[column] == Some(Role::Angle { in_degrees: true });
                Heading::Angle { column, in_degrees }
            }
            ([None, None, None, None], None) => Heading::Absent,
            _ => return Err("a quaternion needs four columns (qx, qy, qz, qw)".to_owned()),
        };
        let is_euroc = names.iter().any(|name| normalized(name).0 == "p_rs_r_x");
        let leaves_out_angle = angle.is_some() && matches!(heading, Heading::Quaternion(_));
        let time = time(names, &roles, &at_most_one)?;
        Ok(Columns { time, x, y, z, heading, is_euroc, leaves_out_angle })
    }
}

type AtMostOne<'a> = &'a dyn Fn(&str, &dyn Fn(Role) -> bool) -> Result<Option<usize>, String>;

fn time(
    names: &[String],
    roles: &[Option<Role>],
    at_most_one: AtMostOne<'_>,
) -> Result<Time, String> {
    let seconds = at_most_one("the seconds", &|role| role == Role::Seconds)?;
    let nanoseconds = at_most_one("the nanoseconds", &|role| role == Role::Nanoseconds)?;
    if let (Some(seconds), Some(nanoseconds)) = (seconds, nanoseconds) {
        return Ok(Time::Two { seconds, nanoseconds });
    }
    // A table exported from a topic has the time of recording and that of the message, which is used.
    let of_message = |column: &usize| names[*column].to_lowercase().contains("header");
    let mut times: Vec<usize> =
        (0..roles.len()).filter(|&k| matches!(roles[k], Some(Role::Time { .. }))).collect();
    if let Some(of_message) = times.iter().copied().find(of_message) {
        times = vec![of_message];
    }
    let column = match (&times[..], seconds, nanoseconds) {
        (&[column], _, _) => column,
        ([], Some(column), None) => return Ok(Time::One { column, unit: Some(1_000_000_000) }),
        ([], None, Some(column)) => return Ok(Time::One { column, unit: Some(1) }),
        ([], _, _) => {
            return Err(
                "there is no column for the time (t, time, stamp, timestamp, sec and nsec)".into(),
            );
        }
        (several, _, _) => {
            let names: Vec<_> = several.iter().map(|&k| shown(&names[k])).collect();
            return Err(format!("{} could each be the time", list(&names)));
        }
    };
    match roles[column] {
        Some(Role::Time { unit }) => Ok(Time::One { column, unit }),
        _ => Ok(Time::One { column, unit: None }),
    }
}

/// A name for messages, truncated because a broken file can have very long ones.
pub(super) fn shown(name: &str) -> String {
    let start: String = name.trim().chars().take(40).collect();
    printable(&start).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(names: &str) -> Result<Columns, String> {
        let names: Vec<String> = names.split(',').map(str::to_owned).collect();
        Columns::find(&names)
    }

    fn time(names: &str) -> Time {
        find(names).unwrap().time
    }

    #[test]
    fn usual_names_are_known() {
        let angle = |column| Heading::Angle { column, in_degrees: false };
        for (names, expected) in [
            ("t,x,y,theta", angle(3)),
            ("Time,X,Y,Yaw", angle(3)),
            ("timestamp [s],p_x [m],p_y [m],heading [rad]", angle(3)),
            ("stamp,tx,ty,yaw_rad", angle(3)),
            ("t,pos_x,pos_y,yaw (deg)", Heading::Angle { column: 3, in_degrees: true }),
            ("t,position.x,position.y", Heading::Absent),
            ("t,x,y,qw,qx,qy,qz", Heading::Quaternion([4, 5, 6, 3])),
            ("t,x,y,q_x,q_y,q_z,q_w", Heading::Quaternion([3, 4, 5, 6])),
            (
                "stamp,pose.position.x,pose.position.y,pose.orientation.x,pose.orientation.y,pose.orientation.z,pose.orientation.w",
                Heading::Quaternion([3, 4, 5, 6]),
            ),
            ("t,/odom/pose/pose/position/x,/odom/pose/pose/position/y", Heading::Absent),
        ] {
            let found = find(names).unwrap_or_else(|problem| panic!("{names}: {problem}"));
            assert_eq!((found.x, found.y, found.heading), (1, 2, expected), "{names}");
        }
    }

    #[test]
    fn velocities_covariances_and_others_are_not_positions() {
        let found = find(
            "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.pose.position.x,\
             field.pose.pose.position.y,field.pose.pose.position.z,field.pose.pose.orientation.x,\
             field.pose.pose.orientation.y,field.pose.pose.orientation.z,field.pose.pose.orientation.w,\
             field.pose.covariance0,field.twist.twist.linear.x,field.twist.twist.angular.z",
        )
        .unwrap();
        assert_eq!(found.time, Time::One { column: 2, unit: None });
        assert_eq!((found.x, found.y, found.z), (4, 5, Some(6)));
        assert_eq!(found.heading, Heading::Quaternion([7, 8, 9, 10]));
        let euroc = find(
            "timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], \
             q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], b_w_RS_S_x [rad s^-1]",
        )
        .unwrap();
        assert!(euroc.is_euroc);
        assert_eq!(euroc.time, Time::One { column: 0, unit: Some(1) });
        assert_eq!(euroc.heading, Heading::Quaternion([5, 6, 7, 4]));
    }

    #[test]
    fn times_have_units_in_their_names_or_not() {
        let one = |unit| Time::One { column: 0, unit };
        for (name, unit) in [
            ("t", None),
            ("time_ns", Some(1)),
            ("timestamp [us]", Some(1000)),
            ("time(ms)", Some(1_000_000)),
            ("time_s", Some(1_000_000_000)),
            ("seconds", Some(1_000_000_000)),
            ("nanoseconds", Some(1)),
        ] {
            assert_eq!(time(&format!("{name},x,y")), one(unit), "{name}");
        }
        assert_eq!(
            time("x,y,header.stamp.sec,header.stamp.nanosec"),
            Time::Two { seconds: 2, nanoseconds: 3 }
        );
    }

    #[test]
    fn missing_and_ambiguous_columns_are_named() {
        for (names, problem) in [
            ("t,y,theta", "there is no column for x (x, position.x, p_x)"),
            ("x,y", "there is no column for the time (t, time, stamp, timestamp, sec and nsec)"),
            ("t,x,y,position.x", "x, position.x could each be x"),
            ("t,timestamp,x,y", "t, timestamp could each be the time"),
            ("t,x,y,qx,qy,qz", "a quaternion needs four columns (qx, qy, qz, qw)"),
            ("t,x,y,yaw,theta", "yaw, theta could each be the heading"),
        ] {
            assert_eq!(find(names).unwrap_err(), problem, "{names}");
        }
        assert!(find("t,x,y,yaw,qx,qy,qz,qw").unwrap().leaves_out_angle);
    }
}
