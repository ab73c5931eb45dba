"""Readers, simulators, data sets and export around evcalib."""

from data_tools._moved import MOVED
from evcalib._moved import install

install(MOVED)
