#!/bin/sh
# gymnasium 1.4.0 with numpy 2.4.6 and array-api-compat 1.16.0 in an environment of their own, 2026-11-29.
# Expected: gymnasium.wrappers.vector.ArrayConversion, or the hint of gymnasium's own about a missing extra, as it gives
# for array-api-compat.
# Seen: ModuleNotFoundError: No module named 'packaging': the module of the wrappers between array libraries (NumpyToTorch
# and JaxToNumpy, too) imports it, and no requirement of gymnasium, nor of its extra array-api's package, brings it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gymnasium==1.4.0 numpy==2.4.6 array-api-compat==1.16.0
if venv/bin/python -c "from gymnasium.wrappers.vector import ArrayConversion" 2>message; then
    echo "CHANGED: the wrapper can be imported"
    exit 1
fi
tail -n 1 message
grep -q "No module named 'packaging'" message
venv/bin/pip install --quiet --disable-pip-version-check packaging==26.3
venv/bin/python -c "from gymnasium.wrappers.vector import ArrayConversion; print('with packaging:', ArrayConversion)"
