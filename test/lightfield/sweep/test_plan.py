"""Plans: what a wanted depth resolution takes, and files that come back."""

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from sweep_scene import pose_at

from pmcl_ros.cli import main
from pmcl_ros.lightfield.sweep.plan import SweepPlan, depth_resolution, width_for
from pmcl_ros.runtime.errors import SettingsError


@given(st.floats(0.1, 10), st.floats(100, 3000), st.floats(1e-4, 0.1), st.floats(0.05, 2))
def test_the_width_is_that_of_the_stereo_rig_with_the_resolution(z, fx, sigma, matching):
    width = width_for(z, fx, sigma, matching)
    assert depth_resolution(z, fx, width, matching) == pytest.approx(sigma)
    # a displacement that is off by matching, seen by the rig, is a depth off by sigma
    step = 1e-6
    slope = (fx * width / (z - step * z) - fx * width / (z + step * z)) / (2 * step * z)
    assert matching / slope == pytest.approx(sigma, rel=1e-3)


def test_a_plan_comes_back_and_an_arm_goes_through_it_without_detours(tmp_path):
    middle = pose_at(0.5, 0.1, 0.9, (170, 10, -5))
    plan = SweepPlan.from_grid(3, 4, 0.02, middle, 'base_link')
    plan.save(tmp_path / 'plan.yaml', 'a plan')
    again = SweepPlan.load(tmp_path / 'plan.yaml')
    assert again == plan
    places = np.array([each.position for each in plan.poses])
    ways = np.linalg.norm(np.diff(places, axis=0), axis=1)
    np.testing.assert_allclose(ways, 0.02, atol=3e-6)
    np.testing.assert_allclose(again.middle, middle, atol=2e-6)
    # x of the camera along the rows, y along the columns
    first = {(each.row, each.column): each.pose for each in plan.poses}
    along = np.linalg.inv(middle) @ first[0, 1] - np.linalg.inv(middle) @ first[0, 0]
    np.testing.assert_allclose(along[:3, 3], [0.02, 0, 0], atol=3e-6)
    assert SweepPlan.from_grid(3, 3, 0.01).middle is None


def test_the_command_writes_what_is_read(tmp_path):
    path = tmp_path / 'plan.yaml'
    result = CliRunner().invoke(main, [
        'sweep', 'plan', '--distance', '0.6', '--resolution', '0.001', '--fx', '600', '--views',
        '3', '5', '--size', '640', '480', '--pose', '0.5', '0', '0.9', '1', '0', '0', '0', '--out',
        str(path)])
    assert result.exit_code == 0, result.output
    plan = SweepPlan.load(path)
    assert (plan.rows, plan.columns, plan.frame) == (3, 5, 'base_link')
    assert plan.baseline == pytest.approx(0.6 ** 2 * 0.25 / (600 * 0.001) / 4)
    assert '15 poses' in result.output
    assert 'depth resolution at 0.6 m: 1.00 mm' in result.output
    # four steps of 37.5 px of 640, two of 37.5 of 480
    assert '65 % of the centre view' in result.output


@pytest.mark.parametrize(('change', 'reason'), [
    (('rows: 2', 'rows: 3'), 'are not the 3x2 of the grid'),
    (('row: 0\n  column: 1', 'row: 5\n  column: 7'), 'are not the 2x2 of the grid'),
    (('0.0, 0.0, 0.0, 1.0', '0.0, 0.0, 0.0, 2.0'), 'has length 2'),
])
def test_files_that_are_no_plan_are_refused(tmp_path, change, reason):
    path = tmp_path / 'plan.yaml'
    SweepPlan.from_grid(2, 2, 0.01).save(path)
    text = path.read_text()
    assert change[0] in text
    path.write_text(text.replace(*change))
    with pytest.raises(SettingsError, match=reason):
        SweepPlan.load(path)
