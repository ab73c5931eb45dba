"""Jitted loops of `evcalib.features`."""
