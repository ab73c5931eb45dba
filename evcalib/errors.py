"""What can go wrong, by name."""


class EvcalibError(Exception):
    """Base of every error that evcalib raises on purpose."""


class InputError(EvcalibError, ValueError):
    """The input is unusable; the message says what, where, and what to do about it."""


class NoAnswerError(InputError):
    """The input is sound, but holds too little to answer; on the command line exit code 3."""
