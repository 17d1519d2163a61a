"""A training from its first step to its score on the test clips."""
import time

import torch

from .data import load_clips
from .identify import identify
from .network import FastNet
from .phases import Discover, Join
from .recentre import recentre

RECENTRE_FRAMES = 1000


class Diverged(Exception):
    pass


def train(training, recipe, seed, steps, discovered, say):
    """Trains and scores. `discovered`: file of the model after discovery, used if it is there. Gives a record."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    began = time.monotonic()
    fast = FastNet(training, recipe["model"])
    train_clips, valid, test = load_clips(training.task_key, training.defects.reshaped_frames)
    record = {"train_clips": len(train_clips), "test_clips": len(test)}
    try:
        if discovered.exists():
            saved = torch.load(discovered)
            fast.net.load_state_dict(saved["model"])
            record["discover_steps"] = saved["steps"]
            say(f"discovery taken from {discovered.name}")
        else:
            config = recipe["discover"]
            phase = Discover(config, fast, train_clips, valid, seed, min(config["max_steps"], steps))
            record["discover_steps"] = descend(phase, training, say)
            write(discovered, {"model": fast.net.state_dict(), "steps": record["discover_steps"]})
        record |= find_parameters(recipe, fast, train_clips, seed, say)
        config = recipe["join"]
        left = min(config["max_steps"], steps - record["discover_steps"])
        record["join_steps"] = descend(Join(config, fast, train_clips, valid, seed, left), training, say) if left else 0
        recons, pred = fast.scores(test)
        record |= {"L_rec": recons, "L_pred": pred, **fast.parameters()}
    except Diverged as error:
        record["diverged"] = str(error)
    return record | {"seconds": round(time.monotonic() - began)}


def write(path, state):
    """In one step, so that a file under its name is complete."""
    partial = path.with_name(path.name + ".partial")
    torch.save(state, partial)
    partial.replace(path)


def descend(phase, training, say):
    """Takes the steps of a phase; gives their number. One line for each validation."""
    optimizers = [training.optimizer(*group) for group in phase.rates]
    schedule, timetable = phase.timetable.schedule, phase.timetable
    phase.begin()
    scores, step, annealed, began = [], 0, False, time.monotonic()
    while True:
        if step % schedule["validate_every"] == 0:
            score, text = phase.score()
            scores.append(score)
            left = timetable.last_step(scores) - step
            pace = (time.monotonic() - began) / step if step else float("nan")
            say(f"{phase.name} {step}: {text}; at most {left} steps of this phase left, {left * pace / 60:.1f} min")
        if step >= timetable.last_step(scores):
            return step
        if not annealed and timetable.annealed(step, scores):
            annealed = True
            for each in optimizers:
                each.anneal()
        loss = phase.loss(step)
        if not torch.isfinite(loss):
            raise Diverged(f"the loss of {phase.name} is not finite at step {step + 1}")
        loss.backward()
        for each in optimizers:
            each.step()
        step += 1


def find_parameters(recipe, fast, clips, seed, say):
    """Identify and re-centre."""
    config, task = recipe["identify"], fast.task
    with torch.no_grad():
        batches = torch.arange(min(config["clips"], len(clips))).split(recipe["join"]["batch"])
        seen = [clips.batch(batch, task.seq_len) for batch in batches]
        positions = torch.cat([fast.net.encoder(x.flatten(0, 1))[0].reshape(*x.shape[:2], -1) for x in seen])
    if not torch.isfinite(positions).all():
        raise Diverged("encoded positions are not finite after discovery")
    offsets, residual = identify(config, fast.cell, task.dt, positions)
    if offsets.abs().max() > config["recentre_above"] > 0:
        recentre(fast, clips.random_frames(RECENTRE_FRAMES, seed, "recentre"), offsets)
    values = {f"identified_{name}": value for name, value in fast.parameters().items()}
    say(f"identify: residual {residual:.3f} px, offsets {[round(x, 2) for x in offsets.tolist()]}, {values}")
    return {"identify_residual": residual, **values}
