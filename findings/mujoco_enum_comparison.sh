#!/bin/sh
# mujoco 4.0.0 with numpy 2.4.6, 2026-11-29 (3.17.0 does the same).
# Expected: `a == b` and `b == a` agree for a joint type read from a model and the enum mjtJoint.
# Seen: with the enum on the right the comparison is by value (and elementwise for arrays), with the enum on the left it
# is False, for NumPy integers and arrays; Python's int is equal from both sides.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0 numpy==2.4.6
venv/bin/python - <<'P'
import sys

import mujoco

HINGE = mujoco.mjtJoint.mjJNT_HINGE
model = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><joint type="hinge"/><geom size=".1"/></body></worldbody></mujoco>'
)
kind = model.jnt_type[0]
print("jnt_type[0] == HINGE:", kind == HINGE, "  HINGE == jnt_type[0]:", HINGE == kind)
print("jnt_type == HINGE:", model.jnt_type == HINGE, "  HINGE == jnt_type:", HINGE == model.jnt_type)
print("int(jnt_type[0]) == HINGE:", int(kind) == HINGE, "  HINGE == int(jnt_type[0]):", HINGE == int(kind))
if not (kind == HINGE and int(kind) == HINGE and HINGE == int(kind)) or HINGE == kind:
    sys.exit("CHANGED")
P
