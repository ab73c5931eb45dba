"""A stream of any length through `calibrate`: what it holds in memory stays bounded."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent / "benchmarks" / "stream_minutes.py"


@pytest.fixture(scope="module")
def streamed():
    """Streams of 15 s and of 60 s of one drive, one after the other in a process of their own."""
    words = [sys.executable, str(SCRIPT), "--size", "small", "--minutes", "0.25", "1"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_four_times_the_stream_takes_hardly_more_memory(streamed):
    """Results grow, by some kB per heading; events do not."""
    short, long = streamed
    assert long["million_events"] == pytest.approx(4 * short["million_events"], rel=0.1)
    assert long["headings"] > 3 * short["headings"]
    assert long["peak_mb"] < short["peak_mb"] + 60


def test_what_is_found_is_near_the_truth(streamed):
    """The camera jumps at the end of each repetition, which spoils a few headings."""
    for result in streamed:
        assert result["rotation_error_deg"] < 3.0
        assert abs(result["offset_error_ms"]) < 100.0
