"""The lookup of libtorch: what is taken, what is refused and in which words."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import zipfile
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from conftest import python

from paig import libtorch, pinned, wheel_parts

LOAD = "import paig; print(paig.versions()['libtorch'])"


def last_line(done: subprocess.CompletedProcess[str]) -> str:
    return done.stderr.strip().splitlines()[-1]


def with_torch(folder: Path, version: str) -> str:
    """A PYTHONPATH with a package `torch` of this version."""
    information = folder / f"torch-{version}.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: torch\nVersion: {version}\n")
    (folder / "torch").mkdir()
    (folder / "torch" / "__init__.py").write_text(f"__version__ = {version!r}\n")
    return str(folder)


def test_another_version_of_torch_is_passed_over_and_not_imported_beside(tmp_path: Path) -> None:
    path = with_torch(tmp_path, "2.9.1")
    assert python(LOAD, PYTHONPATH=path).stdout == "2.11.0\n"
    after = python(LOAD + "\nimport torch", PYTHONPATH=path)
    assert "paig has loaded its own libtorch 2.11" in last_line(after) and "torch==2.11.*" in last_line(after)
    before = python("import torch\n" + LOAD, PYTHONPATH=path)
    assert "torch 2.9.1 is loaded in this process and paig needs 2.11" in last_line(before)


def test_the_torch_of_the_environment_is_taken_where_its_version_fits(tmp_path: Path) -> None:
    path = with_torch(tmp_path, "2.11.3+cpu")
    find = "from paig import libtorch; print(libtorch.find(fetch=False))"
    cache = tmp_path / "cache"

    def found() -> str:
        return python(find, PYTHONPATH=path, PAIG_LIBTORCH="", PAIG_CACHE=str(cache)).stdout.strip()

    folder = tmp_path / "torch" / "lib"
    folder.mkdir()
    (folder / "libtorch_cpu.so").touch()
    assert found() == str(folder)
    (folder / "libtorch_cpu.so").unlink()
    assert found() == str(cache / libtorch.CACHED / "torch" / "lib")


def test_a_given_folder_without_libtorch_is_refused(tmp_path: Path) -> None:
    assert "there is no libtorch_cpu.so in it" in last_line(python(LOAD, PAIG_LIBTORCH=str(tmp_path)))


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    said = last_line(python(LOAD, PAIG_LIBTORCH="", PAIG_CACHE=str(tmp_path / "cache")))
    assert "cannot be written" in said and "set PAIG_CACHE" in said


def test_without_network_the_message_has_a_way_out(tmp_path: Path) -> None:
    nowhere = "http://127.0.0.1:9/simple"
    done = python(
        LOAD, PAIG_LIBTORCH="", PAIG_CACHE=str(tmp_path), PIP_INDEX_URL=nowhere, PIP_FIND_LINKS="", PIP_RETRIES="0",
        PIP_CONFIG_FILE=os.devnull)
    assert "is not on this machine and cannot be fetched" in last_line(done) and "copy " in last_line(done), done.stderr


class Index(BaseHTTPRequestHandler):
    """A package index with one wheel of each project, which serves ranges."""

    wheels: dict[str, Path] = {}
    breaks_after = 0
    served = 0

    def do_GET(self) -> None:
        name = self.path.rsplit("/", 1)[-1]
        if name in self.wheels:
            return self.serve(self.wheels[name].read_bytes())
        project = self.path.strip("/").split("/")[-1].replace("-", "_")
        links = [wheel for wheel in self.wheels if wheel.startswith(project + "-")]
        self.reply(200, "".join(f'<a href="/files/{link}#sha256=0">{link}</a>' for link in links).encode())

    def serve(self, content: bytes) -> None:
        first, last = self.headers["Range"].removeprefix("bytes=").split("-")
        part = content[int(first):int(last) + 1]
        type(self).served += len(part)
        broken = self.breaks_after and len(part) > self.breaks_after
        self.reply(206, part, f"bytes {first}-{last}/{len(content)}", part[: self.breaks_after] if broken else part)
        if broken:
            type(self).breaks_after = 0

    def reply(self, code: int, body: bytes, content_range: str = "", sent: bytes | None = None) -> None:
        self.send_response(code)
        self.send_header("Content-Length", str(len(body)))
        if content_range:
            self.send_header("Content-Range", content_range)
        self.end_headers()
        self.wfile.write(body if sent is None else sent)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def index(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> type[Index]:
    """An index with tiny wheels, whose checksums are the pinned ones, and no pip."""
    checksums = {}
    Index.wheels, Index.breaks_after, Index.served = {}, 0, 0
    for requirement, names in pinned.LIBRARIES.items():
        project, version = requirement.split("==")
        tag = "cp312-cp312" if project == "torch" else "py3-none"
        wheel = tmp_path / f"{project.replace('-', '_')}-{version}-{tag}-manylinux_2_28_x86_64.whl"
        with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in names:
                # A library in more than one run of small files: it does not compress.
                archive.writestr(name, os.urandom(5 << 20 if name.endswith("cpu.so") else 1000))
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(tmp_path / "files")
        checksums.update({name: wheel_parts.sha256(tmp_path / "files" / name) for name in names})
        Index.wheels[wheel.name] = wheel
    server = ThreadingHTTPServer(("127.0.0.1", 0), Index)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    monkeypatch.setattr(pinned, "SHA256", checksums)
    monkeypatch.setattr(wheel_parts, "pip", lambda *_: (1, "No module named pip"))
    monkeypatch.setenv("PIP_INDEX_URL", f"http://127.0.0.1:{server.server_port}/simple")
    monkeypatch.setenv("PAIG_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("PAIG_LIBTORCH", raising=False)
    monkeypatch.setattr(libtorch, "_installed", lambda: None)
    return Index


def test_a_set_is_fetched_once(index: type[Index], tmp_path: Path) -> None:
    folder = libtorch.find()
    assert (folder / "libtorch_cpu.so").stat().st_size == 5 << 20 and (folder / "libtorch.so").exists()
    served = index.served
    assert libtorch.find() == folder and index.served == served


def test_a_truncated_file_is_fetched_again_alone(index: type[Index], capsys: pytest.CaptureFixture[str]) -> None:
    library = libtorch.find() / "libtorch_cpu.so"
    content = library.read_bytes()
    library.write_bytes(content[:1000])
    index.served = 0
    libtorch.find()
    assert library.read_bytes() == content and 5 << 20 < index.served < 6 << 20
    assert "libtorch_cpu.so is damaged; fetching it again" in capsys.readouterr().err


def test_a_broken_download_continues(index: type[Index]) -> None:
    index.breaks_after = 3 << 20
    libtorch.find()
    assert index.served < 9 << 20, "what had arrived was kept"


def test_a_changed_wheel_is_refused(index: type[Index], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(pinned.SHA256, "torch/lib/libc10.so", "0" * 64)
    with pytest.raises(libtorch.LibtorchError, match="libc10.so is not that of the official"):
        libtorch.find()


def test_two_processes_fetch_once(index: type[Index], capsys: pytest.CaptureFixture[str]) -> None:
    folders: list[Path] = []
    threads = [threading.Thread(target=lambda: folders.append(libtorch.find())) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert folders[0] == folders[1] and index.served < 6 << 20
    said = capsys.readouterr().err
    assert said.count("130 MB, once") == 1 and "another process is fetching" in said


def test_the_wheel_holds_what_it_needs() -> None:
    package = Path(libtorch.__file__).parent.parent
    program = package / "bin" / "paig"
    assert os.access(program, os.X_OK) and shutil.which("paig", path=str(Path(sys.executable).parent))
    assert json.dumps(pinned.SHA256).count("/lib/") == 5 and (package / "py.typed").exists()
