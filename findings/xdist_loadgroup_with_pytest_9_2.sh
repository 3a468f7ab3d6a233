#!/bin/sh
# pytest-xdist 3.8.0 with pytest 9.2.0, 2026-11-29 (their issue 1386).
# Expected: with --dist loadgroup all tests of an xdist_group run in one worker.
# Seen: groups are ignored without a word: tests of each of two groups run in both workers. xdist writes the group into an
# attribute of the test that pytest 9.2 does not read any more. With pytest 9.1.1 groups hold.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
cat > test_groups.py <<'P'
import os
import time

import pytest

GROUPS = [pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in ("first", "second")]


@pytest.mark.parametrize("k", range(6))
@pytest.mark.parametrize("name", GROUPS)
def test_where(name, k):
    time.sleep(0.05)
    with open("where.txt", "a") as file:
        print(name, os.environ["PYTEST_XDIST_WORKER"], file=file)
P
for version in 9.1.1 9.2.0; do
  python3 -m venv "venv-$version"
  "venv-$version/bin/pip" install --quiet --disable-pip-version-check "pytest==$version" pytest-xdist==3.8.0
  rm -f where.txt
  "venv-$version/bin/python" -m pytest -q -n 2 --dist loadgroup > output.txt || { cat output.txt; exit 1; }
  pairs=$(sort -u where.txt | wc -l)
  echo "pytest $version: 2 groups in $pairs pairs of group and worker"
  if [ "$version" = 9.1.1 ]; then [ "$pairs" -eq 2 ] || { echo CHANGED; exit 1; }
  else [ "$pairs" -eq 4 ] || { echo CHANGED; exit 1; }; fi
done
