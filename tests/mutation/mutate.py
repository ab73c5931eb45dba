"""The mutation score of the back end: how many small faults in the code the tests notice.

    python tests/mutation/mutate.py --mutants 200 --seed 1
    python tests/mutation/mutate.py --again               # the survivors only; stores nothing

A mutant is one change of one module (an operator, a comparison, a sign, a number, a condition).
Mutants are drawn from all possible ones of `MODULES`; for each, the module's tests run on a copy of
the project, in a process forked from one that has the libraries loaded.  A mutant is killed if a
test fails, crashes, or takes more than `CPU_SECONDS`.  Those that are left meet `LAST`, which knows
only that results are what they were: the score tells both.  Survivors are printed and stored in
``tests/mutation/survivors.txt``, the score in ``tests/mutation/score.csv``.
"""

from __future__ import annotations

import argparse
import ast
import os
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CPU_SECONDS = 300

JOINT = ("test_joint", "test_tracks", "test_campaign")
MODULES = {
    "evcalib/alignment/offset.py": ("test_offset", "test_align"),
    "evcalib/alignment/rotation.py": ("test_rotation", "test_align"),
    "evcalib/kinematics/velocity_track.py": ("test_track", "test_offset"),
    "evcalib/joint/tracks.py": ("test_tracks", "test_joint"),
    "evcalib/uncertainty/_covariance.py": ("test_uncertainty", "test_align"),
    "evcalib/uncertainty/_noise.py": ("test_uncertainty", "test_track", "test_observability"),
    "evcalib/uncertainty/_peak.py": ("test_uncertainty", "test_offset"),
    "evcalib/alignment/observability.py": ("test_observability", "test_align"),
    "evcalib/alignment/offset_refinement.py": ("test_offset", "test_uncertainty", "test_align"),
    "evcalib/alignment/_bootstrap.py": ("test_uncertainty", "test_align"),
    "evcalib/alignment/registration.py": ("test_align", "test_silently_wrong"),
    "evcalib/alignment/_align.py": ("test_align", "test_observability", "test_silently_wrong"),
    "evcalib/alignment/_answers.py": ("test_align", "test_observability", "test_silently_wrong"),
    "evcalib/alignment/_evidence.py": ("test_align", "test_observability", "test_silently_wrong"),
    "evcalib/alignment/_stream_pair.py": ("test_offset", "test_align"),
    "evcalib/alignment/verdict.py": ("test_align", "test_observability", "test_silently_wrong"),
    "evcalib/joint/_refine.py": JOINT,
    "evcalib/joint/_solver.py": JOINT,
    "evcalib/joint/_world_motion.py": JOINT,
    "evcalib/joint/_offset_search.py": JOINT,
    "evcalib/pipeline/_assessment.py": JOINT,
    "evcalib/kernels/alignment/offset.py": ("test_offset",),
    "evcalib/kernels/alignment/rotation.py": ("test_rotation", "test_offset"),
    "evcalib/kernels/kinematics/velocity_track.py": ("test_track", "test_offset"),
    "evcalib/kernels/uncertainty/noise.py": ("test_uncertainty",),
    "evcalib/kernels/joint/observations.py": ("test_joint",),
    "evcalib/kernels/joint/observation_model.py": ("test_joint",),
}
"""The back end, and the tests that answer for each of its modules."""

LAST = ("test_unchanged",)

SWAPS: dict[type, str] = {
    ast.Add: "-",
    ast.Sub: "+",
    ast.Mult: "/",
    ast.Div: "*",
    ast.Pow: "*",
    ast.FloorDiv: "*",
    ast.Mod: "*",
    ast.BitAnd: "|",
    ast.BitOr: "&",
    ast.Lt: "<=",
    ast.LtE: "<",
    ast.Gt: ">=",
    ast.GtE: ">",
    ast.Eq: "!=",
    ast.NotEq: "==",
    ast.Is: "is not",
    ast.IsNot: "is",
    ast.And: "or",
    ast.Or: "and",
}
SIGNS = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
    ast.FloorDiv: "//",
    ast.Mod: "%",
    ast.BitAnd: "&",
    ast.BitOr: "|",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Is: "is",
    ast.IsNot: "is not",
    ast.And: "and",
    ast.Or: "or",
}


