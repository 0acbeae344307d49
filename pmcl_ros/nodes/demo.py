"""`make demo`: a shipped capture becomes a pose through the four nodes, on real ROS 2."""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.utilities import try_shutdown
from rich.console import Console
from rich.markup import escape
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from pmcl_ros.camera.simulated.server import served
from pmcl_ros.drawing.pictures import depth_picture, write_png
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.messages.bag_captures import extract_captures
from pmcl_ros.messages.image import depth_from, picture_from
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.nodes.graph import NODES
from pmcl_ros.nodes.runtime.base import SMALL
from pmcl_ros.nodes.runtime.lifecycle import Lifecycle
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime import start
from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.outputs import Results
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.runtime.ros_domain import own_domain
from pmcl_ros.warm_up.chain import CHAIN
from pmcl_ros.warm_up.stage import compile_ahead

_ROOT = Path(__file__).parents[2]
_PATIENCE = 300.0  # s: for the nodes, and the pose; the first run compiles its kernels
_CONSOLE = Console()
_PICTURES = ('centre.png', 'depth.png', 'overlay.png')


class DemoError(PmclError):
    """The demonstration failed."""


class Watcher(Node):
    """Receives the results of the chain for the one capture."""

    def __init__(self) -> None:
        super().__init__('pmcl_demo')
        self.pose: PoseStamped | None = None
        self.pictures: dict[str, Image] = {}
        self.create_subscription(PoseStamped, 'pose', self._on_pose, SMALL)
        for topic in ('center/image', 'dlv/depth', 'overlay'):
            self.create_subscription(Image, topic, self._keep(topic), SMALL)
        self.shutter = self.create_client(Trigger, 'lytro_driver/capture')

    @property
    def complete(self) -> bool:
        """Whether all messages were received."""
        return self.pose is not None and len(self.pictures) == 3

    def _on_pose(self, message: PoseStamped) -> None:
        self.pose = message

    def _keep(self, topic: str) -> Callable[[Image], None]:
        def keep(message: Image) -> None:
            if topic not in self.pictures:
                _say(f'received {topic}')
            self.pictures[topic] = message
        return keep


_STARTED = time.monotonic()


def _say(text: str) -> None:
    _CONSOLE.print(f'[cyan]{time.monotonic() - _STARTED:5.1f} s[/]  {text}', highlight=False)


def _start(stack: ExitStack, name: str, *arguments: str) -> subprocess.Popen[bytes]:
    """A process of the package, ended when the stack is left."""
    process = subprocess.Popen([sys.executable, '-m', start.__name__, name, *arguments])

    def end() -> None:
        process.terminate()
        process.wait()

    stack.callback(end)
    return process


def _parameters(bag: Path, truth: Truth, camera: dict[str, str]) -> list[str]:
    """Parameters beside config/pmcl.yaml: the camera, and the object and region of the bag."""
    values = {'pmcl_node:object': str(_mesh(bag)),
              'pmcl_node:roi_center': list(truth.roi_center),
              'pmcl_node:roi_size': list(truth.roi_size), **camera}
    return ['--ros-args',
            *(part for name, value in values.items() for part in ('-p', f'{name}:={value}'))]


def _mesh(bag: Path) -> Path:
    return _ROOT / 'models' / f'{bag.name}.obj'


def _simulate(stack: ExitStack, bag: Path) -> str:
    """The address of a simulated camera that takes the pictures of the bag."""
    pictures = stack.enter_context(TemporaryDirectory())
    extract_captures(bag, pictures)
    address, _ = stack.enter_context(served(pictures, '--empty'))
    return address.text


def show(bag: Path, results: Results, simulate: bool) -> None:
    """Run the chain on a bag, print its pose beside the truth, write the pictures.

    simulate: a simulated camera is triggered and takes the picture that is in the bag. Else the
    bag is replayed.
    """
    truth = Truth.load(bag / 'truth.json')
    with ExitStack() as stack:
        stack.callback(try_shutdown)
        rclpy.init()
        watcher = Watcher()
        executor = SingleThreadedExecutor()
        executor.add_node(watcher)
        _say('starting lytro_driver, subaperture_node, dlv_node, pmcl_node; configure, activate')
        # The bag replaces the camera: the driver reads files, and is not triggered.
        camera = ({'lytro_driver:source': 'wifi',
                   'lytro_driver:address': _simulate(stack, bag)} if simulate else
                  {'lytro_driver:source': 'files',
                   'lytro_driver:path': 'package://pmcl_ros/config/cameras'})
        processes = [_start(stack, 'pmcl_bringup', '--processes', '--params-file',
                            str(resolve('package://pmcl_ros/config/pmcl.yaml', 'config')),
                            *_parameters(bag, truth, camera))]
        deadline = time.monotonic() + _PATIENCE

        def alive(*_: object) -> None:
            if any(process.poll() not in (None, 0) for process in processes):
                raise DemoError('a process of the chain has failed; its lines above say why')

        _await_nodes(Lifecycle(watcher, executor, alive), executor, deadline)
        if simulate:
            _trigger(watcher, executor, alive, deadline)
        else:
            processes.append(_start(stack, 'pmcl_replay', str(bag), '--timeout', str(_PATIENCE)))
        while not watcher.complete:
            executor.spin_once(timeout_sec=0.1)
            alive()
            if time.monotonic() > deadline:
                raise DemoError(f'no pose after {_PATIENCE:.0f} s; got {list(watcher.pictures)}')
        _say('received the pose')
        assert watcher.pose is not None
        _report(watcher, watcher.pose, bag, truth.pose, results)
        _say('stopping the nodes')


