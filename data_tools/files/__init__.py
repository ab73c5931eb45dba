"""Bytes of other people's making, read with bounds; and files that stand only when whole."""
