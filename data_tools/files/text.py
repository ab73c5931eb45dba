"""Small text files of other people's making: numbers and YAML, read with care."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from data_tools.files.pipes import refuse_pipe
from evcalib.errors import InputError

LARGEST = 1 << 28
"""Bytes of a text that is read as a whole."""
LARGEST_YAML = 1 << 24
DEEPEST = 50
"""Levels of YAML; the C library that reads it crashes at some ten thousand."""
MOST_VALUES = 500_000
LONGEST_NUMBER = 1000
"""Digits of a whole number in YAML."""

_CUT_NUMBER = re.compile(r"[\d.]\Z")


def read_text(path: str | Path, largest: int = LARGEST, *, whole: bool = True) -> str:
    """Return a text file that is whole, as far as that can be told (or `whole` is False).

    Raises
    ------
    InputError
        If it cannot be read, is no UTF-8 or longer than `largest` bytes, or ends within what may
        be a number, so that digits may be missing.
    """
    refuse_pipe(path)
    data = bytearray()
    try:
        with open(path, "rb") as file:
            while len(data) <= largest and (block := file.read(1 << 18)):
                data += block
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if len(data) > largest:
        raise InputError(f"{path} is over {largest} bytes, too long for what it should be")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file") from None
    if whole:
        check_end(path, text)
    return text


def check_end(path: str | Path, text: str) -> None:
    """Refuse a text whose last number may have lost digits.

    Raises
    ------
    InputError
        If it ends in a digit or a point, without the end of a line.
    """
    if _CUT_NUMBER.search(text):
        last = text[-40:].splitlines()[-1]
        raise InputError(
            f"{path} ends within a line, so its last number may be cut off: {last!r}; end the line"
            " if it is whole, or take it out"
        )


class Mapping(dict[str, Any]):
    """A YAML mapping that knows on which line it begins."""

    line = 0


def read_yaml(path: str | Path) -> Any:
    """Return what a YAML file holds: plain values, lists and `Mapping`.

    Aliases (``*name``), which can unfold a few lines to any size, and tags that build objects are
    refused, and so is a key that is given twice.

    Raises
    ------
    InputError
        If the file cannot be read, is no such YAML, or is larger or deeper than any description.
    """
    try:
        return parse_yaml(read_text(path, LARGEST_YAML))
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def parse_yaml(text: str) -> Any:
    """Return what a YAML text holds; see `read_yaml`."""
    try:
        _scan(text)
        return yaml.load(text, Loader=_Loader)
    except InputError:
        raise
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" (line {mark.line + 1})" if mark else ""
        why = " ".join(str(getattr(error, "problem", None) or error).split())
        raise InputError(f"it is not YAML{where}: {why}") from None
    except (ValueError, LookupError, AttributeError, TypeError, ArithmeticError):
        # what PyYAML lets through for scalars like "!!bool maybe"
        raise InputError("it is not YAML: a value cannot be converted") from None


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Safe YAML whose mappings know their lines and repeat no key."""


def _scan(text: str) -> None:
    """Refuse what would crash the library or fill the memory, before anything is built."""
    depth = values = 0
    for event in yaml.parse(text, _Loader):
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.AliasEvent):
            raise InputError(f"aliases (*name) are not supported (line {line}); write it out")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        values += isinstance(event, yaml.NodeEvent)
        if depth > DEEPEST:
            raise InputError(f"it is not YAML: nested too deeply (line {line})")
        if values > MOST_VALUES:
            raise InputError(f"it is not YAML: over {MOST_VALUES} values (line {line})")


def _mapping(loader: Any, node: yaml.MappingNode) -> Iterator[Mapping]:
    out = Mapping()
    out.line = node.start_mark.line + 1
    yield out
    seen = set()
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise InputError(f"a key is no word (line {key.start_mark.line + 1})")
        if key.value in seen:
            raise InputError(f"{key.value} is given twice (line {key.start_mark.line + 1})")
        seen.add(key.value)
    out.update(loader.construct_mapping(node, deep=True))


def _whole_number(loader: Any, node: yaml.ScalarNode) -> int:
    if len(node.value) > LONGEST_NUMBER:
        raise InputError(f"a number of {len(node.value)} digits (line {node.start_mark.line + 1})")
    return int(loader.construct_yaml_int(node))


_Loader.add_constructor("tag:yaml.org,2002:map", _mapping)
_Loader.add_constructor("tag:yaml.org,2002:int", _whole_number)
