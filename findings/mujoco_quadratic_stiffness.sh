#!/bin/sh
# mujoco 4.0.0, 2026-11-29.
# Expected: a hinge with the stiffness polynomial "0 2" (quadratic coefficient 2) resists a deflection to
# either side alike, as the damping polynomial "0 2" resists velocities: torque -2 q |q|.
# Seen: the quadratic term of damping is odd (-2 v |v|), that of stiffness is even (-2 q q): at -0.5 rad the spring
# pushes away from its rest position. A symmetric spring needs odd powers only.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco==4.0.0
venv/bin/python - <<'P'
import sys

import mujoco

XML = """
<mujoco><option gravity="0 0 0"/><worldbody><body>
  <joint type="hinge" {}="0 2"/><geom size=".1" mass="1"/>
</body></worldbody></mujoco>
"""
torques = {}
for name, field in (("stiffness", "qpos"), ("damping", "qvel")):
    model = mujoco.MjModel.from_xml_string(XML.format(name))
    data = mujoco.MjData(model)
    for value in (0.5, -0.5):
        getattr(data, field)[0] = value
        mujoco.mj_forward(model, data)
        torques[name, value] = data.qfrc_passive[0]
        print(f'{name}="0 2", {field} {value:+}: passive torque {torques[name, value]:+} N m')
if list(torques.values()) != [-0.5, -0.5, -0.5, 0.5]:
    sys.exit("CHANGED")
P
