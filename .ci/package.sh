#!/usr/bin/env bash
# Builds sdist and wheel, and tries the wheel where nothing else is installed:
#
#     .ci/package.sh newest    with the newest versions of everything that it needs
#     .ci/package.sh oldest    with the oldest that pyproject.toml allows (.ci/oldest.txt)
#
# or both. The tests are those of the sdist, on the installed wheel: a part of them, or
# TESTS=tests .ci/package.sh newest
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD work=$PWD/.artefacts/package
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore PIP_QUIET=1
core="align camera cli corners epipolar event_image events events_text export features formats_aedat4 formats_hdf5
    formats_prophesee formats_tables geometry heading joint kinematics lab offset rotation surfaces track two_views unchanged"

started=$SECONDS
note() { printf -- '-- %s (%d s)\n' "$1" $((SECONDS - started)); }

build() {
    note "sdist, and the wheel from it"
    rm -rf "$work" && mkdir -p "$work/sdist"
    python3 -m venv "$work/build"
    "$work/build/bin/pip" install build
    "$work/build/bin/python" -m build --outdir "$work/dist" . >"$work/build.log" || { cat "$work/build.log"; exit 1; }
    tar -xzf "$work"/dist/*.tar.gz -C "$work/sdist" --strip-components=1
    wheel=$(echo "$work"/dist/*.whl)
    python3 .ci/contents.py "$wheel" "$work/sdist"
}

try() {
    local which=$1 bin=$work/$1/bin extras=notebooks,formats constraints=() warnings=()
    export NUMBA_CACHE_DIR=$work/numba-$which
    if [ "$which" = oldest ]; then
        constraints=(-c .ci/oldest.txt)
        # What an old library says about its newer dependencies is not ours to mend.
        warnings=(-W ignore::DeprecationWarning -W ignore::PendingDeprecationWarning)
    fi
    note "$which: install"
    python3 -m venv "$work/$which"
    "$bin/pip" install "${constraints[@]}" "$wheel[$extras]" "pytest>=8" "hypothesis>=6.100"
    "$bin/pip" check
    # shellcheck disable=SC2086
    "$bin/python" .ci/licences.py ${extras//,/ } >"$work/licences-$which.txt"
    note "$which: tests"
    # shellcheck disable=SC2086
    (cd "$work/sdist" && "$bin/pytest" -q -p no:cacheprovider -o addopts="--strict-markers --strict-config" \
        "${warnings[@]}" ${TESTS:-$(printf 'tests/test_%s.py ' $core)})
    note "$which: main job and notebooks"
    mkdir -p "$work/try" && cd "$work/try"
    "$bin/evcalib" demo >demo.txt || { cat demo.txt; exit 1; }
    "$bin/python" "$root/.ci/try_lab.py"
    cd "$root"
}

build
for which in "$@"; do
    try "$which"
done
note "done"
