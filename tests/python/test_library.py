"""Datasets, equations, videos, errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import program

import paig


def test_generated_files_are_those_of_the_program(spring: paig.Dataset, tmp_path: Path) -> None:
    done = program(
        "generate", "--task", "spring_color", "--train", "120", "--valid", "20", "--test", "20", "--seed", "3", "--out",
        tmp_path)
    assert done.returncode == 0, done.stderr
    theirs = tmp_path / spring.train_file.relative_to(spring.folder)
    assert theirs.read_bytes() == spring.train_file.read_bytes()
    assert spring.arrays("train").shape == (120, 12, 32, 32, 3) and spring.arrays("test").shape == (20, 30, 32, 32, 3)


def test_clips_in_memory_have_true_states() -> None:
    clips = paig.generate_clips("pendulum", train=3, frames=9)["train"]
    assert clips.frames.shape[:2] == (3, 9) and clips.frames.dtype == np.uint8
    assert clips.positions.shape == clips.velocities.shape == (3, 9, 1, 1)
    assert clips.actions is not None and clips.actions.shape == (3, 9)
    assert "spring_color" in paig.tasks()


def test_scene_numbers_change_what_is_generated() -> None:
    usual, heavy = (paig.generate_clips("falling", train=1, g=g)["train"].velocities for g in (1.5, 3.0))
    fall = [velocities[0, 1, 0, 1] - velocities[0, 0, 0, 1] for velocities in (usual, heavy)]
    assert fall[1] == pytest.approx(2 * fall[0], rel=1e-4)
    with pytest.raises(paig.errors.InputError, match='background "sea"'):
        paig.generate_clips("falling", train=1, background="sea")


def test_an_equation_is_checked_with_its_place() -> None:
    pull = paig.Equation("-k * (p - vec(x0, y0)) - b * v", parameters=["k", "b", "x0", "y0"])
    assert sorted(pull.parameters) == ["b", "k", "x0", "y0"] and "code" in pull._repr_html_()
    with pytest.raises(paig.errors.InputError, match="units") as error:
        paig.Equation("k * p + v", parameters={"k": {"unit": (0, -2)}})
    assert "^" in str(error.value)
    assert paig.Equation.of_task("spring_color").parameters == ["k", "l"]


def test_errors_have_kinds(tmp_path: Path) -> None:
    with pytest.raises(paig.errors.MissingError):
        paig.load(tmp_path / "none")
    with pytest.raises(FileNotFoundError):
        paig.load(tmp_path / "none")
    with pytest.raises(paig.errors.InputError, match="unknown task"):
        paig.train("sprung_color", out=tmp_path / "run", progress=False)
    with pytest.raises(paig.errors.DeviceError):
        paig.train("spring_color", data=tmp_path, out=tmp_path / "run", device="cuda:99", progress=False)
    broken = tmp_path / "broken" / "spring_color"
    broken.mkdir(parents=True)
    names = [path.name for path in paig.generate("spring_color", train=2, valid=1, test=1, out=tmp_path).folder.rglob("*6.npz")]
    for name in names:
        (broken / name).write_bytes(b"PK\3\4 and no more")
    with pytest.raises(paig.errors.CorruptError, match="npz"):
        paig.train("spring_color", data=tmp_path / "broken", out=tmp_path / "run", progress=False)


@pytest.fixture(scope="module")
def throw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A film of a disc of radius 5 that is thrown, 60 frames a second, as an array in an npz."""
    times = np.arange(120)[:, None, None] / 60
    rows, columns = np.mgrid[0:96, 0:160] + 0.5
    x, y = 15 + 65 * times, 80 - 130 * times + 75 * times**2
    level = np.clip(5.5 - np.hypot(columns - x, rows - y), 0, 1)
    film = tmp_path_factory.mktemp("film") / "throw.npz"
    np.savez_compressed(film, frames=np.repeat((200 * level + 20).astype(np.uint8)[..., None], 3, axis=3))
    return film


def test_a_video_becomes_a_task(throw: Path, tmp_path: Path) -> None:
    scene = paig.import_video(throw, tmp_path / "scene", fps=60, seconds=(0, 1.9), side=48, grey=True)
    assert Path(scene.task).exists() and (tmp_path / "scene" / "contact-sheet.png").exists()
    assert scene.arrays("train").shape[2:] == (48, 48, 1) and scene.details["interval"] == pytest.approx(1 / 60)
    with pytest.raises(paig.errors.InputError, match="holds something already"):
        paig.import_video(throw, tmp_path / "scene", fps=60)


def test_a_video_is_tracked(throw: Path) -> None:
    (path,) = paig.track(throw)
    seen = np.array(path.visibility) == "visible"
    assert seen.sum() >= 110 and path.positions.shape == (120, 2) and path.seconds is None
    times = path.frames / 60
    truth = np.stack([15 + 65 * times, 80 - 130 * times + 75 * times**2], axis=1)
    # The template's centroid may lie beside the disc's middle, by the same distance in all frames.
    offset = (path.positions - truth)[seen]
    assert np.abs(offset - np.median(offset, axis=0)).max() < 0.3 and np.abs(offset).max() < 1
