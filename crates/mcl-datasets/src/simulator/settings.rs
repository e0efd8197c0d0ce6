use std::f64::consts::{FRAC_PI_2, TAU};

use mcl_core::ScanGeometry;
use serde::{Deserialize, Serialize};

/// Why an office cannot be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// A setting lies outside its range.
    #[error("{field} is {value}, expected {expected}")]
    Setting {
        /// The setting, with its table (`laser.beams`).
        field: &'static str,
        /// The value found.
        value: f64,
        /// What is accepted, with the unit.
        expected: &'static str,
    },
}

/// Settings of the simulated office; the default is the default data set.
///
/// Missing fields take their default when read from a file, unknown ones are errors. Ranges are
/// checked by [`OfficeSettings::validate`], which [`simulate`](super::simulate) calls.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OfficeSettings {
    /// Number of pieces of furniture tried per square metre of floor; a piece that does not fit is left out.
    pub furniture_density: f64,
    /// Number of people who walk around.
    pub people: usize,
    /// How the robot drives, and when a scan is logged.
    pub drive: DriveSettings,
    /// The laser range finder.
    pub laser: LaserSettings,
    /// The wheel odometry.
    pub odometry: OdometrySettings,
}

/// How the robot drives, and when a scan is logged.
///
/// A scan is logged like SLAM programs log them: the scanner turns all the time, and a scan is
/// kept when the robot has moved or turned far enough since the last one kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DriveSettings {
    /// Speed on straight lines and wide curves, in m/s.
    pub speed: f64,
    /// Turn rate on the spot and in tight curves, in rad/s.
    pub turn_rate: f64,
    /// Time from one sweep of the scanner to the next, in s; rounded to whole milliseconds.
    pub scan_period: f64,
    /// A sweep is logged at this distance from the last one logged, in m.
    pub scan_distance: f64,
    /// A sweep is logged when the heading differs by this much from the last one logged, in rad.
    pub scan_angle: f64,
    /// Stamp of the first scan, in s; rounded to whole milliseconds.
    pub start_time: f64,
}

/// The laser range finder; the default resembles the Intel log's SICK LMS.
///
/// A beam is lost (drop-out), or continues until a surface returns it, glass only sometimes. Something
/// unmapped may return it before. Noise and rounding come last; a range that is then not within `max_range`
/// is no return.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LaserSettings {
    /// Beams per scan.
    pub beams: usize,
    /// Direction of beam 0 in the laser's frame, in rad.
    pub start_angle: f64,
    /// Angle from one beam to the next, in rad.
    pub angle_step: f64,
    /// Longest range the scanner measures, in m.
    pub max_range: f64,
    /// The value logged when nothing is detected, in m; beyond `max_range`.
    pub no_return: f64,
    /// Standard deviation σ of the Gaussian range noise, in m.
    pub range_noise: f64,
    /// Readings are rounded to multiples of this, in m; 0 leaves them as they are.
    pub resolution: f64,
    /// Probability that a reading is lost.
    pub dropout_probability: f64,
    /// Probability that something unmapped (a person, dust) returns the beam before the building does, at a
    /// range uniform between 0 and that of the building.
    pub short_probability: f64,
    /// Probability that a pane of glass returns a beam at normal incidence.
    pub glass_return: f64,
    /// Exponent *n* of the pane's return for a beam at the angle of incidence *i*: the probability is
    /// `glass_return · cosⁿ(i)`. Glass is a mirror: light comes back only near the normal.
    pub glass_exponent: f64,
}

/// Errors of the odometry, per logged step.
///
/// With (Δx, Δy, Δθ) the true increment, the logged one is the true one followed by the error
/// ```text
/// e_x = translation_scale·Δx                     + N(0, noise_translation²)
/// e_y = sideways_drift·Δx + turn_slip·Δθ         + N(0, noise_translation²)
/// e_θ = heading_drift·Δx  + rotation_scale·Δθ    + N(0, noise_rotation²)
/// ```
/// in the frame of the true new pose. The defaults are the least-squares fit of this model to the
/// 909 steps of the corrected Intel Research Lab log, whose errors have means (1.4 cm, −2.3 cm,
/// −1.8°) and RMS (4.1 cm, 5.2 cm, 3.5°).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OdometrySettings {
    /// Distance logged in excess, per metre driven.
    pub translation_scale: f64,
    /// Drift to the left, in m per metre driven.
    pub sideways_drift: f64,
    /// Slip to the left, in m per radian turned.
    pub turn_slip: f64,
    /// Drift of the heading, in rad per metre driven.
    pub heading_drift: f64,
    /// Rotation logged in excess, per radian turned.
    pub rotation_scale: f64,
    /// Standard deviation of the Gaussian noise of a step along and across, in m.
    pub noise_translation: f64,
    /// Standard deviation of the Gaussian noise of a step's heading, in rad.
    pub noise_rotation: f64,
}

