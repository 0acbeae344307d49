"""A network as an ONNX file that OpenCV's dnn reads, from version 4.6 on: written, and read.

Batch normalisation is folded into the convolutions. Operators: Conv, Relu, MaxPool,
ConvTranspose, Concat.
"""

from pathlib import Path
from typing import Any

import keras
import numpy as np
import onnx
from google.protobuf.message import DecodeError
from numpy.typing import NDArray
from onnx import helper

from pmcl_ros.runtime.errors import SettingsError

_OPSET, _IR = 11, 6
INPUT, OUTPUT = 'picture', 'map'


def write(network: keras.Model, path: Path) -> None:
    """Write a network of `network.build` with float32 weights, (n, 3, h, w) to (n, 6, h, w)."""
    layers = network.layers
    names = {id(network.inputs[0]): INPUT}
    nodes: list[onnx.NodeProto] = []
    weights: list[onnx.TensorProto] = []

    def add(operator: str, layer: keras.Layer, kernel: NDArray[np.floating] | None = None,
            bias: NDArray[np.floating] | None = None, **attributes: Any) -> None:
        sources = layer.input if isinstance(layer.input, list) else [layer.input]
        inputs = [names[id(each)] for each in sources]
        name = OUTPUT if layer is layers[-1] else f'{operator}{len(nodes)}'
        for kind, values in (('kernel', kernel), ('bias', bias)):
            if values is not None:
                array = np.ascontiguousarray(values, np.float32)
                weights.append(onnx.numpy_helper.from_array(array, f'{name}_{kind}'))
                inputs.append(f'{name}_{kind}')
        nodes.append(helper.make_node(operator, inputs, [name], name=name, **attributes))
        names[id(layer.output)] = name

    following = {id(each.input): each for each in layers
                 if isinstance(each, keras.layers.BatchNormalization)}
    for layer in layers:
        match layer:
            case keras.layers.InputLayer():
                pass
            case keras.layers.Conv2D():
                scale, shift = _folded(following[id(layer.output)])
                kernel, stride = np.transpose(layer.kernel.numpy() * scale, (3, 2, 0, 1)), \
                    layer.strides[0]
                before = (kernel.shape[-1] - stride) // 2
                add('Conv', layer, kernel, shift, kernel_shape=kernel.shape[2:],
                    strides=[stride] * 2, pads=[before] * 4)
            case keras.layers.BatchNormalization():  # is in the convolution
                names[id(layer.output)] = names[id(layer.input)]
            case keras.layers.ReLU():
                add('Relu', layer)
            case keras.layers.MaxPooling2D():
                add('MaxPool', layer, kernel_shape=[2, 2], strides=[2, 2])
            case keras.layers.Conv2DTranspose():  # kernel (2, 2, out, in)
                add('ConvTranspose', layer, np.transpose(layer.kernel.numpy(), (3, 2, 0, 1)),
                    layer.bias.numpy(), kernel_shape=[2, 2], strides=[2, 2])
            case keras.layers.Concatenate():
                add('Concat', layer, axis=1)
            case _:
                raise TypeError(f'no ONNX form of {layer}')
    floats = onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        nodes, 'contour_map', initializer=weights,
        inputs=[helper.make_tensor_value_info(INPUT, floats, ['n', 3, 'h', 'w'])],
        outputs=[helper.make_tensor_value_info(OUTPUT, floats, ['n', 6, 'h', 'w'])])
    model = helper.make_model(graph, producer_name='pmcl_ros', ir_version=_IR,
                              opset_imports=[helper.make_opsetid('', _OPSET)])
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())


def read(path: Path, network: keras.Model) -> None:
    """Give a network of `network.build` the weights of a file that `write` wrote.

    Its normalisations, which the file does not hold, are the identity and the shift: they are
    those of training when `network.normalise` has told them the statistics of pictures.
    Raises SettingsError for a file that cannot be read, or is of another network.
    """
    try:
        graph = onnx.load_from_string(path.read_bytes()).graph
    except (OSError, DecodeError) as error:
        raise SettingsError(f'cannot read the network {path}: {error}') from None
    held = {each.name: onnx.numpy_helper.to_array(each) for each in graph.initializer}
    nodes = {kind: iter([node for node in graph.node if node.op_type == kind])
             for kind in ('Conv', 'ConvTranspose')}

    def given(kind: str) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Kernel and bias of the next layer of a kind, as Keras has them."""
        _, kernel, bias = next(nodes[kind]).input
        return np.transpose(held[kernel], (2, 3, 1, 0)), held[bias]

    following = {id(each.input): each for each in network.layers
                 if isinstance(each, keras.layers.BatchNormalization)}
    try:
        for layer in network.layers:
            if isinstance(layer, keras.layers.Conv2DTranspose):
                layer.set_weights(given('ConvTranspose'))
            elif isinstance(layer, keras.layers.Conv2D):
                kernel, bias = given('Conv')
                layer.set_weights([kernel])
                normalisation, one = following[id(layer.output)], np.ones_like(bias)
                normalisation.set_weights([one, bias, 0 * one, one - normalisation.epsilon])
    except (StopIteration, ValueError, KeyError):
        raise SettingsError(f'{path} is no network that learn-map wrote, or an older form of '
                            'it; begin without it') from None
    if any(next(each, None) is not None for each in nodes.values()):
        raise SettingsError(f'{path} has more layers than the network of learn-map; begin '
                            'without it')


def _folded(layer: keras.layers.BatchNormalization
            ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(scale, shift) that the normalisation is when it is used: (channels,) each."""
    gamma, beta, mean, variance = (each.numpy().astype(np.float64) for each in (
        layer.gamma, layer.beta, layer.moving_mean, layer.moving_variance))
    scale = gamma / np.sqrt(variance + layer.epsilon)
    return scale, beta - mean * scale
