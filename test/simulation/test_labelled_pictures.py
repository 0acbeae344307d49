"""Labelled pictures: the same for a seed, written whole, made again where they lack."""

from importlib import import_module
from pkgutil import walk_packages

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

import pmcl_ros.simulation
from pmcl_ros.cli import main
from pmcl_ros.learning.contour_net.pictures import labelled_files
from pmcl_ros.runtime.errors import PictureError, PmclError
from pmcl_ros.simulation.labelled_pictures import (
    PictureSettings,
    labelled_picture,
    path_of,
    read_labelled,
    write_labelled,
    write_many,
)

_SMALL = PictureSettings(largest=64, samples=1, clutter=3)


@pytest.mark.parametrize('seed', range(2))
def test_the_same_seed_gives_the_same_picture(seed):
    one, two = labelled_picture(seed, _SMALL), labelled_picture(seed, _SMALL)
    size = one.picture.shape[:2]
    assert one.picture.dtype == np.uint8
    assert one.picture.shape == (*size, 3)
    assert one.direction.shape == one.inside.shape == size
    assert one.direction.min() >= -1
    assert one.direction.max() < 32
    assert np.ptp(one.picture) > 5
    for name in ('picture', 'direction', 'inside'):
        assert np.array_equal(getattr(one, name), getattr(two, name))


def test_path_tracing_shows_the_same_scene_by_other_light():
    of = {'largest': 64, 'clutter': 3}
    own = labelled_picture(1, PictureSettings(film=False, samples=4, **of))
    traced = labelled_picture(1, PictureSettings(renderer='physical', paths=16, **of))
    np.testing.assert_array_equal(traced.direction, own.direction)
    np.testing.assert_array_equal(traced.inside, own.inside)
    one, two = (cv2.GaussianBlur(each.picture.astype(float), (0, 0), 1.5).ravel()
                for each in (own, traced))
    assert not np.array_equal(traced.picture, own.picture)
    assert np.corrcoef(one, two)[0, 1] > 0.95


def test_rendering_does_not_depend_on_where_kernels_were_compiled():
    """Fast mathematics gives other last digits in another process: no kernel here uses it."""
    modules = [import_module(each.name) for each in walk_packages(
        pmcl_ros.simulation.__path__, 'pmcl_ros.simulation.')]
    kernels = {each.py_func: each.targetoptions['fastmath'] for module in modules
               for each in vars(module).values() if hasattr(each, 'targetoptions')
               and each.py_func.__module__.startswith('pmcl_ros.simulation')}
    assert len(kernels) > 30
    assert not any(kernels.values())


def test_many_are_made_once_and_again_where_one_lacks(tmp_path):
    made = list(write_many(tmp_path, range(3, 5), _SMALL))
    assert made == [path_of(tmp_path, seed) for seed in range(3, 5)]
    before = {path: path.read_bytes() for path in made}
    made[1].unlink()
    assert list(write_many(tmp_path, range(3, 5), _SMALL)) == [made[1]]
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    read = read_labelled(made[0])
    again = labelled_picture(3, _SMALL)
    assert np.array_equal(read.picture, again.picture)
    assert np.array_equal(read.direction, again.direction)
    assert np.array_equal(read.inside, again.inside)


def test_what_a_killed_process_left_is_no_picture(tmp_path):
    path = path_of(tmp_path, 3)
    path.with_name(f'{path.name}.7.part').write_bytes(b'half')
    with pytest.raises(PictureError, match='holds no labelled pictures'):
        labelled_files(tmp_path)
    write_labelled(tmp_path, 3, _SMALL)
    assert labelled_files(tmp_path) == [path]
    read_labelled(path)


def test_a_broken_file_is_named(tmp_path):
    path = write_labelled(tmp_path, 3, _SMALL)
    whole = path.read_bytes()
    for broken in (b'', b'no archive', whole[:len(whole) // 2]):
        path.write_bytes(broken)
        with pytest.raises(PmclError, match=r'000003\.npz is not a labelled picture'):
            read_labelled(path)
    for columns, direction in ((5, 0), (4, 32)):
        np.savez(path, picture=np.zeros((4, 4, 3), np.uint8), inside=np.zeros((4, columns), bool),
                 direction=np.full((4, 4), direction, np.int8))
        with pytest.raises(PmclError, match='do not belong together'):
            read_labelled(path)
    with pytest.raises(PmclError, match=r'000004\.npz'):
        read_labelled(path_of(tmp_path, 4))


def test_processes_and_a_cluster_make_the_same(tmp_path):
    pytest.importorskip('joblib')
    distributed = pytest.importorskip('distributed')
    list(write_many(tmp_path / 'one', range(2), _SMALL))
    list(write_many(tmp_path / 'two', range(2), _SMALL, jobs=2))
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None
                                  ) as cluster:
        list(write_many(tmp_path / 'three', range(2), _SMALL, backend='dask',
                        scheduler=cluster.scheduler_address))
    for seed in range(2):
        one, two, three = (path_of(tmp_path / name, seed).read_bytes()
                           for name in ('one', 'two', 'three'))
        assert one == two == three


def test_what_lacks_is_one_line(tmp_path):
    with pytest.raises(PmclError, match='--scheduler'):
        list(write_many(tmp_path, range(1), _SMALL, backend='dask'))
    with pytest.raises(PmclError, match=r'no Dask scheduler answers at tcp://127\.0\.0\.1:9'):
        list(write_many(tmp_path, range(1), _SMALL, backend='dask',
                        scheduler='tcp://127.0.0.1:9'))


def test_the_command_makes_pictures_and_keeps_them(tmp_path):
    arguments = ['scenes', 'pictures', '--first-seed', '4', '--count', '1', '-o', str(tmp_path)]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert '1 pictures made, 0 were there' in result.output
    again = [*arguments, '--no-film']  # what is there is kept
    assert '0 pictures made, 1 were there' in CliRunner().invoke(main, again).output
    read_labelled(path_of(tmp_path, 4))
    other = CliRunner().invoke(main, [*again[:-2], str(tmp_path / 'other'), '--no-film'])
    assert other.exit_code == 0, other.output
    np.testing.assert_array_equal(read_labelled(path_of(tmp_path / 'other', 4)).picture,
                                  labelled_picture(4, PictureSettings(film=False)).picture)
