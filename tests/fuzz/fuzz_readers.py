"""Coverage-guided fuzzing of the readers, kept apart from the tests: `fuzz_readers.py all`.

Needs atheris (``pip install atheris``, Apache-2.0), which is no dependency of the tests.  A child
process mutates the seeds of `fuzz.targets` and calls one reader on each input.  A finding is
anything but an answer or an InputError: another exception, a crash or panic of a library, more
than `SECONDS` of time or `ROOM` of memory, or events that break the contract of `fuzz.targets`.
The child goes on after an exception and is started again after a crash.

Each run adds its findings to findings.csv, and its time and inputs to the reader's row in
results.csv; a finding that the latest run did not see again counts as fixed there.  The inputs that
are findings are kept in the folder of `--keep`.
"""

from __future__ import annotations

import argparse
import csv
import mmap
import os
import resource
import shutil
import signal
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
    "data_tools.recordings.formats._events_text_kernels",
    "data_tools.recordings.formats._dat_kernels",
    "data_tools.recordings.formats._evt2_kernels",
    "data_tools.recordings.formats._evt3_kernels",
    "data_tools.recordings.formats._es_kernels",
]
CRASHES = {"crash": "crash of the process", "timeout": "hang", "oom": "memory", "leak": "leak"}


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    words.add_argument("reader", nargs="+", help="names of fuzz.targets.TARGETS, or all")
    words.add_argument("--seconds", type=int, default=120, help="time for each reader")
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--keep", type=Path, help="folder for inputs that are findings")
    words.add_argument("--python-kernels", action="store_true", help="count coverage in kernels")
    given = words.parse_args()
    targets = instrumented(given.python_kernels)
    for reader in targets if given.reader == ["all"] else given.reader:
        fuzz(reader, targets[reader], given)


def instrumented(python_kernels: bool) -> dict:
    """Import the readers so that what an input reaches is seen; kernels check their indices."""
    import atheris

    caches = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "evcalib-fuzz"
    os.environ |= {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(caches)}
    os.environ |= {"NUMBA_DISABLE_JIT": "1"} if python_kernels else {}
    sys.path[:0] = [str(HOME.parent)]
    parts = ["data_tools", "yaml", "zipfile", "rosbags.rosbag1", "rosbags.rosbag2"]
    with atheris.instrument_imports(include=parts, exclude=[] if python_kernels else KERNELS):
        from fuzz.targets import TARGETS
    return TARGETS


def fuzz(reader: str, target, given: argparse.Namespace) -> None:
    """Fuzz one reader for some seconds and record what was found."""
    found: set[str] = set()
    seconds, seed = 0.0, given.seed
    with TemporaryDirectory(prefix="fuzz-") as scratch:
        home = Path(scratch)
        for name in ("corpus", "found", "work"):
            (home / name).mkdir()
        (home / "count").write_bytes(bytes(8))
        while (left := given.seconds - seconds) > 1:
            seconds += run_once(reader, target, home, int(left + 1), seed)
            seed += 1
            for path in (home / "found").glob("*-*"):
                kind = path.name.split("-")[0]
                if kind in CRASHES:
                    found.add(f"{CRASHES[kind]} {told(home / 'log')}".strip())
                    path.rename(home / "found" / f"stopped_{path.name}")
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


def run_once(reader: str, target, home: Path, seconds: int, seed: int) -> float:
    """Fuzz in a child until its time is over or it crashes; return how long [s] that took."""
    started = time.monotonic()
    child = os.fork()
    if child == 0:
        with open(home / "log", "wb") as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        try:
            run_child(reader, target, home, seconds, seed)
        finally:
            os._exit(3)
    while time.monotonic() - started < seconds + 60:
        if os.waitpid(child, os.WNOHANG) != (0, 0):
            break
        time.sleep(0.1)
    else:
        os.kill(child, signal.SIGUSR1)  # it writes where it is to the log
        time.sleep(2)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        shutil.copy(home / "work" / "last", home / "found" / "timeout-of-the-child")
        shutil.copy(home / "log", home / "found" / f"hang_{seed}.trace")
    if not (home / "work" / "ready").exists():
        sys.exit((home / "log").read_text(errors="replace")[-4000:])
    return time.monotonic() - started


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


def run_child(reader: str, target, home: Path, seconds: int, seed: int) -> None:
    """Fuzz in this process; never returns."""
    import faulthandler

    import atheris
    from conftest import DATA
    from fuzz import seeds

    from evcalib.errors import InputError

    faulthandler.register(signal.SIGUSR1)
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
    flags = [f"-max_total_time={seconds}", f"-timeout={SECONDS}", "-rss_limit_mb=0"]
    flags += [f"-seed={seed}", f"-artifact_prefix={home}/found/", "-print_final_stats=1"]
    flags += [f"-max_len={max(4096, longest + 256)}", "-verbosity=0"]
    atheris.Setup([sys.argv[0], *flags, str(home / "corpus")], attempt)
    atheris.Fuzz()


def record(reader: str, with_what: str, seconds: float, inputs: int, found: set[str]) -> None:
    """Add the findings and the row of a run."""
    known = read_rows(FINDINGS, ["reader", "finding"])
    known += [[reader, what] for what in sorted(found) if [reader, what] not in known]
    write_rows(FINDINGS, ["reader", "finding"], known)
    ever = sum(row[0] == reader for row in known)
    rows = {(old[0], old[1]): old for old in read_rows(RESULTS, HEADER)}
    before = rows.get((reader, with_what), ["", "", "0", "0"])
    total = [f"{seconds + int(before[2]):.0f}", inputs + int(before[3])]
    row = [reader, with_what, *total, ever, ever - len(found), len(found)]
    rows[reader, with_what] = list(map(str, row))
    write_rows(RESULTS, HEADER, sorted(rows.values()))
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
