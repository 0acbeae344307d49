"""Times the pose search: a pose on either back end, and a whole localisation."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evaluation.bench.timing import best_ms
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.proposals.template_matching import Proposals
from pmcl_ros.pmcl.render.back_end import Renderer
from pmcl_ros.pmcl.render.gl_renderer import GlRenderer
from pmcl_ros.pmcl.render.gl_zbuffers import ZBuffers
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings

CAMERA = Pinhole(328, 328, 945, 945, 163.5, 163.5)
_POSES = 100  # in a call
_PAPER = 50_000  # evaluations: 100 particles, 500 iterations
PLACE = (0.0, 0.0, 0.55)


@dataclass(frozen=True)
class PmclBench:
    """us: a pose, drawn and scored. ms: stages of a localisation. Both the least of several runs.

    geometry: what was worked on. paper_s: the paper's 50,000 likelihoods on the processor [s].
    ratio_to_reference: how many times faster they are than the plain form.
    """

    geometry: str
    us: dict[str, float]
    ms: dict[str, float]
    paper_s: float
    ratio_to_reference: float

    def lines(self) -> list[str]:
        """The lines to print."""
        poses = [f'{name:>24}: {value:9.0f} us a pose, {1e6 / value:9.0f} poses a second'
                 for name, value in self.us.items()]
        stages = [f'{name:>24}: {value:9.0f} ms' for name, value in self.ms.items()]
        return [self.geometry, *poses, *stages,
                f"the paper's {_PAPER} likelihoods: {self.paper_s:.1f} s by numba, "
                f'{self.ratio_to_reference:.0f} times as fast as the plain form']


def bench_pmcl(repeats: int = 5) -> PmclBench:
    """A vessel of 2,000 faces before an F01: both scores on both back ends, and the plain form.

    The plain form draws each pose into a framebuffer of the image's size, reads it back and scores
    it in numpy. The localisation is by the back end that settings choose by themselves.
    Raises RenderError where there is no OpenGL: the plain form needs one.
    """
    model = vessel()
    region = Region(PLACE, (0.16, 0.16, 0.16))
    near, far = region.grown(model.radius)
    depths = depth_labels(near, far, 75)
    likelihood = np.random.default_rng(0).random((328, 328, 75), np.float32)
    volume = DepthLikelihoodVolume(Header(), likelihood, depths, CAMERA)
    poses = poses_beside(_POSES)
    scene = Scene(model, CAMERA, region.window(CAMERA, model.radius), near, far)
    half = Scene(model, CAMERA, scene.window.coarser(2), near, far)
    cpu, gpu = NumbaRenderer(), GlRenderer()
    covered = int((cpu.depths(scene, poses) > 0).sum() / _POSES)
    edges = edges_at(cpu, scene, poses[0])
    us: dict[str, float] = {}
    try:
        for name, renderer in (('numba', cpu), ('gl', gpu)):
            with renderer.likelihood_score(scene, volume) as score:
                us[f'{name} likelihood'] = _us(score, poses, repeats)
            for seen, size in ((scene, 'contour'), (half, 'contour at half size')):
                with renderer.contour_score(seen, edges, ContourProfile.contrast()) as score:
                    us[f'{name} {size}'] = _us(score, poses, repeats)
        us['plain likelihood'] = _plain(gpu, model, volume, near, far, poses[:25], repeats)
    finally:
        gpu.close()
    geometry = (f'{len(model.faces)} faces covering {covered} pixels of 328x328, 75 labels, edges '
                f'at {len(edges.depths)}; {_POSES} poses at once; OpenGL: {gpu.name}')
    fastest = us['numba likelihood']
    return PmclBench(geometry, us, _stages(model, region, edges, repeats),
                     _PAPER * fastest / 1e6, us['plain likelihood'] / fastest)


def _us(score: Callable[[NDArray[np.float64]], object], poses: NDArray[np.float64], repeats: int
        ) -> float:
    score(poses)  # compiles
    return 1e3 * best_ms(lambda: score(poses), repeats) / len(poses)


def _plain(renderer: GlRenderer, model: ObjectModel, volume: DepthLikelihoodVolume, near: float,
           far: float, poses: NDArray[np.float64], repeats: int) -> float:
    scene = Scene(model, CAMERA, Window(0, 0, (CAMERA.width, CAMERA.height)), near, far)
    with ZBuffers(renderer.context, scene, capacity=1) as zbuffers:
        return _us(lambda each: plain_scores(zbuffers, volume, each), poses, min(repeats, 3))


def plain_scores(zbuffers: ZBuffers, volume: DepthLikelihoodVolume, poses: NDArray[np.float64]
                 ) -> NDArray[np.float64]:
    """(n,) mean likelihoods: one framebuffer after the other, read back, the rest in numpy.

    zbuffers: of the whole image, which is all of the volume's pixels and within its labels.
    """
    inverse = 1 / volume.depths
    per_closeness = (len(inverse) - 1) / (inverse[-1] - inverse[0])
    scores = np.zeros(len(poses))
    for n, pose in enumerate(poses):
        zbuffers.draw(pose[None])
        closeness = zbuffers.closeness(1)[0]
        y, x = np.nonzero(closeness)
        label = np.clip((closeness[y, x] - inverse[0]) * per_closeness, 0, len(inverse) - 1)
        below = np.minimum(label.astype(int), len(inverse) - 2)
        part = label - below
        scores[n] = np.mean((1 - part) * volume.likelihood[y, x, below]
                            + part * volume.likelihood[y, x, below + 1])
    return scores


def _stages(model: ObjectModel, region: Region, edges: EdgeVolume, repeats: int
            ) -> dict[str, float]:
    """ms of the stages of a localisation where the vessel's contour alone is seen."""
    settings = PmclSettings(roi_center=region.center, roi_size=region.size)
    proposals = Proposals(NumbaRenderer(), model, region)
    proposals.propose(edges, settings.proposals)
    with Localizer(model, settings) as localizer:
        localizer.localize(edges, np.random.default_rng(0))
        steps: dict[str, Callable[[], object]] = {
            'templates': lambda: Proposals(NumbaRenderer(), model, region),
            'proposals': lambda: proposals.propose(edges, settings.proposals),
            'localisation in all': lambda: localizer.localize(edges, np.random.default_rng(0))}
        return {name: best_ms(step, repeats) for name, step in steps.items()}


