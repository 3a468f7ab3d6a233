#!/bin/sh
# dm_control 1.0.50 with mujoco 4.0.0 (its requirement is satisfied), 2026-11-29.
# Expected: Physics.from_xml_string makes a physics of a hinged sphere.
# Seen: AttributeError: 'MjModel' object has no attribute 'flex_vertedge', for every model: the index of named fields
# lists fields that MuJoCo 4.0 does not have.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check dm_control==1.0.50 mujoco==4.0.0
venv/bin/python - <<'P'
import sys

from dm_control import mujoco

XML = """
<mujoco><worldbody><body><joint name="hinge" type="hinge"/><geom size=".1" mass="1"/></body></worldbody></mujoco>
"""
try:
    mujoco.Physics.from_xml_string(XML)
except AttributeError as fault:
    print("AttributeError:", fault)
else:
    sys.exit("CHANGED: Physics works")
P
