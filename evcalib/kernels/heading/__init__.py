"""Jitted loops of `evcalib.heading`."""
