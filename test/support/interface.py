"""What users rely on, read from the code: `python test/support/interface.py` prints it as YAML."""

import dataclasses
import json
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from inspect import signature
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, get_args, get_origin

import click
import numpy as np
import yaml

from pmcl_ros.cli.localization import json_values
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.readers.posed_views import ViewCamera
from pmcl_ros.nodes.graph import ALL, OPTIONAL, SERVICES, TOPICS
from pmcl_ros.nodes.runtime.parameters import ros_type
from pmcl_ros.pmcl.estimate import PoseEstimate, PoseMode
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate
from pmcl_ros.pmcl.multi_view.camera_errors import CameraScale
from pmcl_ros.runtime.start import MODULES
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.files import write_views
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene

ROOT = Path(__file__).parents[2]
# Files that users write or read: name of the format, where its fields are declared.
FILES = {
    'calibration YAML': 'pmcl_ros.lightfield.calibration.lytro.calibration:Calibration',
    'object YAML': 'pmcl_ros.pmcl.object_model:ObjectSettings',
    'object YAML appearance': 'pmcl_ros.pmcl.appearance:Appearance',
    'object YAML appearance liquid': 'pmcl_ros.pmcl.appearance:Liquid',
    'object YAML appearance mouth': 'pmcl_ros.pmcl.appearance:Mouth',
    'light_field.yaml': 'pmcl_ros.lightfield.readers.folder:GridSettings',
    'sweep.yaml': 'pmcl_ros.lightfield.readers.sweep_folder:SweepFolder',
    'sweep.yaml camera': 'pmcl_ros.lightfield.readers.sweep_folder:CameraEntry',
    'sweep.yaml frame': 'pmcl_ros.lightfield.readers.sweep_folder:FrameEntry',
    'views.yaml': 'pmcl_ros.lightfield.readers.posed_views:ViewsFile',
    'views.yaml camera': 'pmcl_ros.lightfield.readers.posed_views:ViewCamera',
    'views.yaml view': 'pmcl_ros.lightfield.readers.posed_views:ViewEntry',
    'camera YAML': 'pmcl_ros.simulation.ordinary_camera:OrdinaryCamera',
    'sweep plan YAML': 'pmcl_ros.lightfield.sweep.plan:SweepPlan',
    'sweep plan YAML view': 'pmcl_ros.lightfield.sweep.plan:PlannedView',
    'plan YAML of simulated cameras': 'pmcl_ros.simulation.camera_plan:CameraPlan',
    'plan YAML of views': 'pmcl_ros.lightfield.sweep.view_plan:ViewPlan',
    'grasps YAML': 'pmcl_ros.grasps.grasp:GraspFile',
    'grasps YAML grasp': 'pmcl_ros.grasps.grasp:GraspEntry',
    'scene settings YAML': 'pmcl_ros.simulation.scenes.random_scene:SceneSettings',
    'sequence settings YAML': 'pmcl_ros.simulation.sequence:SequenceSettings',
    'settings YAML of described scenes':
        'pmcl_ros.simulation.described.surroundings:DescribedSettings',
    'trial.json': 'pmcl_ros.simulated_robot.trial:ManipulationTrial',
    'config/learned/contour.yaml': 'pmcl_ros.evidence.learned:LearnedContour',
    'config/learned/contour_map.yaml': 'pmcl_ros.evidence.learned:LearnedMap',
    'config/learned/contour_map_evidence.yaml': 'pmcl_ros.evidence.learned:LearnedMapEvidence',
    'config/learned/creases.yaml': 'pmcl_ros.evidence.learned:LearnedProfile',
    'config/learned/views.yaml': 'pmcl_ros.evidence.learned:LearnedViews',
}
PROGRAMS = ('pmcl_bringup', 'pmcl_record', 'pmcl_replay', 'pmcl_soak')


def interface() -> list[str]:
    """Every entry, sorted: commands, options and their choices, executables, topics, ..."""
    return sorted({*_commands(), *_executables(), *_launch(), *_topics(), *_parameters(),
                   *_files(), *_written()})


def _commands() -> Iterator[str]:
    from pmcl_ros.cli import main

    def walk(command: click.Command, name: str) -> Iterator[str]:
        yield f'command {name}'
        context = click.Context(command)
        for each in command.params:
            if isinstance(each, click.Argument):
                taken = len(signature(each.make_metavar).parameters)  # the context; none by 8.1
                yield f'command {name} {each.make_metavar(*[context][:taken])}'
            else:
                yield from (f'command {name} {option}' for option in each.opts)
                if isinstance(each.type, click.Choice):
                    yield from (f'command {name} {each.opts[-1]} {choice}'
                                for choice in each.type.choices)
        if isinstance(command, click.Group):
            for sub in command.list_commands(context):
                found = command.get_command(context, sub)
                assert found is not None
                yield from walk(found, f'{name} {sub}')

    yield from walk(main, 'pmcl')


