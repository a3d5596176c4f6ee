//! roadplane: keypoints.
