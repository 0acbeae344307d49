"""`pmcl learn-map` makes a network that finds contours, with its calibration."""

import numpy as np
import onnx
import pytest
from click.testing import CliRunner
from labelled_discs import discs, write

from pmcl_ros.cli import main
from pmcl_ros.evidence.contour_net import ContourNet
from pmcl_ros.evidence.learned import LearnedMap
from pmcl_ros.runtime.errors import PictureError, SettingsError


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp('learn-map')
    pictures, out = write(folder / 'pictures', range(60)), folder / 'out'
    arguments = ['learn-map', str(pictures), '-o', str(out), '--steps', '150', '--batch', '4',
                 '--crop', '96', '--every', '50', '--width', '0.5']
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 0, done.output
    return out, done.output, arguments


@pytest.fixture(scope='module')
def net(made):
    out, _, _ = made
    return ContourNet(out / 'contour_map.onnx', LearnedMap.load(out / 'contour_map.yaml'))


def test_contours_light_up_in_their_direction(net):
    picture, direction, _ = discs(1000)
    out = net(picture)
    assert (out.shape, out.dtype) == ((96, 112, 6), np.float32)
    at = direction >= 0
    angle = 2 * np.pi * direction[at] / 32

    def ratio(t):
        a0, c1, s1, c2, s2 = out[at][:, :5].T
        return a0 + c1 * np.cos(t) + s1 * np.sin(t) + c2 * np.cos(2 * t) + s2 * np.sin(2 * t)

    assert np.median(ratio(angle)) > 2
    assert np.median(ratio(angle)) > np.median(ratio(angle + np.pi / 2)) + 2
    assert np.median(ratio(angle)) > np.median(ratio(angle + np.pi)) + 0.5
    assert np.median(out[~at][:, 0]) < -2


def test_the_record_says_how_it_was_made(made, net):
    out, printed, arguments = made
    learned = LearnedMap.load(out / 'contour_map.yaml')
    before, after = ' '.join(arguments[:6]), ' '.join(arguments[6:10])
    assert learned.training['command'] == f'pmcl {before} --seed 0 {after} --width 0.5'
    assert learned.training['pictures']['trained'] == {'number': 54, 'first': 0, 'last': 58}
    assert learned.training['losses']['step'] == 150
    assert onnx.load(out / 'contour_map.onnx').graph.initializer[0].dims[0] == 16
    assert {'tensorflow', 'keras', 'onnx'} <= set(learned.training['versions'])
    assert learned.version == learned.sha256[:8]
    assert 'average precision of contour pixels: ' in printed
    assert (out / 'reliability.png').stat().st_size > 10_000
    again = CliRunner().invoke(main, arguments)
    assert again.exit_code == 0, again.output
    assert 'going on from step 150' in again.output
    assert LearnedMap.load(out / 'contour_map.yaml') == learned


def test_too_few_pictures_to_calibrate_on_are_told_at_once(made):
    _, printed, _ = made
    assert printed.splitlines()[0].startswith('few pictures to calibrate on, 3: ')


def test_a_network_is_trained_further(made, tmp_path):
    out, _, (_, pictures, *_) = made
    start, further = out / 'contour_map.onnx', tmp_path / 'further'
    arguments = ['learn-map', pictures, '-o', str(further), '--steps', '4', '--batch', '4',
                 '--crop', '96', '--width', '0.5', '--start', str(start), '--rate', '1e-05']
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 0, done.output
    assert f'beginning with the network {start}' in done.output
    before, after = (LearnedMap.load(each / 'contour_map.yaml').training for each in (
        out, further))
    assert before['start'] == ''
    assert after['start'] == LearnedMap.load(out / 'contour_map.yaml').sha256
    assert after['command'].endswith(f' --width 0.5 --start {start} --rate 1e-05')
    assert after['rate'] == 1e-5
    # Four such steps leave what 150 steps learned.
    assert after['losses']['held_out_contour'] == pytest.approx(
        before['losses']['held_out_contour'], rel=0.02)
    done = CliRunner().invoke(main, [*arguments[:2], '-o', str(out), *arguments[4:]])
    assert 'training that did not begin with' in done.output


def test_files_must_belong_together(made, net, tmp_path):
    file = tmp_path / 'contour_map.onnx'
    file.write_bytes(net.path.read_bytes()[:-1])
    with pytest.raises(SettingsError, match=r'contour_map\.onnx has the sha256 .* do not belong'):
        ContourNet(file, net.learned)
    with pytest.raises(SettingsError, match=r'cannot read .*other\.onnx: No such file'):
        ContourNet(tmp_path / 'other.onnx', net.learned)


def test_wrong_arguments_get_one_line(tmp_path):
    for extra, reason in ((['--crop', '100'], '100 is no multiple of 16'),
                          ([], 'holds 0 labelled pictures')):
        done = CliRunner().invoke(main, ['learn-map', str(tmp_path), '-o', str(tmp_path / 'o'),
                                         *extra])
        assert done.exit_code != 0
        assert reason in done.output
        assert not isinstance(done.exception, PictureError)
