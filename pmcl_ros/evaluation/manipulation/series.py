"""Trials of a simulated robot, one after the other, through the real nodes over DDS."""

import hashlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from signal import SIGINT

import numpy as np
import yaml

from pmcl_ros import __version__
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.grasps.grasp import GraspFile
from pmcl_ros.grasps.ranking import Ranker
from pmcl_ros.grasps.settings import GraspSettings
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.binary_file import sha256
from pmcl_ros.runtime.errors import FileError, SettingsError, SimulationError
from pmcl_ros.runtime.outputs import Results, write_file
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.runtime.text_file import read_json
from pmcl_ros.simulated_robot.trial import Grip, ManipulationTrial
from pmcl_ros.simulation.described.substances import WATER
from pmcl_ros.simulation.lytro.calibration_pictures import write_calibration
from pmcl_ros.simulation.lytro.camera import F01_RAW, LytroCamera
from pmcl_ros.simulation.manipulation.buoyancy import DRIFT
from pmcl_ros.simulation.manipulation.camera_kinds import WIDE_F01, load_camera
from pmcl_ros.simulation.manipulation.fetch_arm import LIFT
from pmcl_ros.simulation.manipulation.pick_and_place import Sight, pick_and_place
from pmcl_ros.simulation.manipulation.workcell import Workcell
from pmcl_ros.simulation.manipulation.workplace import MIDDLE, Task, WorkplaceKind, draw_task
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera

_X, _Y, _Z = GraspSettings().shoulder
_SHOULDER = _X, _Y, _Z + LIFT  # m: the torso is up
_EXECUTIVE = 'package://pmcl_ros/examples/pick_from_water.py'
_PATIENCE = 900.0  # s: until the nodes are active; the first run compiles
_END = 120.0  # s: for a program to end, and for the robot to judge before
_ANSWER = 900.0  # s: for each answer, of a robot that may render raw pictures
_SHOWN = 800  # characters of a log
_FILES = ('trial.json', 'robot.json', 'nodes.yaml', 'nodes.log', 'robot.log', 'executive.log',
          'film.png', *(f'{number:03d}.png' for number in range(100)))  # of a trial, at most
# m: height of the middle of the region where the object's origin is sought, and its size.
_REGION: dict[WorkplaceKind, tuple[float, tuple[float, float, float]]] = {
    'sink': (0.64, (0.3, 0.3, 0.13)), 'tank': (0.775, (0.3, 0.3, 0.1))}
# How the object is turned there: a bottle floats upright, a glass in a sink stands or lies.
_TURNED: dict[WorkplaceKind, dict[str, object]] = {
    'sink': {}, 'tank': {'roi_up': [0.0, 0.0, 1.0], 'roi_tilt': [0.0, 0.5]}}
_USUAL, _DISTANCE = 150, 0.5  # px: extent of an object in a picture; m: of the camera, about
# What the executive is given: the height of its aim, and more. Into a tank it looks through the
# film on its front, by its last views, as the bottle drifts; it is sure enough with a
# quarter of the room that a finger has beside the cap.
_ORDERS: dict[WorkplaceKind, tuple[str, ...]] = {
    'sink': ('0.64',),
    'tank': ('0.86', '--distance', str(_DISTANCE), '--lift-only', '--lift', '0.3', '--least', '2',
             '--sigma', '0.008', '--looks', '8', *(
                 each for turn, height in ((30, 6), (-30, 6), (15, 10), (-15, 10), (45, 12),
                                           (-45, 12), (0, 6), (35, 10), (-35, 10))
                 for each in ('--from', str(turn), str(height))))}
_VIEWS: dict[WorkplaceKind, int] = {'sink': 12, 'tank': 3}  # that count, at most
_DRIFT: dict[WorkplaceKind, float] = {'sink': 0.0, 'tank': DRIFT}
_REACH = 0.6  # m: of the camera from the aim; farther the arm does not come to all sides
_EXACT = np.diag([1e-8] * 6)  # of a pose that is the truth