def vessel() -> ObjectModel:
    """A glass of 2,000 faces that covers about 9,000 pixels at 0.55 m."""
    height = np.linspace(-0.034, 0.034, 19)
    profile = np.stack([0.02 + 0.005 * np.cos(70 * height), height], axis=-1)
    profile = np.concatenate([[[0, height[0]]], profile, [[0, height[-1]]]])
    mesh = trimesh.creation.revolve(profile, sections=53)
    return ObjectModel('vessel', np.asarray(mesh.vertices, float),
                       np.asarray(mesh.faces, np.int64), np.array([0, 0, 1.0]),
                       bool(mesh.is_volume))


def poses_beside(count: int) -> NDArray[np.float64]:
    """(count, 4, 4) upright, a little aside and tilted."""
    rng = np.random.default_rng(0)
    upright = Rotation.from_euler('x', 100, degrees=True)
    turns = Rotation.from_rotvec(rng.normal(0, 0.1, (count, 3))) * upright
    return pose_of(turns, PLACE + rng.normal(0, 0.004, (count, 3)))


def edges_at(renderer: Renderer, scene: Scene, pose: NDArray[np.float64]) -> EdgeVolume:
    """24 labels in which the silhouette of a pose is the only edge, at its own depth."""
    depths = depth_labels(scene.near, scene.far, 24)
    whole = Scene(scene.model, CAMERA, Window(0, 0, (CAMERA.width, CAMERA.height)), scene.near,
                  scene.far)
    mask = (renderer.depths(whole, pose[None])[0] > 0).astype(np.float32)
    smooth = cv2.GaussianBlur(mask, (0, 0), 1.0)
    gx, gy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    tensor = np.stack([gx * gx, gy * gy, gx * gy], axis=-1)
    label = np.interp(1 / pose[2, 3], 1 / depths, np.arange(len(depths)))
    at_label = np.exp(-0.02 * (np.arange(len(depths)) - label) ** 2).astype(np.float32)
    return EdgeVolume(Header(), np.ascontiguousarray(tensor[:, :, None] * at_label[:, None]),
                      depths, CAMERA)
