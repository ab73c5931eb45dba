"""``python -m evcalib`` is the command line."""

from evcalib.cli import main

main()
