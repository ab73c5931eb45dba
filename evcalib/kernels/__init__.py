"""Jitted loops that know arrays only; the steps of the same names check and convert."""
