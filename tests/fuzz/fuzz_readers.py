"""Coverage-guided fuzzing of the readers, kept apart from the tests: `fuzz_readers.py all`.

Needs atheris (``pip install atheris``, Apache-2.0), which is no dependency of the tests.  A child
process mutates the seeds of `fuzz.targets` and calls one reader on each input.  A finding is
anything but an answer or an InputError: another exception, a crash or panic of a library, more
than `SECONDS` of time or `ROOM` of memory, or events that break the contract of `fuzz.targets`.
The child goes on after an exception and is started again after a crash.

Each run adds its findings to findings.csv and its row to results.csv; a finding that the latest
run of a reader did not see again counts as fixed.  The inputs are kept in the folder of `--keep`.
"""

from __future__ import annotations

import argparse
import csv
import mmap
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from tempfile import TemporaryDirectory

HOME = Path(__file__).resolve().parent
RESULTS, FINDINGS = HOME / "results.csv", HOME / "findings.csv"
HEADER = ["reader", "engine", "seconds", "inputs", "found", "fixed", "remaining"]
SECONDS = 10
ROOM = 3 << 30
KERNELS = [
    "evcalib.kernels",
    "data_tools._events_text_kernels",
    "data_tools.formats._dat_kernels",
    "data_tools.formats._evt2_kernels",
    "data_tools.formats._evt3_kernels",
]
CRASHES = {"crash": "crash of the process", "timeout": "hang", "oom": "memory", "leak": "leak"}


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    words.add_argument("reader", nargs="+", help="names of fuzz.targets.TARGETS, or all")
    words.add_argument("--seconds", type=float, default=120, help="time for each reader")
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--keep", type=Path, help="folder for inputs that are findings")
    words.add_argument("--python-kernels", action="store_true", help="count coverage in kernels")
    words.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    given = words.parse_args()
    if given.child is not None:
        run_child(given.reader[0], given.child, given)
    sys.path[:0] = [str(HOME.parent)]
    from fuzz.targets import TARGETS

    for reader in TARGETS if given.reader == ["all"] else given.reader:
        fuzz(reader, given)


def fuzz(reader: str, given: argparse.Namespace) -> None:
    """Fuzz one reader for some seconds and record what was found."""
    found: set[str] = set()
    with TemporaryDirectory(prefix="fuzz-") as scratch:
        home = Path(scratch)
        for name in ("corpus", "found", "work"):
            (home / name).mkdir()
        (home / "count").write_bytes(bytes(8))
        started, seed = time.monotonic(), given.seed
        while (left := given.seconds - (time.monotonic() - started)) > 1:
            run_once(reader, home, given, int(left + 1), seed)
            seed += 1
            for path in (home / "found").glob("*-*"):
                kind = path.name.split("-")[0]
                if kind in CRASHES:
                    found.add(CRASHES[kind] + " " + told(home / "log"))
                    path.rename(home / "found" / f"stopped_{path.name}")
            if not (home / "work" / "ready").exists():
                sys.exit((home / "log").read_text(errors="replace")[-4000:])
        seconds = time.monotonic() - started
        inputs = int.from_bytes((home / "count").read_bytes(), "little")
        for path in (home / "found").glob("*.txt"):
            found.add(path.read_text())
        if given.keep is not None:
            given.keep.mkdir(parents=True, exist_ok=True)
            for path in (home / "found").iterdir():
                (given.keep / f"{reader}_{path.name}").write_bytes(path.read_bytes())
    record(reader, engine(given), seconds, inputs, found)


def engine(given: argparse.Namespace) -> str:
    from importlib.metadata import version

    return f"atheris {version('atheris')}" + (", Python kernels" * given.python_kernels)


def run_once(reader: str, home: Path, given: argparse.Namespace, seconds: int, seed: int) -> None:
    """Run a child until its time is over or it crashes."""
    caches = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "evcalib-fuzz"
    environment = os.environ | {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(caches)}
    if given.python_kernels:
        environment["NUMBA_DISABLE_JIT"] = "1"
    command = [sys.executable, __file__, reader, "--child", str(home), "--seconds", str(seconds)]
    command += ["--seed", str(seed)] + ["--python-kernels"] * given.python_kernels
    with open(home / "log", "wb") as log:
        child = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
        try:
            child.wait(seconds + 60)
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGUSR1)  # it writes where it is to the log
            time.sleep(2)
            child.kill()
            child.wait()
            shutil.copy(home / "work" / "last", home / "found" / "timeout-of-the-child")
            shutil.copy(home / "log", home / "found" / f"hang_{seed}.trace")


