"""Recordings of events: one way to open, one kind of pieces out, one way to write."""

from data_tools.recordings._info import RATE_WINDOW_US, RecordingInfo, describe
from data_tools.recordings._recording import Recording, open_recording

__all__ = [
    "RATE_WINDOW_US",
    "Recording",
    "RecordingInfo",
    "describe",
    "open_recording",
]
