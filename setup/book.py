#!/usr/bin/env python3
"""Assembles the source of the book in target/book/src and checks its links.

Pages keep their paths, so a link means the same on a file server, in an editor and in the book. Linked files outside docs/
(reports, configs, sources, pictures) are copied along; linked pages outside the table of contents become chapters of an
appendix. A link to a folder leads to its README.md; without one it is printed as text.

A link to a file or a heading that does not exist ends the program with exit code 1.
"""

import re
import shutil
import sys
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "target/book/src"
SUMMARY = "docs/SUMMARY.md"
CODE = re.compile(r"(^```.*?^```[^\n]*$|`[^`\n]+`)", re.M | re.S)
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
REFERENCE = re.compile(r"^\[([^\]]+)\]: (\S+)$", re.M)


def resolved(page: str, target: str) -> str:
    """The path from the root of a link on a page."""
    parts: list[str] = []
    for part in (PurePosixPath(page).parent / target).parts:
        if part == "..":
            parts.pop()
        else:
            parts.append(part)
    return "/".join(parts)


def headings(text: str) -> set[str]:
    """The fragments of a page's headings, as GitHub and mdBook form them."""
    found: set[str] = set()
    for title in re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M):
        title = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).replace("`", "").lower()
        base = re.sub(r"[^\w\- ]", "", title).strip().replace(" ", "-")
        name, number = base, 0
        while name in found:
            number += 1
            name = f"{base}-{number}"
        found.add(name)
    return found


class Book:
    def __init__(self) -> None:
        self.broken: list[str] = []
        self.texts: dict[str, str] = {}
        self.pending: list[str] = []

    def text(self, page: str) -> str:
        if page not in self.texts:
            self.texts[page] = (ROOT / page).read_text(encoding="utf-8")
        return self.texts[page]

    def target(self, page: str, link: str) -> str | None:
        """The link as it stands in the book; `None` for text."""
        if "://" in link or link.startswith("mailto:"):
            return link
        path, _, fragment = link.partition("#")
        to = resolved(page, path) if path else page
        if (ROOT / to).is_dir():
            readme = f"{to}/README.md"
            if not (ROOT / readme).is_file():
                return None
            path, to = f"{path.rstrip('/')}/README.md", readme
        if not (ROOT / to).is_file():
            self.broken.append(f"{page}: {link}: no such file")
            return None
        if fragment and to.endswith(".md") and fragment not in headings(self.text(to)):
            self.broken.append(f"{page}: {link}: no such heading")
        self.pending.append(to)
        return f"{path}#{fragment}" if fragment else path

    def converted(self, page: str, text: str) -> str:
        def inline(match: re.Match[str]) -> str:
            target = self.target(page, match[3])
            label = LINK.sub(inline, match[2])
            return label if target is None else f"{match[1]}[{label}]({target})"

        def reference(match: re.Match[str]) -> str:
            target = self.target(page, match[2])
            return f"[{match[1]}]: {target or match[2]}"

        # Code is masked while links are converted: brackets in it are none.
        codes = iter(CODE.findall(text))
        masked = CODE.sub("\0", text)
        masked = REFERENCE.sub(reference, LINK.sub(inline, masked))
        return re.sub("\0", lambda _: next(codes), masked)


def main() -> int:
    shutil.rmtree(OUT, ignore_errors=True)
    book = Book()
    contents = re.sub(r"\]\(([^)]+)\)", lambda m: f"]({resolved(SUMMARY, m[1])})", (ROOT / SUMMARY).read_text(encoding="utf-8"))
    chapters = re.findall(r"\]\(([^)]+)\)", contents)
    book.pending += chapters
    done: set[str] = set()
    appendix: list[str] = []
    while book.pending:
        path = book.pending.pop(0)
        if path in done or path == SUMMARY:
            continue
        done.add(path)
        place = OUT / path
        place.parent.mkdir(parents=True, exist_ok=True)
        if not path.endswith(".md"):
            if (ROOT / path).is_file():
                shutil.copyfile(ROOT / path, place)
            else:
                book.broken.append(f"{path}: no such file")
            continue
        place.write_text(book.converted(path, book.text(path)), encoding="utf-8")
        if path not in chapters:
            appendix.append(f"- [{path.removesuffix('.md').removesuffix('/README')}]({path})")
    text = contents + "\n# Appendix: pages beside the code\n\n" + "\n".join(sorted(appendix)) + "\n"
    (OUT / "SUMMARY.md").write_text(text, encoding="utf-8")
    if book.broken:
        print("broken links:", *sorted(set(book.broken)), sep="\n", file=sys.stderr)
        return 1
    print(f"{len(done)} files, {len(chapters)} chapters and {len(appendix)} pages of the appendix")
    return 0


if __name__ == "__main__":
    sys.exit(main())