@dataclass(frozen=True)
class Series:
    """What is tried.

    thing: YAML with appearance, `thing.grasps.yaml` beside it. mass: of it [kg]. camera: as of
    `load_camera`. renderer, samples: of the wrist camera's pictures. out: folder of the trials.
    declared: whether pmcl_node knows where the water's surface is. force: overwrite files that
    no earlier run wrote.
    """

    place: WorkplaceKind
    thing: Path
    mass: float
    camera: str
    renderer: str
    samples: int
    out: Path
    declared: bool = True
    force: bool = False

    @property
    def grasps(self) -> Path:
        """The grasp file of the object."""
        return self.thing.with_suffix('.grasps.yaml')

    @property
    def pinhole(self) -> Pinhole:
        """Of the pictures that are searched."""
        return self._camera.sensor(np.random.default_rng(0)).grid.pinhole

    def water(self, seed: int) -> Interface:
        """Of a trial, in the frame of the robot's base."""
        points, normals = zip(*self._task(seed).place.faces, strict=True)
        return Interface(np.array(points), np.array(normals), WATER.index)

    def claim(self) -> None:
        """Use the folder; SettingsError where it has trials of another series.

        A series is of these settings, of what is in the files that they name, and of this version.
        """
        of = {each: str(getattr(self, each)) for each in (
            'place', 'thing', 'mass', 'camera', 'renderer', 'samples', 'declared')}
        of |= self._digests | {'pmcl_ros': __version__}
        file = self.out / 'series.json'
        if file.is_file() and (before := read_json(file)) != of:
            differs = sorted(each for each in {*of, *before} if of.get(each) != before.get(each))
            raise SettingsError(f'{self.out} has trials of another series ({file.name} has other '
                                f'{", ".join(differs)}): choose another folder')
        self.out.mkdir(parents=True, exist_ok=True)
        write_file(file, json.dumps(of, indent=1))

    def run(self, seed: int) -> ManipulationTrial:
        """The trial of a seed, with nodes of its own; one that is there already is read.

        Raises SimulationError when a program ends that should not, OutputError where a file is
        there that no earlier run wrote.
        """
        if self.file(seed).is_file():
            return ManipulationTrial.read(self.file(seed))
        place = self.file(seed).parent
        if self.camera == F01_RAW:
            write_calibration(self._calibration, WIDE_F01, self.force)
        with Results(place, 'manipulate', self.force) as results:
            results.reserve(*_FILES)
            (place / 'robot.json').unlink(missing_ok=True)  # of a trial that was cut short
            with self._graph(seed, place):
                return self._trial(seed, place)

    def run_by_truth(self, seed: int) -> ManipulationTrial:
        """The same task where the robot is given the true pose: what physics and planner allow."""
        began = time.monotonic()
        model, gripper, grasps = GraspFile.read(self.grasps)
        task = draw_task(np.random.default_rng(seed), self.place, model)
        cell = Workcell(task, model, self.mass, np.random.default_rng([seed, 3]))
        ranker = Ranker(model, gripper, grasps, GraspSettings(shoulder=_SHOULDER))

        def look() -> Sight:
            return Sight(cell.object_pose, ranker.rank(cell.object_pose, _EXACT).candidates)

        outcome = pick_and_place(cell, model, look)
        grips = ((Grip(gap=cell.gap, held=outcome.held, off=(0.0, 0.0)),)
                 if outcome.held or outcome.cause == 'slip' else ())
        return ManipulationTrial(
            seed=seed, place=self.place, stands=task.stands, by_truth=True, grips=grips,
            largest_touch=outcome.largest_touch, done=outcome.placed, said=outcome.cause,
            status=0 if outcome.placed else 1, times={'physics': time.monotonic() - began})

    def file(self, seed: int) -> Path:
        """Where the trial of a seed is."""
        return self.out / f'{seed:06d}' / 'trial.json'

    @contextmanager
    def _graph(self, seed: int, place: Path) -> Iterator[None]:
        """The nodes of the package, active."""
        file, log = place / 'nodes.yaml', place / 'nodes.log'
        write_file(file, yaml.safe_dump({name: {'ros__parameters': values} for name, values
                                         in self._parameters(seed).items()}))
        with log.open('w') as output:
            nodes = subprocess.Popen(
                [sys.executable, '-m', 'pmcl_ros.nodes.bringup', '--params-file', str(file),
                 '--views', 'rest', '--grasps', str(self.grasps), '--without', 'dlv_node',
                 *(['--lytro', '--without', 'lytro_driver'] if self.camera == F01_RAW else [])],
                stdout=output, stderr=subprocess.STDOUT)
        try:
            _wait(nodes, log, 'active: ')
            yield
        finally:
            _end(nodes)

    def _parameters(self, seed: int) -> dict[str, dict[str, object]]:
        height, size = _REGION[self.place]
        search: dict[str, object] = {
            'object': str(self.thing), 'roi_center': [*MIDDLE[self.place], height],
            'roi_size': list(size)} | _TURNED[self.place]
        if self.declared:
            water = self.water(seed)
            search |= {'interface_index': water.index,
                       'interface_point': water.points.ravel().tolist(),
                       'interface_normal': water.normals.ravel().tolist()}
        decoding: dict[str, dict[str, object]] = {'subaperture_node': {
            'calibration': str(self._calibration / 'calibration.yaml'),
            'white': str(self._calibration / 'white')}} if self.camera == F01_RAW else {}
        return decoding | {
            'sweep_driver': {
                'gamma': self._gamma, 'shrink': self._shrink,
                'poses': 'topic', 'patience': 20.0, 'fixed_frame': 'base_link',
                'most_views': _VIEWS[self.place], 'near': 0.3, 'sigma_position': 0.0011,
                'sigma_rotation': 0.0036, 'common': 0.9, 'drift': _DRIFT[self.place]},
            'pmcl_node': search,
            'grasp_node': {'base_frame': 'base_link', 'arm': 'fixed',
                           'shoulder': list(_SHOULDER)}}

    def _trial(self, seed: int, place: Path) -> ManipulationTrial:
        log = place / 'robot.log'
        with log.open('w') as output:
            robot = subprocess.Popen(
                [sys.executable, '-m', 'pmcl_ros.simulated_robot.robot_node',
                 '--place', self.place, '--object', str(self.thing), '--mass', str(self.mass),
                 '--camera', self.camera, '--renderer', self.renderer,
                 '--samples', str(self.samples), '--seed', str(seed), '--out', str(place)],
                stdout=output, stderr=subprocess.STDOUT)
        try:
            _wait(robot, log, 'ready')
            status, said = self._executive(seed, place)
        finally:
            _end(robot)
        try:
            trial = ManipulationTrial.read(place / 'robot.json')
        except FileError:
            raise SimulationError(f'the robot wrote no trial: {_tail(log)}') from None
        trial = trial.model_copy(update={'status': status, 'said': said})
        write_file(self.file(seed), trial.model_dump_json(indent=1))
        return trial

    def _executive(self, seed: int, place: Path) -> tuple[int, str]:
        """Its status and its last line."""
        task = self._task(seed)
        arguments = ['--aim', *map(str, MIDDLE[self.place]), *_ORDERS[self.place],
                     *self._adapted, '--timeout', str(_ANSWER),
                     '--tray', *map(str, task.place.tray),
                     '--bottom', str(float(self._model.vertices[:, 2].min()))]
        executive = resolve(_EXECUTIVE, 'executive')
        with (place / 'executive.log').open('w') as output:
            done = subprocess.run([sys.executable, str(executive), *arguments], stdout=output,
                                  stderr=subprocess.STDOUT, check=False)
        return done.returncode, _tail(place / 'executive.log').splitlines()[-1]

    @property
    def _adapted(self) -> tuple[str, ...]:
        """Orders that depend on the camera.

        A Lytro sees little: it keeps so far away that an object anywhere in the region is in view.
        """
        camera = self._camera
        if not isinstance(camera, LytroCamera):
            return ()
        seen = max(_REGION[self.place][1]) + float(np.ptp(self._model.vertices, axis=0).max())
        return '--distance', f'{min(seen / camera.field, _REACH):.3f}'

    @property
    def _gamma(self) -> float:
        """Exponent that linearises the pictures."""
        camera = self._camera
        if isinstance(camera, OrdinaryCamera):
            return camera.gamma
        return 1 / CameraMetadata.parse(camera.text()).image.color.gamma

    @property
    def _shrink(self) -> int:
        """Pixels as large as the search wants them, which is made for objects of `_USUAL`."""
        extent = float(np.ptp(self._model.vertices, axis=0).max())
        return max(1, int(extent * self.pinhole.fx / _DISTANCE / _USUAL))

    @property
    def _camera(self) -> OrdinaryCamera | LytroCamera:
        return load_camera(self.camera)

    @property
    def _calibration(self) -> Path:
        """The folder of what decodes raw pictures."""
        return self.out / 'f01'

    @property
    def _digests(self) -> dict[str, str]:
        """SHA-256 of the object's file, mesh and grasps, and of the camera's file."""
        mesh = hashlib.sha256(self._model.vertices.tobytes() + self._model.faces.tobytes())
        files = self.thing, self.grasps, Path(self.camera)
        return {f'SHA-256 of {each.name}': sha256(each) for each in files if each.is_file()} | {
            'SHA-256 of the mesh': mesh.hexdigest()}

    @property
    def _model(self) -> ObjectModel:
        return ObjectModel.load(self.thing)

    def _task(self, seed: int) -> Task:
        return draw_task(np.random.default_rng(seed), self.place, self._model)


def _wait(process: subprocess.Popen[bytes], log: Path, word: str) -> None:
    """Until a word is in a log; SimulationError when its process ends before."""
    deadline = time.monotonic() + _PATIENCE
    while word not in log.read_text(errors='replace'):
        if process.poll() is not None or time.monotonic() > deadline:
            raise SimulationError(f'a program ended before it was ready: {_tail(log)}')
        time.sleep(0.1)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(SIGINT)
    try:
        process.wait(_END)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _tail(log: Path) -> str:
    return log.read_text(errors='replace')[-_SHOWN:].strip() or 'nothing was printed'
