"""Trains the network of the contour map; goes on where it was stopped."""

import contextlib
import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import keras
import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

from pmcl_ros.learning.contour_net.network import build, losses, normalise, total
from pmcl_ros.learning.contour_net.onnx_file import read
from pmcl_ros.learning.contour_net.pictures import Batch, Files, batches, held_out
from pmcl_ros.learning.contour_net.training_plan import TrainingPlan
from pmcl_ros.runtime.binary_file import read_bytes
from pmcl_ros.runtime.errors import FileError, SettingsError, told_as
from pmcl_ros.runtime.npz_file import read_arrays
from pmcl_ros.runtime.outputs import replacing

_WARM_UP = 0.02  # the part of all steps in which the learning rate rises
_BATCHES_OF_STATISTICS = 8  # of which batch normalisation takes its means at the end
_CLIPPED = 1.0  # norm of the gradient of all weights
_MOST_BYTES = 2 ** 28  # of a state
_MOST_OF_NETWORK = 2 ** 26  # bytes
_MOST_HELD_OUT = 64  # crops


@dataclass(frozen=True)
class State:
    """Where training is: weights and Adam's values, in the order Keras gives them.

    history: rows of step, losses of contour and inside in training, and of held-out pictures.
    start: SHA-256 of the file of the network that it began with; empty: with random weights.
    """

    step: int
    weights: tuple[NDArray[np.float32], ...]
    optimizer: tuple[NDArray[np.generic], ...] = ()
    history: tuple[tuple[float, ...], ...] = ()
    seconds: float = 0.0
    start: str = ''

    @classmethod
    def load(cls, path: Path) -> 'State':
        """Read what `save` wrote; SettingsError when the file is something else."""
        try:
            values: dict[str, NDArray[Any]] = read_arrays(path, _MOST_BYTES)
            return cls(int(values['step']),
                       tuple(values[f'weight{n}'] for n in range(values['weights'])),
                       tuple(values[f'optimizer{n}'] for n in range(values['optimizers'])),
                       tuple(tuple(map(float, row)) for row in values['history']),
                       float(values['seconds']),
                       bytes(values.get('start', np.zeros(0, np.uint8))).hex())
        except (FileError, ValueError, KeyError, TypeError) as error:
            raise SettingsError(f'{path} is no state of a training: {error}; delete it to begin '
                                'again') from None

    def save(self, path: Path) -> None:
        """Write the state; a file of that name is replaced when all is written."""
        values: dict[str, Any] = {f'weight{n}': each for n, each in enumerate(self.weights)}
        values |= {f'optimizer{n}': each for n, each in enumerate(self.optimizer)}
        with replacing(path) as part, part.open('wb') as file:
            np.savez(file, step=self.step, weights=len(self.weights),
                     optimizers=len(self.optimizer), history=np.array(self.history),
                     seconds=self.seconds,
                     start=np.frombuffer(bytes.fromhex(self.start), np.uint8), **values)


