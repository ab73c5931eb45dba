"""Drives, scenes and an event camera that knows the truth; every random drive is drawn here."""
