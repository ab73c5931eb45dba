#!/usr/bin/env bash
# Runs the tests that meet kernels directly with bounds checked in all of them (numba checks none of its own accord).
set -euo pipefail
cd "$(dirname "$0")/.."
NUMBA_CACHE_DIR=$(mktemp -d)
trap 'rm -rf "$NUMBA_CACHE_DIR"' EXIT
export NUMBA_CACHE_DIR NUMBA_BOUNDSCHECK=1

python - <<'PY'
import numba
import numpy as np

@numba.njit
def beyond(a):
    return a[a.size]

try:
    beyond(np.zeros(3))
except IndexError:
    print("bounds are checked")
else:
    raise SystemExit("bounds are not checked")
PY

mapfile -t files < <(grep -lE "evcalib\.kernels|naive|unchanged|fuzz_formats" tests/test_*.py; ls tests/test_formats*.py tests/test_events*.py)
mapfile -t files < <(printf '%s\n' "${files[@]}" | sort -u)
started=$SECONDS
pytest -q -p no:cacheprovider -n 2 --dist loadfile "${files[@]}"
printf '%d files of tests with bounds checked (%d s)\n' "${#files[@]}" $((SECONDS - started))
