"""Times training steps in PyTorch: python -m torch_reference.speed --task spring_color"""
import torch

from shared.speed import main

from .optimizers import optimizer
from .physics_models import PhysicsNet
from .switches import Defects


def new(_what, task, batch, threads):
    torch.set_num_threads(threads)
    net = PhysicsNet(task)
    rule = optimizer(task, net.parameters(), Defects())
    clips = torch.rand(batch, task.seq_len, task.side, task.side, 3)

    def step():
        net(clips).train_loss.backward()
        rule.step()

    return step


if __name__ == "__main__":
    main(new)
