"""Modules of users: environments, their baselines and controllers that need no edit of this package."""

import importlib
import sys
from pathlib import Path
from types import ModuleType


def own_module(name: str) -> ModuleType:
    """Import a module from the path or from the working directory.

    Raises:
        ImportError: it cannot be imported, whatever it did meanwhile; the message says what.
    """
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        return importlib.import_module(name)
    except Exception as error:  # whatever the module does while it is imported
        raise ImportError(f"module {name!r} cannot be imported ({type(error).__name__}: {error})") from error
