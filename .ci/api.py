"""Write the API reference from the docstrings, as pages that need no network.

    python .ci/api.py [FOLDER]      # .artefacts/api by default; warnings are errors

Needs the extra `docs`.
"""

import os
import pkgutil
import sys
import warnings
from pathlib import Path

import pdoc

import evcalib

# A package with a list of public names does not show its modules by itself.
modules = [f"evcalib.{found.name}" for found in pkgutil.iter_modules(evcalib.__path__)]
wanted = ["evcalib", *modules, "data_tools", "!data_tools.cli", r"!.*\._"]

warnings.simplefilter("error")
# Types that are imported for the type checker only are shown as they are written.
warnings.filterwarnings("ignore", "Error parsing type annotation")
os.environ["PDOC_ALLOW_EXEC"] = "1"  # a dependency asks the system for the kind of processor
# The public names come when they are first used, so that importing evcalib is quick.
for front in (evcalib, evcalib.plots, evcalib.widgets):
    for name in front.__all__:
        setattr(front, name, getattr(front, name))

folder = Path(sys.argv[1] if sys.argv[1:] else ".artefacts/api")
pdoc.render.configure(
    docformat="numpy", footer_text=f"evcalib {evcalib.__version__}", include_undocumented=False
)
pdoc.pdoc(*wanted, output_directory=folder)
pages = list(folder.rglob("*.html"))
print(
    f"{len(pages)} pages written to {folder}, {sum(p.stat().st_size for p in pages) / 1e6:.1f} MB"
)
