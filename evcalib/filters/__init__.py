"""Filters of event streams: what a sensor adds to what it sees is left out."""

from evcalib.filters._denoiser import Denoiser, Noise, denoise

__all__ = ["Denoiser", "Noise", "denoise"]
