"""From shutter to pose: through a graph in one process, and without ROS, of the same captures.

Prints one JSON object; `pmcl bench graph` runs it.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.files import read_raw_frame, write_picture
from pmcl_ros.camera.packing import pack12
from pmcl_ros.evaluation.bench.checkout import BAG, CALIBRATION, QUICK, WHITE, object_in
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.messages.bag_captures import extract_captures
from pmcl_ros.nodes.bench.running_graph import Graph, GraphError
from pmcl_ros.nodes.runtime.running import ros
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Box
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.tracking.continuity import Continuity
from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.ros_domain import own_domain

_PLAIN = {'interpolation': 'neutral', 'truncate': False, 'view_weights': 'light'}


def measure(bag: Path, captures: int, arguments: list[str], quick: bool,
            edges: bool) -> dict[str, object]:
    """Take `captures` pictures by the graph, each followed by the same without ROS.

    Both read the picture from a file (not compressed), decode, compute the evidence and search,
    with the settings of `pmcl localize` and the same random numbers. The first one is not
    counted. quick: hardly a search, which shows the nodes' own share better. edges: search by
    edges alone. The nodes make the contour map of each capture too, else, and without ROS it is
    made only where edges are not enough.
    Times are from the shutter to the pose in another process, and from reading to the pose [ms].
    """
    result: dict[str, object] = {}
    with TemporaryDirectory() as name, ros():
        folder = Path(name)
        (folder / 'picture').mkdir()
        picture, = extract_captures(bag, folder / 'picture')
        frame = read_raw_frame(picture)
        raw = folder / 'raw' / 'capture.RAW'
        raw.parent.mkdir()
        write_picture(raw, pack12(frame.counts), frame.metadata.text)
        truth = Truth.load(bag / 'truth.json')
        mesh = object_in(bag)
        model = ObjectModel.load(mesh)
        pmcl = PmclSettings.make({'object': str(mesh),
                                  'roi_center': truth.roi_center, 'roi_size': truth.roi_size,
                                  **(QUICK if quick else {}),
                                  **({'evidence': 'edges'} if edges else {})})
        decoders = Decoders(Calibration.load(CALIBRATION), WHITE)
        random = np.random.default_rng(pmcl.seed)
        # The nodes make the volume as in the mode default, in both modes.
        with Pipeline.for_object(model, pmcl, _PLAIN) as pipeline:
            dlv = pipeline.settings_for(decoders.decoder_for(frame.metadata).grid)
            parameters: dict[str, dict[str, Any]] = {
                'lytro_driver': {'source': 'files', 'path': str(raw), 'loop': True},
                'subaperture_node': {'calibration': str(CALIBRATION), 'white': str(WHITE)},
                'dlv_node': _listed(dlv.model_dump()), 'pmcl_node': _listed(pmcl.model_dump())}

            # As the node publishes it: its frame does not turn between captures.
            steady = Continuity(model.symmetry, Box(pmcl.roi_center, pmcl.roi_size))

            def offline() -> NDArray[np.float64]:
                run = pipeline.run(lambda: decoders.decode(read_raw_frame(raw)), random)
                return steady.follow(run.estimate).pose

            with Graph(parameters, folder, arguments) as graph:
                result = _compare(graph, offline, captures)
                if result['equal'] != captures:  # the nodes' own log says why
                    sys.stderr.write(graph.log)
    if not result:
        raise GraphError('interrupted')
    return result


def _listed(values: dict[str, object]) -> dict[str, object]:
    return {name: list(each) if isinstance(each, tuple) else each
            for name, each in values.items() if each is not None}


def _compare(graph: Graph, offline: Callable[[], NDArray[np.float64]],
             captures: int) -> dict[str, object]:
    through, without, equal = [], [], 0
    used = {'graph': 0.0, 'offline': 0.0}
    for number in range(captures + 1):
        before = graph.cpu_seconds
        answer = graph.capture()
        graph.wait(lambda: len(graph.poses) == number + 1 and answer.done(), 'a pose')  # noqa: B023
        stamp, arrived, pose = graph.poses[-1]
        after = graph.cpu_seconds
        began, cpu = time.perf_counter(), time.process_time()
        expected = offline()
        seconds, cpu = time.perf_counter() - began, time.process_time() - cpu
        if number >= 1:
            used['graph'] += after - before
            used['offline'] += cpu
            through.append(1e-6 * (arrived - stamp))
            without.append(1e3 * seconds)
            equal += np.allclose(pose, expected)
    pairs = np.divide(through, without)
    return {'captures': captures, 'equal': equal,
            'ms': {'graph': float(np.median(through)), 'offline': float(np.median(without))},
            'cpu_ms': {name: 1e3 * each / captures for name, each in used.items()},
            'ratio': float(np.median(pairs)), 'worst_ratio': float(pairs.max()),
            'cpu_ratio': used['graph'] / used['offline']}


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--bag', type=Path, default=BAG)
    parser.add_argument('--captures', type=int, default=20)
    parser.add_argument('--processes', action='store_true', help='a process for each node')
    parser.add_argument('--quick', action='store_true', help='hardly a search')
    parser.add_argument('--edges', action='store_true', help='search by edges alone: then the '
                        'nodes compute no more than is computed without ROS')
    options = parser.parse_args()
    out = os.fdopen(os.dup(1), 'w', buffering=1)
    os.dup2(2, 1)  # Fast DDS complains there
    try:
        own_domain()
        result = measure(options.bag, options.captures,
                         ['--processes'] if options.processes else [], options.quick,
                         options.edges)
    except PmclError as error:
        sys.stderr.write(f'{error}\n')
        return 1
    out.write(json.dumps(result) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
