"""Carries out the README in a fresh clone: every block, in order, as a reader would type it.

    python tests/readme.py            # clones this repository's HEAD into a temporary folder; a quarter of an hour

Shell lines go to one bash, Python blocks to one interpreter of the clone's own environment. A few lines are cut short,
and say so: `make test` and `make bench` run a part, since `.ci/run` runs the whole, and what waits for a person is
ended once it has begun.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from tests.support.pages import blocks  # noqa: E402

SHORTER = {"make test": "tests/envs/test_pages.py", "make bench": "--only plans"}
"""Line → the ARGS with which it is run here."""

WAITS = {"magwire play": "", "magwire view": "look at http"}
"""Line that waits for a person → what it prints once it is there; it is ended after that, or after `PATIENCE`."""

PATIENCE = 60.0
"""s that such a line has to begin."""

PYTHON = """
import sys
names = {"__name__": "readme"}
for line in sys.stdin:
    path = line.strip()
    try:
        exec(compile(open(path, encoding="utf-8").read(), path, "exec"), names)
    except BaseException as error:
        import traceback
        traceback.print_exc()
        print("\\x00failed", flush=True)
    else:
        print("\\x00done", flush=True)
"""


class Session:
    """A process that is given one thing after the other and answers with a line that begins with a NUL."""

    def __init__(self, command: list[str], folder: Path) -> None:
        environment = dict(os.environ, SDL_VIDEODRIVER="dummy", MPLBACKEND="Agg")
        for name in ("PYTHONPATH", "VIRTUAL_ENV", "MAGWIRE_CACHE"):
            environment.pop(name, None)
        environment["MAGWIRE_CACHE"] = str(folder.parent / "cache")
        self._process = subprocess.Popen(
            command, cwd=folder, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, encoding="utf-8", bufsize=1,
        )  # fmt: skip

    def give(self, text: str) -> str:
        """Give it a text; its output is printed as it comes. Returns the answer."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()
        for line in self._process.stdout:
            if line.startswith("\x00"):
                return line[1:].strip()
            print("    " + line, end="", flush=True)
        raise SystemExit(f"{text!r} ended the session")

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()


class Shell(Session):
    """A bash, which keeps what `. .venv/bin/activate` sets."""

    def __init__(self, folder: Path) -> None:
        super().__init__(["bash"], folder)

    def type(self, command: str) -> None:
        """Type a line; ends the program if it fails."""
        print(f"$ {command}", flush=True)
        began = time.monotonic()
        line = command
        if command in SHORTER:
            line = f"ARGS='{SHORTER[command]}' {command}"
            print(f"    (a part: ARGS={SHORTER[command]!r})", flush=True)
        if command in WAITS:
            line = self._ended_once_there(command)
        answer = self.give(f"{line} < /dev/null; printf '\\0%s\\n' $?")
        print(f"    ({time.monotonic() - began:.0f} s)", flush=True)
        if answer != "0":
            raise SystemExit(f"README: {command!r} ended with status {answer}")

    def _ended_once_there(self, command: str) -> str:
        """A line that starts `command`, looks whether it lives and has said what it must, and ends it."""
        said = WAITS[command]
        look = f'grep -q "{said}" "$log"' if said else "[ $i -ge 10 ]"
        return (
            f'log=$(mktemp); {command} > "$log" 2>&1 & pid=$!; there=1; for i in $(seq {PATIENCE:.0f}); do sleep 1; '
            f'kill -0 $pid 2> /dev/null || break; if {look}; then there=0; break; fi; done; cat "$log"; '
            "kill $pid 2> /dev/null; wait $pid 2> /dev/null; (exit $there)"
        )


def main(clone_of: Path, keep: bool) -> None:
    """Clone, follow, tidy up."""
    place = Path(tempfile.mkdtemp(prefix="readme-"))
    clone = place / "clone"
    shell = python = None
    try:
        subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", str(clone_of), str(clone)], check=True)
        shell = Shell(clone)
        for number, block in enumerate(blocks(clone / "README.md")):
            if block.file is not None:
                print(f"# writes {block.file}", flush=True)
                (clone / block.file).write_text(block.code, encoding="utf-8")
            elif block.language == "sh":
                for command in block.commands:
                    shell.type(command)
            elif block.language == "python":
                if python is None:
                    python = Session([str(clone / ".venv/bin/python"), "-u", "-c", PYTHON], clone)
                path = place / f"block{number}.py"
                path.write_text(block.code, encoding="utf-8")
                print(f">>> the block of line {block.line}", flush=True)
                if python.give(str(path)) != "done":
                    raise SystemExit(f"README: the Python block of line {block.line} failed")
            else:
                raise SystemExit(f"README: nobody carries out the block of line {block.line} ({block.language})")
        print("the README works as written")
    finally:
        for session in (shell, python):
            if session is not None:
                session.end()
        if keep:
            print(f"kept: {clone}")
        else:
            shutil.rmtree(place, ignore_errors=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--of", type=Path, default=ROOT, help="the repository that is cloned")
    parser.add_argument("--keep", action="store_true", help="keep the clone")
    options = parser.parse_args()
    main(options.of, options.keep)
