"""Pictures as a film."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

SUFFIXES = (".gif", ".mp4")
_COLOURS = 96
_FEWEST = 8  # pictures that a GIF keeps, however large


def write_film(
    frames: Sequence[Image.Image],
    path: Path,
    fps: int = 20,
    hold: float = 0.9,
    most_bytes: float = float("inf"),
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a film.

    Args:
        frames: pictures of one size.
        path: its suffix says which kind: .gif, or .mp4, which needs the package imageio-ffmpeg; its folder is made.
        fps: pictures per second.
        hold: how long the last picture of a GIF stays [s].
        most_bytes: of a GIF, which leaves out pictures if need be.
        progress: called with how many pictures are encoded, of how many.

    Raises:
        ValueError: another suffix, or MP4 is wanted and imageio-ffmpeg is not installed.
    """
    if path.suffix in SUFFIXES:
        path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".gif":
        _write_gif(frames, path, fps, hold, most_bytes, progress)
    elif path.suffix == ".mp4":
        _write_mp4(frames, path, fps, progress)
    else:
        raise ValueError(f"{path}: the name of a film must end in {' or '.join(SUFFIXES)}")


def _told(frames: Sequence[Image.Image], progress: Callable[[int, int], None] | None) -> Iterator[Image.Image]:
    """The pictures, one after another, and each time how many have been taken."""
    for number, frame in enumerate(frames, 1):
        yield frame
        if progress is not None:
            progress(number, len(frames))


def _write_gif(
    frames: Sequence[Image.Image],
    path: Path,
    fps: int,
    hold: float,
    most_bytes: float,
    progress: Callable[[int, int], None] | None,
) -> None:
    """One palette for all frames; every second frame only, and so on, until the file is small enough."""
    palette = _palette(frames)
    stride = 1
    while True:
        chosen = [*frames[: len(frames) - 1 : stride], frames[-1]]
        indexed = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in _told(chosen, progress))
        durations = [round(1000 * stride / fps)] * (len(chosen) - 1) + [round(1000 * hold)]
        # Pillow takes the others as it encodes them.
        next(indexed).save(path, save_all=True, append_images=indexed, duration=durations, loop=0, optimize=False)
        if path.stat().st_size <= most_bytes or len(chosen) <= _FEWEST:
            return
        stride *= 2


def _palette(frames: Sequence[Image.Image]) -> Image.Image:
    """A palette for all frames; maximum coverage keeps the colours of thin lines, which median cut loses."""
    sample = [*frames[:: max(1, len(frames) // 6)], frames[-1]]
    together = Image.fromarray(np.concatenate([np.asarray(frame) for frame in sample]))
    return together.quantize(_COLOURS, method=Image.Quantize.MAXCOVERAGE)


def _write_mp4(
    frames: Sequence[Image.Image], path: Path, fps: int, progress: Callable[[int, int], None] | None
) -> None:
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise ValueError(
            f"{path}: MP4 needs  pip install 'tensegrity-envs[film]'; a name that ends in .gif needs nothing"
        ) from error
    film = imageio_ffmpeg.write_frames(str(path), frames[0].size, fps=fps, macro_block_size=2)
    film.send(None)
    for frame in _told(frames, progress):
        film.send(np.ascontiguousarray(frame))
    film.close()
