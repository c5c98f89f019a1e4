"""What `make docs` fills in: the tasks' pages, which the environments print of themselves."""

from __future__ import annotations

import re
from typing import Any

MARK = "<!-- task-pages -->"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put the page of every registered task in the place of `MARK`."""
    if MARK not in markdown:
        return markdown
    from magwire_env.envs.pages import page
    from magwire_env.envs.task import TASKS

    pages = [f"## {task}\n\n{re.sub(r'^## ', '### ', page(task), flags=re.MULTILINE)}" for task in TASKS]
    return markdown.replace(MARK, "\n\n".join(pages))
