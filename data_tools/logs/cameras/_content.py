"""A camera file's text as plain mappings and lists: YAML, OpenCV's YAML and XML, JSON, numbers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.parsers import expat

from data_tools.files.text import DEEPEST, MOST_VALUES, check_end, parse_yaml, read_text
from evcalib.errors import InputError

LARGEST = 1 << 20
"""Bytes of a camera file; the longest of the real ones that were tried has 4 kB."""

_NUMBERS = re.compile(r"[\s,;]+")
_NUMBER = re.compile(r"\s*[-+]?\.?\d")
_OPENCV_HEAD = re.compile(r"\A\s*%YAML[ :][\d.]+[^\n]*\n")
_OPENCV_TAG = re.compile(r"!!opencv-[\w-]+")


def read_content(path: str | Path) -> tuple[Any, Any]:
    """Return what a camera file holds: mappings and lists, or the lines of numbers of a text.

    YAML whose last line is not ended may have lost digits of its last number.  Many tools write
    such files, so they are read; a line of numbers that is not ended is refused.

    Parameters
    ----------
    path : path
        A file of any kind that is known: YAML (OpenCV's too), XML, JSON, or numbers alone.

    Returns
    -------
    (dict or list, dict or list)
        Mappings, lists, words and numbers; of a text of numbers, a list of lines, each a list.
        The second is the first, or what it would be if the last number had one more digit.

    Raises
    ------
    InputError
        If it cannot be read, or is none of these.
    """
    text = read_text(path, LARGEST, whole=False)
    try:
        if text.lstrip().startswith("<"):
            content: Any = _Xml().parse(text)
        elif (content := _numbers(text)) is None:
            content = parse_yaml(_plain(text))
            if text[-1].isdigit() or text[-1] == ".":
                return content, parse_yaml(_plain(text + "9"))
        else:
            check_end(path, text)
        return content, content
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def _numbers(text: str) -> list[list[float]] | None:
    """Return the lines of a text that is numbers alone; `#` begins a comment."""
    lines = [line.split("#")[0].strip(" \t,;") for line in text.splitlines()]
    try:
        return [[float(word) for word in _NUMBERS.split(line)] for line in lines if line]
    except ValueError as error:
        if _NUMBER.match(text):
            raise InputError(
                f"it is not a line of numbers fx fy cx cy k1 k2 p1 p2 k3: {error}"
            ) from None
        return None


def _plain(text: str) -> str:
    """Return OpenCV's YAML without what only OpenCV reads, and one message of `rostopic echo`.

    JSON is YAML, but for tabs between its words.
    """
    text = _OPENCV_TAG.sub("", _OPENCV_HEAD.sub("", text)).replace("\t", " ")
    text = text.strip()
    return text.removesuffix("---").removesuffix("...") + "\n"


class _Xml:
    """Elements as mappings: `rows`, `cols` and `data` of OpenCV's matrices are as in its YAML."""

    def __init__(self) -> None:
        self._open: list[tuple[dict[str, Any], list[str]]] = [({}, [])]
        self._count = 0

    def parse(self, text: str) -> dict[str, Any]:
        parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text
        parser.StartDoctypeDeclHandler = self._refuse
        try:
            parser.Parse(text.encode(), True)
        except expat.ExpatError as error:
            raise InputError(f"it is not XML (line {error.lineno}): {error}") from None
        content: dict[str, Any] = self._open[0][0]
        (root,) = content.values()
        return root if isinstance(root, dict) else content

    def _refuse(self, *declared: Any) -> None:
        raise InputError("it is XML with a document type, whose entities are not read")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if len(self._open) > DEEPEST or self._count > MOST_VALUES:
            raise InputError("it is not the XML of a camera: nested too deeply, or too long")
        self._open.append(({}, []))

    def _text(self, text: str) -> None:
        self._open[-1][1].append(text)

    def _end(self, name: str) -> None:
        children, texts = self._open.pop()
        words = "".join(texts).split()
        value: Any = children or (words if name == "data" else " ".join(words).strip('"'))
        there = self._open[-1][0]
        if name != "_" and name in there:
            raise InputError(f"<{name}> is given twice")
        there[name if name != "_" else f"_{len(there)}"] = value