def told(log: Path) -> str:
    """Return what stopped the child: the first frame that its log names, else its last words."""
    lines = log.read_text(errors="replace").splitlines()
    for line in lines:
        if "File " in line and ("data_tools" in line or "evcalib" in line):
            return "in " + line.strip().split("/")[-1].replace('"', "").split(",")[0]
    for line in lines:
        if "ERROR: libFuzzer" in line:
            return line.split("ERROR: ")[1]
    return ""


def run_child(reader: str, home: Path, given: argparse.Namespace) -> None:
    """Fuzz in this process; never returns."""
    import faulthandler

    import atheris

    faulthandler.register(signal.SIGUSR1)
    sys.path[:0] = [str(HOME.parent)]
    parts = ["data_tools", "evcalib", "yaml", "zipfile", "rosbags.rosbag1", "rosbags.rosbag2"]
    exclude = [] if given.python_kernels else KERNELS
    with atheris.instrument_imports(include=parts, exclude=exclude):
        from fuzz.targets import TARGETS

    from conftest import DATA
    from fuzz import seeds

    from evcalib.errors import InputError

    target = TARGETS[reader]
    made = target.make()
    real = DATA / "formats" / "davis346.aedat4"
    if reader == "aedat4" and real.exists():
        made.append(seeds.aedat4(real, 20_000))
    for number, content in enumerate(made):
        (home / "corpus" / f"seed{number}").write_bytes(content)
    path = home / "work" / f"input{target.suffix}"
    with open(home / "count", "r+b") as file:
        count = mmap.mmap(file.fileno(), 8)

    def attempt(data: bytes) -> None:
        count[:] = (int.from_bytes(count[:], "little") + 1).to_bytes(8, "little")
        path.write_bytes(data)
        (home / "work" / "last").write_bytes(data)
        try:
            target.read(path)
        except InputError as error:
            if len(str(error)) > 5000:
                keep(AssertionError("a message of over 5000 characters"), data)
        except Exception as error:
            keep(error, data)

    def keep(error: Exception, data: bytes) -> None:
        where = [f for f in traceback.extract_tb(error.__traceback__) if "fuzz" not in f.filename]
        ours = [f for f in where if "data_tools" in f.filename or "evcalib" in f.filename]
        frame = (ours or where or [None])[-1]
        place = f"{Path(frame.filename).stem}.{frame.name}" if frame else "the contract"
        what = f"{type(error).__name__} in {place}"
        if isinstance(error, AssertionError):
            what += f": {error}"[:100]
        what = " ".join(what.split())
        stem = home / "found" / "".join(c if c.isalnum() else "_" for c in what)
        if not stem.with_suffix(".txt").exists():
            stem.with_suffix(".txt").write_text(what)
            stem.with_suffix(".bin").write_bytes(data)
            stem.with_suffix(".trace").write_text("".join(traceback.format_exception(error)))

    for content in made:
        attempt(content)
    (home / "work" / "ready").touch()
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + ROOM, used + ROOM))
    longest = max(map(len, made))
    flags = [f"-max_total_time={int(given.seconds)}", f"-timeout={SECONDS}", "-rss_limit_mb=0"]
    flags += [f"-seed={given.seed}", f"-artifact_prefix={home}/found/", "-print_final_stats=1"]
    flags += [f"-max_len={max(4096, longest + 256)}", "-verbosity=0"]
    atheris.Setup([sys.argv[0], *flags, str(home / "corpus")], attempt)
    atheris.Fuzz()


def record(reader: str, with_what: str, seconds: float, inputs: int, found: set[str]) -> None:
    """Add the findings and the row of a run."""
    known = read_rows(FINDINGS, ["reader", "finding"])
    known += [[reader, what] for what in sorted(found) if [reader, what] not in known]
    write_rows(FINDINGS, ["reader", "finding"], known)
    ever = sum(row[0] == reader for row in known)
    row = [reader, with_what, f"{seconds:.0f}", inputs, ever, ever - len(found), len(found)]
    others = [old for old in read_rows(RESULTS, HEADER) if old[:2] != [reader, with_what]]
    write_rows(RESULTS, HEADER, sorted([*others, list(map(str, row))]))
    print(f"{reader}: {inputs} inputs in {seconds:.0f} s, {len(found)} findings", flush=True)
    for what in sorted(found):
        print(f"  {what}", flush=True)


def read_rows(path: Path, header: list[str]) -> list[list[str]]:
    if not path.exists():
        return []
    with path.open(newline="") as file:
        first, *rows = csv.reader(file)
    return rows if first == header else []


def write_rows(path: Path, header: list[str], rows: list[list[str]]) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])


if __name__ == "__main__":
    main()
