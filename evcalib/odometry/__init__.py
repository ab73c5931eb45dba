"""Raw events to the trajectory of the camera: visual odometry after EVO and EMVS."""

from evcalib.odometry._odometry import Trajectory, VisualOdometry, estimate_trajectory

__all__ = ["Trajectory", "VisualOdometry", "estimate_trajectory"]
