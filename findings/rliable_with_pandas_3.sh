#!/bin/sh
# rliable 1.2.0 with pandas 3.1.1 and arch 7.2.0 (the versions that pip chooses), 2026-11-29.
# Expected: `import rliable.library` works.
# Seen: TypeError: deprecate_kwarg() missing 1 required positional argument: 'new_arg_name', from arch, which uses a
# decorator of pandas that has another signature in pandas 3. With pandas 2 it works.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check rliable==1.2.0 arch==7.2.0 pandas==3.1.1
if venv/bin/python -c "import rliable.library" 2>message; then
    echo "CHANGED: rliable can be imported with pandas 3"
    exit 1
fi
tail -n 1 message
venv/bin/pip install --quiet --disable-pip-version-check "pandas<3"
venv/bin/python -c "import pandas, rliable.library; print('imported with pandas', pandas.__version__)"