impl Default for OfficeSettings {
    fn default() -> Self {
        OfficeSettings {
            furniture_density: 0.8,
            people: 0,
            drive: DriveSettings::default(),
            laser: LaserSettings::default(),
            odometry: OdometrySettings::default(),
        }
    }
}

impl Default for DriveSettings {
    fn default() -> Self {
        DriveSettings {
            speed: 0.4,
            turn_rate: 0.6,
            scan_period: 0.2,
            scan_distance: 0.92,
            scan_angle: 0.46,
            start_time: 30.0,
        }
    }
}

impl Default for LaserSettings {
    fn default() -> Self {
        LaserSettings {
            beams: 180,
            start_angle: -FRAC_PI_2,
            angle_step: 1f64.to_radians(),
            max_range: 80.0,
            no_return: 81.83,
            range_noise: 0.015,
            resolution: 0.01,
            dropout_probability: 0.025,
            short_probability: 0.003,
            glass_return: 0.9,
            glass_exponent: 4.0,
        }
    }
}

impl Default for OdometrySettings {
    fn default() -> Self {
        OdometrySettings {
            translation_scale: 0.035,
            sideways_drift: -0.028,
            turn_slip: -0.093,
            heading_drift: -0.063,
            rotation_scale: 0.022,
            noise_translation: 0.033,
            noise_rotation: 0.042,
        }
    }
}

impl LaserSettings {
    /// Directions of the beams.
    pub fn geometry(&self) -> ScanGeometry {
        ScanGeometry {
            start_angle: self.start_angle,
            angle_step: self.angle_step,
            beams: self.beams,
        }
    }
}

impl OfficeSettings {
    /// Checks every setting. The limits keep the recording finite and of a size that fits into memory; within
    /// them, every value is simulated unchanged.
    ///
    /// # Errors
    /// [`SimulationError::Setting`] with the first setting that is out of range.
    pub fn validate(&self) -> Result<(), SimulationError> {
        within("furniture_density", self.furniture_density, 0.0, 10.0, "0 to 10 pieces per m²")?;
        within("people", self.people as f64, 0.0, 1000.0, "0 to 1000 people")?;

        let drive = &self.drive;
        within("drive.speed", drive.speed, 0.01, 10.0, "0.01 to 10 m/s")?;
        within("drive.turn_rate", drive.turn_rate, 0.01, 10.0, "0.01 to 10 rad/s")?;
        within("drive.scan_period", drive.scan_period, 0.001, 60.0, "0.001 to 60 s")?;
        within("drive.scan_distance", drive.scan_distance, 0.05, 100.0, "0.05 to 100 m")?;
        within("drive.scan_angle", drive.scan_angle, 0.02, TAU, "0.02 to 2π rad")?;
        within("drive.start_time", drive.start_time, 0.0, 4e9, "0 to 4·10⁹ s")?;

        let laser = &self.laser;
        let beams = laser.beams as f64;
        within("laser.beams", beams, 1.0, 3600.0, "1 to 3600 beams")?;
        within("laser.start_angle", laser.start_angle, -TAU, TAU, "−2π to 2π rad")?;
        let expected = "−2π to 2π rad, and less than one turn over all beams";
        within("laser.angle_step", laser.angle_step, -TAU, TAU, expected)?;
        within("laser.angle_step", laser.angle_step * (beams - 1.0), -TAU, TAU, expected)?;
        within("laser.max_range", laser.max_range, 0.1, 1000.0, "0.1 to 1000 m")?;
        if !(laser.no_return.is_finite() && laser.no_return > laser.max_range) {
            return Err(SimulationError::Setting {
                field: "laser.no_return",
                value: laser.no_return,
                expected: "a finite number of metres above laser.max_range",
            });
        }
        within("laser.range_noise", laser.range_noise, 0.0, 10.0, "0 to 10 m")?;
        within("laser.resolution", laser.resolution, 0.0, 1.0, "0 to 1 m")?;
        let expected = "a probability, 0 to 1";
        within("laser.dropout_probability", laser.dropout_probability, 0.0, 1.0, expected)?;
        within("laser.short_probability", laser.short_probability, 0.0, 1.0, expected)?;
        within("laser.glass_return", laser.glass_return, 0.0, 1.0, expected)?;
        within("laser.glass_exponent", laser.glass_exponent, 0.0, 100.0, "0 to 100")?;

        let odometry = &self.odometry;
        let expected = "−1 to 1 m/m";
        within("odometry.translation_scale", odometry.translation_scale, -1.0, 1.0, expected)?;
        within("odometry.sideways_drift", odometry.sideways_drift, -1.0, 1.0, expected)?;
        within("odometry.turn_slip", odometry.turn_slip, -1.0, 1.0, "−1 to 1 m/rad")?;
        within("odometry.heading_drift", odometry.heading_drift, -1.0, 1.0, "−1 to 1 rad/m")?;
        within("odometry.rotation_scale", odometry.rotation_scale, -1.0, 1.0, "−1 to 1 rad/rad")?;
        within("odometry.noise_translation", odometry.noise_translation, 0.0, 10.0, "0 to 10 m")?;
        within("odometry.noise_rotation", odometry.noise_rotation, 0.0, TAU, "0 to 2π rad")
    }
}

