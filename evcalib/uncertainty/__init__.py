"""How noise scatters, how long it remembers, and what that makes of a covariance."""

from evcalib._moved import leftovers
from evcalib.uncertainty._agreement import Agreement, agreement
from evcalib.uncertainty._covariance import (
    UNKNOWN,
    JointCovariance,
    joint_covariance,
    rotation_radius,
    rotation_sd,
    sandwich,
    t_quantile,
)
from evcalib.uncertainty._noise import (
    WHITE,
    NoiseModel,
    coloured_noise,
    fit_noise,
    robust_sd,
    sd_of_median,
    white_noise,
)
from evcalib.uncertainty._peak import peak_of_parabola

__all__ = [
    "UNKNOWN",
    "WHITE",
    "Agreement",
    "JointCovariance",
    "NoiseModel",
    "agreement",
    "coloured_noise",
    "fit_noise",
    "joint_covariance",
    "peak_of_parabola",
    "robust_sd",
    "rotation_radius",
    "rotation_sd",
    "sandwich",
    "sd_of_median",
    "t_quantile",
    "white_noise",
]

__getattr__ = leftovers(__name__)
