"""Starts the chain, in one process or one for each node, and takes it to active."""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node

from pmcl_ros.nodes.graph import (
    BOARD,
    BY_BOARD,
    GRASPS,
    NODES,
    OF_LYTRO,
    SWEEP,
    VIEWS,
    NodeEntry,
    chain,
)
from pmcl_ros.nodes.runtime.lifecycle import ACTIVATE, CONFIGURE, Lifecycle, LifecycleError
from pmcl_ros.nodes.runtime.parameter_file import (
    check_parameter_file,
    parameter_file,
    parameter_files,
)
from pmcl_ros.nodes.runtime.running import NodeThread, pause, ros
from pmcl_ros.nodes.runtime.supervision import NodeProcess, Running, Supervisor
from pmcl_ros.nodes.transport.intra_process_bus import IntraProcessBus
from pmcl_ros.runtime.errors import PmclError


def bring_up(options: argparse.Namespace, ros_args: Sequence[str]) -> None:
    """Start the nodes and stay until a signal comes; PmclError when a node fails or ends."""
    entries = [entry for entry in chain(bool(options.sweep or options.views), options.lytro,
                                        options.views == 'fixed', options.board)
               if entry.name not in options.without]
    entries += [GRASPS] if options.grasps else []
    running: dict[str, Running] = {}
    bus = IntraProcessBus()  # volumes go by reference between the nodes of this process

    def check(name: str) -> None:
        pause(0)
        if not running[name].alive():
            raise LifecycleError(f'{name} has ended; its log says why')

    with ExitStack() as stack:
        for entry in reversed(entries):
            running[entry.name] = (NodeProcess(entry, ros_args) if options.processes
                                   else NodeThread(entry.load()(bus=bus)))
            # by its name: it may have been started again by then
            stack.callback(lambda name: running[name].stop(), entry.name)
        if options.autostart:
            with client_node('pmcl_bringup') as node:
                activate(node, list(running), check, options.timeout)
        if options.respawn:
            supervise(running, {entry.name: entry for entry in entries}, ros_args, check,
                      options.timeout)
        while True:
            pause(0.5)
            for name in running:
                check(name)


def supervise(running: dict[str, Running], entries: dict[str, NodeEntry], ros_args: Sequence[str],
              check: Callable[[str], None], timeout: float) -> None:
    """Stay until a signal comes; whatever ends meanwhile is started again."""
    # One node for all: rclpy keeps 0.1 MB of each that was made and destroyed.
    with client_node('pmcl_supervisor') as node:
        supervisor = Supervisor(node, running, lambda name: NodeProcess(entries[name], ros_args),
                                lambda name: activate(node, [name], check, timeout))
        while True:
            supervisor.check()
            pause(0.5)