def _await_nodes(lifecycle: Lifecycle, executor: SingleThreadedExecutor, deadline: float) -> None:
    """Return once all nodes are active and know the watcher: they publish each result once."""
    for entry in NODES:
        while lifecycle.state(entry.name, deadline) != State.PRIMARY_STATE_ACTIVE:
            executor.spin_once(timeout_sec=0.2)


def _trigger(watcher: Watcher, executor: SingleThreadedExecutor, alive: Callable[[], None],
             deadline: float) -> None:
    """Call the service of the driver, which is active."""
    while not watcher.shutter.service_is_ready():  # it may be found after the driver's others
        alive()
        executor.spin_once(timeout_sec=0.1)
        if time.monotonic() > deadline:
            raise DemoError(f'{watcher.shutter.srv_name} is not there after {_PATIENCE:.0f} s')
    _say('the camera is triggered')
    watcher.shutter.call_async(Trigger.Request()).add_done_callback(
        lambda answer: _say(f'lytro_driver: {answer.result().message}'))


def _report(watcher: Watcher, found: PoseStamped, bag: Path, truth: NDArray[np.float64],
            results: Results) -> None:
    model = ObjectModel.load(_mesh(bag))
    _, pose = pose_from(found)
    error = pose_error(pose, truth, model.symmetry)
    _CONSOLE.rule(f'{bag.name} in {found.header.frame_id}')
    for name, each in (('estimate', pose), ('truth', truth)):
        direction = each[:3, :3] @ (model.axis if model.axis is not None else [0, 0, 1.0])
        _CONSOLE.print(f'{name:>9}: position ({", ".join(f"{v:+.4f}" for v in each[:3, 3])}) m, '
                       f'axis ({", ".join(f"{v:+.3f}" for v in direction)})', highlight=False)
    _CONSOLE.print(f'    error: [bold]{1e3 * error.translation:.1f} mm[/], '
                   f'[bold]{np.rad2deg(error.rotation):.1f} degrees[/] (of the symmetry axis)',
                   highlight=False)
    depth = depth_from(watcher.pictures['dlv/depth'])
    near, far = np.nanpercentile(depth, [1, 99])
    centre, likely, overlay = (results.path(name) for name in _PICTURES)
    write_png(centre, picture_from(watcher.pictures['center/image']))
    write_png(likely, depth_picture(depth, near, far))
    write_png(overlay, picture_from(watcher.pictures['overlay']))
    _CONSOLE.print(f' pictures: {centre}, {likely} (most likely depth), {overlay} (estimate on '
                   'the centre view)', highlight=False)
    _CONSOLE.rule()


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog='pmcl_demo', description=__doc__)
    parser.add_argument('--bag', type=Path, default=_ROOT / 'bags' / 'wine_glass',
                        help='bag with its truth.json; the object is models/NAME.obj')
    parser.add_argument('--out', type=Path, default=Path('out'), help='folder for the pictures')
    parser.add_argument('--camera', choices=['', 'simulated'], default='', help='simulated: a '
                        'camera made of software takes the picture; else the bag is replayed')
    parser.add_argument('--force', action='store_true',
                        help='overwrite files that are there already')
    options = parser.parse_args()
    try:
        own_domain()
        with Results(options.out, 'demo', options.force) as results:
            results.reserve(*_PICTURES)
            compile_ahead(_CONSOLE, CHAIN)  # on all cores, before four processes need the kernels
            show(options.bag, results, options.camera == 'simulated')
    except PmclError as error:
        _CONSOLE.print(f'[red]the demo failed:[/] {escape(str(error))}', soft_wrap=True)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())
