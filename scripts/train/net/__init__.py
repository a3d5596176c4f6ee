"""The keypoint net: training, evaluation, calibration, export."""
