"""Print one of README's two commands, so that CI runs what README says.

A command is the shell block that follows the line ``<!-- command: NAME -->``.
"""

import re
import sys
from pathlib import Path

name = sys.argv[1]
text = Path("README.md").read_text(encoding="utf-8")
found = re.search(rf"<!-- command: {re.escape(name)} -->\n```sh\n(.+?)\n```", text, re.DOTALL)
if found is None:
    sys.exit(f"README.md has no command named {name}")
print(found.group(1))
