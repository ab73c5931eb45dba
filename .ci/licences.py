"""List the licences of everything that evcalib installs, and refuse what is not permissive.

    python .ci/licences.py            # what `pip install evcalib` brings
    python .ci/licences.py tests      # with the extra `tests`, and so with all others but `peers`

Read from the metadata of the packages that are installed.  Permissive licences pass, and the LGPL
and MPL, which leave the code that uses them alone; an unknown one must be looked up and named here.
"""

import re
import sys
from importlib.metadata import Distribution, PackageNotFoundError, distribution

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ALLOWED = re.compile(
    r"(0BSD|BSD|BSD-[23]-Clause|MIT|MIT-0|MIT-CMU|ISC|Apache-2\.0|PSF-2\.0|Python-2\.0|Zlib|CC0-1\.0"
    r"|Unlicense|MPL-2\.0|LGPL(-[23](\.[01])?(-only|-or-later)?)?"
    r"|Apache-2\.0 WITH LLVM-exception|GPL-3\.0-or-later WITH GCC-exception-3\.1)"
)
FORMS = {
    r"BSD.3.Clause.*|(new|modified|3-clause) bsd.*|bsd, 3-clause.*": "BSD-3-Clause",
    r"BSD.2.Clause.*|2-clause bsd.*|simplified bsd.*": "BSD-2-Clause",
    r"BSD( license)?|BSD-like": "BSD",
    r"(the )?MIT( license)?( \(MIT\))?": "MIT",
    r"Apache( software)?( license)?,?( v| version )?( ?2(\.0)?)?": "Apache-2.0",
    r"PSF.*|Python Software Foundation.*|matplotlib.*": "PSF-2.0",
    r"Mozilla Public License 2\.0.*|MPL.?2\.0": "MPL-2.0",
    r"ISC( license)?( \(ISCL\))?": "ISC",
    r".*Lesser General Public License.*|LGPL.*": "LGPL",
}
LOOKED_UP = {
    "apsw": "Zlib",  # its LICENSE; the metadata say any-OSI
    # Its LICENSE is MIT; its doc/information.rst names those of the filters that it bundles.
    "aedat": "MIT",
    "hdf5plugin": "MIT AND BSD-3-Clause AND Apache-2.0",
}


def closure(name: str, extras: set[str]) -> dict[str, Distribution]:
    """Return the installed packages that one needs, itself left out, by name."""
    found: dict[str, Distribution] = {}
    waiting, seen = [(name, extras)], set()
    while waiting:
        name, extras = waiting.pop()
        for extra in extras | {""}:
            if (name, extra) in seen:
                continue
            seen.add((name, extra))
            try:
                package = found.setdefault(name, distribution(name))
            except PackageNotFoundError:
                sys.exit(f"{name} is needed but not installed")
            for line in package.requires or []:
                need = Requirement(line)
                if need.marker is None or need.marker.evaluate({"extra": extra}):
                    waiting.append((canonicalize_name(need.name), set(need.extras)))
    return {name: found[name] for name in sorted(found) if name != "evcalib"}


def licence(name: str, package: Distribution) -> str:
    """Return the licence as an SPDX expression where the metadata allow it."""
    if name in LOOKED_UP:
        return LOOKED_UP[name]
    meta = package.metadata
    if meta.get("License-Expression"):
        return str(meta.get("License-Expression"))
    kinds = [k.split(" :: ")[-1] for k in meta.get_all("Classifier", []) if k.startswith("License")]
    first = str(meta.get("License") or "").strip().split("\n")[0]
    for text in (*[k for k in kinds if k != "OSI Approved"], first):
        for form, spdx in FORMS.items():
            if re.fullmatch(form, text.strip(), re.IGNORECASE):
                return spdx
    return first or "; ".join(kinds) or "unknown"


def permitted(expression: str) -> bool:
    """Whether an SPDX expression leaves us free: one side of a plain OR, else every part."""
    parts = re.split(r"\b(?:AND|OR)\b", expression.replace("(", " ").replace(")", " "))
    good = [ALLOWED.fullmatch(part.strip()) is not None for part in parts]
    return all(good) or (any(good) and "AND" not in expression)


def main() -> None:
    """Print the list; fail for what may not be used."""
    refused = []
    for name, package in closure("evcalib", set(sys.argv[1:])).items():
        expression = licence(name, package)
        print(f"{name:30} {package.version:16} {expression}")
        if not permitted(expression):
            refused.append(name)
    if refused:
        sys.exit(f"licence unknown or not permissive: {', '.join(refused)}")


if __name__ == "__main__":
    main()
