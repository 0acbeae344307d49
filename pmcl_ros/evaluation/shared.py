"""Values with large arrays, handed to other processes without copies: through a mapped file."""

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

T = TypeVar('T')
_ALIGNED = 64  # bytes


@dataclass(frozen=True)
class Shared(Generic[T]):
    """Where a value lies. Small enough to be sent to another process of this machine.

    path: of the file with the arrays. head: the rest of the value. places: first byte and one past
    the last of each array in the file.
    """

    path: Path
    head: bytes
    places: tuple[tuple[int, int], ...]

    @classmethod
    def put(cls, value: T, path: Path) -> 'Shared[T]':
        """Write a value's arrays to a file; the caller deletes it when nobody opens it again."""
        buffers: list[pickle.PickleBuffer] = []
        head = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
        places, end = [], 0
        with path.open('wb') as stream:
            for each in buffers:
                data = each.raw()
                places.append((end, end + data.nbytes))
                stream.write(data)
                end += stream.write(bytes(-data.nbytes % _ALIGNED)) + data.nbytes
            stream.write(b'\0')  # an empty file cannot be mapped
        return cls(path, head, tuple(places))

    def get(self) -> T:
        """The value. Its arrays are read-only, and the same memory in all processes."""
        mapped = np.memmap(self.path, mode='r')
        value: T = pickle.loads(self.head, buffers=[mapped[first:end]
                                                    for first, end in self.places])
        return value
