"""How well the contour of a pose lies on edges at its own depth (docs/method.md).

A point of the occluding contour is worth e(0) - e(outside): the edge energy across the contour, on
it, less that just outside it. Glass shows edges as strong a few pixels inside (the inner wall,
caustics), hardly ever outside; where there is no object both terms have the same expectation, so
the sum over a wrong contour is near zero whatever the clutter.
"""

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import EdgeVolume
from pmcl_ros.errors import RenderError
from pmcl_ros.gl import GlContext
from pmcl_ros.pmcl.zbuffers import ZBuffers

_COMPUTE = """
#version 430
layout(local_size_x = 64) in;
const uint MOST = 6144u;    // pairs of pixels on a contour: 24 KiB of shared memory
const float UNIT = 1024.0;  // of the fixed-point sums
layout(binding = 0) uniform sampler2D depths;    // the atlas
layout(binding = 1) uniform sampler3D tensor;    // xx, yy, xy at (x, y, label)
layout(std430, binding = 2) writeonly buffer Sums { vec2 sums[]; };  // evidence, length [px]
layout(std430, binding = 3) readonly buffer Boxes { ivec4 boxes[]; };
uniform ivec2 tile;
uniform ivec2 tiles;
uniform vec3 window;      // left, top, scale [image px]
uniform vec2 image;       // width, height [image px]
uniform vec2 inverse;     // 1 / near, 1 / far of the z-buffer
uniform vec3 labels;      // 1 / depth of label 0, labels per 1/m, number of labels
uniform float jump;       // difference in 1/z across an occlusion, relative [1]
uniform float reach;      // unit of the outside offsets [image px]
shared uint found[MOST];
shared uint count;
shared ivec2 total;

ivec2 corner;

float closeness(ivec2 at) {  // 1/z; 0 where nothing is drawn; negative outside the tile
    if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, tile))) return -1.0;
    float depth = texelFetch(depths, corner + at, 0).x;
    return depth < 1.0 ? inverse.x - depth * (inverse.x - inverse.y) : 0.0;
}

float energy(vec2 pixel, float label, vec2 n) {
    vec3 at = vec3((pixel + 0.5) / image, (label + 0.5) / labels.z);
    vec3 m = textureLod(tensor, at, 0.0).xyz;
    return sqrt(max(m.x * n.x * n.x + m.y * n.y * n.y + 2.0 * m.z * n.x * n.y, 0.0));
}

// Whether a contour runs between two neighbouring pixels.
bool across(float here, float there) {
    float near = max(here, there);
    return here >= 0.0 && there >= 0.0 && min(here, there) < near * (1.0 - jump);
}

// Evidence and length of the contour between `near_at` and its neighbour, in fixed point.
ivec2 evidence(ivec2 near_at, vec2 between) {
    float near = closeness(near_at);
    // The outward normal: from the centre of the nearer surface within 5x5 pixels to the centre of
    // the rest.
    vec2 n = vec2(0.0);
    for (int dy = -2; dy <= 2; ++dy) for (int dx = -2; dx <= 2; ++dx) {
        float other = closeness(near_at + ivec2(dx, dy));
        float weight = exp(-0.35 * float(dx * dx + dy * dy));
        if (other >= 0.0 && other < near * (1.0 - jump)) n += weight * vec2(dx, dy);
    }
    if (dot(n, n) < 1e-6) return ivec2(0);
    n = normalize(n);
    float label = (near - labels.x) * labels.y;
    vec2 pixel = window.xy + window.z * between + (window.z - 1.0) / 2.0;
    float on = min(energy(pixel, label, n), 2.0);
    float outside = 0.0;
    for (int k = 0; k < 3; ++k) {
        outside += energy(pixel + reach * (3.0 + 1.5 * float(k)) * n, label, n) / 3.0;
    }
    // A line is crossed by |nx| horizontal and |ny| vertical pairs of pixels for each pixel of its
    // length.
    float length_px = window.z / (abs(n.x) + abs(n.y));
    return ivec2(round(UNIT * length_px * vec2(on - min(outside, 2.0), 1.0)));
}

void main() {
    int pose = int(gl_WorkGroupID.x);
    uint lane = gl_LocalInvocationID.x;
    corner = ivec2(pose % tiles.x, pose / tiles.x) * tile;
    if (lane == 0u) { count = 0u; total = ivec2(0); }
    barrier();
    // First the contour's pairs of pixels are collected, then every lane has one to weigh.
    ivec4 box = boxes[pose];
    ivec2 size = max(box.zw - box.xy, ivec2(0));
    uint pixels = uint(size.x * size.y);
    for (uint i = lane; i < pixels; i += 64u) {
        ivec2 at = box.xy + ivec2(int(i) % size.x, int(i) / size.x);
        float here = closeness(at);
        for (int axis = 0; axis < 2; ++axis) {
            float there = closeness(at + ivec2(1 - axis, axis));
            if (across(here, there)) {
                uint slot = atomicAdd(count, 1u);
                uint code = uint(at.y * tile.x + at.x) * 4u + axis * 2u + (here > there ? 0u : 1u);
                if (slot < MOST) found[slot] = code;
            }
        }
    }
    barrier();
    ivec2 sum = ivec2(0);
    bool whole = count <= MOST;
    uint todo = whole ? count : 2u * pixels;
    for (uint i = lane; i < todo; i += 64u) {
        ivec2 at;
        int axis;
        bool first, contour = true;  // whether the first of the pair is the nearer
        if (whole) {
            uint code = found[i];
            at = ivec2(int(code / 4u) % tile.x, int(code / 4u) / tile.x);
            axis = int(code / 2u) & 1;
            first = (code & 1u) == 0u;
        } else {  // a contour too long for the list: its pairs are looked for once more
            at = box.xy + ivec2(int(i / 2u) % size.x, int(i / 2u) / size.x);
            axis = int(i) & 1;
            float here = closeness(at), there = closeness(at + ivec2(1 - axis, axis));
            first = here > there;
            contour = across(here, there);
        }
        ivec2 step = ivec2(1 - axis, axis);
        if (contour) sum += evidence(first ? at : at + step, vec2(at) + 0.5 * vec2(step));
    }
    // Sums of integers: the same whatever the order, so that the same seed gives the same pose.
    atomicAdd(total.x, sum.x);
    atomicAdd(total.y, sum.y);
    barrier();
    if (lane == 0u) sums[pose] = vec2(total) / UNIT;
}
"""


