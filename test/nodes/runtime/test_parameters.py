"""ROS parameters are those of the settings classes, and config/pmcl.yaml holds all of them."""

from typing import Literal

import pytest
import rclpy
import yaml
from harness import CONFIGURE, INACTIVE, ROOT, UNCONFIGURED, Process
from pydantic import Field
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from pmcl_ros.nodes.graph import ALL
from pmcl_ros.nodes.runtime.parameters import Parameters
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import Settings


class Example(Settings):
    """One field of every kind."""

    flag: bool = False
    count: int = Field(3, ge=1, le=10, description='how many')
    length: float = Field(2, gt=0, description='how long [m]')
    mode: Literal['a', 'b'] = 'a'
    point: tuple[float, float, float] = (0.0, 0.0, 1.0)
    path: str = Field(description='where')
    limit: float | None = None


class Changeable(Example):
    """One that a running node takes over, too."""

    live: str = Field('', json_schema_extra={'live': True})


@pytest.fixture
def make():
    """A function overrides -> (node, parameters)."""
    context = Context()
    rclpy.init(context=context)
    nodes = []

    def make(kind=Example, **values):
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        nodes.append(Node('example', context=context, parameter_overrides=overrides))
        return nodes[-1], Parameters(nodes[-1], kind)

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown(context=context)


def test_defaults_and_descriptions_are_those_of_the_settings(make):
    node, parameters = make(path='x')
    assert parameters.read() == Example(path='x')
    count, length = node.describe_parameters(['count', 'length'])
    assert count.description == 'how many'
    assert (count.integer_range[0].from_value, count.integer_range[0].to_value) == (1, 10)
    assert length.description == 'how long [m]'
    assert length.floating_point_range[0].from_value == 0


def test_what_is_set_is_read(make):
    node, parameters = make(path='x', point=[1.0, 2.0, 3.0], count=5, limit=4.5)
    node.set_parameters([Parameter('flag', value=True), Parameter('mode', value='b')])
    assert parameters.read() == Example(path='x', point=(1, 2, 3), count=5, limit=4.5, flag=True,
                                        mode='b')


@pytest.mark.parametrize(('values', 'reason'), [
    ({}, 'path: Field required'),
    ({'path': 'x', 'mode': 'c'}, "mode: Input should be 'a' or 'b'"),
    ({'path': 'x', 'length': 0.0}, 'length: Input should be greater than 0'),
    ({'path': 'x', 'count': 11}, "parameter 'count'.*out of range"),
    ({'path': 'x', 'length': 1}, "parameter 'length'.*write 1.0, not 1"),
    ({'path': 'x', 'point': [1, 2, 3]}, "parameter 'point'.*write 1.0, not 1"),
    ({'path': 'x', 'point': [1.0, 2.0]}, r'point: number 3 is missing \(got \(1.0, 2.0\)\)'),
    ({'path': 'x', 'flag': 'yes'}, "parameter 'flag'.*expecting type 'BOOL'"),
])
def test_what_cannot_be_is_told_when_read(make, values, reason):
    _, parameters = make(**values)
    with pytest.raises(SettingsError, match=reason):
        parameters.read()


def test_a_refused_value_can_be_mended(make):
    node, parameters = make(path='x', length=1)
    node.set_parameters([Parameter('length', value=1.0)])
    assert parameters.read().length == 1.0


def test_what_is_set_and_not_taken_over_is_told(make, capfd):
    """While the node goes on with other values; what it takes over or has is none of it."""
    node, parameters = make(Changeable, path='x')

    def told(**values):
        results = node.set_parameters([Parameter(name, value=value)
                                       for name, value in values.items()])
        assert all(each.successful for each in results)
        return [line.partition('[example]: ')[2] for line in capfd.readouterr().err.splitlines()]

    after = (': read at the next configure (deactivate, cleanup, configure, activate); until '
             'then the node goes on with what it has')
    with parameters.used(parameters.read()):
        assert told(count=5, point=[1.0, 0.0, 1.0]) == [
            f'{each}{after}' for each in ('count 5', 'point [1.0, 0.0, 1.0]')]
        assert told(count=3, point=[0.0, 0.0, 1.0], live='now') == []
    assert told(count=6) == []


@pytest.mark.parametrize(('name', 'hint'), [
    ('cuont', "unknown parameter 'cuont'; did you mean 'count'?"),
    ('zzz', "unknown parameter 'zzz' (known: flag, count, length, mode, point, path, limit)"),
])
def test_a_name_that_nobody_knows_is_refused_with_a_suggestion(make, name, hint):
    _, parameters = make(path='x', **{name: 5})
    with pytest.raises(SettingsError) as caught:
        parameters.read()
    assert str(caught.value).startswith(f'example: {hint}')


def test_a_name_that_another_node_knows_may_be_for_all_of_them(make, capfd):
    _, parameters = make(path='x', labels=5, use_sim_time=False)
    assert parameters.read() == Example(path='x')
    error = capfd.readouterr().err
    assert "'labels' is none of example, it is one of dlv_node: without effect here" in error
    assert 'use_sim_time' not in error


@pytest.mark.parametrize('entry', ALL, ids=lambda entry: entry.name)
def test_shipped_parameters_are_all_of_a_node_and_valid(make, entry):
    shipped = yaml.safe_load((ROOT / 'config' / 'pmcl.yaml').read_text())
    values = shipped[f'/**/{entry.name}']['ros__parameters']
    kind = entry.load().settings_class
    assert list(values) == list(kind.model_fields)
    assert all(field.description for field in kind.model_fields.values())
    _, parameters = make(kind, **values)
    read = parameters.read().model_dump(mode='json')
    assert read == values
    # of bags/wine_glass
    its_own = {'calibration', 'white', 'object', 'grasps', 'roi_center', 'roi_size'}
    defaults = kind().model_dump(mode='json')
    assert {k: v for k, v in read.items() if k not in its_own} == {
        k: v for k, v in defaults.items() if k not in its_own}


def test_shipped_parameters_are_of_no_other_node():
    shipped = yaml.safe_load((ROOT / 'config' / 'pmcl.yaml').read_text())
    assert list(shipped) == [f'/**/{entry.name}' for entry in ALL]


@pytest.mark.parametrize(('name', 'changes', 'fields'), [
    ('pmcl_node', {'source': 'posed_views'}, {
        'contour': 'least_support',  # the default of a parameter
        'contour_map': 'version', 'contour_map_evidence': 'least_weight',
        'views': 'support_slope'}),
    ('pmcl_node', {}, {'contour_map_evidence': 'least_weight'}),
    ('dlv_node', {}, {'contour_map': 'version'})])
def test_a_broken_file_of_learned_numbers_is_an_error_of_configure_and_can_be_mended(
        user, tmp_path, package_tree, parameters, name, changes, fields):
    """fields: of the files that are broken, in the order in which they are read."""
    good = {}
    for learned, field in fields.items():
        file = package_tree / 'config' / 'learned' / f'{learned}.yaml'
        good[file] = file.read_text()
        file.write_text(good[file].replace(f'{field}:', 'least:'))
    with Process(tmp_path, f'pmcl_ros.nodes.{name}', params=parameters[name] | changes,
                 root=package_tree) as node:
        for (file, text), field in zip(good.items(), fields.values(), strict=True):
            assert not user.change(name, CONFIGURE)
            assert f'cannot configure: {file}: {field}: Field required' in node.log
            assert user.state(name) == UNCONFIGURED
            file.write_text(text)
        assert user.change(name, CONFIGURE)
        assert user.state(name) == INACTIVE
