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
from pmcl_ros.runtime.outputs import write_file

_OPSET, _IR = 11, 6  # of ONNX 1.6 (2019), so that old runtimes read it
INPUT, OUTPUT = 'picture', 'map'


def write(network: keras.Model, path: Path) -> None:
    """Write a network of `network.build` with float32 weights, (n, 3, h, w) to (n, 6, h, w)."""
    model = helper.make_model(_graph(network), producer_name='pmcl_ros', ir_version=_IR,
                              opset_imports=[helper.make_opsetid('', _OPSET)])
    onnx.checker.check_model(model)
    write_file(path, model.SerializeToString())


def _graph(network: keras.Model) -> onnx.GraphProto:
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

    following = _normalisations(network)
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
    return helper.make_graph(
        nodes, 'contour_map', initializer=weights,
        inputs=[helper.make_tensor_value_info(INPUT, floats, ['n', 3, 'h', 'w'])],
        outputs=[helper.make_tensor_value_info(OUTPUT, floats, ['n', 6, 'h', 'w'])])


def read(data: bytes, network: keras.Model) -> None:
    """Give a network of `network.build` the weights of a file that `write` wrote.

    Its normalisations, which the file does not hold, are the identity and the shift: they are
    those of training when `network.normalise` has told them the statistics of pictures.
    Raises SettingsError for a file of anything else.
    """
    expected = _graph(network)
    try:
        graph = onnx.load_from_string(data).graph
        alike = _layout(graph) == _layout(expected)
        held = ({each.name: onnx.numpy_helper.to_array(each) for each in graph.initializer}
                if alike else {})
    except (DecodeError, ValueError) as error:
        raise SettingsError(f'cannot read the network: {error}') from None
    if not alike:
        raise SettingsError('it is no network of the form that learn-map trains, or its '
                            'layers have another width')
    if not all(np.isfinite(each).all() for each in held.values()):
        raise SettingsError('it has weights that are no finite numbers')
    following = _normalisations(network)
    names = iter([node.input[1:] for node in graph.node if len(node.input) == 3])
    for layer in network.layers:
        if not isinstance(layer, keras.layers.Conv2D | keras.layers.Conv2DTranspose):
            continue
        kernel, bias = (held[name] for name in next(names))
        kernel = np.transpose(kernel, (2, 3, 1, 0))
        if isinstance(layer, keras.layers.Conv2DTranspose):
            layer.set_weights([kernel, bias])
        else:
            layer.set_weights([kernel])
            normalisation, one = following[id(layer.output)], np.ones_like(bias)
            normalisation.set_weights([one, bias, 0 * one, one - normalisation.epsilon])


def _layout(graph: onnx.GraphProto) -> tuple[list[Any], list[Any]]:
    """What a graph has besides the values of its weights."""
    return ([node.SerializeToString(deterministic=True) for node in graph.node],
            [(each.name, list(each.dims), each.data_type, each.data_location)
             for each in graph.initializer])


def _normalisations(network: keras.Model) -> dict[int, keras.layers.BatchNormalization]:
    """By the identity of what they normalise."""
    return {id(each.input): each for each in network.layers
            if isinstance(each, keras.layers.BatchNormalization)}


def _folded(layer: keras.layers.BatchNormalization
            ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(scale, shift) that the normalisation is when it is used: (channels,) each."""
    gamma, beta, mean, variance = (each.numpy().astype(np.float64) for each in (
        layer.gamma, layer.beta, layer.moving_mean, layer.moving_variance))
    scale = gamma / np.sqrt(variance + layer.epsilon)
    return scale, beta - mean * scale
