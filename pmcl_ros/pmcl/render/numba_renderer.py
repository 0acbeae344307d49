"""Renderer and scores on the processor: a thread draws a pose and scores it while it is warm."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.sampling import copy_row
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.contour import label_scale, sums
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.contour_score import ContourScore
from pmcl_ros.pmcl.render.creases import CreasePoints, Creases, crease_sum
from pmcl_ros.pmcl.render.level_of_detail import longest_edge
from pmcl_ros.pmcl.render.raster import MARGIN, Buffers, Drawing, draw, own_buffers
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.kernel_threads import LOCK
from pmcl_ros.runtime.kernels import borrowed, compiled, rounds


@dataclass(frozen=True)
class NumbaRenderer:
    """Draws and scores by numba: in any thread, the same numbers whatever the machine's cores."""

    name: str = 'numba'

    def depths(self, scene: Scene, poses: NDArray[np.floating]) -> NDArray[np.float32]:
        """See `Renderer`."""
        drawing = Drawing.from_scene(scene)
        inverse = np.zeros((len(poses), drawing.height, drawing.width), np.float32)
        _draw_all(drawing, _float32(poses), Buffers.for_threads(drawing), inverse)
        return np.divide(1, inverse, out=np.zeros_like(inverse), where=inverse > 0)

    def contour_score(self, scene: Scene, volume: EvidenceVolume, profile: ContourProfile,
                      creases: Creases | None = None) -> 'NumbaContourScore':
        """See `Renderer`."""
        return NumbaContourScore(scene, volume, profile, creases)

    def likelihood_score(self, scene: Scene, volume: DepthLikelihoodVolume
                         ) -> 'NumbaLikelihoodScore':
        """See `Renderer`."""
        return NumbaLikelihoodScore(scene, volume)

    def warm_up(self, likelihoods: bool = True) -> None:
        """Compile, or load from numba's cache, all that scoring needs.

        likelihoods: compile their scores too.
        """
        scene, edges = tiny_scene()
        pose = np.eye(4)
        self.depths(scene, pose[None])
        if likelihoods:
            self.likelihood_score(scene, DepthLikelihoodVolume(
                Header(), edges.tensor[..., 0], edges.depths, edges.pinhole))(pose[None])
        creases = Creases(np.zeros((0, 2, 3)), np.zeros((0, 2, 3)), True,
                          ContourProfile.contrast())
        for each in (None, creases):
            score = self.contour_score(scene, edges, ContourProfile.contrast(), creases=each)
            score(pose[None])
            score.points(pose)
            score.creases(pose)

    def use(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Nothing to do."""


class NumbaContourScore(ContourScore):
    """See `ContourScore`."""

    def __init__(self, scene: Scene, volume: EvidenceVolume, profile: ContourProfile,
                 creases: Creases | None = None) -> None:
        super().__init__(scene, volume, profile, creases)
        self._drawing = Drawing.from_scene(scene)
        self._buffers = Buffers.for_threads(self._drawing)
        self._found = np.zeros((len(self._buffers.z), 2 * self._buffers.z.shape[1]), np.int32)

    def evaluate(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """See `ContourScore`."""
        self.evaluations += len(poses)
        result = np.zeros((len(poses), 2))
        given = self._drawing, _float32(poses), self._buffers, self._volume, self._found
        if self._lines is None:
            _contours(*given, result)
        else:
            _contours_and_creases(*given, *self._lines, result)
        return result

    def points(self, pose: NDArray[np.floating]) -> ContourPoints:
        """See `ContourScore`."""
        with LOCK:
            points = super().points(pose)
        water = self._drawing.water
        if not len(water):
            return points
        # An edge of the mesh from the air into the water is drawn straight, which it is not.
        return points.seen_through(water[:, :4], self._scene.image,
                                   longest_edge(self._scene.model) / 2)

    def creases(self, pose: NDArray[np.floating]) -> CreasePoints | None:
        """See `ContourScore`."""
        with LOCK:
            return super().creases(pose)

    def _drawn(self, pose: NDArray[np.floating]
               ) -> tuple[tuple[int, int, int, int], NDArray[np.float32]]:
        """Box and z-buffer; the lock is held."""
        buffers = self._buffers
        return draw(self._drawing, _float32(pose), buffers.corners[0], buffers.exact[0],
                    buffers.z[0]), buffers.z[0]


class NumbaLikelihoodScore(Closing):
    """See `LikelihoodScore`."""

    def __init__(self, scene: Scene, volume: DepthLikelihoodVolume) -> None:
        self.evaluations = 0
        self._drawing = Drawing.from_scene(scene)
        self._buffers = Buffers.for_threads(self._drawing)
        self._volume = np.ascontiguousarray(volume.likelihood, np.float32)
        self._labels = label_scale(volume.depths)
        self._window = (scene.window.left, scene.window.top, scene.window.scale)

    def __call__(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """See `LikelihoodScore`."""
        self.evaluations += len(poses)
        result = np.zeros(len(poses))
        _likelihoods(self._drawing, _float32(poses), self._buffers, self._volume, *self._window,
                     *self._labels, result)
        return result


def _float32(poses: NDArray[np.floating]) -> NDArray[np.float32]:
    return np.ascontiguousarray(poses, np.float32)


def tiny_scene() -> tuple[Scene, EdgeVolume]:
    """A triangle, and an edge volume without edges, of 8x8 px: to compile with."""
    corners = np.array([[0, 0, 1.0], [0, 0.4, 1], [0.4, 0, 1]])
    camera = Pinhole(8, 8, 8.0, 8.0, 3.5, 3.5)
    scene = Scene(ObjectModel('triangle', corners, np.array([[0, 1, 2]]), None, False), camera,
                  Window(0, 0, (8, 8)), 0.5, 2.0)
    return scene, EdgeVolume(Header(), np.zeros((8, 8, 2, 3), np.float32),
                             depth_labels(0.5, 2.0, 2), camera)


@compiled(parallel=True)
def _draw_all(drawing, poses, buffers, inverse, portion):  # type: ignore[no-untyped-def]
    corners, exact, z = own_buffers(buffers, portion[0])
    for n in rounds(len(poses), portion):
        left, top, right, bottom = draw(drawing, poses[n], corners, exact, z)
        stride = right - left + 2 * MARGIN
        for row in range(bottom - top):
            first = (row + MARGIN) * stride + MARGIN
            copy_row(z[first:first + right - left], inverse[n, top + row, left:right])


@compiled(parallel=True)
def _contours(drawing, poses, buffers, volume, found, result, portion):  # type: ignore[no-untyped-def]
    corners, exact, z = own_buffers(buffers, portion[0])
    for n in rounds(len(poses), portion):
        box = draw(drawing, poses[n], corners, exact, z)
        result[n, 0], result[n, 1] = sums(box, z, volume, borrowed(found[portion[0]]))


@compiled(parallel=True)
def _contours_and_creases(drawing, poses, buffers, volume, found,  # type: ignore[no-untyped-def]
                          lines, marks, result, portion):
    corners, exact, z = own_buffers(buffers, portion[0])
    for n in rounds(len(poses), portion):
        box = draw(drawing, poses[n], corners, exact, z)
        total, result[n, 1] = sums(box, z, volume, borrowed(found[portion[0]]))
        result[n, 0] = total + max(crease_sum(poses[n], box, z, lines, marks), 0.0)


@compiled(parallel=True)
def _likelihoods(drawing, poses, buffers, volume, left, top, scale,  # type: ignore[no-untyped-def]
                 farthest, per_closeness, result, portion):
    corners, exact, z = own_buffers(buffers, portion[0])
    for n in rounds(len(poses), portion):
        box = draw(drawing, poses[n], corners, exact, z)
        result[n] = _mean(box, z, volume, left, top, scale, farthest, per_closeness)


@compiled(inlined=True, inner=True)
def _mean(box, z, volume, left, top, scale, farthest, per_closeness):  # type: ignore[no-untyped-def]
    """The mean likelihood of covered pixels, between labels; beyond the labels it is zero."""
    height, width, labels = volume.shape
    half = (scale - 1) // 2
    stride = box[2] - box[0] + 2 * MARGIN
    total, count = 0.0, 0
    for row in range(box[3] - box[1]):
        y = top + scale * (box[1] + row) + half
        if y >= height:
            break
        first = (row + MARGIN) * stride + MARGIN
        line = z[first:first + box[2] - box[0]]
        columns = min(len(line), (width - 1 - half - left) // scale - box[0] + 1)
        rays = volume[y]
        for k in range(columns):
            if line[k] > 0:
                count += 1
                label = (line[k] - farthest) * per_closeness
                if 0 <= label <= labels - 1:
                    ray = rays[left + scale * (box[0] + k) + half]
                    below = min(int(label), labels - 2)
                    total += ray[below] + (label - below) * (ray[below + 1] - ray[below])
    return total / max(count, 1)
