"""Results are the digits they were: see unchanged.py."""

import json

import pytest
import unchanged

STORED = json.loads(unchanged.STORED.read_text())


def test_every_case_is_stored():
    assert list(STORED) == list(unchanged.CASES)


@pytest.mark.parametrize("case", list(unchanged.CASES))
def test_no_digit_has_changed(case):
    """To four digits: CPUs and versions of libraries differ in the last ones."""
    before, now = STORED[case], unchanged.told(case)
    assert list(now) == list(before)
    other = [name for name in before if not same(before[name], now[name])]
    assert not other, f"{[(name, before[name], now[name]) for name in other]}"


def same(before, now, largest=0.0):
    """Compare to four digits, those of an array with its largest."""
    if isinstance(before, list):
        largest = max((abs(x) for x in before if isinstance(x, float)), default=0.0)
        pairs = zip(before, now, strict=False)
        return len(before) == len(now) and all(same(a, b, largest) for a, b in pairs)
    if isinstance(before, float) and isinstance(now, float):
        return now == pytest.approx(before, rel=1e-4, abs=max(1e-4 * largest, 1e-12))
    return before == now


@pytest.mark.parametrize(
    ("before", "now"),
    [
        (1.0, 1.001),
        (3e-8, 0.0),
        ([1e-6, 2e-8], [1e-6, 3e-8]),
        ("a", "b"),
        ([1.0], [1.0, 2.0]),
        (True, False),
    ],
)
def test_a_change_is_seen(before, now):
    assert same(before, before)
    assert not same(before, now)
