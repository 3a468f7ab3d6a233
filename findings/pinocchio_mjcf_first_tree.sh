#!/bin/sh
# pin (Pinocchio) 4.1.0, 2026-11-29.
# Expected: buildModelFromMJCF of a file with two bodies in the world, each with a hinge, has two joints, or says that it
# takes one tree only.
# Seen: the model has the first body's joint alone, without a word.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pin==4.1.0
cat > two_trees.xml <<'X'
<mujoco><worldbody>
  <body name="first"><joint name="hinge_1" type="hinge"/><geom type="sphere" size=".1" mass="1"/></body>
  <body name="second" pos="1 0 0"><joint name="hinge_2" type="hinge"/><geom type="sphere" size=".1" mass="1"/></body>
</worldbody></mujoco>
X
venv/bin/python - <<'P'
import sys

import pinocchio

model = pinocchio.buildModelFromMJCF("two_trees.xml")
print("joints:", list(model.names), " nq:", model.nq)
if list(model.names) != ["universe", "hinge_1"]:
    sys.exit("CHANGED")
P