@dataclass
class Trainer:
    """A network, its optimizer and one compiled step."""

    plan: TrainingPlan
    network: keras.Model = field(init=False)

    def __post_init__(self) -> None:
        keras.utils.set_random_seed(self.plan.seed)
        self.network = build(self.plan.channels, self.plan.dtype)
        self._adam = keras.optimizers.Adam(self.plan.rate, global_clipnorm=_CLIPPED)
        self._adam.build(self.network.trainable_variables)
        self._step = tf.function(self._step_eagerly)
        self._losses = tf.function(
            lambda picture, *labels: losses(self.network(picture, training=False), *labels))

    def state(self, step: int) -> State:
        """The values now."""
        return State(step, tuple(self.network.get_weights()),
                     tuple(each.numpy() for each in self._adam.variables))

    def restore(self, state: State) -> None:
        """Take over the values of a state; SettingsError when it is of another network."""
        shapes = [each.shape for each in self.network.get_weights()]
        if shapes != [each.shape for each in state.weights]:
            raise SettingsError('the state of the training is that of another network: give the '
                                'same --width, or delete it to begin again')
        self.network.set_weights(state.weights)
        for variable, value in zip(self._adam.variables, state.optimizer, strict=True):
            variable.assign(value)

    def start_from(self, data: bytes, folder: Path) -> None:
        """Take over the network of an ONNX file, and statistics of the pictures of a folder.

        Raises SettingsError for data that are none of `onnx_file.write`.
        """
        read(data, self.network)
        plan = self.plan
        with contextlib.closing(batches(folder, 0, plan.size, plan.crop, plan.seed)) as first:
            normalise(self.network, (each.picture for each in islice(
                first, _BATCHES_OF_STATISTICS)))

    def step(self, batch: Batch, number: int) -> NDArray[np.float32]:
        """One step of Adam: (losses of contour and inside,) before it."""
        part = (number + 1) / self.plan.steps
        self._adam.learning_rate.assign(self.plan.rate * min(1.0, part / _WARM_UP)
                                        * 0.5 * (1 + np.cos(np.pi * min(part, 1.0))))
        return np.stack(self._step(*_tensors(batch)))

    def losses(self, batch: Batch) -> NDArray[np.float32]:
        """(losses of contour and inside,) of the network as it is used."""
        return np.stack(self._losses(*_tensors(batch)))

    def _step_eagerly(self, picture: tf.Tensor, *labels: tf.Tensor) -> tuple[tf.Tensor, ...]:
        with tf.GradientTape() as tape:
            both = losses(self.network(picture, training=True), *labels)
            lowered = total(*both)
        variables = self.network.trainable_variables
        self._adam.apply_gradients(zip(tape.gradient(lowered, variables), variables, strict=True))
        return both


def _tensors(batch: Batch) -> tuple[tf.Tensor, ...]:
    return (tf.constant(batch.picture), tf.constant(batch.direction), tf.constant(batch.inside),
            tf.constant(batch.offset))


def train(folder: Path, path: Path, plan: TrainingPlan, report: Callable[[str], object],
          start: Path | None = None) -> State:
    """Train on the labelled pictures of a folder until `plan.steps` are done.

    path: the state's file; where it exists, training goes on from it. New pictures are used as
    they come. report: called with a line now and then. start: ONNX file of the network to begin
    with; by default its weights are random. Raises FileError or SettingsError for another
    file, and where the training that goes on began otherwise.
    """
    trainer = Trainer(plan)
    data = None if start is None else read_bytes(
        start, _MOST_OF_NETWORK, 'it is no network of the form that learn-map trains')
    digest = '' if data is None else hashlib.sha256(data).hexdigest()
    state = trainer.state(0)
    if path.exists():
        state = State.load(path)
        if data is not None and state.start != digest:
            raise SettingsError(f'{path} is of a training that did not begin with {start}: give '
                                'another folder')
        trainer.restore(state)
        report(f'going on from step {state.step} of {path}' + (
            f', to {plan.steps}, with the learning rate {plan.rate:g}' if state.step < plan.steps
            else f': nothing is left to train of {plan.steps}'))
    elif data is not None:
        with told_as(SettingsError, name=start):
            trainer.start_from(data, folder)
        state = replace(trainer.state(0), start=digest)
        report(f'beginning with the network {start}')
    files = Files.find(folder)
    devices = [each.device_type for each in tf.config.list_physical_devices()]
    report(f'{len(files.training)} pictures to train, {len(files.held_out)} held out, on '
           f'{", ".join(devices)}; {trainer.network.count_params()} parameters')
    source = batches(folder, state.step, plan.size, plan.crop, plan.seed)
    while state.step < plan.steps:
        begun = time.monotonic()
        numbers = range(state.step, min(plan.steps, state.step + plan.every))
        trained = np.mean([trainer.step(next(source), number) for number in numbers], axis=0)
        checked = np.mean([trainer.losses(batch) for batch in held_out(
            files.held_out[:_MOST_HELD_OUT], plan.size, plan.crop)], axis=0)
        step, seconds = numbers.stop, state.seconds + time.monotonic() - begun
        row = (step, *map(float, trained), *map(float, checked))
        state = replace(trainer.state(step), history=(*state.history, row), seconds=seconds,
                        start=state.start)
        state.save(path)
        report(f'step {step} of {plan.steps}: contour {row[1]:.4f}, inside {row[2]:.4f}; held out '
               f'{row[3]:.4f}, {row[4]:.4f}; {seconds:.0f} s')
    source.close()
    return state
