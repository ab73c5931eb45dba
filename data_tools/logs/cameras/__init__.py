"""Camera calibrations of other people's making: what a file holds, whatever tool wrote it."""

from __future__ import annotations

from data_tools.logs.cameras._content import read_content
from data_tools.logs.cameras._intrinsics import Intrinsics
from data_tools.logs.cameras._layouts import find_cameras

__all__ = ["Intrinsics", "find_cameras", "read_content"]
