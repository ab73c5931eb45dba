"""Jitted loops of `evcalib.odometry`."""
