"""Makes the files of the contour map: trains, writes the ONNX file, calibrates, records."""

import hashlib
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path

import cv2
import keras
import numpy as np
import onnx
import tensorflow as tf

from pmcl_ros.drawing.charts import draw
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.evidence.contour_net import logits, read_network
from pmcl_ros.evidence.learned import LearnedMap
from pmcl_ros.learning.contour_net.calibration import Measured, charts
from pmcl_ros.learning.contour_net.network import POSITIVE_WEIGHT, build
from pmcl_ros.learning.contour_net.onnx_file import write
from pmcl_ros.learning.contour_net.pictures import Files
from pmcl_ros.learning.contour_net.training import train
from pmcl_ros.learning.contour_net.training_plan import TrainingPlan

# With so many held-out pictures the bias of contours has a standard deviation of 0.1 nat, that of
# the inside 0.3, by resampling pictures; both go with one over the root of their number.
_ENOUGH = 20
_LIBRARIES = (tf, keras, onnx, np, cv2)


def learn(pictures: Path, out: Path, plan: TrainingPlan, command: str,
          report: Callable[[str], object], start: Path | None = None) -> LearnedMap:
    """Write contour_map.onnx, contour_map.yaml and reliability.png into a folder.

    Training goes on from `training.npz` in that folder, where there is one. Calibrated on some
    held-out pictures; what is reported and drawn is measured on others. start: as of `train`.
    """
    out.mkdir(parents=True, exist_ok=True)
    held_out = len(Files.find(pictures).held_out)
    if held_out < _ENOUGH:
        report(f'few pictures to calibrate on, {held_out}: the log odds of other pictures may be '
               f'off; 20 pictures more hold out one more, make {20 * _ENOUGH} in all')
    state = train(pictures, out / 'training.npz', plan, report, start)
    network = build(plan.channels)
    network.set_weights(state.weights)
    path = out / 'contour_map.onnx'
    write(network, path)
    data = path.read_bytes()
    network_logits, files = partial(logits, read_network(data)), Files.find(pictures)
    report(f'calibrating on {len(files.held_out)} pictures, measuring on {len(files.tested)}')
    fitted, tested = (Measured.measure(network_logits, each)
                      for each in (files.held_out, files.tested))
    contour, inside = fitted.contour.calibration(), fitted.inside.calibration()
    results = tested.results(contour, inside)
    for name, value in results.items():
        report(f'{name.replace("_", " ")}: {value}')
    digest = hashlib.sha256(data).hexdigest()
    learned = LearnedMap(
        version=digest[:8], sha256=digest, positive_weight=POSITIVE_WEIGHT, contour=contour,
        inside=inside, training={
            'command': command, **asdict(plan), 'seconds': round(state.seconds),
            'start': state.start, 'pictures': {
                name: {'number': len(each), 'first': int(each[0].stem), 'last': int(each[-1].stem)}
                for name, each in (
                ('trained', files.training), ('held_out', files.held_out),
                ('tested', files.tested))},
            'losses': dict(zip(('step', 'contour', 'inside', 'held_out_contour',
                                'held_out_inside'), state.history[-1], strict=True)),
            'results': results, 'versions': {
                each.__name__: each.__version__ for each in _LIBRARIES}})
    learned.save(out / 'contour_map.yaml', command)
    write_png(out / 'reliability.png', draw(charts(tested, contour, inside)))
    return learned