@dataclass(frozen=True)
class Mutant:
    """One change: bytes `start` to `stop` of a module become `text`."""

    module: str
    start: int
    stop: int
    text: str

    def applied(self, source: bytes) -> bytes:
        """Return the changed module."""
        return source[: self.start] + self.text.encode() + source[self.stop :]

    def words(self, source: bytes) -> str:
        """Return where it is, and the line before and after."""
        number = source[: self.start].count(b"\n")
        old = source.splitlines()[number].decode().strip()
        new = self.applied(source).splitlines()[number].decode().strip()
        return f"{self.module}:{number + 1}: {old}  ->  {new}"


class _Finder(ast.NodeVisitor):
    """Collects what can be changed, leaving out annotations, docstrings and texts of errors."""

    def __init__(self, module: str, source: bytes) -> None:
        self.module, self.source, self.found = module, source, list[Mutant]()
        lengths = [len(line) for line in source.splitlines(keepends=True)]
        self.starts = [0, *np.cumsum(lengths).tolist()]

    def at(self, line: int, column: int) -> int:
        return self.starts[line - 1] + column

    def span(self, node: ast.AST) -> tuple[int, int]:
        return self.at(node.lineno, node.col_offset), self.at(node.end_lineno, node.end_col_offset)

    def add(self, start: int, stop: int, text: str) -> None:
        self.found.append(Mutant(self.module, start, stop, text))

    def swap(self, operator: ast.AST, left: ast.AST, right: ast.AST) -> None:
        """Change the sign between two operands; parentheses and comments stay where they are."""
        if type(operator) not in SWAPS:
            return
        low, high, sign = self.span(left)[1], self.span(right)[0], SIGNS[type(operator)]
        place = self.source[low:high].find(sign.encode())
        if place >= 0:
            self.add(low + place, low + place + len(sign), SWAPS[type(operator)])

    def visit_BinOp(self, node):
        self.swap(node.op, node.left, node.right)
        self.generic_visit(node)

    def visit_AugAssign(self, node):
        self.swap(node.op, node.target, node.value)
        self.generic_visit(node)

    def visit_Compare(self, node):
        for operator, left, right in zip(
            node.ops, [node.left, *node.comparators], node.comparators, strict=False
        ):
            self.swap(operator, left, right)
        self.generic_visit(node)

    def visit_BoolOp(self, node):
        for left, right in zip(node.values, node.values[1:], strict=False):
            self.swap(node.op, left, right)
        self.generic_visit(node)

    def visit_UnaryOp(self, node):
        start, stop = self.span(node)[0], self.span(node.operand)[0]
        if isinstance(node.op, ast.USub | ast.Not | ast.Invert):
            self.add(start, stop, "(" if self.source[start:stop].rstrip().endswith(b"(") else "")
        self.generic_visit(node)

    def visit_Constant(self, node):
        start, stop = self.span(node)
        if isinstance(node.value, bool):
            self.add(start, stop, str(not node.value))
        elif isinstance(node.value, int):
            self.add(start, stop, str(node.value + 1))
        elif isinstance(node.value, float):
            self.add(start, stop, repr(1.5 * node.value if node.value else 1.0))

    def visit_If(self, node):
        start, stop = self.span(node.test)
        self.add(start, stop, f"not ({self.source[start:stop].decode()})")
        self.generic_visit(node)

    def visit_Break(self, node):
        self.add(*self.span(node), "continue")

    def visit_Raise(self, node):
        self.add(*self.span(node), "pass")

    def visit_AnnAssign(self, node):
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node):
        for part in (*node.args.defaults, *filter(None, node.args.kw_defaults), *node.body):
            self.visit(part)

    def visit_Assert(self, node):
        """Leave out what only tells the type checker."""

    def visit_JoinedStr(self, node):
        """Leave out texts."""


def mutants_of(module: str) -> list[Mutant]:
    """Return all mutants of a module that are still Python."""
    source = (ROOT / module).read_bytes()
    finder = _Finder(module, source)
    finder.visit(ast.parse(source))
    found = []
    for mutant in dict.fromkeys(finder.found):
        try:
            compile(mutant.applied(source), module, "exec")
        except SyntaxError:
            continue
        found.append(mutant)
    return found


