"""The cost volume and its likelihood as GL 4.3 compute shaders: both stay where a scorer is.

Values are those of the numba form (`cost`, `likelihood`).
"""

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.cost_shaders import GROUP, LABELS, LIKELIHOOD, LINE, MATCH, SUM
from pmcl_ros.dlv.matching import Matching
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.errors import RenderError
from pmcl_ros.gl import GlContext
from pmcl_ros.lightfield.light_field import LightField

_PAIR = np.dtype([('weights', 'f4', 4), ('limits', 'f4', 4), ('inside', 'i4', 4)])
_NODE = np.dtype([('taps', 'f4', (2, 4)), ('cell', 'i4', 4)])


@dataclass(frozen=True)
class GlArray:
    """float32 numbers in a buffer of a context, row-major; whose it is releases the buffer."""

    context: GlContext
    buffer: moderngl.Buffer
    shape: tuple[int, int, int]

    def read(self) -> NDArray[np.float32]:
        """A copy (`shape`). Raises RenderError in another thread than the context's."""
        self.context.use()
        values = np.empty(self.shape, np.float32)
        self.buffer.read_into(values)
        return values

    def release(self) -> None:
        """Free it."""
        self.context.use()
        self.buffer.release()


class GlCost:
    """Makes volumes in a context, on its thread.

    All methods raise RenderError in another thread, and when the views or the volume are larger
    than this GL can hold; and VolumeError as `Matching.of` does.
    """

    def __init__(self, context: GlContext) -> None:
        context.use()
        self.context = context
        self._match, self._sum, self._log = (context.gl.compute_shader(source)
                                             for source in (MATCH, SUM, LIKELIHOOD))

    def cost_volume(self, light_field: LightField, depths: NDArray[np.float64],
                    settings: DlvSettings) -> NDArray[np.float32]:
        """What `cost.cost_volume` gives: (labels, height, width)."""
        task = Matching.of(light_field, depths, settings)
        rows, columns = task.wanted.within(task.lattice)
        with ExitStack() as stack:
            costs = self._costs(task, settings.color_cost == 'l2', stack)
            values = GlArray(self.context, costs, task.shape).read()
        return np.ascontiguousarray(values[:, rows, columns])

    def log_likelihood(self, light_field: LightField, depths: NDArray[np.float64],
                       settings: DlvSettings) -> GlArray:
        """What `likelihood.log_likelihood` makes of it: (height, width, labels), on the GPU.

        The layout is that which `pmcl.likelihood_score` reads. The caller releases it.
        """
        task = Matching.of(light_field, depths, settings)
        rows, columns = task.wanted.within(task.lattice)
        labels, height, width = task.shape
        shape = rows.stop - rows.start, columns.stop - columns.start, labels
        with ExitStack() as stack:
            costs = self._costs(task, settings.color_cost == 'l2', stack)
            made = self.context.gl.buffer(reserve=4 * shape[0] * shape[1] * labels)
            self._log['size'] = (width, height, labels)
            self._log['wanted'] = (columns.start, rows.start, shape[1], shape[0])
            self._run(self._log, [costs, made], (-(-shape[1] // LINE), shape[0], 1))
        return GlArray(self.context, made, shape)

    def release(self) -> None:
        """Free the programs."""
        self.context.use()
        for each in (self._match, self._sum, self._log):
            each.release()

    def _costs(self, task: Matching, l2: bool, stack: ExitStack) -> moderngl.Buffer:
        """(labels, rows, columns) of the task's lattice, windows summed; `stack` releases it."""
        self.context.use()
        labels, height, width = task.shape
        size = 4 * labels * height * width
        self._check(max(size, task.planes.nbytes))

        def hold(buffer: moderngl.Buffer) -> moderngl.Buffer:
            stack.callback(buffer.release)
            return buffer

        inputs = [hold(self.context.gl.buffer(each)) for each in (task.planes, *_tables(task))]
        costs = hold(self.context.gl.buffer(reserve=size))
        program, lattice = self._match, task.lattice
        program['size'] = (width, height, labels)
        program['lattice'] = (lattice.left + task.pad, lattice.top + task.pad, lattice.stride)
        program['plane'] = task.planes.shape[:-3:-1]
        program['l2'] = l2
        self._run(program, [inputs[0], costs, *inputs[1:]],
                  (-(-width // GROUP[0]), -(-height // GROUP[1]), -(-labels // LABELS)))
        if task.half:
            other = hold(self.context.gl.buffer(reserve=size))
            self._sum['size'] = (width, height, labels)
            self._sum['reach'] = task.half
            for down, buffers in ((True, [costs, other]), (False, [other, costs])):
                self._sum['down'] = down
                self._run(self._sum, buffers, (-(-width // LINE), height, labels))
        return costs

    def _run(self, program: moderngl.ComputeShader, buffers: list[moderngl.Buffer],
             groups: tuple[int, int, int]) -> None:
        for binding, each in enumerate(buffers):
            each.bind_to_storage_buffer(binding)
        program.run(*groups)
        self.context.gl.memory_barrier()
        error = self.context.gl.error  # memory that ran out shows here alone
        if error != 'GL_NO_ERROR':
            raise RenderError(f'OpenGL ({self.context.renderer}) failed at a volume: {error}; '
                              'choose back_end numba, fewer views or labels, or a crop')

    def _check(self, size: int) -> None:
        most = self.context.limit('GL_MAX_SHADER_STORAGE_BLOCK_SIZE')
        if size > most:
            raise RenderError(f'views or a volume of {size} bytes are beyond this GL '
                              f'({self.context.renderer}), which holds {most} at most; choose '
                              'back_end numba, fewer views or labels, or a crop')


def _tables(task: Matching) -> list[NDArray[Any]]:
    """Runs, nodes, times and pairs as the shader declares them."""
    pairs = np.zeros(len(task.weights), _PAIR)
    pairs['weights'][:, :3], pairs['limits'][:, :3] = task.weights, task.limits
    pairs['inside'] = task.inside
    nodes = np.zeros(len(task.runs.cells), _NODE)
    nodes['taps'], nodes['cell'][:, :2] = task.runs.taps, task.runs.cells
    return [np.ascontiguousarray(task.runs.where, np.int32), nodes,
            np.ascontiguousarray(task.runs.time), pairs]
