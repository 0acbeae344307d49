"""The creases that a pose shows inside its outline, and what edges say along them: the kernels.

The creases of an object may show in a picture or not, as light and colours are: a priori either is
as likely. So with s, the sum of the evidence along them, a pose has log(1 + exp(s)) more than its
contour, which is max(s, 0) but for a nat: what does not show says nothing against a pose.

Seen is a crease with both sides towards the camera (else it is occluding contour), where the
z-buffer has nothing nearer. Within 3 px of an occluding contour that contour is what shows in the
picture: a crease does not count there.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.energies import evidence_across
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.contour import KernelVolume, check_profile, evidence, sample
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.raster import MARGIN
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.kernels import compiled, rounds

SHARP = np.deg2rad(30)  # between normals: round parts of more than twelve facets a turn have less
_CLEAR = 3  # image px to the nearest occluding contour; no more than MARGIN
_STEP = 2  # pixels of the z-buffer: from one point of a crease to the next
_BEHIND = 0.1  # of what counts as an occlusion: how far below the z-buffer a crease is still seen


@dataclass(frozen=True)
class Creases:
    """Edges at which a mesh's surface turns by more than `SHARP`.

    ends: (m, 2, 3) [m]. normals: (m, 2, 3) of the faces on both sides. closed: these point out of
    the object; else they only agree with each other.
    profile: of the evidence across them, as a contour's; no side is the outside.
    """

    ends: NDArray[np.float64]
    normals: NDArray[np.float64]
    closed: bool
    profile: ContourProfile

    @classmethod
    def from_model(cls, model: ObjectModel, profile: ContourProfile | None = None
                   ) -> 'Creases | None':
        """Of a mesh as it was given: where it is simplified its facets turn otherwise.

        None where there are none, and for objects with an axis of symmetry: what creases say
        about those does not pay (docs/concepts/evidence.md). profile: by default the learned one.
        """
        if model.axis is not None:
            return None
        mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
        mesh.merge_vertices()
        sharp = mesh.face_adjacency_angles > SHARP
        if not sharp.any():
            return None
        return cls(np.asarray(mesh.vertices[mesh.face_adjacency_edges[sharp]], np.float64),
                   np.asarray(mesh.face_normals[mesh.face_adjacency[sharp]], np.float64),
                   model.closed, profile or ContourProfile.learned_creases())


class Lines(NamedTuple):
    """Creases as kernels take them.

    ends, normals, closed: of `Creases`. camera: (4,) fx, fy, cx, cy of the image [px].
    left, top, scale: of the z-buffer in the image [image px]. clear: how many of its pixels have
        to be clear of occluding contours. near: nothing nearer is drawn [m].
    """

    ends: NDArray[np.float64]
    normals: NDArray[np.float64]
    closed: bool
    camera: NDArray[np.float64]
    left: int
    top: int
    scale: int
    clear: int
    near: float

    @classmethod
    def from_creases(cls, scene: Scene, volume: EvidenceVolume, creases: Creases
                     ) -> tuple['Lines', KernelVolume]:
        """Those, and the volume with their profile.

        Raises RenderError for a profile larger than scores are made for.
        """
        check_profile(creases.profile)
        camera, window = scene.image, scene.window
        lines = cls(np.ascontiguousarray(creases.ends, np.float64),
                    np.ascontiguousarray(creases.normals, np.float64), bool(creases.closed),
                    np.array([camera.fx, camera.fy, camera.cx, camera.cy]), window.left,
                    window.top, window.scale, math.ceil(_CLEAR / window.scale), float(scene.near))
        return lines, KernelVolume.from_volume(scene, volume, creases.profile)


@dataclass(frozen=True)
class CreasePoints:
    """Points of the creases that a pose shows; their normals are on either side of them.

    profile: what edges across them say.
    """

    points: ContourPoints
    profile: ContourProfile

    @classmethod
    def from_zbuffer(cls, pose: NDArray[np.float32], box: tuple[int, int, int, int],
                     z: NDArray[np.float32], lines: Lines, volume: KernelVolume,
                     profile: ContourProfile) -> 'CreasePoints':
        """Of a pose (4, 4) whose z-buffer (`raster`) is given: those that are summed."""
        rows = _rows(pose, box, z, lines, volume)
        energies = rows[:, 8:]
        points = ContourPoints(rows[:, :2], rows[:, 2:4], rows[:, 4], rows[:, 5], energies,
                               profile.evidence(energies), rows[:, 6].astype(np.int64),
                               rows[:, 7], np.zeros(len(rows)))
        return cls(points, profile)

    @property
    def shown(self) -> bool:
        """Whether their evidence counts: their sum is for the pose."""
        return bool(self.points.lengths @ self.points.evidence > 0)

    def evidence(self, volume: EvidenceVolume, shifts: NDArray[np.floating]
                 ) -> NDArray[np.float64]:
        """(n, k) of the points moved along their normals by `shifts` (k,) [nat / px]."""
        return evidence_across(volume, self.points.pixels, self.points.normals, self.points.depths,
                               self.profile, shifts)


@compiled(parallel=True)
def sums_of_images(poses, images, lines, volume, result, portion):  # type: ignore[no-untyped-def]
    """Add to result (n,) what creases say in z-buffers of the whole window, (n, height, width)."""
    _, height, width = images.shape
    for n in rounds(len(poses), portion):
        z = np.full((height + 2 * MARGIN, width + 2 * MARGIN), np.float32(-1))
        z[MARGIN:-MARGIN, MARGIN:-MARGIN] = images[n]
        said = crease_sum(poses[n], (0, 0, width, height), z.ravel(), lines, volume)
        result[n] += max(said, 0.0)


@compiled(inlined=True, inner=True)
def crease_sum(pose, box, z, lines, volume):  # type: ignore[no-untyped-def]
    """The evidence [nat] along the creases seen in a z-buffer."""
    total = 0.0
    for k in range(len(lines.ends)):
        count, u, v, du, dv, first, step, nx, ny, length = _line(pose, k, lines)
        for i in range(count):
            part = (i + 0.5) / count
            x, y, closeness = u + part * du, v + part * dv, first + part * step
            if not _seen(box, z, x, y, closeness, lines, volume.keep):
                continue
            value = volume.bias
            for j in range(len(volume.offsets)):
                e = _energy(volume, j, x - lines.left, y - lines.top, nx, ny, closeness)
                value += evidence(e, volume.knots, volume.widths, volume.slopes[j])
            total += length * value
    return total


@compiled()
def _rows(pose, box, z, lines, volume):  # type: ignore[no-untyped-def]
    """(n, 8 + j) x, y, normal, depth, length, crease, place along it [px], energies."""
    most = 0
    for k in range(len(lines.ends)):
        most += _line(pose, k, lines)[0]
    rows = np.zeros((most, 8 + len(volume.offsets)))
    seen = 0
    for k in range(len(lines.ends)):
        count, u, v, du, dv, first, step, nx, ny, length = _line(pose, k, lines)
        for i in range(count):
            part = (i + 0.5) / count
            x, y, closeness = u + part * du, v + part * dv, first + part * step
            if not _seen(box, z, x, y, closeness, lines, volume.keep):
                continue
            row = rows[seen]
            row[0], row[1], row[2], row[3], row[4] = x, y, nx, ny, 1 / closeness
            row[5], row[6], row[7] = length, k, (i + 0.5) * length
            for j in range(len(volume.offsets)):
                row[8 + j] = _energy(volume, j, x - lines.left, y - lines.top, nx, ny, closeness)
            seen += 1
    return rows[:seen]


@compiled(inlined=True, inner=True)
def _line(pose, k, lines):  # type: ignore[no-untyped-def]
    """A crease in the image, in stretches of `_STEP` pixels of the z-buffer.

    How many (0: it does not show), where it begins and how far it goes [image px], its 1/z there
    and how much that changes (it is affine in the image), its normal, and a stretch's length.
    """
    none = (0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if not np.isfinite(pose).all():
        return none
    ax, ay, az = _placed(pose, lines.ends[k, 0])
    bx, by, bz = _placed(pose, lines.ends[k, 1])
    if min(az, bz) <= lines.near:
        return none
    front = _faces(pose, lines.normals[k, 0], ax, ay, az)
    if front != _faces(pose, lines.normals[k, 1], ax, ay, az) or (lines.closed and not front):
        return none
    fx, fy, cx, cy = lines.camera
    u, v = fx * ax / az + cx, fy * ay / az + cy
    du, dv = fx * bx / bz + cx - u, fy * by / bz + cy - v
    extent = math.sqrt(du * du + dv * dv)
    count = math.ceil(extent / (_STEP * lines.scale))
    if count == 0:
        return none
    # The sign of the normal means nothing, but neighbours in a ring must agree: away from the
    # object's origin.
    out = (dv * (u + du / 2 - cx - fx * pose[0, 3] / pose[2, 3])
           - du * (v + dv / 2 - cy - fy * pose[1, 3] / pose[2, 3]))
    unit = (1 if out >= 0 else -1) / extent
    return (count, u, v, du, dv, 1 / az, 1 / bz - 1 / az, unit * dv, -unit * du, extent / count)


@compiled(inlined=True, inner=True)
def _placed(pose, point):  # type: ignore[no-untyped-def]
    x, y, z = point
    return (float(pose[0, 0]) * x + float(pose[0, 1]) * y + float(pose[0, 2]) * z
            + float(pose[0, 3]),
            float(pose[1, 0]) * x + float(pose[1, 1]) * y + float(pose[1, 2]) * z
            + float(pose[1, 3]),
            float(pose[2, 0]) * x + float(pose[2, 1]) * y + float(pose[2, 2]) * z
            + float(pose[2, 3]))


@compiled(inlined=True, inner=True)
def _faces(pose, normal, x, y, z):  # type: ignore[no-untyped-def]
    """Whether a face shows its front, whose normal is in the object's frame, at (x, y, z)."""
    total = 0.0
    for j in range(3):
        total += normal[j] * (pose[0, j] * x + pose[1, j] * y + pose[2, j] * z)
    return total < 0


