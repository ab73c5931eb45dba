"""Jitted loops of `evcalib.surfaces`."""
