#!/usr/bin/env bash
# Builds sdist and wheel, and tries the wheel where nothing else is installed:
#
#     .ci/package.sh newest    with the newest versions of everything that it needs
#     .ci/package.sh oldest    with the oldest that pyproject.toml allows (.ci/oldest.txt)
#
# The tests are those of the sdist, on the installed wheel. More of them: TESTS="tests" .ci/package.sh ...
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD which=$1 work=$PWD/.artefacts/package
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore PIP_QUIET=1 NUMBA_CACHE_DIR=$work/numba-$which
core="test_align test_camera test_cli test_corners test_epipolar test_event_image test_events test_events_text
    test_export test_features test_formats_hdf5 test_formats_prophesee test_formats_tables test_geometry test_heading
    test_joint test_kinematics test_offset test_rotation test_surfaces test_track test_two_views test_vehicles"

started=$SECONDS
note() { printf -- '-- %s: %s (%d s)\n' "$which" "$1" $((SECONDS - started)); }

rm -rf "$work/dist" "$work/sdist" "${work:?}/$which" "$NUMBA_CACHE_DIR"
mkdir -p "$work/sdist"
note "sdist, and the wheel from it"
python3 -m venv "$work/$which"
bin=$work/$which/bin
"$bin/pip" install build
"$bin/python" -m build --outdir "$work/dist" . >"$work/build.log" || { cat "$work/build.log"; exit 1; }
"$bin/pip" uninstall -y build pyproject_hooks
tar -xzf "$work"/dist/*.tar.gz -C "$work/sdist" --strip-components=1
python3 .ci/contents.py "$work"/dist/*.whl "$work/sdist"

wheel=$(echo "$work"/dist/*.whl)
constraints=() extras=notebooks,formats warnings=()
if [ "$which" = oldest ]; then
    constraints=(-c .ci/oldest.txt) extras=formats
    # What an old library says about its newer dependencies is not ours to mend.
    warnings=(-W ignore::DeprecationWarning -W ignore::PendingDeprecationWarning)
fi
note "install"
"$bin/pip" install "${constraints[@]}" "$wheel[$extras]" "pytest>=8" "hypothesis>=6.100"
"$bin/pip" check
"$bin/python" .ci/licences.py ${extras//,/ } >"$work/licences-$which.txt"

note "tests"
cd "$work/sdist"
# shellcheck disable=SC2086
"$bin/pytest" -q -p no:cacheprovider -o addopts="--strict-markers --strict-config" "${warnings[@]}" \
    ${TESTS:-$(printf 'tests/%s.py ' $core)}
if [ "$which" = newest ]; then
    note "main job and notebooks"
    mkdir -p "$work/try" && cd "$work/try"
    "$bin/evcalib" demo >demo.txt || { cat demo.txt; exit 1; }
    "$bin/python" "$root/.ci/try_lab.py"
fi
note "done"
