#!/usr/bin/env bash
# Runs the tests of what calls kernels with bounds checked in all of them; numba checks none of its own accord.
set -euo pipefail
cd "$(dirname "$0")/.."
NUMBA_CACHE_DIR=$(mktemp -d)
trap 'rm -rf "$NUMBA_CACHE_DIR"' EXIT
export NUMBA_CACHE_DIR NUMBA_BOUNDSCHECK=1
names="authors campaign cgoc corners epipolar event_image events events_text features filters
    formats_aedat4 formats_hdf5
    formats_prophesee formats_streams formats_tables fuzz_flips geometry hand_eye heading joint joint_search offset
    rotation simulator surface_quality surfaces track tracks two_views uncertainty unchanged"

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

started=$SECONDS
# shellcheck disable=SC2046,SC2086
pytest -q -p no:cacheprovider -n 2 --dist loadfile $(printf 'tests/test_%s.py ' $names)
printf 'no index beyond its array in %d files of tests (%d s)\n' "$(wc -w <<<"$names")" $((SECONDS - started))
