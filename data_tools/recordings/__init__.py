"""Recordings of events: one way to open, one kind of pieces out, one way to write."""

from data_tools.recordings._imu import RecordedImu, read_imu
from data_tools.recordings._info import RecordingInfo, describe
from data_tools.recordings._recording import Recording, open_recording

__all__ = [
    "RecordedImu",
    "Recording",
    "RecordingInfo",
    "describe",
    "open_recording",
    "read_imu",
]
