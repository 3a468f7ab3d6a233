"""Packages that only some commands need: they come with the extras of this package."""

from importlib import import_module


class MissingExtraError(ImportError):
    """A package that is not installed; the message says which extra brings it."""


def need(extra: str, what: str, *packages: str) -> None:
    """See that packages are there.

    Args:
        extra: that brings them, such as "onnx".
        what: needs them, in words: "ONNX needs".
        *packages: names to import.

    Raises:
        MissingExtraError: one of them is not installed.
    """
    for package in packages:
        try:
            import_module(package)
        except ImportError as error:
            message = f"{what}  pip install 'tensegrity-envs[{extra}]'  ({error})"
            raise MissingExtraError(message, name=package) from error