@compiled(inlined=True, inner=True)
def _seen(box, z, x, y, closeness, lines, keep):  # type: ignore[no-untyped-def]
    """Whether a point of the image is on the surface that is drawn there, clear of contours."""
    left, top, right, bottom = box
    begin, above, scale, clear = lines.left, lines.top, lines.scale, lines.clear
    column = math.floor((x - begin + 0.5) / scale) - left
    row = math.floor((y - above + 0.5) / scale) - top
    if not (0 <= column < right - left and 0 <= row < bottom - top):
        return False
    stride = right - left + 2 * MARGIN
    least = keep * closeness
    farthest = np.float32(np.inf)
    for j in range(-clear, clear + 1):
        middle = (row + j + MARGIN) * stride + column + MARGIN
        for i in range(-clear, clear + 1):
            other = z[middle + i]
            if other < 0:  # outside the window nothing is known
                continue
            if other < least:
                return False
            if abs(i) <= 1 and abs(j) <= 1:
                farthest = min(farthest, other)
    return farthest <= (1 + _BEHIND * (1 - keep)) * closeness


@compiled(inlined=True, inner=True)
def _energy(volume, j, x, y, nx, ny, closeness):  # type: ignore[no-untyped-def]
    """The energy across a crease at an offset of the profile; x, y: in the window [image px]."""
    mx, my, off = np.float32(nx), np.float32(ny), volume.offsets[j]
    label = np.float32((closeness - volume.farthest) * volume.per_closeness)
    return sample(volume.tensor, np.float32(x + volume.left) + off * mx,
                  np.float32(y + volume.top) + off * my, label, mx, my)
