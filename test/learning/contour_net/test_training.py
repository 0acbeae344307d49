"""A few steps lower the loss; a training that was stopped goes on as if it had not been."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from labelled_discs import write

from pmcl_ros.learning.contour_net.network import build
from pmcl_ros.learning.contour_net.onnx_file import write as write_network
from pmcl_ros.learning.contour_net.training import State, train
from pmcl_ros.learning.contour_net.training_plan import TrainingPlan
from pmcl_ros.runtime.errors import FileError, PmclError, SettingsError

PLAN = TrainingPlan(steps=40, size=4, crop=64, every=20)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return write(tmp_path_factory.mktemp('pictures'), range(40))


@pytest.fixture(scope='module')
def trained(folder, tmp_path_factory):
    lines = []
    path = tmp_path_factory.mktemp('state') / 'training.npz'
    return train(folder, path, PLAN, lines.append), path, lines


def test_the_loss_falls(trained):
    state, _, lines = trained
    (_, *first), (_, *last) = state.history
    assert last[0] < 0.8 * first[0]  # contour
    assert last[1] < first[1]
    assert [each[0] for each in state.history] == [20, 40]
    assert lines[0].startswith('36 pictures to train, 2 held out, on CPU')
    assert lines[-1].startswith(f'step 40 of 40: contour {last[0]:.4f}')


def test_it_goes_on_where_it_was_stopped(trained, folder, tmp_path):
    class StopError(Exception):
        pass

    def stop(line):
        if line.startswith('step 20 '):
            raise StopError

    state, _, _ = trained
    path = tmp_path / 'training.npz'
    with pytest.raises(StopError):
        train(folder, path, PLAN, stop)
    assert State.load(path).step == 20
    again = train(folder, path, PLAN, [].append)
    np.testing.assert_allclose(again.history, state.history, rtol=1e-3)
    for one, other in zip(again.weights, state.weights, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-3)


def test_a_finished_training_is_only_read(trained, folder):
    state, path, _ = trained
    again = train(folder, path, replace(PLAN, steps=30), [].append)
    assert again.history == state.history
    assert all(np.array_equal(*each) for each in zip(again.weights, state.weights, strict=True))


def test_it_begins_with_a_network(trained, folder, tmp_path):
    state, _, _ = trained
    network = build()
    network.set_weights(state.weights)
    write_network(network, tmp_path / 'map.onnx')
    lines = []
    further = train(folder, tmp_path / 'training.npz', replace(PLAN, steps=20, rate=1e-5),
                    lines.append, tmp_path / 'map.onnx')
    assert lines[0] == f'beginning with the network {tmp_path / "map.onnx"}'
    # So small a learning rate leaves the network as it was: no random one has this loss.
    assert further.history[0][3] == pytest.approx(state.history[-1][3], rel=0.02)
    # It goes on with that network, named again or not, and with no other.
    digest = hashlib.sha256((tmp_path / 'map.onnx').read_bytes()).hexdigest()
    assert State.load(tmp_path / 'training.npz').start == digest
    for start in (tmp_path / 'map.onnx', None):
        again = train(folder, tmp_path / 'training.npz', replace(PLAN, steps=20), [].append, start)
        assert again.start == digest
    network.set_weights([1.1 * each for each in state.weights])
    write_network(network, tmp_path / 'other.onnx')
    with pytest.raises(SettingsError, match=r'training that did not begin with .*other\.onnx'):
        train(folder, tmp_path / 'training.npz', PLAN, [].append, tmp_path / 'other.onnx')


def test_a_network_that_cannot_be_read_is_told_with_its_file(folder, tmp_path):
    for name, reason in (('none.onnx', r'cannot read .*none\.onnx: No such file'),
                         ('text.onnx', r'text\.onnx: .*network')):
        (tmp_path / 'text.onnx').write_text('no network')
        with pytest.raises(PmclError, match=reason):
            train(folder, tmp_path / 'training.npz', PLAN, [].append, tmp_path / name)
    with pytest.raises(FileError, match='zero has more than 64 MiB'):
        train(folder, tmp_path / 'training.npz', PLAN, [].append, Path('/dev/zero'))


def test_a_width_is_a_share_of_the_shipped_channels():
    assert TrainingPlan().channels == (32, 48, 64, 96)
    assert TrainingPlan(width=0.5).channels == (16, 24, 32, 48)
    assert TrainingPlan(width=1.4).channels == (48, 64, 88, 136)
    assert TrainingPlan(width=0.01).channels == (8, 8, 8, 8)


def test_a_file_that_is_no_state_is_refused(folder, trained, tmp_path):
    path = tmp_path / 'training.npz'
    np.savez(path, step=3)
    with pytest.raises(SettingsError, match=r'training\.npz is no state of a training'):
        train(folder, path, PLAN, print)
    state, _, _ = trained
    replace(state, weights=state.weights[1:]).save(path)
    with pytest.raises(SettingsError, match='that of another network'):
        train(folder, path, PLAN, [].append)
    with pytest.raises(SettingsError, match='that of another network: give the same --width'):
        train(folder, trained[1], replace(PLAN, width=0.5), [].append)
