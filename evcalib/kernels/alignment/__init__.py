"""Jitted loops of `evcalib.alignment`."""
