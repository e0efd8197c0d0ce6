#!/bin/sh
# Tries the wheel and the source distribution as a user has them: in fresh environments and a folder outside of the
# repository. Usage: test.sh PYTHON WHEELS, the folder of both, with CARGO_TARGET_DIR for what the source distribution
# compiles.
set -eu
python=$1
wheels=$(cd "$2" && pwd)
here=$(cd "$(dirname "$0")" && pwd)
fresh=$(mktemp -d)
trap 'rm -rf "$fresh"' EXIT
cd "$fresh"

# With numpy alone.
"$python" -m venv plain
plain/bin/pip install --quiet --disable-pip-version-check "$wheels"/*.whl
plain/bin/mcl-eval --version
plain/bin/mcl-eval map simulated-office --init grid --size 1% -o map.csv
plain/bin/python -c 'import mcl_eval; print(mcl_eval.localize(mcl_eval.read_log("simulated-office"), mcl_eval.Map.read("map.csv")).figures["translation"])'

"$python" -m venv full
full/bin/pip install --quiet --disable-pip-version-check -r "$here/requirements-test.txt" "$wheels"/*.whl
PATH="$fresh/full/bin:$PATH" full/bin/python -m pytest -q -p no:cacheprovider "$here/tests"
full/bin/python -m mypy --strict --cache-dir "$fresh/mypy" -p mcl_eval

# Without git, and without what lies around the source distribution.
"$python" -m venv source
source/bin/pip install --quiet --disable-pip-version-check "$wheels"/*.tar.gz
source/bin/mcl-eval --version
source/bin/python -c 'import mcl_eval; print(len(mcl_eval.read_log("simulated-office")), "scans")'
