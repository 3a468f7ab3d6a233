"""Files that are there whole or not at all, even if the process is killed while it writes them."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PART = ".part"  # the end of the name of what is not whole yet


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a path beside another one to write to, and put that file in its place when it is whole.

    Args:
        path: where the file is to be.
    """
    part = path.with_name(path.name + PART)
    try:
        yield part
        os.replace(part, path)
    except OSError as error:
        if error.filename == str(part):  # of which nobody has heard
            error.filename = str(path)
        raise
    finally:
        with suppress(OSError):  # where its folder is none
            part.unlink(missing_ok=True)
