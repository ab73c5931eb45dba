"""Say what a wheel holds, and check it against the sdist that it was built from.

    python .ci/contents.py WHEEL SDIST_FOLDER

Every module and every file of the notebooks' course is in it, and nothing else.
"""

import sys
import zipfile
from pathlib import Path

NOTEBOOKS = "data_tools/course/_notebooks/"
CODE = {".py", ".typed", ".css"}

wheel, source = Path(sys.argv[1]), Path(sys.argv[2])
entries = [
    entry for entry in zipfile.ZipFile(wheel).infolist() if ".dist-info/" not in entry.filename
]
have = {entry.filename for entry in entries}

course = [
    p for form in ("[0-9][0-9]_*.ipynb", "README.md") for p in (source / "notebooks").glob(form)
]
course += [p for p in (source / "notebooks" / "data").rglob("*") if p.is_file()]
want = {NOTEBOOKS + p.relative_to(source / "notebooks").as_posix() for p in course}
for package in ("evcalib", "data_tools"):
    files = (p for p in (source / package).rglob("*") if p.suffix in CODE)
    want |= {p.relative_to(source).as_posix() for p in files}
if have != want:
    sys.exit(f"the wheel lacks {sorted(want - have)} and holds {sorted(have - want)} too much")

ours = [entry for entry in entries if entry.filename.startswith(NOTEBOOKS)]
print(
    f"{wheel.name}: {wheel.stat().st_size / 1e6:.2f} MB, {len(have)} files; of them the notebooks"
    f" with their data {sum(e.compress_size for e in ours) / 1e6:.2f} MB"
    f" ({sum(e.file_size for e in ours) / 1e6:.2f} MB unpacked), {len(ours)} files"
)
