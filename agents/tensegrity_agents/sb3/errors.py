"""What can go wrong with agents. No Torch here: commands catch these without it."""


class TrainingError(RuntimeError):
    """Training cannot go on; the message says what to do."""


class TrainingInterruptedError(KeyboardInterrupt):
    """Training was asked to stop, and has written a checkpoint.

    Args:
        timesteps: done so far.
        number: of the signal.
    """

    def __init__(self, timesteps: int, number: int) -> None:
        super().__init__(f"interrupted after {timesteps:,} steps, which are kept")
        self.timesteps, self.number = timesteps, number


class ExportError(RuntimeError):
    """A policy whose file for other programs does not do what it does."""