def survives(copy: Path, tests: tuple[str, ...]) -> bool:
    """Tell whether the tests pass on the copy as it is."""
    process = os.fork()
    if process == 0:
        os.setsid()
        null = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(null, stream)
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
        os.chdir(copy)
        sys.path[:0] = [str(copy), str(copy / "tests")]
        files = [f"tests/{name}.py" for name in tests]
        import pytest

        options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:nbval", "--benchmark-skip"]
        os._exit(pytest.main([*options, "--override-ini=addopts=", "--hypothesis-seed=0", *files]))
    _, status = os.waitpid(process, 0)
    return os.waitstatus_to_exitcode(status) == 0


def tried(mutant: Mutant, copy: Path) -> str:
    """Put the mutant in, run its tests, and take it out again; return what became of it."""
    place = copy / mutant.module
    source = place.read_bytes()
    try:
        place.write_bytes(mutant.applied(source))
        _forget_kernels(copy, mutant.module)
        if not survives(copy, MODULES[mutant.module]):
            return "killed"
        return "survived" if survives(copy, LAST) else "seen as a change"
    finally:
        place.write_bytes(source)
        _forget_kernels(copy, mutant.module)


def _forget_kernels(copy: Path, module: str) -> None:
    """Remove compiled kernels that inline this module: the cache does not notice its change."""
    name = module.removesuffix(".py").replace("/", ".")
    for user in (copy / "evcalib" / "kernels").rglob("*.py"):
        if f"{name} import" in user.read_text() or user == copy / module:
            for path in (user.parent / "__pycache__").glob(f"{user.stem}.*.nb[ic]"):
                path.unlink()


def main() -> None:
    """Draw mutants, try them, print and store the score."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--mutants", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--again", action="store_true", help="those in survivors.txt")
    parser.add_argument("--only", nargs="+", choices=tuple(MODULES), help="these modules")
    options = parser.parse_args()
    # A mutant may have the size and the second of the one before: no bytes of that one.
    sys.dont_write_bytecode = True
    every = [m for module in options.only or MODULES for m in mutants_of(module)]
    rng = np.random.default_rng(options.seed)
    if options.again:
        left = set((HERE / "survivors.txt").read_text().splitlines())
        every = [m for m in every if m.words((ROOT / m.module).read_bytes()) in left]
    count = len(every) if options.again else min(options.mutants, len(every))
    drawn = [every[k] for k in np.sort(rng.choice(len(every), count, replace=False))]
    print(f"{len(every)} possible mutants, {count} drawn", flush=True)
    started, fates, alive = time.monotonic(), Counter[tuple[str, str]](), list[str]()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "project"
        ignored = shutil.ignore_patterns("__pycache__", "*.ipynb", ".git", ".venv*", ".artefacts")
        shutil.copytree(ROOT, copy, ignore=ignored)
        if (ROOT.parent / "shared").exists():
            (Path(folder) / "shared").symlink_to(ROOT.parent / "shared")
        _preload()
        for tests in sorted({LAST} | {MODULES[m.module] for m in drawn}):
            if not survives(copy, tests):
                raise SystemExit(f"the tests {tests} fail on the code as it is")
        for mutant in drawn:
            fate, words = tried(mutant, copy), mutant.words((ROOT / mutant.module).read_bytes())
            fates[mutant.module, fate] += 1
            print(f"{fate}: {words}", flush=True)
            if fate == "survived":
                alive.append(words)
    if not options.again:
        _store(fates, alive)
    killed, changed = (sum(fates[m, f] for m in MODULES) for f in ("killed", "seen as a change"))
    print(
        f"of {count}: {killed / count:.1%} killed, with those seen as a change"
        f" {(killed + changed) / count:.1%} ({time.monotonic() - started:.0f} s)"
    )


def _preload() -> None:
    """Load the libraries once; the project itself is loaded by each fork."""
    import cv2  # noqa: F401
    import matplotlib.pyplot  # noqa: F401
    import numba  # noqa: F401
    import pytest  # noqa: F401
    import scipy.optimize
    import scipy.stats  # noqa: F401


def _store(fates: Counter[tuple[str, str]], alive: list[str]) -> None:
    names = ("killed", "seen as a change", "survived")
    tried = [module for module in MODULES if any(fates[module, name] for name in names)]
    rows = [["module", *names]]
    rows += [[module, *(str(fates[module, name]) for name in names)] for module in tried]
    (HERE / "score.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    (HERE / "survivors.txt").write_text("".join(line + "\n" for line in alive))


if __name__ == "__main__":
    main()
