"""Jitted loops of `evcalib.joint`."""
