"""TensorFlow's names and layouts of variables to PyTorch's and back; the table is that of src/network/variable_names.rs.

    net/encoder/conv2d_3/kernel [kh, kw, in, out]    encoder.conv2d_3.weight [out, in, kh, kw]
    net/encoder/dense/kernel    [in, out]            encoder.dense.weight    [out, in]
    net/encoder/dense/bias      [out]                encoder.dense.bias      [out]
    net/spring_ode_cell/log_k   []                   spring_ode_cell.log_k   []
"""


def to_torch(name):
    return name.removeprefix("net/").replace("/kernel", "/weight").replace("/", ".")


def to_tensorflow(name):
    return "net/" + name.replace(".weight", ".kernel").replace(".", "/")


def layout_to_torch(x):
    """A kernel in TensorFlow's layout to PyTorch's; biases and scalars stay."""
    return x.transpose(3, 2, 0, 1) if x.ndim == 4 else x.T


def layout_to_tensorflow(x):
    return x.transpose(2, 3, 1, 0) if x.ndim == 4 else x.T
