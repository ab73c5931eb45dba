"""Jitted loops of `evcalib.baselines`."""
