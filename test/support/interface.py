"""What users rely on, read from the code: `python test/support/interface.py` prints it as YAML."""

import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from inspect import signature
from pathlib import Path

import click
import yaml

from pmcl_ros.nodes.graph import ALL, OPTIONAL, SERVICES, TOPICS
from pmcl_ros.nodes.runtime.parameters import ros_type
from pmcl_ros.runtime.start import MODULES

ROOT = Path(__file__).parents[2]
# Files that users write or read: name of the format, where its fields are declared.
FILES = {
    'calibration YAML': 'pmcl_ros.lightfield.calibration.calibration:Calibration',
    'object YAML': 'pmcl_ros.pmcl.object_model:ObjectSettings',
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
    'grasps YAML': 'pmcl_ros.grasps.grasp:GraspFile',
    'grasps YAML grasp': 'pmcl_ros.grasps.grasp:GraspEntry',
    'scene settings YAML': 'pmcl_ros.simulation.scenes.random_scene:SceneSettings',
    'sequence settings YAML': 'pmcl_ros.simulation.sequence:SequenceSettings',
}
PROGRAMS = ('pmcl_bringup', 'pmcl_record', 'pmcl_replay', 'pmcl_soak')


def interface() -> list[str]:
    """Every entry, sorted: commands, options, executables, topics, services, parameters, files."""
    return sorted({*_commands(), *_executables(), *_launch(), *_topics(), *_parameters(),
                   *_files()})


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


def _files() -> Iterator[str]:
    for name, place in FILES.items():
        module, _, kind = place.partition(':')
        for key, field in getattr(import_module(module), kind).model_fields.items():
            yield f'file {name}: {field.alias or key}'
    from pmcl_ros.evaluation.records import COLUMNS
    yield from (f'file results.csv: {each}' for each in COLUMNS)


if __name__ == '__main__':
    yaml.safe_dump(interface(), sys.stdout, width=200)
