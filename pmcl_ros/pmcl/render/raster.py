"""Z-buffers on the processor: the kernels that scores are fused with.

The rules are GL's, so that its pixels are ours: corners are rounded to 1/256 pixel, a pixel is
covered if its centre is inside, edges that run exactly through centres belong to one of their two
triangles, and 1/z, which is affine in the image, is interpolated.

A z-buffer holds 1/z of the nearest surface [1/m], zero where there is none, less than zero
outside the window. It is as large as the object's box (`Box`) with `MARGIN` pixels around.
"""

from typing import NamedTuple

import numpy as np
from numba import int32, int64
from numpy.typing import NDArray

from pmcl_ros.pmcl.render.clipping import CORNERS, clipped
from pmcl_ros.pmcl.render.refraction import apparent
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.kernel_threads import CORES
from pmcl_ros.runtime.kernels import borrowed, compiled

MARGIN = 3  # px around the box: what looks at a pixel's neighbours needs no bounds
_HALF = 128  # half a pixel, in the units of corners
_EXTENT = 2040  # px: edges of triangles up to this size fit 32 bits
LARGEST = 1800  # px: of a window
_SLIVER = np.float32(1 / 256)  # px: so narrow that rounding the corners may turn it round


class Drawing(NamedTuple):
    """A scene as kernels take it.

    vertices: (3, n) float32 [m]. faces: (m, 3) int32. closed: back faces are not drawn.
    camera: (4,) float32 fx, fy, cx, cy of the window [px]. width, height: of the window [px].
    near, far: what is drawn [m]. water: (k, 5) float32, of each plane of an interface its normal,
    the camera's height above it [m], the index; k is 0 where there is none, or the camera is in
    it.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    closed: bool
    camera: NDArray[np.float32]
    width: int
    height: int
    near: float
    far: float
    water: NDArray[np.float32]

    @classmethod
    def from_scene(cls, scene: Scene) -> 'Drawing':
        """Raises RenderError when the window is too large."""
        check_size(scene.window)
        camera, interface = scene.camera, scene.interface
        water = np.zeros((0, 5), np.float32)
        if interface is not None and (interface.heights > 0).any():
            index = np.full(len(interface.heights), interface.index)
            water = np.column_stack([interface.normals, interface.heights, index]
                                    ).astype(np.float32)
        return cls(np.ascontiguousarray(scene.model.vertices.T, np.float32),
                   np.ascontiguousarray(scene.model.faces, np.int32), scene.model.closed,
                   np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32),
                   *scene.window.size, float(scene.near), float(scene.far), water)


def check_size(window: Window) -> None:
    """Raise RenderError for a window that is too large to draw."""
    width, height = window.size
    if max(width, height) > LARGEST:
        raise RenderError(
            f'a window of {width}x{height} pixels is drawn on the processor up to {LARGEST} a '
            'side; choose a smaller region of interest, or make pixels '
            f'{-(-max(width, height) // LARGEST)} times as large (--shrink)')


class Buffers(NamedTuple):
    """Memory that drawing needs, for each thread that draws.

    corners: (threads, 2, n) projected vertices, rounded [1/256 px]. exact: (threads, 3, n) the
        same [px] and their 1/z; -1 nearer than `near`. z: (threads, length) z-buffers.
    """

    corners: NDArray[np.int32]
    exact: NDArray[np.float32]
    z: NDArray[np.float32]

    @classmethod
    def for_threads(cls, drawing: Drawing) -> 'Buffers':
        """For each core."""
        width, height = drawing.width, drawing.height
        count = drawing.vertices.shape[1]
        length = (width + 2 * MARGIN) * (height + 2 * MARGIN)
        return cls(np.zeros((CORES, 2, count), np.int32),
                   np.zeros((CORES, 3, count), np.float32),
                   np.zeros((CORES, length), np.float32))


@compiled(inlined=True, inner=True)
def own_buffers(buffers, thread):  # type: ignore[no-untyped-def]
    """Corners, exact and z of a thread, borrowed."""
    return (borrowed(buffers.corners[thread]), borrowed(buffers.exact[thread]),
            borrowed(buffers.z[thread]))


@compiled()
def draw(drawing, pose, corners, exact, z):  # type: ignore[no-untyped-def]
    """Draw one pose; returns left, top, right, bottom (exclusive) of what may be covered.

    pose: (4, 4) float32, object to camera; one that is not finite shows nothing.
    corners, exact, z: of the thread's `Buffers`; the z-buffer's rows are right - left + 2 MARGIN
        long.
    """
    vertices, faces, closed = drawing.vertices, drawing.faces, drawing.closed
    camera, near, far = drawing.camera, drawing.near, drawing.far
    width, height, water = drawing.width, drawing.height, drawing.water
    if not np.isfinite(pose).all():
        return 0, 0, 0, 0
    _project(vertices, pose, camera, near, water, corners, exact)
    inverse = exact[2]
    least, left, top, right, bottom = _extent(corners, inverse)
    # How far outside the window corners may be [1/256 px].
    guard = 128 * (_EXTENT - max(width, height))
    whole = (least > 0 and min(left, top) > -guard and right < 256 * width + guard
             and bottom < 256 * height + guard)
    if whole:
        left, right = max(_first(left), int64(0)), min(_last(right) + 1, int64(width))
        top, bottom = max(_first(top), int64(0)), min(_last(bottom) + 1, int64(height))
    else:
        left, top, right, bottom = int64(0), int64(0), int64(width), int64(height)
    if left >= right or top >= bottom:
        return 0, 0, 0, 0
    stride = right - left + 2 * MARGIN
    z[:stride * (bottom - top + 2 * MARGIN)] = 0
    window = (left, top, right, bottom)
    for face in range(len(faces)):
        a, b, c = int64(faces[face, 0]), int64(faces[face, 1]), int64(faces[face, 2])
        if whole or (_usual(corners[:, a], inverse[a], width, height, guard)
                     and _usual(corners[:, b], inverse[b], width, height, guard)
                     and _usual(corners[:, c], inverse[c], width, height, guard)):
            _fill(corners, exact, a, b, c, closed, window, stride, z)
        else:
            _clipped(vertices, faces[face], pose, camera, width, height, near, water, guard,
                     closed, window, stride, z)
    if not least * far >= 1:
        _remove_beyond(far, z[:stride * (bottom - top + 2 * MARGIN)])
    _frame(window, width, height, stride, z)
    return window


@compiled(inner=True)
def _extent(corners, inverse):  # type: ignore[no-untyped-def]
    """The least 1/z of the vertices, and left, top, right, bottom of their corners [1/256 px]."""
    least = np.float32(np.inf)
    left, top, right, bottom = int64(1 << 40), int64(1 << 40), int64(-1 << 40), int64(-1 << 40)
    for i in range(len(inverse)):
        least = min(least, inverse[i])
        left, right = min(left, int64(corners[0, i])), max(right, int64(corners[0, i]))
        top, bottom = min(top, int64(corners[1, i])), max(bottom, int64(corners[1, i]))
    return least, left, top, right, bottom


@compiled(inner=True)
def _remove_beyond(far, z):  # type: ignore[no-untyped-def]
    """Leave nothing in a z-buffer that is farther than `far`."""
    for i in range(len(z)):
        if z[i] * far < 1:
            z[i] = 0


@compiled(inner=True)
def _first(corner):  # type: ignore[no-untyped-def]
    """The first pixel whose centre is not before a place [1/256 px]."""
    return (corner + _HALF - 1) >> 8


@compiled(inner=True)
def _last(corner):  # type: ignore[no-untyped-def]
    return (corner - _HALF) >> 8


@compiled(inner=True)
def _usual(corner, inverse, width, height, guard):  # type: ignore[no-untyped-def]
    """Whether a corner can be drawn as it is: in front of `near`, not far outside the window."""
    return (inverse > 0 and -guard < corner[0] < 256 * width + guard
            and -guard < corner[1] < 256 * height + guard)


@compiled(inlined=True, inner=True)
def _project(vertices, pose, camera, near, water,  # type: ignore[no-untyped-def]
             corners, exact):
    """Project into the window, from its own corner (`Buffers`)."""
    fx, fy, cx, cy = camera
    half, scale, limit = np.float32(0.5), np.float32(256), np.float32(1 << 14)
    r00, r01, r02, tx = pose[0]
    r10, r11, r12, ty = pose[1]
    r20, r21, r22, tz = pose[2]
    xs, ys, zs = vertices[0], vertices[1], vertices[2]
    across, down = corners[0], corners[1]
    us, vs, inverse = exact[0], exact[1], exact[2]
    is_wet = len(water) > 0
    for i in range(len(xs)):
        x, y, z = xs[i], ys[i], zs[i]
        right = r00 * x + r01 * y + r02 * z + tx
        below = r10 * x + r11 * y + r12 * z + ty
        depth = r20 * x + r21 * y + r22 * z + tz
        if is_wet:
            seen = apparent(right, below, depth, water)
            right, below, depth = np.float32(seen[0]), np.float32(seen[1]), np.float32(seen[2])
        one = np.float32(1) / depth
        u = fx * right * one + (cx + half)
        v = fy * below * one + (cy + half)
        across[i] = int32(np.floor(scale * max(min(u, limit), -limit) + half))
        down[i] = int32(np.floor(scale * max(min(v, limit), -limit) + half))
        us[i], vs[i] = u, v
        inverse[i] = one if depth >= near else np.float32(-1)


@compiled(inner=True)
def _fill(corners, exact, a, b, c, closed, window, stride, z):  # type: ignore[no-untyped-def]
    """Draw a triangle of three of the projected vertices."""
    ax, bx, cx = corners[0, a], corners[0, b], corners[0, c]
    ay, by, cy = corners[1, a], corners[1, b], corners[1, c]
    area = int64(bx - ax) * int64(cy - ay) - int64(cx - ax) * int64(by - ay)
    if area >= 0:
        if area == 0 or closed:  # a back face, as rows run down
            return
    else:
        b, bx, by, c, cx, cy = c, cx, cy, b, bx, by
        area = -area
    left = max(_first(min(ax, bx, cx)), window[0])
    right = min(_last(max(ax, bx, cx)) + 1, window[2])
    top = max(_first(min(ay, by, cy)), window[1])
    bottom = min(_last(max(ay, by, cy)) + 1, window[3])
    if left >= right or top >= bottom:
        return
    x, y = 256 * left + _HALF, 256 * top + _HALF
    # What three edges say at the first centre: not less than zero inside. Steps between centres
    # are whole in these units, the remainders are alike.
    e0, e1, e2 = (_edge(ax, ay, bx, by, x, y), _edge(bx, by, cx, cy, x, y),
                  _edge(cx, cy, ax, ay, x, y))
    right0, right1, right2 = int32(ay - by), int32(by - cy), int32(cy - ay)
    down0, down1, down2 = int32(bx - ax), int32(cx - bx), int32(ax - cx)
    w, gx, gy = _plane(corners, exact, a, b, c, left, top)
    first = (top - window[1] + MARGIN) * stride + left - window[0] + MARGIN
    for _ in range(bottom - top):
        line = z[first:first + right - left]
        for i in range(right - left):
            k = int32(i)
            inside = int32(int32(e0 + k * right0) | int32(e1 + k * right1)
                           | int32(e2 + k * right2)) >= 0
            closer = w + np.float32(k) * gx
            held = line[i]
            line[i] = closer if inside & (closer > held) else held
        first += stride
        e0, e1, e2 = int32(e0 + down0), int32(e1 + down1), int32(e2 + down2)
        w += gy


@compiled(inlined=True, inner=True)
def _plane(corners, exact, a, b, c, left, top):  # type: ignore[no-untyped-def]
    """1/z at the centre of a pixel, and its steps to the right and down.

    Of a sliver the rounded corners are taken: what is inside them has no 1/z beyond theirs.
    """
    ax, ay = exact[0, a], exact[1, a]
    bx, by, cx, cy = exact[0, b] - ax, exact[1, b] - ay, exact[0, c] - ax, exact[1, c] - ay
    if abs(bx * cy - cx * by) < _SLIVER * (abs(bx) + abs(by) + abs(cx) + abs(cy)):
        one = np.float32(1 / 256)
        ax, ay = one * corners[0, a], one * corners[1, a]
        bx, by = one * corners[0, b] - ax, one * corners[1, b] - ay
        cx, cy = one * corners[0, c] - ax, one * corners[1, c] - ay
    aw = exact[2, a]
    bw, cw = exact[2, b] - aw, exact[2, c] - aw
    one = np.float32(1) / (bx * cy - cx * by)
    gx, gy = (bw * cy - cw * by) * one, (cw * bx - bw * cx) * one
    half = np.float32(0.5)
    return aw + gx * (np.float32(left) + half - ax) + gy * (np.float32(top) + half - ay), gx, gy


@compiled(inner=True)
def _edge(ax, ay, bx, by, x, y):  # type: ignore[no-untyped-def]
    """Which side of the edge from a to b a place is on: not less than zero inside, or on it.

    Of places exactly on an edge those on a left or top one are inside.
    """
    dx, dy = int64(bx - ax), int64(by - ay)
    side = dx * (y - ay) - dy * (x - ax)
    if not (dy < 0 or (dy == 0 and dx > 0)):
        side -= 1
    return int32(side >> 8)


@compiled(inner=True)
def _clipped(vertices, face, pose, camera, width, height, near,  # type: ignore[no-untyped-def]
             water, guard, closed, window, stride, z):
    """Draw what of a triangle is beyond `near` and within the guard band around the window."""
    fx, fy, cx, cy = camera
    polygon, count = clipped(vertices, face, pose, camera, width, height, near, water,
                             guard / 256 - 1)
    corners, exact = np.zeros((2, CORNERS), np.int32), np.zeros((3, CORNERS), np.float32)
    for k in range(count):
        for axis, focal, middle in ((0, fx, cx), (1, fy, cy)):
            exact[axis, k] = focal * polygon[k, axis] / polygon[k, 2] + middle + 0.5
            corners[axis, k] = int32(np.floor(256 * exact[axis, k] + np.float32(0.5)))
        exact[2, k] = 1 / polygon[k, 2]
    for k in range(1, count - 1):
        _fill(corners, exact, 0, k, k + 1, closed, window, stride, z)


@compiled(inner=True)
def _frame(window, width, height, stride, z):  # type: ignore[no-untyped-def]
    """Mark what of the margin is outside the window."""
    left, top, right, bottom = window
    for row in range(bottom - top + 2 * MARGIN):
        line = z[row * stride:(row + 1) * stride]
        for k in range(MARGIN):
            if left + k < MARGIN:
                line[k] = -1
            if right + k >= width:
                line[right - left + MARGIN + k] = -1
        if not 0 <= top + row - MARGIN < height:
            line[:] = -1
