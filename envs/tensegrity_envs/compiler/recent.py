"""What was used recently, and no more: memory does not grow with how many designs a process goes through."""

from typing import Generic, TypeVar

K = TypeVar("K")
V = TypeVar("V")


class Recent(Generic[K, V]):
    """A dict that forgets what has not been used for longest.

    It takes no lock, which a fork could leave locked for ever: of two threads that look for the same at the same time,
    one may not find it and make it anew.

    Args:
        most: how many it keeps.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: dict[K, V] = {}

    def __len__(self) -> int:
        return len(self._kept)

    def get(self, key: K) -> V | None:
        """What is kept there, if anything."""
        found = self._kept.pop(key, None)
        if found is not None:
            self._kept[key] = found  # the last one now
        return found

    def put(self, key: K, value: V) -> None:
        """Keep it, and forget what is too much."""
        self._kept[key] = value
        for old in list(self._kept)[: -self._most]:
            self._kept.pop(old, None)

    def clear(self) -> None:
        """Forget all."""
        self._kept.clear()
