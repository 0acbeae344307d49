"""z-buffers, edges -> evidence along the contour, on the GPU (`contour`: on the processor)."""

import moderngl
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.learned import MOST_KNOTS, MOST_OFFSETS
from pmcl_ros.pmcl.render.contour_score import ContourScore
from pmcl_ros.pmcl.render.creases import Creases, sums_of_images
from pmcl_ros.pmcl.render.gl_zbuffers import ZBuffers
from pmcl_ros.pmcl.render.raster import MARGIN
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.gl import GlContext

_COMPUTE = f"""
#version 430
const int MOST_OFFSETS = {MOST_OFFSETS}, MOST_RAMPS = {MOST_KNOTS - 1};
""" + """
layout(local_size_x = 64) in;
const uint MOST = 6144u;    // pairs of pixels on a contour: 24 KiB of shared memory
const float UNIT = 8192.0;  // of the fixed-point sums
layout(binding = 0) uniform sampler2D depths;    // the atlas
layout(binding = 1) uniform sampler3D tensor;    // xx, yy, xy at (x, y, label)
layout(std430, binding = 2) writeonly buffer Sums { vec2 sums[]; };  // evidence, length [px]
layout(std430, binding = 3) readonly buffer Boxes { ivec4 boxes[]; };
uniform ivec2 tile;
uniform ivec2 tiles;
uniform vec3 window;      // left, top in the tensor, scale [image px]
uniform vec2 inverse;     // 1 / near, 1 / far of the z-buffer
uniform vec2 labels;      // 1 / depth of label 0, labels per 1/m
uniform float keep;       // a pixel is beyond another if its 1/z is less than this times that
uniform ivec2 size;       // offsets and ramps of the profile
uniform float offsets[MOST_OFFSETS];               // from the contour, outside > 0 [px]
uniform vec2 ramps[MOST_RAMPS];                    // where they begin, how long they are [1]
uniform float slopes[MOST_OFFSETS * MOST_RAMPS];   // of the evidence [nat/px]
uniform float bias;       // of a point [nat / px]
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
    // Between texels by hand: a GPU's own filter knows 256 places between two.
    ivec3 last = textureSize(tensor, 0) - 1;
    vec3 at = clamp(vec3(pixel, label), vec3(0.0), vec3(last));
    ivec3 low = ivec3(at), high = min(low + 1, last);
    vec3 part = at - vec3(low);
    vec3 m = vec3(0.0);
    for (int k = 0; k < 2; ++k) {
        int level = k == 0 ? low.z : high.z;
        vec3 upper = mix(texelFetch(tensor, ivec3(low.xy, level), 0).xyz,
                         texelFetch(tensor, ivec3(high.x, low.y, level), 0).xyz, part.x);
        vec3 lower = mix(texelFetch(tensor, ivec3(low.x, high.y, level), 0).xyz,
                         texelFetch(tensor, ivec3(high.xy, level), 0).xyz, part.x);
        m += (k == 0 ? 1.0 - part.z : part.z) * mix(upper, lower, part.y);
    }
    return sqrt(max(m.x * n.x * n.x + m.y * n.y * n.y + 2.0 * m.z * n.x * n.y, 0.0));
}

// Whether a contour runs between two neighbouring pixels.
bool across(float here, float there) {
    float near = max(here, there);
    return here >= 0.0 && there >= 0.0 && min(here, there) < near * keep;
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
        if (other >= 0.0 && other < near * keep) n += weight * vec2(dx, dy);
    }
    if (dot(n, n) < 1e-6) return ivec2(0);
    n = normalize(n);
    float label = (near - labels.x) * labels.y;
    vec2 pixel = window.xy + window.z * between + (window.z - 1.0) / 2.0;
    float value = bias;
    for (int j = 0; j < size.x; ++j) {
        float e = energy(pixel + offsets[j] * n, label, n);
        for (int k = 0; k < size.y; ++k)
            value += slopes[j * MOST_RAMPS + k] * clamp(e - ramps[k].x, 0.0, ramps[k].y);
    }
    // A line is crossed by |nx| horizontal and |ny| vertical pairs of pixels for each pixel of its
    // length.
    float length_px = window.z / (abs(n.x) + abs(n.y));
    return ivec2(round(UNIT * length_px * vec2(value, 1.0)));
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


class GlContourScore(ContourScore):
    """See `ContourScore`. capacity: poses drawn at once.

    Raises RenderError when the volume, the window or the profile is larger than this GL can hold.
    """

    def __init__(self, context: GlContext, scene: Scene, volume: EvidenceVolume,
                 profile: ContourProfile, capacity: int = 96,
                 creases: Creases | None = None) -> None:
        super().__init__(scene, volume, profile, creases)
        self.zbuffers = ZBuffers(context, scene, capacity)
        self._tensor = _texture(
            context, np.ascontiguousarray(self._volume.tensor.transpose(2, 0, 1, 3)))
        self._sums = context.gl.buffer(reserve=self.zbuffers.capacity * 8)
        self._program = context.gl.compute_shader(_COMPUTE)
        judged = self._volume
        ramps = np.zeros((MOST_KNOTS - 1, 2), np.float32)
        slopes = np.zeros((MOST_OFFSETS, MOST_KNOTS - 1), np.float32)
        offsets = np.zeros(MOST_OFFSETS, np.float32)
        ramps[:len(judged.knots)] = np.stack([judged.knots, judged.widths], axis=-1)
        slopes[:len(judged.offsets), :len(judged.knots)] = judged.slopes
        offsets[:len(judged.offsets)] = judged.offsets
        self._program['tile'] = scene.window.size
        self._program['tiles'] = self.zbuffers.tiles
        self._program['window'] = (judged.left, judged.top, judged.scale)
        self._program['inverse'] = self.zbuffers.inverse
        self._program['labels'] = (judged.farthest, judged.per_closeness)
        self._program['keep'] = float(judged.keep)
        self._program['size'] = judged.slopes.shape
        self._program['bias'] = float(judged.bias)
        self._program['offsets'] = offsets.tolist()
        self._program['ramps'] = [tuple(ramp) for ramp in ramps.tolist()]
        self._program['slopes'] = slopes.ravel().tolist()

    def evaluate(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """See `ContourScore`."""
        self.evaluations += len(poses)
        capacity = self.zbuffers.capacity
        batches = [self._batch(poses[first:first + capacity])
                   for first in range(0, len(poses), capacity)]
        return np.concatenate([np.zeros((0, 2)), *batches])

    def _drawn(self, pose: NDArray[np.floating]
               ) -> tuple[tuple[int, int, int, int], NDArray[np.float32]]:
        self.zbuffers.draw(pose[None])
        drawn = np.pad(self.zbuffers.closeness(1)[0], MARGIN, constant_values=-1).ravel()
        return (0, 0, *self._scene.window.size), drawn

    def _batch(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        self.zbuffers.draw(poses)
        self.zbuffers.bind(depths=0, boxes=3)
        self._tensor.use(1)
        self._sums.bind_to_storage_buffer(2)
        self._program.run(group_x=len(poses))
        self.zbuffers.context.gl.memory_barrier()
        sums = np.frombuffer(self._sums.read(len(poses) * 8), np.float32)
        result = sums.reshape(-1, 2).astype(np.float64)
        if self._lines is not None:  # on the processor: they are few, and the z-buffers are here
            images = self.zbuffers.closeness(len(poses))
            sums_of_images(np.ascontiguousarray(poses, np.float32), images, *self._lines,
                           result[:, 0])
        return result

    def close(self) -> None:
        """Free what this score holds on the GPU."""
        self.zbuffers.close()
        for each in (self._tensor, self._sums, self._program):
            each.release()


def _texture(context: GlContext, tensor: NDArray[np.float32]) -> moderngl.Texture3D:
    labels, height, width, _ = tensor.shape
    most = context.limit('GL_MAX_3D_TEXTURE_SIZE')
    if max(width, height, labels) > most:
        raise RenderError(f'an edge volume of {width}x{height} pixels and {labels} labels is '
                          f'beyond this GL, which holds {most} each way at most; choose fewer '
                          'labels or a smaller region of interest')
    texture = context.gl.texture3d((width, height, labels), 3, tensor, dtype='f4')
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture
