"""Times training steps of a reference, as the port's `speed` does: prints the seconds of each as a JSON list."""
import argparse
import json
import time

from .tasks import TASKS

WARM_UP = 2  # libraries choose and compile their kernels in the first steps


def main(new_step):
    """`new_step(task, batch)` gives a function that makes one step."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", choices=TASKS, required=True)
    parser.add_argument("--batch", type=int, default=25, help="clips in a step [default: 25]")
    parser.add_argument("--steps", type=int, default=5, help="steps that are timed [default: 5]")
    arguments = parser.parse_args()
    step, seconds = new_step(TASKS[arguments.task], arguments.batch), []
    for _ in range(WARM_UP + arguments.steps):
        began = time.perf_counter()
        step()
        seconds.append(time.perf_counter() - began)
    print(json.dumps(seconds[WARM_UP:]))
