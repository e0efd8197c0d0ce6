use crate::{CoreError, Pose2, Stamp};

/// Stamped poses in recorded order, not necessarily sorted by time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trajectory {
    stamps: Vec<Stamp>,
    poses: Vec<Pose2>,
}

impl Trajectory {
    /// Creates a trajectory from equally many stamps and poses.
    ///
    /// # Errors
    /// [`CoreError::LengthMismatch`] if the numbers differ.
    pub fn new(stamps: Vec<Stamp>, poses: Vec<Pose2>) -> Result<Self, CoreError> {
        if stamps.len() != poses.len() {
            return Err(CoreError::LengthMismatch { stamps: stamps.len(), poses: poses.len() });
        }
        Ok(Trajectory { stamps, poses })
    }

    /// Number of stamped poses.
    pub fn len(&self) -> usize {
        self.stamps.len()
    }

    /// Whether there is no pose.
    pub fn is_empty(&self) -> bool {
        self.stamps.is_empty()
    }

    /// Stamps, in recorded order.
    pub fn stamps(&self) -> &[Stamp] {
        &self.stamps
    }

    /// Poses, in recorded order.
    pub fn poses(&self) -> &[Pose2] {
        &self.poses
    }

    /// Stamps with their poses, in recorded order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (Stamp, Pose2)> + '_ {
        self.stamps.iter().copied().zip(self.poses.iter().copied())
    }
}

impl FromIterator<(Stamp, Pose2)> for Trajectory {
    fn from_iter<I: IntoIterator<Item = (Stamp, Pose2)>>(iter: I) -> Self {
        let (stamps, poses) = iter.into_iter().unzip();
        Trajectory { stamps, poses }
    }
}
