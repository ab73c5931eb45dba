"""Streams that do not overlap: the likely cause, and the way out."""

import numpy as np
import pytest
from typer.testing import CliRunner

from data_tools.cli import app
from data_tools.logs.series_files import read_velocities, write_headings, write_velocities
from evcalib.alignment import align
from evcalib.geometry import LOOKS_FORWARD
from evcalib.series import HeadingSeries, VelocitySeries, clocks_apart

T = np.arange(0.0, 15.0, 0.05)
COURSE = 0.8 * np.sin(2 * np.pi * T / 6)
V = np.column_stack([np.cos(COURSE), np.sin(COURSE), 0 * T])


@pytest.mark.parametrize(
    ("camera", "body", "parts"),
    [
        ((0.5, 19), (3600, 3620), ("about 1 h: a time zone?", "(--clock-shift -3600)")),
        ((19800, 19820), (1.5, 30), ("about 5.5 h: a time zone?", "(--clock-shift 19800)")),
        ((0, 20), (1.7e9, 1.7e9 + 20), ("counts from 1970", "by -1700000000.000 s if both")),
        ((0, 20), (400, 420), ("starts are 400.000 s apart", "(--clock-shift -400.000)")),
    ],
)
def test_the_likely_cause_is_named(camera, body, parts):
    said = clocks_apart(camera, body)
    assert all(part in said for part in parts), said
    assert ("time zone" in said) == ("time zone" in parts[0])


@pytest.fixture
def files(tmp_path):
    seen = V @ LOOKS_FORWARD
    write_headings(tmp_path / "h.csv", HeadingSeries(T, seen))
    write_velocities(tmp_path / "v.csv", VelocitySeries(T + 3600.1, V))
    rows = "".join(f"{1000 * t};{x};{y}\n" for t, (x, y, _) in zip(T + 3600.1, V, strict=True))
    (tmp_path / "ms.csv").write_text("when;east;north\n" + rows)
    (tmp_path / "map.yaml").write_text("t: when\nvx: east\nvy: north\n")
    return tmp_path


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_align_tells_of_the_hour_and_shifts_it(files):
    found = run("align", files / "h.csv", files / "v.csv", "--clock-shift", "-3600")
    assert found.exit_code == 0, found.output
    assert "Offset     +0.1000 s" in found.output
    assert "-3600 s were added to all times" in found.output
    assert "the camera looks forward; image upright" in found.output
    mapped = run("align", files / "h.csv", files / "ms.csv", "--columns", files / "map.yaml",
                 "--motion-time-unit", "ms", "--clock-shift", "-3600", "--json")  # fmt: skip
    assert mapped.exit_code == 0, mapped.output
    assert mapped.output.lstrip().startswith("{")
    refused = run("align", files / "h.csv", files / "v.csv")
    assert refused.exception is not None
    assert "about 1 h: a time zone?" in str(refused.exception)


def test_velocities_takes_a_unit_and_draws_what_the_log_claims(files):
    out, plot = files / "out.csv", files / "plot.png"
    done = run("velocities", files / "ms.csv", "--columns", files / "map.yaml", "--time-unit", "ms",
               "-o", out, "--plot", plot)  # fmt: skip
    assert done.exit_code == 0, done.output
    np.testing.assert_allclose(read_velocities(out).t, T + 3600.1, atol=1e-9)
    assert plot.read_bytes().startswith(b"\x89PNG")
    (files / "stated.yaml").write_text("t: {column: when, unit: ms}\nvx: east\nvy: north\n")
    both = run("velocities", files / "ms.csv", "--columns", files / "stated.yaml", "--time-unit",
               "us", "-o", out)  # fmt: skip
    assert "contradicts" in str(both.exception)


def test_a_search_does_not_walk_away_from_the_data():
    """Two short drives a minute apart: rows that have partners at no shift but a small one."""
    rng = np.random.default_rng(4)
    t = np.sort(np.concatenate([rng.uniform(0, 10, 14), rng.uniform(57, 66, 14)]))
    side = np.where(t < 30, 0.0, np.pi / 2)
    v = np.column_stack([np.cos(side), np.sin(side), 0 * t]) + rng.normal(0, 0.1, (t.size, 3))
    seen = v @ LOOKS_FORWARD + rng.normal(0, 0.1, (t.size, 3))
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    flat = v * [1, 1, 0]
    found = align(HeadingSeries(t, seen), VelocitySeries(t + 1e-3, flat), hold=0.01)
    assert not found.offset_observable
    error = np.arccos(np.clip((np.trace(found.R_body_cam @ LOOKS_FORWARD.T) - 1) / 2, -1, 1))
    assert error < max(found.rotation_radius, np.radians(10))
