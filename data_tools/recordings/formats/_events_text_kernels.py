"""Parser of `t x y p` lines: bytes in, columns out, one pass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evcalib.kernels.jit import jit

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

# What can be wrong with a line.
GARBLED, OUTSIDE_X, OUTSIDE_Y, NEGATIVE, TOO_LATE, BACKWARDS, POLARITY, MIXED = range(1, 9)

# Fields of the parser's state, which lives across blocks.  Lines count from 1.
LINE, LAST, ERROR, AT, MINUS_LINE, ZERO_LINE, BEGUN, PASSED, STATE_SIZE = range(9)

_POWERS = 10 ** np.arange(19, dtype=np.int64)
_DIGITS = 18
_NEWLINE, _RETURN, _SPACE, _TAB, _COMMA, _HASH = 10, 13, 32, 9, 44, 35
_PLUS, _MINUS, _POINT, _ZERO, _NINE, _BIG_E, _SMALL_E = 43, 45, 46, 48, 57, 69, 101


@jit
def parse_lines(
    text: Bytes, unit: int, limits: Ints, x: NDArray, y: NDArray, t: Ints, p: NDArray, state: Ints
) -> int:
    """Parse whole lines, the last with its newline too; return how many events.

    `unit` is the power of ten from the file's time unit to microseconds, `limits` are width,
    height, the origin subtracted from times, the largest time [us] and whether times must ascend.
    At an error the line's number, the position of its first byte and the reason are left in
    `state`, which also counts the comments below the first event: a 3 with a flipped bit is a #.
    """
    n = 0
    at = 0
    while at < text.size:
        state[LINE] += 1
        state[AT] = at
        at = _skip_blanks(text, at)
        if _at_end(text, at) or text[at] == _HASH:
            state[PASSED] += text[at] == _HASH and state[BEGUN]
            at = _next_line(text, at)
            continue
        state[BEGUN] = 1
        stamp, at = _time(text, at, unit)
        column, at = _count(text, at)
        row, at = _count(text, at)
        sign, at = _sign(text, at)
        if at < 0 or not _at_end(text, _skip_blanks(text, at)):
            state[ERROR] = GARBLED
            return n
        state[ERROR] = _wrong(stamp - limits[2], column, row, sign, limits, state)
        if state[ERROR]:
            return n
        x[n], y[n], t[n], p[n] = column, row, stamp - limits[2], sign > 0
        state[LAST] = t[n]
        n += 1
        at = _next_line(text, at)
    return n


@jit
def _wrong(t: int, column: int, row: int, sign: int, limits: Ints, state: Ints) -> int:
    if column >= limits[0]:
        return OUTSIDE_X
    if row >= limits[1]:
        return OUTSIDE_Y
    if t < 0:
        return NEGATIVE
    if t > limits[3]:
        return TOO_LATE
    if t < state[LAST] and limits[4]:
        return BACKWARDS
    if sign < -1 or sign > 1:
        return POLARITY
    if sign == -1 and state[MINUS_LINE] == 0:
        state[MINUS_LINE] = state[LINE]
    if sign == 0 and state[ZERO_LINE] == 0:
        state[ZERO_LINE] = state[LINE]
    return MIXED if state[MINUS_LINE] > 0 and state[ZERO_LINE] > 0 else 0


@jit
def _skip_blanks(text: Bytes, at: int) -> int:
    while text[at] == _SPACE or text[at] == _TAB or text[at] == _COMMA or text[at] == _RETURN:
        at += 1
    return at


@jit
def _at_end(text: Bytes, at: int) -> bool:
    return text[at] == _NEWLINE


@jit
def _next_line(text: Bytes, at: int) -> int:
    while text[at] != _NEWLINE:
        at += 1
    return at + 1


@jit
def _is_digit(text: Bytes, at: int) -> bool:
    return _ZERO <= text[at] <= _NINE


@jit
def _after_number(text: Bytes, start: int, at: int) -> int:
    """Return `at` if a number with at least one digit ends there, else -1."""
    if at == start or not (_skip_blanks(text, at) > at or _at_end(text, at)):
        return -1
    return at


@jit
def _count(text: Bytes, at: int) -> tuple[int, int]:
    """Parse digits; at = -1 passes an earlier error on."""
    if at < 0:
        return 0, -1
    start = at = _skip_blanks(text, at)
    value = 0
    while _is_digit(text, at) and at - start < _DIGITS:
        value = 10 * value + (text[at] - _ZERO)
        at += 1
    return value, _after_number(text, start, at)


@jit
def _sign(text: Bytes, at: int) -> tuple[int, int]:
    """Parse a polarity with an optional minus."""
    if at < 0:
        return 0, -1
    at = _skip_blanks(text, at)
    if text[at] == _MINUS:
        value, at = _count(text, at + 1 if _is_digit(text, at + 1) else -1)
        return -value, at
    return _count(text, at)


@jit
def _time(text: Bytes, at: int, unit: int) -> tuple[int, int]:
    """Parse a time as integer microseconds; the usual form quickly, the rest in general."""
    start = at
    value = 0
    while _is_digit(text, at):
        value = 10 * value + (text[at] - _ZERO)
        at += 1
    whole, missing = at - start, unit
    if text[at] == _POINT:
        at += 1
        while missing > 0 and _is_digit(text, at):
            value = 10 * value + (text[at] - _ZERO)
            missing -= 1
            at += 1
        if missing == 0 and _is_digit(text, at):
            value += text[at] - _ZERO >= 5
            while _is_digit(text, at):
                at += 1
    if 0 < whole <= _DIGITS - 6 and missing >= 0 and (text[at] == _SPACE or text[at] == _COMMA):
        return value * _POWERS[missing], at
    return _any_time(text, start, unit)


@jit
def _any_time(text: Bytes, at: int, unit: int) -> tuple[int, int]:
    """Parse any decimal number as integer microseconds, rounded half up; no float is involved."""
    negative = text[at] == _MINUS
    at += negative
    value, kept, power, digits = 0, 0, unit, 0
    point = False
    while True:
        if text[at] == _POINT and not point:
            point = True
        elif _is_digit(text, at):
            digits += 1
            power -= point
            if kept < _DIGITS:
                value = 10 * value + (text[at] - _ZERO)
                kept += value > 0
            else:
                power += 1
        else:
            break
        at += 1
    if digits and (text[at] == _SMALL_E or text[at] == _BIG_E):
        exponent, at = _exponent(text, at + 1)
        power += exponent
    if at < 0 or digits == 0:
        return 0, -1
    stamp = _scaled(value, power)
    return -stamp if negative else stamp, _after_number(text, at - 1, at)


@jit
def _exponent(text: Bytes, at: int) -> tuple[int, int]:
    negative = text[at] == _MINUS
    if text[at] == _MINUS or text[at] == _PLUS:
        at += 1
    if not _is_digit(text, at):
        return 0, -1
    value, at = _count(text, at)
    value = min(value, 1000)
    return -value if negative else value, at


@jit
def _scaled(value: int, power: int) -> int:
    """Return value times 10^power, rounded half up; the largest int64 where that is too large."""
    if power < -_DIGITS or value == 0:
        return 0
    if power < 0:
        divisor = _POWERS[-power]
        return int((value + divisor // 2) // divisor)
    largest = 2**62
    if power > _DIGITS or value > largest // _POWERS[power]:
        return largest
    return int(value * _POWERS[power])
