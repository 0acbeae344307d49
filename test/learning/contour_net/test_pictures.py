"""Labelled pictures are read, held out by seed, cut, and turned with their directions."""

from itertools import islice

import numpy as np
import pytest
from labelled_discs import discs, write

from pmcl_ros.learning.contour_net.pictures import (
    BINS,
    Files,
    batches,
    held_out,
    turned,
)
from pmcl_ros.runtime.errors import PictureError
from pmcl_ros.simulation.labelled_pictures import LabelledPicture


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return write(tmp_path_factory.mktemp('pictures'), range(20))


@pytest.mark.parametrize('quarters', range(4))
@pytest.mark.parametrize('mirrored', [False, True])
def test_directions_turn_with_the_picture(quarters, mirrored):
    y, x = np.indices((41, 41)) - 20
    k = np.rint(np.arctan2(y, x) / (2 * np.pi / BINS)).astype(np.int8) % BINS
    ring = np.where(np.abs(np.hypot(y, x) - 15) < 0.5, k, -1).astype(np.int8)
    # A quarter of the ring, so that the place tells how it was turned; normals stay radial.
    part = np.where((x > 0) & (y > 0), ring, -1).astype(np.int8)
    picture = np.repeat((part >= 0).astype(np.uint8)[..., None], 3, -1)
    out = turned(LabelledPicture(picture, part, part >= 0), quarters, mirrored)
    there = out.direction >= 0
    assert there.sum() == (part >= 0).sum()
    np.testing.assert_array_equal(out.direction[there], ring[there])
    np.testing.assert_array_equal(there, out.inside)
    np.testing.assert_array_equal(there, out.picture[..., 0] > 0)


def test_a_batch_depends_on_its_number_and_the_seed_alone(folder):
    first = list(islice(batches(folder, 0, 3, 64, seed=5), 4))
    later, = islice(batches(folder, 3, 3, 64, seed=5), 1)
    other, = islice(batches(folder, 3, 3, 64, seed=6), 1)
    np.testing.assert_array_equal(first[3].picture, later.picture)
    np.testing.assert_array_equal(first[3].direction, later.direction)
    assert (first[3].offset, later.picture.dtype) == (later.offset, np.float32)
    assert first[3].picture.shape == (3, 64, 64, 3)
    assert np.any(later.picture != other.picture)
    assert max(abs(each.picture).max() for each in first) <= 0.5


def test_the_held_out_train_nothing(folder):
    files = Files.find(folder)
    assert [each.stem for each in files.held_out + files.tested] == ['000009', '000019']
    assert len(files.training) == 18
    batch, = held_out(files.held_out, 4, 128)  # larger than the picture: continued at the border
    picture, direction, _ = discs(9)
    np.testing.assert_array_equal(batch.picture[0, :96, :112],
                                  picture.astype(np.float32) / 255 - np.float32(0.5))
    np.testing.assert_array_equal(batch.direction[0, :96, :112], direction)
    assert (batch.direction[0, 96:] == -1).all()


def test_new_pictures_are_used(tmp_path):
    folder = write(tmp_path, range(20), shape=(64, 64))
    source = batches(folder, 190, 1, 64, seed=0)
    next(source)
    for seed in range(20, 420):
        (folder / f'{seed:06d}.npz').symlink_to(folder / 'new.npz')
    np.savez(folder / 'new.npz', picture=np.full((64, 64, 3), 255, np.uint8),
             direction=np.full((64, 64), -1, np.int8), inside=np.zeros((64, 64), bool))
    assert any(np.ptp(each.picture, axis=(1, 2)).max() < 0.15 for each in islice(source, 30))


def test_a_folder_of_too_few_is_refused(tmp_path):
    with pytest.raises(PictureError, match='holds 9 labelled pictures'):
        Files.find(write(tmp_path, range(9)))