/// Limits are inclusive; NaN is in no range.
fn within(
    field: &'static str,
    value: f64,
    min: f64,
    max: f64,
    expected: &'static str,
) -> Result<(), SimulationError> {
    if (min..=max).contains(&value) {
        Ok(())
    } else {
        Err(SimulationError::Setting { field, value, expected })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_out_of_range_is_named() {
        let field_of = |edit: fn(&mut OfficeSettings)| {
            let mut settings = OfficeSettings::default();
            edit(&mut settings);
            match settings.validate() {
                Err(SimulationError::Setting { field, .. }) => field,
                Ok(()) => panic!("{settings:?} was accepted"),
            }
        };
        assert_eq!(OfficeSettings::default().validate(), Ok(()));
        assert_eq!(field_of(|s| s.laser.beams = 0), "laser.beams");
        assert_eq!(field_of(|s| s.laser.range_noise = f64::NAN), "laser.range_noise");
        assert_eq!(field_of(|s| s.laser.no_return = 80.0), "laser.no_return");
        assert_eq!(field_of(|s| s.laser.angle_step = 0.1), "laser.angle_step");
        assert_eq!(field_of(|s| s.laser.dropout_probability = 1.5), "laser.dropout_probability");
        assert_eq!(field_of(|s| s.people = 1001), "people");
        assert_eq!(field_of(|s| s.drive.speed = 0.0), "drive.speed");
        assert_eq!(field_of(|s| s.drive.scan_distance = -1.0), "drive.scan_distance");
        assert_eq!(field_of(|s| s.odometry.noise_rotation = -0.1), "odometry.noise_rotation");
        assert_eq!(field_of(|s| s.furniture_density = f64::INFINITY), "furniture_density");
        let mut settings = OfficeSettings::default();
        settings.laser.range_noise = -0.5;
        let message = settings.validate().unwrap_err().to_string();
        assert_eq!(message, "laser.range_noise is -0.5, expected 0 to 10 m");
    }

    #[test]
    fn settings_read_from_a_file_fill_up_and_refuse_unknown_keys() {
        let settings: OfficeSettings =
            toml::from_str("furniture_density = 0.1\n[laser]\nrange_noise = 0.03\n").unwrap();
        assert_eq!(settings.laser.range_noise, 0.03);
        assert_eq!(settings.laser.beams, 180);
        assert_eq!(settings.drive, DriveSettings::default());
        let error = toml::from_str::<OfficeSettings>("[laser]\nbeam_count = 3\n").unwrap_err();
        assert!(error.to_string().contains("beam_count"), "{error}");
        let written = toml::to_string(&settings).unwrap();
        assert_eq!(toml::from_str::<OfficeSettings>(&written).unwrap(), settings);
    }
}
