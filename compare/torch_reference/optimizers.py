"""TensorFlow 1's optimizers, on lists of parameters (original: base.py)."""
import torch


class Optimizer:
    """`clip`: every element of a gradient is clipped to +- this; None does not clip."""

    def __init__(self, parameters, lr, clip=1.0):
        self.parameters, self.lr, self.clip, self.t = list(parameters), lr, clip, 0
        self.anneals = True

    @torch.no_grad()
    def step(self):
        self.t += 1
        for i, p in enumerate(self.parameters):
            if p.grad is not None:
                g = p.grad if self.clip is None else p.grad.clamp(-self.clip, self.clip)
                p -= self.update(i, g)
                p.grad = None

    def anneal(self):
        """At three quarters of the epochs."""
        if self.anneals:
            self.lr /= 5


class GradientDescent(Optimizer):
    def update(self, i, g):
        return self.lr * g


class Momentum(Optimizer):
    def __init__(self, parameters, lr, clip=1.0):
        super().__init__(parameters, lr, clip)
        self.a = [torch.zeros_like(p) for p in self.parameters]

    def update(self, i, g):
        self.a[i] = 0.9 * self.a[i] + g
        return self.lr * self.a[i]


class RMSProp(Optimizer):
    """The mean square starts at one; epsilon is under the root."""

    def __init__(self, parameters, lr, clip=1.0):
        super().__init__(parameters, lr, clip)
        self.ms = [torch.ones_like(p) for p in self.parameters]

    def update(self, i, g):
        self.ms[i] = 0.9 * self.ms[i] + 0.1 * g**2
        return self.lr * g / torch.sqrt(self.ms[i] + 1e-10)


class Adam(Optimizer):
    def __init__(self, parameters, lr, clip=1.0):
        super().__init__(parameters, lr, clip)
        self.m = [torch.zeros_like(p) for p in self.parameters]
        self.v = [torch.zeros_like(p) for p in self.parameters]

    def update(self, i, g):
        self.m[i] = 0.9 * self.m[i] + 0.1 * g
        self.v[i] = 0.999 * self.v[i] + 0.001 * g**2
        lr_t = self.lr * (1 - 0.999**self.t) ** 0.5 / (1 - 0.9**self.t)
        return lr_t * self.m[i] / (torch.sqrt(self.v[i]) + 1e-8)


class TorchRMSProp(Optimizer):
    """Defect 5: PyTorch's own, with its defaults."""

    def __init__(self, parameters, lr, clip=1.0):
        super().__init__(parameters, lr, clip)
        self.ms = [torch.zeros_like(p) for p in self.parameters]

    def update(self, i, g):
        self.ms[i] = 0.99 * self.ms[i] + 0.01 * g**2
        return self.lr * g / (torch.sqrt(self.ms[i]) + 1e-8)


OPTIMIZERS = {"rmsprop": RMSProp, "adam": Adam, "momentum": Momentum, "sgd": GradientDescent}


def optimizer(task, parameters, defects):
    rule = TorchRMSProp if defects.torch_rmsprop and task.opt == "rmsprop" else OPTIMIZERS[task.opt]
    result = rule(parameters, task.base_lr, None if defects.no_clipping else 1.0)
    result.anneals = not defects.no_annealing
    return result
