"""``python -m evcalib`` is the command line."""

from data_tools.cli import main

main()
