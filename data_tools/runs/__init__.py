"""One recording, from its files to a folder of results."""

from data_tools.runs._inputs import input_file

__all__ = [
    "input_file",
]