def _executables() -> Iterator[str]:
    for name, module in MODULES.items():
        yield f'executable {name}'
        if name in PROGRAMS:
            text = subprocess.run([sys.executable, '-m', module, '--help'], check=True,
                                  capture_output=True, text=True, cwd=ROOT).stdout
            yield from (f'executable {name} {option}'
                        for option in re.findall(r'^  .*?(--[\w-]+)', text, re.MULTILINE))
    makefile = (ROOT / 'Makefile').read_text()
    phony = re.search(r'^\.PHONY:(.*)$', makefile, re.MULTILINE)
    assert phony is not None
    yield from (f'make {target}' for target in phony[1].split())


def _launch() -> Iterator[str]:
    text = (ROOT / 'launch' / 'pmcl.launch.py').read_text()
    yield from (f'launch pmcl.launch.py {name}:='
                for name in re.findall(r"DeclareLaunchArgument\('(\w+)'", text))


def _topics() -> Iterator[str]:
    for each in (*TOPICS, *OPTIONAL):
        for node in each.publishers:
            yield f'topic {each.name} {each.type} from {node}'
        for node in each.subscribers:
            yield f'topic {each.name} {each.type} to {node}'
    for node, services in SERVICES.items():
        yield from (f'service {node} {name}' for name, _ in services)


def _parameters() -> Iterator[str]:
    for entry in ALL:
        for name, field in entry.load().settings_class.model_fields.items():
            yield f'parameter {entry.name} {name} {ros_type(field).name.lower()}'
            yield from (f'parameter {entry.name} {name} {choice!r}'
                        for choice in _choices(field.annotation))


def _choices(kind: Any) -> list[Any]:
    """Values of the Literals in the type of a field."""
    if get_origin(kind) is Literal:
        return [*get_args(kind)]
    return [choice for each in get_args(kind) for choice in _choices(each)]


def _files() -> Iterator[str]:
    for name, place in FILES.items():
        module, _, kind = place.partition(':')
        for key, field in getattr(import_module(module), kind).model_fields.items():
            yield f'file {name}: {field.alias or key}'
            yield from (f'file {name}: {field.alias or key} {choice!r}'
                        for choice in _choices(field.annotation))
    from pmcl_ros.evaluation.records import COLUMNS
    yield from (f'file results.csv: {each}' for each in COLUMNS)
    yield from (f'file trials.json: {each.name}' for each in dataclasses.fields(Trial))


def _written() -> Iterator[str]:
    """Keys of JSON that no class declares: those of what is written."""
    scene = random_scene(np.random.default_rng(0), SceneSettings(views=3, size=64))
    camera = ViewCamera(**dataclasses.asdict(scene.sensor.grid.pinhole))
    with TemporaryDirectory() as folder:
        write_views(Path(folder), scene, [np.zeros((64, 64, 3), np.uint8)] * 2, camera,
                    CameraPlan(grid=(1, 2, 0.1)), 0, digest='digest')
        truth = json.loads((Path(folder) / 'truth.json').read_text())
    yield from (f'file truth.json: {each}' for each in _keys(truth))
    pose = np.eye(4)
    found = PoseEstimate(
        Header(), pose, np.eye(6), pose[None], np.zeros(1), 1.0, lost=False, mode='default',
        modes=(PoseMode(pose, 1.0, 1.0),), support=1.0, evidence=1.0, least_support=1.0,
        least_evidence=1.0, least_weight=1.0, camera_scale=CameraScale(0.0, 1.0), hidden=(1,),
        evidence_of='map', degrees_of_freedom=4.0)
    lost = dataclasses.replace(found, lost=True, support=0.0)
    printed = [*_keys(json_values(found, {})), *_keys(json_values(lost, {})),
               *json_values(SceneEstimate.of_one('NAME', found), {})]
    yield from (f'command pmcl localize --json: {key}' for key in printed)


def _keys(values: Mapping[str, Any], before: str = '') -> Iterator[str]:
    """Of values, and of what these hold; of a list those of its first."""
    for key, value in values.items():
        yield before + key
        first = value[0] if isinstance(value, list) and value else value
        if isinstance(first, Mapping):
            yield from _keys(first, f'{before}{key}.')


if __name__ == '__main__':
    yaml.safe_dump(interface(), sys.stdout, width=200)
