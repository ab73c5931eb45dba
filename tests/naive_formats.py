"""Plain writers of Prophesee's words and records, and slow readers of them.

Events are tuples (t, x, y, p) of whole numbers, ascending in t.
"""

import struct

HEADER_EVT2 = b"% evt 2.0\n% geometry 640x480\n"
HEADER_EVT3 = b"% evt 3.0\n% format EVT3;height=720;width=1280\n% end\n"
HEADER_DAT = b"% Data file containing CD events\n% Version 2\n% Width 640\n% Height 480\n"


def evt2_words(events):
    words, high = [], None
    for t, x, y, p in events:
        for step in range((high if high is not None else t >> 6), t >> 6, 1 << 26):
            words.append(0x8 << 28 | step & 0xFFFFFFF)
        if t >> 6 != high:
            high = t >> 6
            words.append(0x8 << 28 | high & 0xFFFFFFF)
        words.append((1 if p else 0) << 28 | (t & 63) << 22 | x << 11 | y)
    return b"".join(struct.pack("<I", word) for word in words)


def evt3_words(events, vectors=True):
    """Write events; those of one time, row and polarity with ascending x as vectors, if wished."""
    words, high, low, row = [], None, None, None
    k = 0
    while k < len(events):
        t, x, y, p = events[k]
        if t >> 12 != high:
            # A sensor repeats the high bits all the time, so a reader sees each of their loops.
            for step in range(high if high is not None else t >> 12, t >> 12, 1 << 10):
                words.append(0x8000 | step & 0xFFF)
            high, low = t >> 12, None
            words.append(0x8000 | high & 0xFFF)
        if t & 0xFFF != low:
            low = t & 0xFFF
            words.append(0x6000 | low)
        if y != row:
            row = y
            words.append(y)
        run = [x]
        while vectors and k + len(run) < len(events):
            after = events[k + len(run)]
            if (after[0], after[2], after[3]) != (t, y, p) or after[1] <= run[-1]:
                break
            run.append(after[1])
        words += _run(run, p)
        k += len(run)
    return b"".join(struct.pack("<H", word) for word in words)


def _run(run, p):
    if len(run) == 1:
        return [0x2000 | p << 11 | run[0]]
    words, base = [0x3000 | p << 11 | run[0]], run[0]
    while run:
        if run[0] > base + 30:
            words.append(0x3000 | p << 11 | run[0])
            base = run[0]
        bits, kind = (8, 0x5000) if run[-1] - base < 8 else (12, 0x4000)
        words.append(kind | sum(1 << x - base for x in run if x < base + bits))
        base += bits
        run = [x for x in run if x >= base]
    return words


def dat_records(events):
    return b"\x0c\x08" + b"".join(
        struct.pack("<II", t & 0xFFFFFFFF, p << 28 | y << 14 | x) for t, x, y, p in events
    )


def read_evt3(data):
    """Return the events of EVT3 words, by the letter of the format, loops of the clock included."""
    events, loops = [], 0
    high = low = row = base = sign = None
    for at in range(0, len(data) - 1, 2):
        bits = f"{data[at + 1]:08b}{data[at]:08b}"
        kind, value = int(bits[:4], 2), int(bits[4:], 2)
        if kind == 0x8:
            if high is not None and value != high:
                loops += (value < high - 2048) - (value > high + 2048)
                low = None if low is None else 0
            high = value
        elif kind == 0x6:
            low = value
        elif kind == 0x0:
            row = int(bits[5:], 2)
        elif kind == 0x3:
            base, sign = int(bits[5:], 2), int(bits[4])
        elif kind in (0x2, 0x4, 0x5):
            known = None not in (high, low, row)
            now = 0 if high is None or low is None else (loops * 4096 + high) * 4096 + low
            if kind == 0x2:
                events += [(now, int(bits[5:], 2), row, int(bits[4]))] if known else []
                continue
            mask = bits[4:][::-1] if kind == 0x4 else bits[8:][::-1]
            if base is not None:
                hits = [base + k for k, bit in enumerate(mask) if bit == "1"]
                events += [(now, x, row, sign) for x in hits] if known else []
                base += len(mask)
    return events


def read_evt2(data):
    """Return the events of EVT2 words; without loops of the clock."""
    events, high = [], None
    for at in range(0, len(data) - 3, 4):
        bits = f"{int.from_bytes(data[at : at + 4], 'little'):032b}"
        kind = int(bits[:4], 2)
        if kind == 0x8:
            high = int(bits[4:], 2)
        elif kind <= 1 and high is not None:
            time = 64 * high + int(bits[4:10], 2)
            events.append((time, int(bits[10:21], 2), int(bits[21:], 2), kind))
    return events


def read_dat(data):
    """Return the events of DAT records, without their two leading bytes."""
    events = []
    for at in range(0, len(data) - 7, 8):
        t, place = struct.unpack_from("<II", data, at)
        events.append((t, place % 16384, place // 16384 % 16384, place // 2**28 % 2))
    return events
