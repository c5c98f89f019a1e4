"""``python -m agents.par``: the bracket of a task or a scenario, as a table."""

from .bracket import main

if __name__ == "__main__":
    main()
