"""The subcommand `cache`: what is kept between runs, where, and how much."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Cache", "cache"]


@dataclass
class Cache:
    """Show what is kept for later: plans of the par, pools of tracts, anatomies, compiled kernels. Clearing costs
    nothing but time."""

    clear: bool = False
    """Delete it."""


def cache(options: Cache) -> None:
    """Print a line for each store, and delete its files if asked to."""
    from magwire_env.validation.report import format_table

    rows: list[tuple[str, ...]] = []
    for what, folder, files in _stores():
        size = sum(file.stat().st_size for file in files)
        rows.append((what, str(len(files)), f"{size / 1e6:.1f} MB", str(folder)))
        if options.clear:
            for file in files:
                file.unlink(missing_ok=True)
    print(format_table(("what", "files", "size", "folder"), rows, flexible=()))
    print(
        "cleared"
        if options.clear
        else "MAGWIRE_CACHE moves all but the kernels, NUMBA_CACHE_DIR the kernels; --clear deletes all"
    )


def _stores() -> Iterator[tuple[str, Path, list[Path]]]:
    """Name, folder and files of every store."""
    import os

    import magwire_env
    from agents.par.cache import default_folder
    from magwire_env.lumen.loading import kept_lumens
    from magwire_env.quasistatic.kept_pools import kept_pools
    from magwire_env.simulation.free.kept_walls import kept_walls

    plans = default_folder()
    yield "plans of the par", plans, sorted(plans.glob("??/*.npz"))
    yield "pools of tracts", kept_pools(), sorted(kept_pools().glob("*.npz"))
    yield "anatomies read", kept_lumens(), sorted(kept_lumens().glob("*.lumen"))
    yield "walls in bricks", kept_walls(), sorted(kept_walls().glob("*.npz"))
    package = Path(magwire_env.__file__).parent
    own = os.environ.get("NUMBA_CACHE_DIR")
    kernels = Path(own) if own else package
    yield "compiled kernels", kernels, sorted(f for end in ("*.nbi", "*.nbc") for f in kernels.rglob(end))