def activate(node: Node, names: Sequence[str], check: Callable[[str], None], timeout: float
             ) -> None:
    """Configure, then activate, one node after the other; `node` asks them."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        lifecycle = Lifecycle(node, executor, check)
        for transition in (CONFIGURE, ACTIVATE):
            for name in names:
                lifecycle.change(name, transition, timeout)
        node.get_logger().info(f'active: {", ".join(names)}')
    finally:
        executor.shutdown()


@contextmanager
def client_node(name: str) -> Iterator[Node]:
    """A node that asks others."""
    node = Node(name)
    try:
        yield node
    finally:
        node.destroy_node()


def _split(args: Sequence[str]) -> tuple[list[str], list[str]]:
    """This program's own arguments, and the parts `--ros-args ... --`, which the nodes get too.

    rclpy's remove_ros_args reads the parameter files, and fails with them.
    """
    own: list[str] = []
    parts: list[str] = []
    inside = False
    for each in args:
        inside = inside or each == '--ros-args'
        (parts if inside else own).append(each)
        inside = inside and each != '--'
    return own, parts


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='pmcl_bringup', description=__doc__)
    parser.add_argument('--params-file', type=Path, help='parameters of the nodes, YAML')
    parser.add_argument('--processes', action='store_true', help='one process for each node')
    parser.add_argument('--respawn', action='store_true', help='with --processes: start a node '
                        'again that has ended, and take it to active')
    parser.add_argument('--no-autostart', dest='autostart', action='store_false',
                        help='leave configure and activate to somebody else')
    parser.add_argument('--without', action='append', default=[], metavar='NODE',
                        choices=[entry.name for entry in NODES], help='do not start this node')
    parser.add_argument('--grasps', metavar='FILE',
                        help='start grasp_node too, with these grasps, YAML (pmcl grasps)')
    parser.add_argument('--sweep', metavar='FILE',
                        help='start sweep_driver in place of lytro_driver and subaperture_node, '
                        'with this plan, YAML (pmcl sweep plan)')
    parser.add_argument('--views', choices=VIEWS, help='start sweep_driver likewise, for posed '
                        'views: where the camera comes to rest, at each call of ~/take, or at the '
                        'poses of a plan, which the parameter plan names; fixed: start '
                        'fixed_cameras instead, for those of several cameras at rest')
    parser.add_argument('--lytro', action='store_true', help='with --views: of the centre views '
                        'of a Lytro, so that lytro_driver and subaperture_node are started too')
    parser.add_argument('--board', action='store_true', help='with --views of a moved camera: '
                        'start board_node too, which tells its poses by a printed board in view')
    parser.add_argument('--pose', metavar='TOPIC', help='where pmcl_node publishes its pose, and '
                        'grasp_node and a grasp pipeline find it, instead of pose')
    parser.add_argument('--timeout', type=float, default=120.0,
                        help='for one transition of one node [s]')
    return parser


def _problem(options: argparse.Namespace) -> str:
    """Why nothing can be started by these options; empty where it can."""
    file, views = options.params_file, options.views
    problems = (
        (options.respawn and not (options.processes and options.autostart),
         '--respawn needs --processes, and autostart'),
        (file is not None and not file.is_file(), f'there is no {file}'),
        (options.sweep and views,
         '--sweep is for a light field, --views for posed views: give one of them'),
        (options.lytro and views in (None, 'fixed'),
         '--lytro says what the views are of: give --views too, of a moved camera'),
        (options.board and (views in (None, 'fixed') or options.lytro),
         '--board tells where an ordinary camera is: give --views too, of a moved camera, and no '
         '--lytro'))
    return next((text for wrong, text in problems if wrong), '')


def _ros_arguments(options: argparse.Namespace, given: Sequence[str]) -> list[str]:
    """What the nodes get: the parameter file, what was given, and the remappings of options."""
    remapped = [f'pose:={options.pose}'] if options.pose else []
    if options.lytro:
        remapped += [f'{SWEEP.name}:{name}:={heard}' for name, heard in OF_LYTRO.items()]
    # first: what the command line says goes over what the file says
    file = ([] if options.params_file is None
            else ['--ros-args', '--params-file', str(options.params_file), '--'])
    return [*file, *given,
            *(part for each in remapped for part in ('--ros-args', '-r', each, '--'))]


def _own_values(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """By node: parameters that follow from options, whatever a parameter file says."""
    collect, source = None, None
    if options.sweep:
        collect, source = 'grid', 'light_field'
    elif options.views:
        collect, source = None if options.views == 'fixed' else options.views, 'posed_views'
    return {GRASPS.name: {'grasps': options.grasps},
            SWEEP.name: {'plan': options.sweep, 'collect': collect,
                         **(BY_BOARD[SWEEP.name] if options.board else {})},
            BOARD.name: BY_BOARD[BOARD.name] if options.board else {},
            'pmcl_node': {'source': source}}


def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    given = list(sys.argv if args is None else args)
    own, of_ros = _split(given[1:])
    parser = _parser()
    options = parser.parse_args(own)
    if problem := _problem(options):
        parser.error(problem)
    ros_args = _ros_arguments(options, of_ros)
    try:
        others = [(file, node) for file in parameter_files(ros_args)
                  for node in check_parameter_file(file)]
        with parameter_file(_own_values(options)) as last, ros([given[0], *ros_args, *last]):
            for file, node in others:
                get_logger('pmcl_bringup').warning(
                    f'{file} has parameters for {node!r}, which is none of this package')
            bring_up(options, [*ros_args, *last])
    except PmclError as error:
        sys.stderr.write(f'pmcl_bringup: {error}\n')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
