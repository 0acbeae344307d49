"""Renderer and scores in an OpenGL context."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.gl_cost import GlArray
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.render.contour import label_scale
from pmcl_ros.pmcl.render.creases import Creases
from pmcl_ros.pmcl.render.gl_contour import GlContourScore
from pmcl_ros.pmcl.render.gl_zbuffers import ZBuffers
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.gl import GlContext

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


class GlLikelihoodScore(Closing):
    """See `LikelihoodScore`. capacity: poses drawn at once.

    Raises RenderError when the volume is larger than this GL can hold.
    """

    def __init__(self, context: GlContext, scene: Scene, volume: DepthLikelihoodVolume,
                 capacity: int = 96) -> None:
        context.use()
        self.evaluations = 0
        self._likelihood = _uploaded(context, volume)
        self.zbuffers = ZBuffers(context, scene, capacity)
        self._sums = context.gl.buffer(reserve=self.zbuffers.capacity * 8)
        self._program = context.gl.compute_shader(_COMPUTE)
        window = scene.window
        height, width, labels = self._likelihood.shape
        self._program['tile'] = window.size
        self._program['tiles'] = self.zbuffers.tiles
        self._program['window'] = (window.left, window.top, window.scale)
        self._program['volume'] = (width, height, labels)
        self._program['inverse'] = self.zbuffers.inverse
        self._program['labels'] = label_scale(volume.depths)

    def __call__(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """See `LikelihoodScore`."""
        self.evaluations += len(poses)
        capacity = self.zbuffers.capacity
        batches = [self._batch(poses[first:first + capacity])
                   for first in range(0, len(poses), capacity)]
        return np.concatenate([np.zeros(0), *batches])

    def _batch(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        self.zbuffers.draw(poses)
        self.zbuffers.bind(depths=0, boxes=3)
        self._likelihood.bind(1)
        self._sums.bind_to_storage_buffer(2)
        self._program.run(group_x=len(poses))
        self.zbuffers.context.gl.memory_barrier()
        sums = np.frombuffer(self._sums.read(len(poses) * 8), np.float32).reshape(-1, 2)
        return sums[:, 0].astype(np.float64) / np.maximum(sums[:, 1], 1)

    def close(self) -> None:
        """Free what this score holds on the GPU."""
        self.zbuffers.close()
        for each in (self._likelihood, self._sums, self._program):
            each.release()


def _uploaded(context: GlContext, volume: DepthLikelihoodVolume) -> GlArray:
    """The likelihoods in a buffer of the context."""
    values = volume.likelihood
    most = context.limit('GL_MAX_SHADER_STORAGE_BLOCK_SIZE')
    if values.nbytes > most:
        raise RenderError(f'a volume of {values.shape} takes {values.nbytes} bytes, this GL holds '
                          f'{most} at most; choose fewer labels')
    height, width, labels = values.shape
    return GlArray(context, context.gl.buffer(np.ascontiguousarray(values, 'f4')),
                   (height, width, labels))


class GlRenderer:
    """Draws and scores on the GPU, in the thread that made it.

    context: whoever made it closes it; left out: one of its own, closed with this.
    """

    def __init__(self, context: GlContext | None = None) -> None:
        self._own = context is None
        self.context = context or GlContext()
        self.name = self.context.renderer

    def depths(self, scene: Scene, poses: NDArray[np.floating]) -> NDArray[np.float32]:
        """See `Renderer`."""
        width, height = scene.window.size
        depths = np.zeros((len(poses), height, width), np.float32)
        with ZBuffers(self.context, scene, max(1, min(len(poses), 64))) as zbuffers:
            for first in range(0, len(poses), zbuffers.capacity):
                batch = poses[first:first + zbuffers.capacity]
                zbuffers.draw(batch)
                inverse = zbuffers.closeness(len(batch))
                np.divide(1, inverse, out=depths[first:first + len(batch)], where=inverse > 0)
        return depths

    def contour_score(self, scene: Scene, volume: EvidenceVolume, profile: ContourProfile,
                      creases: Creases | None = None) -> GlContourScore:
        """See `Renderer`."""
        return GlContourScore(self.context, scene, volume, profile, creases=creases)

    def likelihood_score(self, scene: Scene, volume: DepthLikelihoodVolume) -> GlLikelihoodScore:
        """See `Renderer`."""
        return GlLikelihoodScore(self.context, scene, volume)

    def use(self) -> None:
        """See `GlContext.use`."""
        self.context.use()

    def close(self) -> None:
        """Release the context, if it is this renderer's own."""
        if self._own:
            self.context.close()
