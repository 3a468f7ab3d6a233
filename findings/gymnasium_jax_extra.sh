#!/bin/sh
# gymnasium[jax] 1.4.0 with jax 0.10.2 and numpy 2.4.6, 2026-11-29.
# Expected: with the extra jax (and so with torch) the wrappers that it is for, such as JaxToNumpy, can be imported.
# Seen: ModuleNotFoundError: No module named 'packaging', which their module imports. The extras array-api and mujoco
# require it, jax and torch do not; in most environments some other package has brought it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check "gymnasium[jax]==1.4.0" jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6
if venv/bin/python -c "from gymnasium.wrappers.vector import JaxToNumpy" 2>message; then
    echo "CHANGED: the wrapper can be imported"
    exit 1
fi
tail -n 1 message
grep -q "No module named 'packaging'" message
venv/bin/pip install --quiet --disable-pip-version-check packaging==26.3
venv/bin/python -c "from gymnasium.wrappers.vector import JaxToNumpy; print('with packaging:', JaxToNumpy)"
