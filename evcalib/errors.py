"""What can go wrong, by name."""


class EvcalibError(Exception):
    """Base of every error that evcalib raises on purpose."""


class InputError(EvcalibError, ValueError):
    """The input is unusable; the message says what, where, and what to do about it."""
