"""Short files of studies, and comparisons of methods, against small tables written by hand."""

import numpy as np
import pytest

from data_tools.studies import (
    load_short,
    median_ratio,
    medians,
    run_study,
    scratch_study,
    short_lines,
    study,
)
from evcalib.errors import EvcalibError, InputError

TEXT = """group,method,quantity,trials...
arc,vc,rotation_deg,1,3,2
arc,vc,offset_ms,-10,20,30
zigzag,vc,rotation_deg,4,5,9
zigzag,vc,offset_ms,0,0,-7
"""


@pytest.fixture
def short(tmp_path):
    path = tmp_path / "study.csv"
    path.write_text(TEXT)
    return load_short(path)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    given = {"methods": ["vc", "vc_wota"], "motions": ["polyline"]}
    folder = tmp_path_factory.mktemp("study")
    return run_study("paper", trials=2, seed=3, folder=folder, **given)


def test_a_short_file_is_a_table_like_any_studys(short):
    assert short.groups == ("arc", "zigzag")
    assert short.trials == 3
    np.testing.assert_array_equal(short.values("rotation_deg", group="arc"), [1, 3, 2])
    np.testing.assert_allclose(
        short.values("offset_error_s", group="arc", method="vc"), [-0.01, 0.02, 0.03]
    )
    assert np.isnan(short.values("offset_observable")).all()


def test_a_study_survives_the_short_form_to_three_digits(small, tmp_path):
    path = tmp_path / "short.csv"
    path.write_text("\n".join(short_lines(small, {"offset_observable": ["vc"]})) + "\n")
    again = load_short(path)
    assert again.groups == small.groups
    for column in ("rotation_deg", "offset_error_s"):
        for group in small.groups:
            for method in ("vc", "vc_wota"):
                where = {"group": group, "method": method}
                np.testing.assert_allclose(
                    again.values(column, **where), small.values(column, **where), rtol=5.1e-3
                )
    known = np.isfinite(again.values("offset_observable"))
    np.testing.assert_array_equal(known, again.values("method") == "vc")


def test_two_files_are_one_table(tmp_path):
    lines = TEXT.splitlines(keepends=True)
    for name, part in (("a", lines[:3]), ("b", [lines[0], *lines[3:]])):
        (tmp_path / name).write_text("".join(part))
    both = load_short(tmp_path / "a", tmp_path / "b")
    assert both.groups == ("arc", "zigzag")
    np.testing.assert_array_equal(both.values("rotation_deg"), [1, 3, 2, 4, 5, 9])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no short file"),
        ("group,method\n", "no short file"),
        (TEXT.replace("offset_ms", "colour", 1), "line 3: quantity must be one of"),
        (TEXT.replace("9\n", "nine\n"), "line 4 holds a value that is no number"),
        (TEXT.replace(",30", ""), "line 3 has another number of trials"),
        (TEXT + "arc\n", "line 6: quantity must be"),
    ],
)
def test_files_that_are_none_are_refused(tmp_path, text, words):
    path = tmp_path / "study.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        load_short(path)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(EvcalibError, match=r"cannot read .*gone\.csv"):
        load_short(tmp_path / "gone.csv")
    with pytest.raises(InputError, match="at least one file"):
        load_short()


def test_medians_stand_in_a_table(short):
    assert medians(short).splitlines() == [
        "              vc",
        "arc         2.00",
        "zigzag      5.00",
    ]
    text = medians(
        short, "offset_error_s", groups=["arc"], factor=1000, digits=0, short={"vc": "paper"}
    )
    assert text.split() == ["paper", "arc", "20"]


def test_a_ratio_of_medians_has_its_scatter():
    rng = np.random.default_rng(1)
    a = rng.normal(2.0, 0.5, 400)
    ratio, low, high = median_ratio(a, 0.5 * a, rng)
    assert (ratio, low, high) == pytest.approx((2.0, 2.0, 2.0))
    b = rng.normal(2.0, 0.5, 400)
    ratio, low, high = median_ratio(a, b, rng)
    assert ratio == np.median(a) / np.median(b)
    # the sd of a median of normal values is 1.253 sigma / sqrt(n); two of them, relative to 2
    width = 2 * 1.96 * np.sqrt(2) * 1.253 * 0.25 / 20
    assert high - low == pytest.approx(width, rel=0.35)
    with pytest.raises(InputError, match="same trials"):
        median_ratio(a, b[1:], rng)


def test_a_scratch_study_is_a_run_study_of_its_groups(small):
    made = study("paper", methods=["vc", "vc_wota"], motions=["polyline"])
    first = scratch_study(made, trials=2, seed=3, groups=[small.groups[0]])
    assert first.groups == small.groups[:1]
    np.testing.assert_array_equal(
        first.values("rotation_deg"), small.values("rotation_deg", group=small.groups[0])
    )
    with pytest.raises(InputError, match="group must be one of"):
        scratch_study(made, trials=1, seed=3, groups=["arc 2 m"])
