"""What `pmcl simulate` writes is what the other commands read."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from command_line import pmcl

from pmcl_ros.cli.simulations import options
from pmcl_ros.simulation.lytro.camera import LytroCamera

QUICK = 'proposals=12,particles=48,moves=3'
SIMULATED = ('--renderer', 'fast', '--samples', 1, '--surroundings', 'table', '--attitude',
             'upright')


@pytest.fixture
def block(tmp_path: Path) -> Path:
    trimesh.creation.box(bounds=[[-0.03, -0.02, 0], [0.03, 0.02, 0.09]]).export(
        tmp_path / 'block.stl')
    path = tmp_path / 'block.yaml'
    path.write_text(yaml.safe_dump({'mesh': 'block.stl', 'scale': 1.0, 'appearance': {
        'material': 'opaque', 'colour': [0.6, 0.02, 0.02]}}))
    return path


def evaluated(captures: Path, out: Path, *more: Any) -> dict[str, str]:
    """The row of the one search of `pmcl evaluate`."""
    pmcl('evaluate', captures, '--trials', 1, '--processes', 1, '--out', out, *more)
    with (out / 'results.csv').open() as file:
        row, = csv.DictReader(file)
    return row


@pytest.mark.parametrize('plan', [(), ('--cameras', 'arc:2:30')])
def test_its_pictures_are_localised_recorded_and_evaluated(block: Path, plan: tuple[str, ...]
                                                           ) -> None:
    folder = block.parent
    (folder / 'camera.yaml').write_text('{width: 160, height: 120, fx: 150, cx: 79.5, cy: 59.5}')
    pmcl('simulate', block, '--camera', folder / 'camera.yaml', *plan, *SIMULATED, '--count', 1,
         '-o', folder / 'out')
    capture = folder / 'out' / '000000'
    told = json.loads((capture / 'truth.json').read_text())['roi']
    command = ('--object', block, '--roi', *told['center'], *told['size'], '--set', QUICK,
               '--json')
    found = json.loads(pmcl('localize', capture, *command).stdout)
    off = np.abs(np.subtract(found['position'], told['center']))
    assert (off <= np.array(told['size']) / 2).all()
    recorded = pmcl('bag', 'record', capture, folder / 'bag', status=0 if plan else 1)
    if not plan:
        assert 'is one picture without the pose of its camera' in recorded.stderr
        return
    again = json.loads(pmcl('localize', folder / 'bag', *command).stdout)
    for name in ('position', 'orientation_xyzw'):
        np.testing.assert_allclose(again[name], found[name], atol=1e-6)
    row = evaluated(folder / 'out', folder / 'evaluated')
    assert float(row['translation_mm']) < 10
    assert row['lost'] == 'False'


def test_raw_pictures_are_studied_and_evaluated(block: Path, monkeypatch: pytest.MonkeyPatch
                                                ) -> None:
    """Of a small Lytro, with views of 32x32 px."""
    monkeypatch.setattr(options, 'RAW_CAMERA', LytroCamera(width=320, height=320))
    block.write_text(yaml.safe_dump(yaml.safe_load(block.read_text()) | {'scale': 0.1}))
    out = block.parent / 'out'
    raw = '--camera', 'f01-raw', *SIMULATED
    pmcl('feasibility', block, *raw, '--scenes', 1, '-o', out)
    trial, = json.loads((out / 'scenes' / '000000' / 'trials.json').read_text()).values()
    assert (out / 'feasibility.html').read_text().count('data:image/png') == 2  # scene, worst
    assert not (out / 'scenes' / 'board1').exists()  # its calibration is known
    made = pmcl('simulate', block, *raw, '--count', 1, '-o', out / 'scenes')
    assert made.stdout.splitlines() == [str(out / 'scenes' / each) for each in (
        'white', *(f'board{number}' for number in range(1, 9)), '000000')]
    row = evaluated(out / 'scenes', out / 'evaluated', '--calibration',
                    out / 'scenes' / 'calibration.yaml')
    # The same search of the same views.
    assert float(row['translation_mm']) == pytest.approx(trial['translation_mm'], abs=1e-6)
    assert float(row['axis_deg']) == pytest.approx(trial['axis_deg'], abs=1e-6)
