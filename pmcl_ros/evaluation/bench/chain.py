"""Times the chain without ROS: from the bytes of a raw picture to the pose."""

import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pmcl_ros.camera.files import read_picture
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.packing import unpack12
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.evaluation.bench.checkout import BAG, CALIBRATION, WHITE, object_in
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.messages.bag_captures import extract_captures
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import SettingsError

_WANTED = {'pose': 1000.0, 'total': 1500.0}  # ms, on two quiet cores


@dataclass(frozen=True)
class ChainBench:
    """ms: medians of several runs, the first not counted.

    geometry: of the data. ratio_to_wanted: to the times wanted on two quiet cores. error_mm: the
    largest of the poses. evaluations: poses drawn and scored, the median.
    """

    geometry: str
    ms: dict[str, float]
    ratio_to_wanted: dict[str, float]
    error_mm: float
    evaluations: int

    def lines(self) -> list[str]:
        """The lines to print."""
        wanted = [f'{name:>16}: {value:9.2f} of the {_WANTED[name]:.0f} ms that are wanted'
                  for name, value in self.ratio_to_wanted.items()]
        return [self.geometry, *(f'{name:>16}: {value:9.1f} ms' for name, value in
                                 self.ms.items()), *wanted,
                f'{self.evaluations} poses scored, {self.error_mm:.1f} mm from the truth at most']


def bench_chain(repeats: int = 9, bag: Path = BAG) -> ChainBench:
    """The raw picture of a shipped bag: packed bytes to views, evidence and pose.

    The decoder and the localizer are made before, as nodes make them when they are configured, and
    kernels are compiled. The settings choose the back ends. Each run has another seed. Raises
    SettingsError where the bag or its calibration is missing, as beside an installed package.
    """
    mesh = object_in(bag)
    for path in (bag, CALIBRATION, WHITE, mesh):
        if not path.exists():
            raise SettingsError(f'there is no {path}: this bench wants a checkout of the sources')
    raw, text = _picture(bag)
    truth, model = Truth.load(bag / 'truth.json'), ObjectModel.load(mesh)
    settings = PmclSettings(roi_center=truth.roi_center, roi_size=truth.roi_size)
    decoders = Decoders(Calibration.load(CALIBRATION), WHITE)
    runs, estimates = [], []
    with Pipeline.for_object(model, settings) as pipeline:
        once = partial(_run, raw, text, decoders, pipeline)
        once(0)
        for seed in range(repeats):
            times, estimate = once(seed)
            runs.append(times)
            estimates.append(estimate)
        renderer = pipeline.localizer.renderer
    ms = {name: 1e3 * float(np.median([each[name] for each in runs])) for name in runs[0]}
    errors = [pose_error(each.pose, truth.pose, model.symmetry).translation for each in estimates]
    return ChainBench(
        f'{bag.name}: {len(raw)} bytes of a raw picture to a pose; poses scored by {renderer}',
        ms, {name: ms[name] / limit for name, limit in _WANTED.items()}, 1e3 * max(errors),
        int(np.median([each.evaluations for each in estimates])))


def _picture(bag: Path) -> tuple[bytes, str]:
    with tempfile.TemporaryDirectory(prefix='pmcl_bench_') as folder:
        return read_picture(extract_captures(bag, folder)[0])


def _run(raw: bytes, text: str, decoders: Decoders, pipeline: Pipeline[PoseEstimate], seed: int
         ) -> tuple[dict[str, float], PoseEstimate]:
    """Seconds of each stage and of all; the estimate."""
    def decode() -> LightField:
        metadata = CameraMetadata.parse(text)
        counts = unpack12(raw, metadata.image.width, metadata.image.height)
        return decoders.decode(RawFrame(Header(), counts, metadata))

    run = pipeline.run(decode, np.random.default_rng(seed))
    return {'decode': run.seconds['views'], 'evidence': run.seconds['evidence'],
            'pose': run.seconds['pose'], 'total': sum(run.seconds.values())}, run.estimate
