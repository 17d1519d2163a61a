"""Training, runs, models."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import SHORT, program

import paig


def weights(run: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted((run / "checkpoints").rglob("*.safetensors"))]


def test_python_and_program_learn_the_same_bits(spring: paig.Dataset, run: paig.Run, tmp_path: Path) -> None:
    out = tmp_path / "run"
    settings = [part for key, value in SHORT.items() for part in ("--set", f"{key}={value}")]
    done = program(
        "train", "--task", "spring_color", "--data", spring.folder, "--out", out, "--threads", "1", *settings)
    assert done.returncode == 0, done.stderr
    assert weights(out) == weights(run.folder) != []
    ours, theirs = (json.loads((folder / "summary.json").read_text()) for folder in (run.folder, out))
    assert ours["parameters"] == theirs["parameters"] and ours["test"] == theirs["test"]


def test_a_run_has_parameters_with_interval_unit_and_truth(run: paig.Run) -> None:
    assert list(run.parameters) == ["k", "l"]
    k = run.parameters["k"]
    assert k.truth == 4.0 and k.unit == "1/t^2" and k.error_percent == pytest.approx(100 * (k.value / 4 - 1))
    assert k.interval is not None and k.interval[0] <= k.interval[1]
    assert run.verdict is not None and not run.verdict and "look at" in repr(run.verdict)
    assert "<table>" in run._repr_html_() and "spring_color" in repr(run)
    assert run.record()["k"] == k.value and run.metrics()[-1]["step"] == run.summary["steps"]
    assert {"losses", "example0"} <= run.pictures().keys()
    assert [found.folder for found in paig.runs(run.folder.parent)] == [run.folder]


def test_a_model_encodes_rolls_out_and_decodes(run: paig.Run) -> None:
    model = run.model(threads=1)
    frames = model.clips("test", 0, 3)
    assert frames.shape == (3, 30, 32, 32, 3) and 0 <= frames.min() and frames.max() <= 1
    positions = model.encode(frames[:, :4])
    states = model.roll_out(positions, 7)
    assert positions.shape == (3, 4, 2, 2) and states.positions.shape == states.velocities.shape == (3, 8, 2, 2)
    drawn = model.decode(states.positions[:, 1:])
    assert drawn.shape == (3, 7, 32, 32, 3)
    # In parts as in one call, but for the order of float32 sums.
    prediction = run.predict(7, clip=2)
    np.testing.assert_allclose(prediction.frames, drawn[2], atol=1e-4)
    np.testing.assert_allclose(prediction.positions, states.positions[2], atol=1e-3)
    assert prediction.clip.shape == (30, 32, 32, 3)
    # Bytes and numbers from 0 to 1 are the same frames.
    bytes_of = np.rint(frames[:, :4] * 255).astype(np.uint8)
    np.testing.assert_array_equal(model.encode(bytes_of), positions)
    assert run.positions().shape == (20, 30, 2, 2)
    assert run.evaluate()["pred_loss"] == run.summary["test"]["pred_loss"]


def test_wrong_shapes_are_input_errors(run: paig.Run) -> None:
    model = run.model(threads=1)
    with pytest.raises(paig.errors.InputError, match=r"expected \[clips, time, 32, 32, 3\]"):
        model.encode(np.zeros((1, 4, 16, 16, 3), np.float32))
    with pytest.raises(paig.errors.InputError, match="expected 4, the input"):
        model.roll_out(np.zeros((1, 2, 2, 2), np.float32), 3)
    with pytest.raises(paig.errors.InputError, match="20 clips"):
        run.predict(3, clip=20)


def test_events_come_in_the_callers_thread_and_their_exception_stops_and_saves(
    spring: paig.Dataset, tmp_path: Path
) -> None:
    events: list[paig.Event] = []

    def listen(event: paig.Event) -> None:
        events.append(event)
        if event.kind == "step":
            raise RuntimeError("enough")

    out = tmp_path / "stopped"
    with pytest.raises(RuntimeError, match="enough"):
        paig.train(spring, out=out, settings=SHORT, threads=1, progress=listen)
    assert [event.kind for event in events[:2]] == ["begin", "phase"] and events[1].phase == "discover"
    stopped = paig.load(out)
    assert not stopped.finished and "not finished" in repr(stopped)
    with pytest.raises(paig.errors.MissingError, match="resume"):
        _ = stopped.summary


def test_a_stopped_run_goes_on_to_the_same_bits(spring: paig.Dataset, run: paig.Run, tmp_path: Path) -> None:
    out = tmp_path / "resumed"
    training = paig.Training(spring, out=out, settings=SHORT, threads=1)
    for event in training:
        if event.kind == "step":
            training.stop()
    assert not paig.load(out).finished
    resumed = paig.resume(out, threads=1, progress=False)
    assert resumed.finished and weights(out)[-1] == weights(run.folder)[-1]


def test_ctrl_c_stops_and_saves(spring: paig.Dataset, tmp_path: Path) -> None:
    out = tmp_path / "interrupted"
    code = (
        "import paig\n"
        "try:\n"
        f"    paig.train('spring_color', data={str(spring.folder)!r}, out={str(out)!r}, threads=1)\n"
        "except KeyboardInterrupt:\n"
        "    print('stopped')\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    metrics = out / "metrics.jsonl"
    while process.poll() is None and not (metrics.exists() and "valid" in metrics.read_text()):
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    printed, errors = process.communicate()
    assert printed == "stopped\n" and process.returncode == 0, errors
    assert list((out / "checkpoints").glob("step_*")), "a checkpoint was saved"


def test_the_gil_is_released() -> None:
    counted, over = 0, threading.Event()

    def count() -> None:
        nonlocal counted
        while not over.wait(0.01):
            counted += 1

    thread = threading.Thread(target=count)
    thread.start()
    begun = time.monotonic()
    paig.generate_clips("spring_color", train=3000, threads=1)
    seconds = time.monotonic() - begun
    over.set()
    thread.join()
    # With the GIL held it counts a few times at most; without, up to a hundred times a second.
    assert counted > 10 * seconds


def test_clips_from_an_array(tmp_path: Path) -> None:
    clips = paig.generate_clips("falling", train=40, frames=14, seed=5)["train"]
    equation = paig.Equation("vec(0, g)", parameters={"g": {"unit": (1, -2)}})
    out = tmp_path / "fall"
    learned = paig.train(
        clips.frames / np.float32(255), equation=equation, dt=0.3, out=out, settings=SHORT, threads=1, progress=False)
    assert learned.task == "fall" and list(learned.parameters) == ["g"] and learned.parameters["g"].unit == "px/t^2"
    with np.load(tmp_path / "fall-data" / "test.npz") as file:
        np.testing.assert_array_equal(file["test_x"], clips.frames[-4:])
    with pytest.raises(paig.errors.InputError, match="need equation, dt and out"):
        paig.train(clips.frames)
