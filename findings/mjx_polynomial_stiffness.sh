#!/bin/sh
# mujoco-mjx 3.17.0 with mujoco 4.0.0 (its requirement, mujoco>=3.17.0.dev0, is satisfied), jax 0.10.2, 2026-11-29.
# Expected: a hinge of polynomial stiffness "1 2 3" at 0.7 rad has the passive torque of MuJoCo, -2.709 N m; or
# put_model refuses the model, as it refuses other features that MJX does not have.
# Seen: put_model takes the model, and the torque is that of the linear term alone, -0.7 N m.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check mujoco-mjx==3.17.0 mujoco==4.0.0 jax==0.10.2 jaxlib==0.10.2
JAX_PLATFORMS=cpu venv/bin/python - <<'P' 2>messages
import sys

import mujoco
from mujoco import mjx

model = mujoco.MjModel.from_xml_string("""
<mujoco><option gravity="0 0 0"/><worldbody><body>
  <joint type="hinge" stiffness="1 2 3"/><geom size=".1" mass="1"/>
</body></worldbody></mujoco>
""")
data = mujoco.MjData(model)
data.qpos[0] = 0.7
mujoco.mj_forward(model, data)
theirs = mjx.forward(mjx.put_model(model), mjx.put_data(model, data)).qfrc_passive[0]
print(f"MuJoCo {data.qfrc_passive[0]:.4f} N m, MJX {float(theirs):.4f} N m, linear term {-0.7:.4f} N m")
if abs(data.qfrc_passive[0] + 2.709) > 1e-9 or abs(float(theirs) + 0.7) > 1e-6:
    sys.exit("CHANGED")
P
