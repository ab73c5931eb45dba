"""What is shown while kernels are compiled."""

import io

import numba
import numpy as np
from numba.core import event
from tqdm.auto import tqdm

from evcalib.kernels import compiling


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_sees_what_is_compiled_and_a_script_nothing(monkeypatch):
    def inner(x):
        return x + 1

    monkeypatch.setenv("TQDM_DISABLE", "0")
    for stream, shown in ((Terminal(), True), (io.StringIO(), False)):
        listener = compiling._Bar()
        monkeypatch.setattr("tqdm.auto.tqdm", lambda to=stream, **given: tqdm(file=to, **given))
        with event.install_listener("numba:compile", listener):
            numba.njit(inner)(np.float64(1.0))
            numba.njit(inner)(np.int64(1))
        assert ("compiling, once: 2 kernels" in stream.getvalue()) == shown
