"""The end of Python, which may free a built-in function of machine code after all modules are empty."""

import os
import subprocess
import sys

# The registry of codecs is emptied after modules.
_CODE = """
import codecs
from tensegrity_envs.compiler.calling import function

class Last:
    def __call__(self, error): ...

last = Last()
last.function = function(1, "never_called")
codecs.register_error("last", last)
"""


def test_a_function_that_outlives_its_module_is_freed_without_harm():
    """What is freed is filled with ones, by glibc: where it is read, Python crashes."""
    env = os.environ | {"PYTHONMALLOC": "malloc", "MALLOC_PERTURB_": "255"}
    done = subprocess.run([sys.executable, "-c", _CODE], check=False, env=env, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
