"""Single files out of wheels of a package index, read through HTTP range requests.

An interrupted fetch continues where it stopped: a file appears under its name only when its CRC-32 has been checked.
"""

from __future__ import annotations

import hashlib
import http.client
import io
import json
import os
import re
import struct
import subprocess
import sys
import tempfile
import urllib.parse
import urllib.request
import zipfile
import zlib
from pathlib import Path
from typing import IO, Callable, Iterator, Sequence

BLOCK = 1 << 20
USUAL_INDEX = "https://pypi.org/simple"
# Settings of pip and uv that name an index, in this order.
INDEX_SETTINGS = ("PIP_INDEX_URL", "UV_DEFAULT_INDEX", "UV_INDEX_URL")

# Called with bytes fetched so far and bytes in all.
Progress = Callable[[int, int], None]

# What reading a part of a wheel can fail with, where a retry or the whole wheel may help.
UNREADABLE = (
    OSError, http.client.HTTPException, zipfile.BadZipFile, zlib.error, struct.error, KeyError, IndexError, ValueError)


class Damaged(Exception):
    """A file whose size or checksum differs from the expected one."""


def pip(*arguments: str) -> tuple[int, str]:
    """Exit code and output of the running Python's pip."""
    command = [sys.executable, "-m", "pip", *arguments, "--disable-pip-version-check"]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return done.returncode, done.stdout


def pip_tags(python_tag: str, platforms: Sequence[str]) -> list[str]:
    """Options of pip for wheels of other Pythons and platforms than the running one."""
    version = f"{python_tag[2]}.{python_tag[3:]}"
    tags = ["--python-version", version, "--only-binary=:all:"]
    return tags + [part for platform in platforms for part in ("--platform", platform)]


class RangeReader(io.RawIOBase):
    """A remote file for `zipfile`, served by HTTP range requests."""

    def __init__(self, url: str) -> None:
        self.url, self.position = url, 0
        with self.open(0, 0) as answer:
            content_range = answer.headers.get("Content-Range", "")
            if answer.status != 206 or "/" not in content_range:
                raise OSError("the index does not serve byte ranges")
            self.size = int(content_range.rsplit("/", 1)[1])

    def open(self, first: int, last: int) -> http.client.HTTPResponse:
        request = urllib.request.Request(self.url, headers={"Range": f"bytes={first}-{last}"})
        answer: http.client.HTTPResponse = urllib.request.urlopen(request, timeout=60)
        return answer

    def seekable(self) -> bool:
        return True

    def readable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        self.position = offset + (0, self.position, self.size)[whence]
        return self.position

    def tell(self) -> int:
        return self.position

    def read(self, count: int = -1) -> bytes:
        end = self.size if count < 0 else min(self.size, self.position + count)
        if end <= self.position:
            return b""
        with self.open(self.position, end - 1) as answer:
            data = answer.read()
        self.position += len(data)
        return data

    def read_at(self, offset: int, count: int) -> bytes:
        self.seek(offset)
        return self.read(count)


def wheel_urls(requirements: Sequence[str], python_tag: str, platforms: Sequence[str]) -> list[str]:
    """The addresses of wheels: from the index that pip is set up for, without pip from that of the environment or PyPI."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.json")
        code, output = pip("install", "--dry-run", "--ignore-installed", "--no-deps", "--quiet", "--target", folder,
                           "--report", str(report), *pip_tags(python_tag, platforms), *requirements)
        if code and "No module named pip" in output:
            return [wheel_of_index(requirement, python_tag, platforms) for requirement in requirements]
        if code:
            raise OSError(last_line(output))
        installed = json.loads(report.read_text())["install"]
    urls: dict[str, str] = {
        item["metadata"]["name"].lower().replace("_", "-"): item["download_info"]["url"] for item in installed}
    return [urls[requirement.split("==")[0]] for requirement in requirements]


def wheel_of_index(requirement: str, python_tag: str, platforms: Sequence[str]) -> str:
    """The address of a wheel on a simple index (PEP 503), in its HTML form."""
    index = next((os.environ[name] for name in INDEX_SETTINGS if os.environ.get(name)), USUAL_INDEX)
    project, version = requirement.split("==")
    page = f"{index.rstrip('/')}/{project}/"
    request = urllib.request.Request(page, headers={"Accept": "text/html"})
    with urllib.request.urlopen(request, timeout=60) as answer:
        links = re.findall(r'href="([^"]+)"', answer.read().decode())
    stem = f"{project.replace('-', '_')}-{version}-"
    link: str
    for link in links:
        name = urllib.parse.unquote(urllib.parse.urlsplit(link).path.rsplit("/", 1)[-1])
        fits = f"-{python_tag}-" in name or "-py3-" in name
        if name.startswith(stem) and fits and any(platform in name for platform in platforms):
            return urllib.parse.urljoin(page, link)
    raise OSError(f"{page} has no wheel of {requirement} for {platforms[0]}")


def last_line(output: str) -> str:
    return (output.strip().splitlines() or ["pip failed without a message"])[-1]


def members_in(archive: zipfile.ZipFile, requirement: str, prefixes: Sequence[str]) -> list[zipfile.ZipInfo]:
    """The files of a wheel whose names begin with one of the prefixes."""
    members = [m for m in archive.infolist() if m.filename.startswith(tuple(prefixes)) and not m.is_dir()]
    for prefix in prefixes:
        if not any(m.filename.startswith(prefix) for m in members):
            raise Damaged(f"{requirement}: the wheel holds no {prefix}; expected the layout of the official Linux wheels")
    return members


def complete(member: zipfile.ZipInfo, target: Path) -> bool:
    path = target / member.filename
    return path.exists() and path.stat().st_size == member.file_size


def runs_of(members: list[zipfile.ZipInfo], limit: int = 64 * BLOCK) -> Iterator[list[zipfile.ZipInfo]]:
    """Neighbouring members joined into runs, so that ten thousand headers cost a few requests, not ten thousand."""
    run: list[zipfile.ZipInfo] = []
    for member in sorted(members, key=lambda m: m.header_offset):
        if run and (member.header_offset - run[-1].header_offset > 4 * BLOCK
                    or member.header_offset + member.compress_size - run[0].header_offset > limit):
            yield run
            run = []
        run.append(member)
    if run:
        yield run


def place(member: zipfile.ZipInfo, data: bytes, target: Path) -> None:
    """Check `data` against the member's CRC and size and let it appear under its name in one step."""
    if len(data) != member.file_size or zlib.crc32(data) != member.CRC:
        raise Damaged(f"{member.filename}: damaged in transfer (size or CRC-32 differs); run the command again")
    path = target / member.filename
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(data)
    partial.replace(path)


