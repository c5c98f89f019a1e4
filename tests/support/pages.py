"""Markdown pages as a reader follows them: their blocks in order.

A block whose first line is ``# name.ext`` is a file to be written. Python blocks share one namespace. Shell blocks are
lines to be typed; what stands behind ``#`` is for the reader.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Block", "blocks", "follow"]


@dataclass(frozen=True)
class Block:
    """A fenced block.

    language : of the fence; "" for text that nobody types
    code : its text
    line : of the page where it begins
    """

    language: str
    code: str
    line: int

    @property
    def file(self) -> str | None:
        """The name of the file that it is, if it is one."""
        match = re.match(r"# ([\w./-]+\.(?:py|toml|csv))\n", self.code)
        return match[1] if match else None

    @property
    def commands(self) -> list[str]:
        """The lines of a shell block, without comments."""
        return [line for line in (re.sub(r"\s+#.*", "", x).strip() for x in self.code.splitlines()) if line]


def blocks(page: Path) -> Iterator[Block]:
    """The fenced blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    for match in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        yield Block(match[1], match[2], text[: match.start()].count("\n") + 1)


def follow(page: Path, shell: Callable[[str], Any], folder: Path) -> int:
    """Do what a page says, standing in `folder`; returns how many blocks were carried out.

    shell : is given every line that a reader types
    """
    names: dict[str, Any] = {"__name__": page.stem}
    count = 0
    for block in blocks(page):
        if block.file is not None:
            (folder / block.file).write_text(block.code, encoding="utf-8")
        elif block.language == "python":
            exec(compile("\n" * block.line + block.code, str(page), "exec"), names)
        elif block.language == "sh":
            for command in block.commands:
                shell(command)
        elif block.language:
            raise AssertionError(f"{page.name}:{block.line}: a block of {block.language} that nothing carries out")
        else:
            continue
        count += 1
    return count


def words(command: str) -> list[str]:
    """A line of a shell without pipes, as a program gets it."""
    return shlex.split(command)
