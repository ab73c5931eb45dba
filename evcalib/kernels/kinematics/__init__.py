"""Jitted loops of `evcalib.kinematics`."""
