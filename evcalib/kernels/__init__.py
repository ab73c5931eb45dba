"""Jitted loops that know arrays only; the modules of the same names above check and convert."""
