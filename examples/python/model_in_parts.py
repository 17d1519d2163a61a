"""A trained model in parts, its events as an iterator, its arrays in torch.

    python model_in_parts.py spring/run
"""

import sys

import numpy as np

import paig

run = paig.load(sys.argv[1])
model = run.model(threads=1)
frames = model.clips("test", 0, 8)
states = model.roll_out(model.encode(frames[:, : run.input_steps]), 20)
drawn = model.decode(states.positions[:, 1:])
truth = frames[:, run.input_steps : run.input_steps + 20]
print("squared error of each predicted frame:", np.square(drawn - truth).sum((2, 3, 4)).mean(0).round(2))
print("losses on the test clips:", model.evaluate()["pred_loss"])

# The same run again with another seed, a few steps of it.
training = paig.Training(run.task, data="spring/data", out="spring/again", seed=1, settings={"discover.max_steps": 20})
for event in training:
    if event.kind == "step":
        print(event.phase, event.step, event.loss)
    if event.step >= 20:
        training.stop()
