"""``python -m agents.cli`` is the `magwire` command."""

from .main import main

main()
