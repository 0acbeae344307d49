"""Z-buffers of many poses at once: one depth texture, cut into a tile for each pose (an atlas)."""

import math

import moderngl
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.render.scene import Scene, sphere_bounds
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.gl import GlContext

_MOST_PIXELS = 2 ** 26  # of an atlas: 256 MiB
_VERTEX = """
#version 430
in vec3 position;
layout(std430, binding = 0) readonly buffer Poses { mat4 poses[]; };
uniform vec4 pinhole;     // fx, fy, cx, cy of a tile [tile px]
uniform vec2 inverse;     // 1 / near, 1 / far [1/m]
uniform vec2 tile;        // width, height [px]
uniform ivec2 tiles;      // columns, rows of the atlas
out float gl_ClipDistance[4];
void main() {
    vec3 p = (poses[gl_InstanceID] * vec4(position, 1.0)).xyz;
    // The tile's own clip coordinates; rows of the texture run down, as rows of the image do.
    vec2 pixel = pinhole.xy * p.xy + (pinhole.zw + 0.5) * p.z;
    vec2 ndc = 2.0 * pixel / tile - p.z;
    gl_ClipDistance[0] = p.z + ndc.x;
    gl_ClipDistance[1] = p.z - ndc.x;
    gl_ClipDistance[2] = p.z + ndc.y;
    gl_ClipDistance[3] = p.z - ndc.y;
    vec2 cell = vec2(gl_InstanceID % tiles.x, gl_InstanceID / tiles.x);
    vec2 count = vec2(tiles);
    // Window depth runs from 0 at near to 1 at far and is affine in 1 / z.
    float depth = (inverse.x * p.z - 1.0) / (inverse.x - inverse.y);
    gl_Position = vec4((ndc + (2.0 * cell + 1.0 - count) * p.z) / count, 2.0 * depth - p.z, p.z);
}
"""


class ZBuffers(Closing):
    """Renders batches of poses of one scene into a depth atlas that stays on the GPU.

    capacity: poses per batch at most; fewer where their tiles would not fit the GL's largest
        texture, or take too much memory.
    Raises RenderError when not even one tile does.
    """

    def __init__(self, context: GlContext, scene: Scene, capacity: int = 128) -> None:
        context.use()
        gl = context.gl
        self.context = context
        self.window = scene.window
        self.inverse = (1 / scene.near, 1 / scene.far)
        width, height = scene.window.size
        self.tiles = _layout(width, height, capacity, context.limit('GL_MAX_TEXTURE_SIZE'))
        columns, rows = self.tiles
        self.capacity = columns * rows
        tile = self._camera = scene.camera
        self._program = gl.program(vertex_shader=_VERTEX,
                                   fragment_shader='#version 430\nvoid main() {}')
        self._program['pinhole'] = (tile.fx, tile.fy, tile.cx, tile.cy)
        self._program['inverse'] = self.inverse
        self._program['tile'] = (width, height)
        self._program['tiles'] = self.tiles
        self._poses = gl.buffer(reserve=self.capacity * 64)
        self._vertices = gl.buffer(np.ascontiguousarray(scene.model.vertices, 'f4'))
        self._faces = gl.buffer(np.ascontiguousarray(scene.model.faces, 'i4'))
        self._mesh = gl.vertex_array(self._program, [(self._vertices, '3f', 'position')],
                                     self._faces)
        self._closed = scene.model.closed
        self._radius = scene.model.radius
        self._boxes = gl.buffer(reserve=self.capacity * 16)
        self.depth = gl.depth_texture((columns * width, rows * height))
        self.depth.compare_func = ''
        self.depth.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._frame = gl.framebuffer(depth_attachment=self.depth)

    def draw(self, poses: NDArray[np.floating]) -> None:
        """Draw the z-buffers of poses (n, 4, 4), object to camera; n at most `capacity`.

        A pose that holds NaN or an infinity shows nothing.
        """
        self.context.use()
        if len(poses) > self.capacity:
            raise RenderError(f'{len(poses)} poses in one batch, this atlas holds '
                              f'{self.capacity}')
        known = np.isfinite(poses).all(axis=(1, 2), keepdims=True)
        poses = np.where(known, poses, 0)  # all of the object at the camera, where nothing is seen
        gl = self.context.gl
        # GL matrices are column-major.
        self._poses.write(np.ascontiguousarray(np.swapaxes(poses, 1, 2), 'f4'))
        self._poses.bind_to_storage_buffer(0)
        self._frame.use()
        self._frame.clear(depth=1.0)
        gl.enable_only(moderngl.DEPTH_TEST
                       | (moderngl.CULL_FACE if self._closed else moderngl.NOTHING))
        gl.front_face = 'cw'  # rows run down: the image is mirrored as GL sees it
        gl.enable_direct(0x3000)  # GL_CLIP_DISTANCE0 and the three after it
        for plane in range(1, 4):
            gl.enable_direct(0x3000 + plane)
        self._mesh.render(moderngl.TRIANGLES, instances=len(poses))
        self._boxes.write(self._bounds(poses))

    def bind(self, depths: int, boxes: int) -> None:
        """Give the atlas to a shader: a texture unit for its depths, a buffer for `_bounds`."""
        self.depth.use(depths)
        self._boxes.bind_to_storage_buffer(boxes)

    def _bounds(self, poses: NDArray[np.floating]) -> NDArray[np.int32]:
        """(n, 4) left, top, right, bottom of what the object can touch, and a pixel around it."""
        box = sphere_bounds(self._camera, poses[:, :3, 3], self._radius)
        box[:, :2] = np.floor(box[:, :2]) - 1
        box[:, 2:] = np.ceil(box[:, 2:]) + 2
        return np.clip(box, 0, self.window.size * 2).astype(np.int32)

    def closeness(self, count: int) -> NDArray[np.float32]:
        """(count, height, width) 1/z of what was drawn last [1/m]; 0 where nothing was drawn."""
        self.context.use()
        (width, height), (columns, rows) = self.window.size, self.tiles
        atlas = np.frombuffer(self.depth.read(alignment=1), np.float32)
        tiles = atlas.reshape(rows, height, columns, width).swapaxes(1, 2)
        depth = tiles.reshape(-1, height, width)[:count].astype(np.float64)
        near, far = self.inverse
        return np.where(depth < 1, near - depth * (near - far), 0).astype(np.float32)

    def close(self) -> None:
        """Free what this atlas holds on the GPU."""
        self.context.use()
        self.context.gl.detect_framebuffer(0).use()  # moderngl binds again what was bound last
        for each in (self._mesh, self._vertices, self._faces, self._poses, self._boxes,
                     self._frame, self.depth, self._program):
            each.release()


def _layout(width: int, height: int, capacity: int, largest: int) -> tuple[int, int]:
    """Columns and rows of an atlas of about `capacity` tiles in a texture of `largest` pixels."""
    capacity = max(1, min(capacity, _MOST_PIXELS // (width * height)))
    columns = min(math.ceil(math.sqrt(capacity)), largest // width)
    rows = min(math.ceil(capacity / max(columns, 1)), largest // height)
    if columns < 1 or rows < 1:
        raise RenderError(f'a tile of {width}x{height} pixels is beyond this GL, which draws '
                          f'{largest} pixels at most; choose a smaller region of interest')
    return columns, rows