def inflate(member: zipfile.ZipInfo, compressed: bytes) -> bytes:
    return compressed if member.compress_type == zipfile.ZIP_STORED else zlib.decompress(compressed, -15)


def fetch_large(reader: RangeReader, member: zipfile.ZipInfo, target: Path, count: Callable[[int], None]) -> None:
    """A large member is kept as it arrives, so that an interruption costs no more than one block."""
    header = struct.unpack("<HH", reader.read_at(member.header_offset + 26, 4))
    start = member.header_offset + 30 + sum(header)
    kept = target / (member.filename.replace("/", "_") + ".download")
    have = kept.stat().st_size if kept.exists() else 0
    count(min(have, member.compress_size))
    with open(kept, "ab") as file:
        while have < member.compress_size:
            with reader.open(start + have, start + member.compress_size - 1) as answer:
                while block := answer.read(BLOCK):
                    file.write(block)
                    have += len(block)
                    count(len(block))
    data = kept.read_bytes()
    kept.unlink()
    if len(data) != member.compress_size:
        raise Damaged(f"{member.filename}: received {len(data)} bytes, expected {member.compress_size}; run the command "
                      "again")
    place(member, inflate(member, data), target)


def fetch_run(reader: RangeReader, run: list[zipfile.ZipInfo], target: Path, count: Callable[[int], None]) -> None:
    first, last = run[0].header_offset, run[-1]
    # The local header's own extra field can be longer than the directory's: 4 KiB of slack covers it.
    end = last.header_offset + 30 + len(last.filename) + last.compress_size + 4096
    data = reader.read_at(first, min(end, reader.size) - first)
    for member in run:
        offset = member.header_offset - first
        name_length, extra_length = struct.unpack("<HH", data[offset + 26:offset + 30])
        offset += 30 + name_length + extra_length
        place(member, inflate(member, data[offset:offset + member.compress_size]), target)
    count(len(data))


def fetch(url: str, requirement: str, prefixes: Sequence[str], target: Path, progress: Progress) -> None:
    """Fetch the files of a remote wheel that `target` lacks."""
    reader = RangeReader(url)
    with zipfile.ZipFile(reader) as archive:
        members = members_in(archive, requirement, prefixes)
    missing = [m for m in members if not complete(m, target)]
    total, done = sum(m.compress_size for m in missing), 0

    def count(fetched: int) -> None:
        nonlocal done
        done += fetched
        progress(min(done, total), total)

    for run in runs_of([m for m in missing if m.compress_size <= 4 * BLOCK]):
        fetch_run(reader, run, target, count)
    for member in (m for m in missing if m.compress_size > 4 * BLOCK):
        fetch_large(reader, member, target, count)


def unpack(wheel: Path | IO[bytes], requirement: str, prefixes: Sequence[str], target: Path) -> None:
    """The same from a wheel on the disk."""
    with zipfile.ZipFile(wheel) as archive:
        for member in members_in(archive, requirement, prefixes):
            if not complete(member, target):
                place(member, archive.read(member), target)


def sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()
