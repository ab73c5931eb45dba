"""Jitted loops of `evcalib.uncertainty`."""
