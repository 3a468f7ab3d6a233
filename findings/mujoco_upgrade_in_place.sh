#!/bin/sh
# mujoco 3.17.0 upgraded in place to 4.0.0 (PyPI, Linux, Python 3.11), 2026-11-29.
# Expected: after `pip install --upgrade mujoco==4.0.0` the package can be imported.
# Seen: pip installs mujoco, mujoco-core and mujoco-studio 4.0.0, and `import mujoco` raises ImportError: uninstalling
# the old, monolithic mujoco took files of mujoco-core along. MuJoCo's own message tells the repair; uninstalling
# mujoco first avoids it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==3.17.0
venv/bin/pip install --quiet --disable-pip-version-check --upgrade mujoco==4.0.0
venv/bin/pip list --disable-pip-version-check 2>/dev/null | grep mujoco
if venv/bin/python -c "import mujoco" 2>message; then
    echo "CHANGED: mujoco can be imported after an upgrade in place"
    exit 1
fi
tail -n 2 message
venv/bin/pip uninstall --quiet --yes mujoco mujoco-core mujoco-studio
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0
venv/bin/python -c "import mujoco; print('after uninstalling and installing again:', mujoco.__version__)"
