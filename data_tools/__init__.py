"""Readers, simulators, data sets and export around evcalib."""