class ContourScore:
    """Scores the z-buffers of an atlas against an edge volume, on the GPU.

    zbuffers: its window's scale is the step of the contour [image px].
    radius: of the object about its origin [m]; an occlusion is a jump in depth by a fifth of it or
        more.
    blur: of the edge energy [image px]; 0: as it is. It widens the basin of attraction for the
        coarse part of a search.
    Raises RenderError when the volume is larger than this GL can hold.
    """

    def __init__(self, zbuffers: ZBuffers, edges: EdgeVolume, radius: float,
                 blur: float = 0.0) -> None:
        context = zbuffers.context
        context.use()
        self.zbuffers = zbuffers
        self._tensor = _texture(context, edges, blur)
        self._sums = context.gl.buffer(reserve=zbuffers.capacity * 8)
        self._program = context.gl.compute_shader(_COMPUTE)
        window = zbuffers.window
        inverse = 1 / edges.depths
        per_closeness = (len(inverse) - 1) / (inverse[-1] - inverse[0])
        self._program['tile'] = window.size
        self._program['tiles'] = zbuffers.tiles
        self._program['window'] = (window.left, window.top, window.scale)
        self._program['image'] = (edges.pinhole.width, edges.pinhole.height)
        self._program['inverse'] = zbuffers.inverse
        self._program['labels'] = (inverse[0], per_closeness, len(inverse))
        self._program['jump'] = 0.2 * radius * inverse.mean()
        self._program['reach'] = max(1.0, blur)

    def __call__(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n,) sum of the evidence along each pose's (n, 4, 4) contour."""
        batches = [self.batch(poses[first:first + self.zbuffers.capacity])[:, 0]
                   for first in range(0, len(poses), self.zbuffers.capacity)]
        return np.concatenate(batches) if batches else np.zeros(0)

    def batch(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n, 2) sum of the evidence and length of the contour in the image [px].

        poses: (n, 4, 4), n at most the atlas' capacity.
        """
        self.zbuffers.draw(poses)
        self.zbuffers.bind(depths=0, boxes=3)
        self._tensor.use(1)
        self._sums.bind_to_storage_buffer(2)
        self._program.run(group_x=len(poses))
        self.zbuffers.context.gl.memory_barrier()
        sums = np.frombuffer(self._sums.read(len(poses) * 8), np.float32)
        return sums.reshape(-1, 2).astype(np.float64)

    def __enter__(self) -> 'ContourScore':
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free what this score holds on the GPU."""
        self.zbuffers.context.use()
        for each in (self._tensor, self._sums, self._program):
            each.release()


def _texture(context: GlContext, edges: EdgeVolume, blur: float) -> moderngl.Texture3D:
    height, width, labels, _ = edges.tensor.shape
    most = context.limit('GL_MAX_3D_TEXTURE_SIZE')
    if max(width, height, labels) > most:
        raise RenderError(f'an edge volume of {width}x{height} pixels and {labels} labels is '
                          f'beyond this GL, which holds {most} each way at most')
    tensor = np.ascontiguousarray(edges.tensor.transpose(2, 0, 1, 3), np.float32)
    if blur > 0:
        tensor = np.stack([cv2.GaussianBlur(each, (0, 0), blur) for each in tensor])
    texture = context.gl.texture3d((width, height, labels), 3, tensor, dtype='f4')
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = texture.repeat_z = False
    return texture
