"""The paper's score: the mean likelihood under the rendered pixels.

Section V, the last two equations.
"""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.errors import RenderError
from pmcl_ros.pmcl.zbuffers import ZBuffers

_COMPUTE = """
#version 430
layout(local_size_x = 64) in;
layout(binding = 0) uniform sampler2D depths;    // the atlas
layout(std430, binding = 1) readonly buffer Volume { float likelihood[]; };  // y, x, label
layout(std430, binding = 3) readonly buffer Boxes { ivec4 boxes[]; };
layout(std430, binding = 2) writeonly buffer Sums { vec2 sums[]; };  // likelihoods, valid pixels
uniform ivec2 tile;
uniform ivec2 tiles;
uniform ivec3 window;     // left, top, scale
uniform ivec3 volume;     // width, height, labels
uniform vec2 inverse;     // 1 / near, 1 / far of the z-buffer
uniform vec2 labels;      // 1 / depth of label 0, labels per 1/m
shared vec2 partial[64];

void main() {
    int pose = int(gl_WorkGroupID.x);
    int lane = int(gl_LocalInvocationID.x);
    ivec2 corner = ivec2(pose % tiles.x, pose / tiles.x) * tile;
    vec2 sum = vec2(0.0);
    ivec4 box = boxes[pose];
    ivec2 size = max(box.zw - box.xy, ivec2(0));
    for (int i = lane; i < size.x * size.y; i += 64) {
        ivec2 at = box.xy + ivec2(i % size.x, i / size.x);
        float depth = texelFetch(depths, corner + at, 0).x;
        ivec2 pixel = window.xy + window.z * at + (window.z - 1) / 2;
        if (depth >= 1.0 || any(greaterThanEqual(pixel, volume.xy))) continue;
        float label = (inverse.x - depth * (inverse.x - inverse.y) - labels.x) * labels.y;
        // Beyond the volume's range nothing is known: a valid pixel without likelihood.
        if (label >= 0.0 && label <= float(volume.z - 1)) {
            int below = min(int(label), volume.z - 2);
            int first = (pixel.y * volume.x + pixel.x) * volume.z + below;
            sum.x += mix(likelihood[first], likelihood[first + 1], label - float(below));
        }
        sum.y += 1.0;
    }
    partial[lane] = sum;
    barrier();
    for (int half_count = 32; half_count > 0; half_count /= 2) {
        if (lane < half_count) partial[lane] += partial[lane + half_count];
        barrier();
    }
    if (lane == 0) sums[pose] = partial[0];
}
"""


class LikelihoodScore:
    """Scores the z-buffers of an atlas in a volume, on the GPU.

    zbuffers: its window's pixels are the image's, or each is read at the image pixel at its centre
        or just above and left of that.
    Raises RenderError when the volume is larger than this GL can hold.
    """

    def __init__(self, zbuffers: ZBuffers, volume: DepthLikelihoodVolume) -> None:
        context = zbuffers.context
        context.use()
        most = context.limit('GL_MAX_SHADER_STORAGE_BLOCK_SIZE')
        if 4 * volume.likelihood.size > most:
            raise RenderError(f'a volume of {volume.likelihood.shape} takes '
                              f'{4 * volume.likelihood.size} bytes, this GL holds {most} at most; '
                              'choose fewer labels')
        self.zbuffers = zbuffers
        self._volume = context.gl.buffer(np.ascontiguousarray(volume.likelihood, 'f4'))
        self._sums = context.gl.buffer(reserve=zbuffers.capacity * 8)
        self._program = context.gl.compute_shader(_COMPUTE)
        window = zbuffers.window
        height, width, labels = volume.likelihood.shape
        inverse = 1 / volume.depths
        self._program['tile'] = window.size
        self._program['tiles'] = zbuffers.tiles
        self._program['window'] = (window.left, window.top, window.scale)
        self._program['volume'] = (width, height, labels)
        self._program['inverse'] = zbuffers.inverse
        self._program['labels'] = (inverse[0], (labels - 1) / (inverse[-1] - inverse[0]))

    def __call__(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n,) mean likelihood under each pose's (n, 4, 4) valid pixels; 0 if it covers none."""
        batches = [self._batch(poses[first:first + self.zbuffers.capacity])
                   for first in range(0, len(poses), self.zbuffers.capacity)]
        return np.concatenate(batches) if batches else np.zeros(0)

    def _batch(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        self.zbuffers.draw(poses)
        self.zbuffers.bind(depths=0, boxes=3)
        self._volume.bind_to_storage_buffer(1)
        self._sums.bind_to_storage_buffer(2)
        self._program.run(group_x=len(poses))
        self.zbuffers.context.gl.memory_barrier()
        sums = np.frombuffer(self._sums.read(len(poses) * 8), np.float32).reshape(-1, 2)
        return sums[:, 0].astype(np.float64) / np.maximum(sums[:, 1], 1)

    def __enter__(self) -> 'LikelihoodScore':
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free what this score holds on the GPU."""
        self.zbuffers.context.use()
        for each in (self._volume, self._sums, self._program):
            each.release()
