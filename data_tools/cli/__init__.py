"""The command line, thin over both packages.

Exit codes: 0 the rotation is determined; 2 bad input; 3 the motion cannot answer; 4 the data
contradict the answer, or repeated runs each other; 130 Ctrl-C.
"""

from __future__ import annotations

import io
import sys
import warnings
from typing import Any

import typer

# Importing them adds their commands, in this order.
from data_tools.cli import _calibrate, _files, _lab, _plan, _studies  # noqa: F401
from data_tools.cli._options import BAD_INPUT, DOUBTS, INTERRUPTED, NO_ANSWER, Interrupted, app
from evcalib.errors import EvcalibError, NoAnswerError

__all__ = ["BAD_INPUT", "DOUBTS", "NO_ANSWER", "app", "main"]

# The class of all errors of usage; typer has it from click, or brings its own copy of click.
UsageError: Any = typer.BadParameter.__bases__[0]

_SHOW = warnings.showwarning


def main() -> None:
    """Run the command line; errors of the input are one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A name that the code page of a console or a log lacks is no reason to fail.
            stream.reconfigure(errors="backslashreplace")
    warnings.showwarning = _warn
    try:
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except UsageError as error:
        _fail(f"{error.format_message()} (see evcalib --help)")
    except NoAnswerError as error:
        _fail(str(error), NO_ANSWER)
    except EvcalibError as error:
        _fail(str(error))
    except Interrupted as stop:
        print(f"evcalib: interrupted{stop}", file=sys.stderr)
        sys.exit(INTERRUPTED)
    sys.exit(code)


def _warn(message: Any, category: type[Warning], *args: Any, **kwargs: Any) -> None:
    """Say what is meant for users in one line; what is meant for programmers as Python does."""
    if category is UserWarning:
        print(f"evcalib: {message}", file=sys.stderr)
    else:
        _SHOW(message, category, *args, **kwargs)


def _fail(message: str, code: int = BAD_INPUT) -> None:
    print(f"evcalib: {message}", file=sys.stderr)
    sys.exit(code)
