#!/bin/sh
# stable-baselines3 2.9.2 with torch 2.13.0, onnx 1.23.2 and onnxscript 0.7.2, 2026-11-29.
# Expected: torch.onnx.export, whose default since torch 2.9 is the exporter by torch.export, takes the deterministic
# action of a PPO or SAC policy with a batch of any size, as SB3's page on exporting policies has it.
# Seen: it ends with TorchExportError (a data-dependent guard): SB3 makes a torch distribution on the way even to its mode,
# and its constructor checks values, on which no exported graph can branch. With
# Distribution.set_default_validate_args(False) both are exported.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check torch==2.13.0
venv/bin/pip install --quiet --disable-pip-version-check stable-baselines3==2.9.2 onnx==1.23.2 onnxscript==0.7.2
cat > export.py <<'P'
import sys
import warnings

import torch
from stable_baselines3 import PPO, SAC
from torch.distributions import Distribution

warnings.simplefilter("ignore")


class Action(torch.nn.Module):
    def __init__(self, policy):
        super().__init__()
        self.policy = policy

    def forward(self, observation):
        return self.policy._predict(observation, deterministic=True)


Distribution.set_default_validate_args(sys.argv[1] == "checked")
for kind in (PPO, SAC):
    action = Action(kind("MlpPolicy", "Pendulum-v1", device="cpu").policy.eval())
    shapes = {"observation": {0: torch.export.Dim("n")}}
    try:
        torch.onnx.export(action, (torch.zeros(3, 3),), dynamic_shapes=shapes, dynamo=True, verbose=False)
        print(kind.__name__, "exported")
    except Exception as error:
        print(kind.__name__, type(error).__name__)
P
for values in checked unchecked; do
  venv/bin/python export.py "$values" 2> errors.txt > "$values.txt" || { cat errors.txt; exit 1; }
  echo "values of distributions $values:"
  cat "$values.txt"
done
[ "$(grep -c TorchExportError checked.txt)" -eq 2 ] || { echo CHANGED; exit 1; }
[ "$(grep -c exported unchecked.txt)" -eq 2 ] || { echo CHANGED; exit 1; }
