"""`pmcl measure-map`: what a network finds in labelled pictures, of which nothing is hidden."""

import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner
from labelled_discs import write

from pmcl_ros.cli import main
from pmcl_ros.evidence.contour_net import contour_net
from pmcl_ros.evidence.learned import learned_file


def measured(*arguments: object) -> dict[str, float]:
    done = CliRunner().invoke(main, ['measure-map', *map(str, arguments)])
    assert done.exit_code == 0, done.output
    assert f'network {contour_net().learned.version}, ' in done.output
    return {name: float(value) for name, value in re.findall(r'^(.+): (.+)$', done.output, re.M)}


@pytest.fixture(scope='module')
def pictures(tmp_path_factory):
    return write(tmp_path_factory.mktemp('discs'), range(1000, 1006))


def test_the_shipped_network_finds_opaque_discs(pictures):
    found = measured(pictures)
    assert found['average precision within 1.5 px'] > 0.7
    assert found['average precision of inside'] > 0.8
    assert found['nats of contours a pixel'] > 0
    shipped = learned_file('contour_map.onnx').parent
    assert measured(pictures, '--map', shipped) == found


def test_contours_in_another_place_are_not_found(pictures, tmp_path):
    for each in pictures.iterdir():
        with np.load(each) as values:
            np.savez(tmp_path / each.name, picture=values['picture'], inside=~values['inside'],
                     direction=np.roll(values['direction'], (31, 47), (0, 1)))
    found, wrong = measured(pictures), measured(tmp_path)
    assert wrong['average precision within 1.5 px'] < found['average precision within 1.5 px'] / 3
    assert wrong['average precision of inside'] < 0.6
    assert wrong['nats of inside a pixel'] < 0


def test_wrong_folders_get_one_line(pictures, tmp_path):
    shutil.copy(learned_file('contour_map.yaml'), tmp_path)
    (tmp_path / 'contour_map.onnx').write_bytes(b'another')
    small = write(tmp_path / 'small', [1], shape=(20, 20))
    plain = write(tmp_path / 'plain', [1], number=0)
    for arguments, reason in (([tmp_path], 'holds no labelled pictures SEED.npz'),
                              ([tmp_path / 'none'], 'there is no folder .*none'),
                              ([small], r'000001\.npz: .* it has 20x20'),
                              ([plain], 'no picture shows a contour'),
                              ([pictures, '--map', pictures], 'cannot read .*contour_map.yaml'),
                              ([pictures, '--map', tmp_path], 'do not belong together')):
        done = CliRunner().invoke(main, ['measure-map', *map(str, arguments)])
        assert done.exit_code == 1
        assert re.search(reason, done.output)
        assert '\n' not in done.output.strip()
