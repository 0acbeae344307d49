"""The preset standard stays what it was.

Sets of scenes are named by preset and seeds: figures of today are compared with those of before.
A change of the generator that moves any of these scenes ends that; it belongs into another preset.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.runtime.text_file import read_json
from pmcl_ros.simulation.scenes.random_scene import KINDS, SceneSettings, random_scene

# By kind, for the seeds 0 to 4: name, numbers of solids and sheets, the target's position [m],
# rotation vector [rad], sides of the box about its vertices [m].
STORED = read_json(Path(__file__).parents[2] / 'data' / 'standard_preset.json')


def test_every_kind_is_stored():
    assert list(STORED) == ['any', *KINDS]


@pytest.mark.parametrize('kind', STORED)
def test_scenes_of_the_preset_are_those_of_before(kind):
    settings = SceneSettings() if kind == 'any' else SceneSettings(kinds=(kind,))
    for seed, (name, solids, sheets, *numbers) in enumerate(STORED[kind]):
        scene = random_scene(np.random.default_rng(seed), settings)
        assert (scene.name, len(scene.solids), len(scene.sheets)) == (name, solids, sheets)
        pose, sides = scene.targets[0].pose, np.ptp(scene.targets[0].vertices, axis=0)
        np.testing.assert_allclose([*pose[:3, 3], *sides], [*numbers[:3], *numbers[6:]], atol=2e-6)
        turned = Rotation.from_rotvec(numbers[3:6]).inv() * Rotation.from_matrix(pose[:3, :3])
        assert turned.magnitude() < 5e-6
