#!/usr/bin/env bash
# Runs the notebooks with the CPU's newer instruction sets switched off: numpy, OpenCV, numba, OpenBLAS and libm
# choose code by CPU, and what the notebooks store must be the same on another machine.
#   .ci/plain_cpu.sh                             all notebooks
#   .ci/plain_cpu.sh notebooks/04_offset.ipynb   some
set -euo pipefail
cd "$(dirname "$0")/.."
cache=$(mktemp -d)
trap 'rm -rf "$cache"' EXIT

dispatched=$(python - <<'PY'
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
print(" ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name)))
PY
)
export NPY_DISABLE_CPU_FEATURES=$dispatched
export OPENCV_CPU_DISABLE=AVX,FP16,AVX2,AVX512-SKX
export NUMBA_CPU_NAME=generic NUMBA_CACHE_DIR=$cache
export OPENBLAS_CORETYPE=Nehalem
export GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-AVX512F,-FMA

python - <<'PY'
import re

import cv2
import numba
import numpy as np
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

@numba.njit
def dot(a, b):
    total = 0.0
    for k in range(a.size):
        a[k] += 2 * b[k]
        total += a[k] * b[k]
    return total

dot(np.ones(9), np.ones(9))
code = "".join(dot.inspect_asm().values())
assert not any(__cpu_features__[name] for name in __cpu_dispatch__), "numpy"
assert not re.search(r"AVX[\w-]*(?![\w?-])", cv2.getCPUFeaturesLine()), cv2.getCPUFeaturesLine()
assert "xmm" in code and "ymm" not in code and "zmm" not in code and "fmadd" not in code, "numba"
print("switched off for numpy, OpenCV and numba")
PY

started=$SECONDS
pytest -q -p no:cacheprovider --nbval-cell-timeout=600 --durations=5 "${@:-notebooks}"
printf 'the stored outputs hold without newer instructions (%d s)\n' $((SECONDS - started))
