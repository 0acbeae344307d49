"""The cost volume and its likelihood as GL 4.3 compute shaders: both stay where a scorer is.

Values are those of the numba form (`cost`, `likelihood`).
"""

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.cost import CostInputs
from pmcl_ros.dlv.cost_shaders import GROUP, LABELS, LIKELIHOOD, LINE, MATCH, SUM
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.gl import GlContext

_PAIR = np.dtype([('weights', 'f4', 4), ('limits', 'f4', 4), ('inside', 'i4', 4)])
_NODE = np.dtype([('taps', 'f4', (2, 4)), ('cell', 'i4', 4)])


@dataclass(frozen=True)
class GlArray:
    """float32 numbers in a buffer of a context, row-major; whose it is releases the buffer."""

    context: GlContext
    buffer: moderngl.Buffer
    shape: tuple[int, int, int]

    def bind(self, binding: int) -> None:
        """Let shaders of its context read it as `readonly buffer Name { float values[]; }`.

        Raises RenderError in another thread than the context's.
        """
        self.context.use()
        self.buffer.bind_to_storage_buffer(binding)

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


@dataclass(frozen=True)
class Uploaded(Closing):
    """A task on the GPU, until it is closed.

    inputs: the planes and the tables of `_tables`.
    costs, other: (labels + 1, rows, columns) of the task's lattice; what costs differ from those
        of label 0, then these, as of `row_costs`. They change places to sum over windows.
    """

    task: CostInputs
    l2: bool
    inputs: list[moderngl.Buffer]
    costs: moderngl.Buffer
    other: moderngl.Buffer
    held: ExitStack

    def close(self) -> None:
        """Release it."""
        self.held.close()


class GlCost:
    """Makes volumes in a context, on its thread.

    All methods raise RenderError in another thread, and when the views or the volume are larger
    than this GL can hold; and VolumeError as `CostInputs.from_light_field` does.
    """

    def __init__(self, context: GlContext) -> None:
        context.use()
        self.context = context
        self._match, self._sum, self._log = (context.gl.compute_shader(source)
                                             for source in (MATCH, SUM, LIKELIHOOD))

    def cost_volume(self, light_field: LightField, depths: NDArray[np.float64],
                    settings: DlvSettings) -> NDArray[np.float32]:
        """What `cost.cost_volume` gives: (labels, height, width)."""
        task = CostInputs.from_light_field(light_field, depths, settings)
        rows, columns = task.wanted.within(task.lattice)
        with self.upload(task, settings) as uploaded:
            self._sum_costs(uploaded)
            labels, height, width = task.shape
            values = GlArray(self.context, uploaded.costs, (labels + 1, height, width)).read()
        return values[:-1, rows, columns] + values[-1, rows, columns]

    def log_likelihood(self, light_field: LightField, depths: NDArray[np.float64],
                       settings: DlvSettings) -> GlArray:
        """What `cost.likelihood_volume` makes: (height, width, labels), on the GPU.

        The layout is that which `pmcl`'s scorer reads. The caller releases it.
        """
        task = CostInputs.from_light_field(light_field, depths, settings)
        with self.upload(task, settings) as uploaded:
            return self.likelihood_of(uploaded)

    def upload(self, task: CostInputs, settings: DlvSettings) -> Uploaded:
        """Bring a task, made with the same settings, to the GPU; the caller closes it."""
        self.context.use()
        labels, height, width = task.shape
        size = 4 * (labels + 1) * height * width
        self._check(max(size, task.planes.nbytes))
        with ExitStack() as stack:
            def hold(buffer: moderngl.Buffer) -> moderngl.Buffer:
                stack.callback(buffer.release)
                return buffer

            gl = self.context.gl
            inputs = [hold(gl.buffer(each)) for each in (task.planes, *_tables(task))]
            costs = hold(gl.buffer(reserve=size))
            other = hold(gl.buffer(reserve=size)) if task.half else costs
            return Uploaded(task, settings.color_cost == 'l2', inputs, costs, other,
                            stack.pop_all())

    def likelihood_of(self, uploaded: 'Uploaded') -> GlArray:
        """The likelihood volume of a task on the GPU, there; the caller releases it."""
        self._sum_costs(uploaded)
        task = uploaded.task
        rows, columns = task.wanted.within(task.lattice)
        labels, height, width = task.shape
        shape = *task.wanted.shape, labels
        made = self.context.gl.buffer(reserve=4 * shape[0] * shape[1] * labels)
        try:
            self._log['size'] = (width, height, labels)
            self._log['wanted'] = (columns.start, rows.start, shape[1], shape[0])
            self._run(self._log, [uploaded.costs, made], (-(-shape[1] // LINE), shape[0], 1))
        except BaseException:
            made.release()
            raise
        return GlArray(self.context, made, shape)

    def release(self) -> None:
        """Free the programs."""
        self.context.use()
        for each in (self._match, self._sum, self._log):
            each.release()

    def _sum_costs(self, uploaded: 'Uploaded') -> None:
        """Fill `uploaded.costs`."""
        self.context.use()
        task, program = uploaded.task, self._match
        labels, height, width = task.shape
        program['size'] = (width, height, labels)
        program['lattice'] = (*task.corner, task.lattice.stride)
        program['plane'] = task.planes.shape[3], task.planes.shape[1]
        program['l2'] = uploaded.l2
        planes, *tables = uploaded.inputs
        self._run(program, [planes, uploaded.costs, *tables],
                  (-(-width // GROUP[0]), -(-height // GROUP[1]), -(-labels // LABELS)))
        if task.half:
            self._sum['size'] = (width, height, labels + 1)
            self._sum['reach'] = task.half
            both = [uploaded.costs, uploaded.other]
            for down, buffers in ((True, both), (False, both[::-1])):
                self._sum['down'] = down
                self._run(self._sum, buffers, (-(-width // LINE), height, labels + 1))

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


def _tables(task: CostInputs) -> list[NDArray[Any]]:
    """Runs, nodes, times and pairs as the shader declares them."""
    pairs = np.zeros(len(task.weights), _PAIR)
    pairs['weights'][:, :3], pairs['limits'][:, :3] = task.weights, task.limits
    pairs['inside'] = task.inside
    nodes = np.zeros(len(task.runs.cells), _NODE)
    nodes['taps'], nodes['cell'][:, :2] = task.runs.taps, task.runs.cells
    return [np.ascontiguousarray(task.runs.where, np.int32), nodes,
            np.ascontiguousarray(task.runs.time), pairs]
