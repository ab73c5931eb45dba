"""Loops of `evcalib.filters`."""
