"""Draws augmented crops of labelled pictures (`simulation/labelled_pictures.py`) from disk."""

from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import count, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_net import network_input
from pmcl_ros.runtime.errors import PictureError
from pmcl_ros.simulation.labelled_pictures import LabelledPicture, read_labelled
from pmcl_ros.simulation.occluding import DIRECTIONS

BINS = DIRECTIONS  # of a label
_HELD_OUT, _TESTED = 9, 19  # seeds modulo 20: calibrate, and measure; the others train
_KEPT = 4000  # pictures kept in memory: 2 GB of the default size
_LISTED = 200  # batches after which new files are looked for
_AHEAD, _THREADS = 6, 2  # batches made before they are asked for, by so many threads


@dataclass(frozen=True)
class Batch:
    """Input of the network (n, h, w, 3), labels (n, h, w), offset of the loss's directions."""

    picture: NDArray[np.float32]
    direction: NDArray[np.int8]
    inside: NDArray[np.bool_]
    offset: int = 0


@dataclass(frozen=True)
class Files:
    """The labelled pictures of a folder, apart by their seeds."""

    training: tuple[Path, ...]
    held_out: tuple[Path, ...]
    tested: tuple[Path, ...]

    @classmethod
    def find(cls, folder: Path) -> 'Files':
        """PictureError where the folder holds none to train or to hold out."""
        files = _numbered(folder)
        found = cls(*(tuple(each for each in files if kind(int(each.stem) % 20)) for kind in (
            lambda n: n not in (_HELD_OUT, _TESTED), _HELD_OUT.__eq__, _TESTED.__eq__)))
        if not (found.training and found.held_out and found.tested):
            raise PictureError(
                f'{folder} holds {len(files)} labelled pictures SEED.npz; training takes those of '
                f'20 seeds in a row at least (seeds {_HELD_OUT} and {_TESTED} of 20 are held '
                'out); pmcl scenes pictures makes them')
        return found


def labelled_files(folder: Path) -> list[Path]:
    """All labelled pictures of a folder; PictureError where there is none."""
    if not folder.is_dir():
        raise PictureError(f'there is no folder {folder}; pmcl scenes pictures makes one')
    files = _numbered(folder)
    if not files:
        raise PictureError(f'{folder} holds no labelled pictures SEED.npz; pmcl scenes pictures '
                           'makes them')
    return files


def _numbered(folder: Path) -> list[Path]:
    return sorted(each for each in folder.glob('*.npz') if each.stem.isdigit())


_read = lru_cache(_KEPT)(read_labelled)


def batches(folder: Path, first: int, size: int, crop: int, seed: int
            ) -> Generator[Batch, None, None]:
    """Batches number `first`, `first` + 1, ... of `size` augmented crops of `crop` px.

    A batch depends on its number, the seed, and the files there are. Threads make batches ahead.
    """
    def make(number: int, files: tuple[Path, ...]) -> Batch:
        rng = np.random.default_rng([seed, number])
        chosen = rng.integers(len(files), size=size)
        crops = [_augmented(_crop(_read(files[each]), crop, rng), rng) for each in chosen]
        return Batch(np.stack([each[0] for each in crops]),
                     np.stack([each[1].direction for each in crops]),
                     np.stack([each[1].inside for each in crops]), int(rng.integers(4)))

    with ThreadPoolExecutor(_THREADS) as pool:
        files = Files.find(folder).training
        waiting = []
        for number in count(first):
            if number % _LISTED == 0:
                files = Files.find(folder).training
            waiting.append(pool.submit(make, number, files))
            if len(waiting) > _AHEAD:
                yield waiting.pop(0).result()


def held_out(files: tuple[Path, ...], size: int, crop: int) -> Iterator[Batch]:
    """Batches of `size` crops, one of each picture, not augmented: the same every time."""
    rng = np.random.default_rng(0)
    rest = iter(files)
    while chosen := [_crop(_read(each), crop, rng) for each in islice(rest, size)]:
        yield Batch(np.stack([network_input(each.picture) for each in chosen]),
                    np.stack([each.direction for each in chosen]),
                    np.stack([each.inside for each in chosen]))


def _crop(whole: LabelledPicture, size: int, rng: np.random.Generator) -> LabelledPicture:
    """A square of a picture; one without a contour is drawn again once."""
    missing = [(0, max(0, size - each)) for each in whole.direction.shape]
    picture = np.pad(whole.picture, [*missing, (0, 0)], 'edge')
    direction = np.pad(whole.direction, missing, constant_values=-1)
    inside = np.pad(whole.inside, missing, 'edge')
    for _ in range(2):
        top, left = (int(rng.integers(each - size + 1)) for each in direction.shape)
        square = np.s_[top:top + size, left:left + size]
        if (direction[square] >= 0).any():
            break
    return LabelledPicture(picture[square], direction[square], inside[square])


def turned(labelled: LabelledPicture, quarters: int, mirrored: bool) -> LabelledPicture:
    """Turn counter-clockwise by quarters, then exchange left and right: directions go along."""
    picture, inside = np.rot90(labelled.picture, quarters), np.rot90(labelled.inside, quarters)
    direction = np.rot90(labelled.direction, quarters)
    k = direction - np.int8(BINS // 4 * (quarters % 4))
    if mirrored:
        picture, direction, inside = picture[:, ::-1], direction[:, ::-1], inside[:, ::-1]
        k = np.int8(BINS // 2) - k[:, ::-1]
    k = np.where(direction < 0, np.int8(-1), k % np.int8(BINS))
    return LabelledPicture(picture, k, inside)


def _augmented(labelled: LabelledPicture, rng: np.random.Generator
               ) -> tuple[NDArray[np.float32], LabelledPicture]:
    """(Input of the network, labels): turned, and in other colours, light and noise."""
    labelled = turned(labelled, int(rng.integers(4)), rng.random() < 0.5)
    levels = np.arange(256, dtype=np.float32) / 255
    gamma = np.exp(rng.normal(0, 0.2))
    gains = rng.uniform(0.6, 1.25) * rng.uniform(0.9, 1.1, 3)
    colours = rng.permutation(3)
    curves = np.minimum(levels[:, None] ** gamma * gains, 1).astype(np.float32)
    picture = np.stack([curves[labelled.picture[..., colours[each]], each] for each in range(3)],
                       axis=-1)
    if rng.random() < 0.2:
        picture = np.repeat(picture.mean(-1, keepdims=True), 3, -1)
    noise = np.float32(rng.uniform(0, 0.02) * (rng.random() < 0.5))
    if noise:
        picture = picture + noise * rng.standard_normal(picture.shape, np.float32)
    return np.clip(picture, 0, 1) - np.float32(0.5), labelled
