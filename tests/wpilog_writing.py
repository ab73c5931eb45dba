"""WPILib logs for tests, after the published description of the format (version 1.0)."""

import struct

STATE = "double speed;Rotation2d angle"
SCHEMAS = {
    "SwerveModuleState": STATE,
    "SwerveModulePosition": "double distance;Rotation2d angle",
    "ChassisSpeeds": "double vx;double vy;double omega",
    "Rotation2d": "double value",
}


def narrow(number, least=1):
    """Return the fewest little-endian bytes that hold a number."""
    return number.to_bytes(max(least, (number.bit_length() + 7) // 8), "little")


def record(entry, t_us, payload):
    entry, size, t = narrow(entry), narrow(len(payload)), narrow(t_us)
    widths = (len(entry) - 1) | (len(size) - 1) << 2 | (len(t) - 1) << 4
    return bytes([widths]) + entry + size + t + payload


def text(words):
    return struct.pack("<I", len(words)) + words.encode()


def start(number, name, type, t_us=0):
    payload = struct.pack("<BI", 0, number) + text(name) + text(type) + text('{"source":"x"}')
    return record(0, t_us, payload)


def log(entries, schemas=SCHEMAS, first=1, extra="AdvantageKit"):
    """Return a log of entries (name, type, [(time in us, payload)...]), in the order of time."""
    out, rows = b"WPILOG" + struct.pack("<H", 0x0100) + text(extra), []
    number = first
    for name, schema in schemas.items():
        out += start(number, f"/.schema/struct:{name}", "structschema")
        out += record(number, 0, schema.encode())
        number += 1
    for name, type, values in entries:
        out += start(number, name, type)
        out += record(0, 0, struct.pack("<BI", 2, number) + text('{"more":1}'))
        rows += [(t, number, payload) for t, payload in values]
        number += 1
    rows.sort(key=lambda row: row[0])
    return out + b"".join(record(number, t, payload) for t, number, payload in rows)


def doubles(rows):
    return [struct.pack(f"<{len(row)}d", *row) for row in rows]
