"""The subcommand `anatomy`: a lumen in words, as a picture, as a file that stands alone, on a page with a wire."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import tyro

from magwire_env.lumen import Lumen, LumenNote
from magwire_env.physics.checks import positive
from magwire_env.plotting import BLUE, GREY, ORANGE, RED, SKY, blank, styled
from magwire_env.words import counted

if TYPE_CHECKING:
    from magwire_env.simulation import Library

__all__ = ["RUN", "Anatomy", "picture", "report", "scene_of", "task_of"]

_TASK = "Anatomy/Trunk-v0"

_STRAIGHT = 10.0
"""m, a bend radius that no anatomy has."""


@dataclass
class Anatomy:
    """Read an anatomy from a file, report on it, draw it, and save it as a .lumen file that stands alone."""

    file: tyro.conf.Positional[Path]
    """A surface, a mask, centrelines, a folder of curves, or a .lumen file."""
    unit: Literal["m", "cm", "mm", "um"] | None = None
    """Unit of the file's coordinates, where it declares none; by default guessed, and said."""
    inlet: tuple[float, float, float] | None = None
    """Where the wire comes in: a point near an end, in the file's own coordinates."""
    invert: bool = False
    """The surface is that of the material about the lumen."""
    radius: float | None = None
    """Radius of the lumen in m, for lines without radii."""
    holes: Literal["refuse", "close"] = "refuse"
    """What to do with holes in the wall that are no ends."""
    wire: float = 0.889e-3
    """Diameter of the wire that is to pass, m; the report names the places too narrow for it."""
    out: Path | None = None
    """Folder to write to; by default here."""
    view: bool = False
    """Then serve a page for the browser, with a wire in the lumen."""
    port: int = 8080
    """Port of the page, or the next free one."""


def anatomy(options: Anatomy) -> None:
    """Print the report, and the names of the picture and of the lumen's file; with `view`, serve the page."""
    start = time.perf_counter()
    wire = positive("wire", options.wire, "m")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LumenNote)  # the report holds them
        lumen = Lumen.load(
            options.file, options.unit, options.inlet, options.invert, options.radius, options.holes
        )  # fmt: skip
    print(report(lumen, wire))
    folder = options.out or Path()
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder / (lumen.name.replace(" ", "_") or "lumen")
    lumen.save(stem.with_suffix(".lumen"))
    print(picture(lumen, stem.with_suffix(".png")), stem.with_suffix(".lumen"), sep="\n")
    print(f"read, drawn and saved in {time.perf_counter() - start:.1f} s")
    if options.view:
        _serve(lumen, wire, options.port)


def _parts(lumen: Lumen) -> str:
    return f"{counted(len(lumen.branches), 'branch', 'branches')}, {counted(len(lumen.leaves), 'end')}"


def report(lumen: Lumen, wire: float) -> str:
    """What a person wants to know of a lumen before they use it; wire : its diameter, m."""
    low, high = (1e3 * corner for corner in lumen.bounds)
    bend, at_bend = lumen.sharpest_bend
    narrow, at_narrow = lumen.narrowest
    rows = [
        f"{lumen.name or 'lumen'}: {_parts(lumen)}, {1e3 * lumen.total_length:.0f} mm of centreline",
        f"axes {lumen.axes or 'not declared'}; from {_shown(low)} to {_shown(high)} mm; "
        f"inlet at {_shown(1e3 * lumen.position('inlet'))} mm",
        f"narrowest {2e3 * narrow:.3g} mm across, {_where(lumen, at_narrow)}; "
        + (f"sharpest bend {1e3 * bend:.3g} mm, {_where(lumen, at_bend)}" if bend < _STRAIGHT else "no bend"),
        "",
        f"{'branch':12s} {'leaves':>12s} {'at mm':>7s} {'length mm':>9s} {'across mm':>15s}  end",
    ]
    for b in lumen.branches:
        r = b.radius(np.linspace(0.0, b.length, 200))
        end = _shown(1e3 * lumen.position(b.name)) if b.name in lumen.leaves else ""
        rows.append(
            f"{b.name:12s} {b.parent or 'inlet':>12s} {1e3 * b.start:7.1f} {1e3 * b.length:9.1f} "
            f"{2e3 * r.min():6.2f} – {2e3 * r.max():6.2f}  {end}"
        )
    tight = lumen.too_narrow_for(wire / 2)
    rows += ["", *(f"note: {note}" for note in lumen.notes)]
    rows += [
        f"note: a wire of {1e3 * wire:.3g} mm does not pass {_where(lumen, place)}, which is {2e3 * radius:.3g} mm "
        "across"
        for place, radius in tight
    ]
    return "\n".join(rows)


def _shown(point: np.ndarray) -> str:
    return "({:.1f}, {:.1f}, {:.1f})".format(*point)


def _where(lumen: Lumen, place: Any) -> str:
    return f"in {place.branch!r} {1e3 * place.s:.1f} mm along, at {_shown(1e3 * lumen.position(place))} mm"


def picture(lumen: Lumen, path: Path) -> Path:
    """Write a picture of a lumen along each axis: its wall, its centrelines, its inlet and its ends by name; .png."""
    from matplotlib.collections import EllipseCollection

    with styled():
        figure, panels = blank(1, 3, (13.0, 4.2))
        for panel, (i, j) in zip(np.ravel(panels), ((0, 1), (0, 2), (1, 2)), strict=True):
            if hasattr(lumen.wall, "vertices"):
                spots = 1e3 * lumen.wall.vertices[:: max(1, len(lumen.wall.vertices) // 20_000)]  # type: ignore[union-attr]
                panel.plot(spots[:, i], spots[:, j], ",", color=GREY, alpha=0.5, zorder=1)
            for b in lumen.branches:
                s = np.linspace(0.0, b.length, max(30, round(b.length / 1e-3)))
                line, across = 1e3 * b.curve.position(s), 2e3 * b.radius(s)
                panel.add_collection(
                    EllipseCollection(
                        across, across, 0 * across, units="xy", offsets=line[:, [i, j]], transOffset=panel.transData,
                        facecolor=SKY, alpha=0.25, linewidth=0, zorder=2,
                    )
                )  # fmt: skip
                panel.plot(line[:, i], line[:, j], color=BLUE, linewidth=0.8, zorder=3)
            at = 1e3 * lumen.position("inlet")
            panel.plot(at[i], at[j], "o", color=RED, zorder=5)
            panel.annotate("inlet", (at[i], at[j]), fontsize=7, color=RED, zorder=6)
            for name in lumen.leaves:
                end = 1e3 * lumen.position(name)
                panel.plot(end[i], end[j], ".", color=ORANGE, zorder=4)
                panel.annotate(name, (end[i], end[j]), fontsize=6, zorder=6)
            panel.set(aspect="equal", xlabel=f"{'xyz'[i]} (mm)", ylabel=f"{'xyz'[j]} (mm)")
            panel.autoscale_view()
        figure.suptitle(f"{lumen.name or 'lumen'}: {_parts(lumen)}")
        figure.savefig(path)
    return path


def scene_of(lumen: Lumen, wire: float = 0.889e-3, length: float = 0.4) -> Any:
    """A scenario with a soft magnetic wire that is fed into the lumen under a magnet that turns and slides over it.

    wire : diameter, m; less where the trunk asks for it. The wire stands about 30 mm in the trunk at the start
    """
    from magwire_env import Scenario
    from magwire_env.physics import BlockMagnet, CylinderMagnet, Guidewire
    from magwire_env.scenario import ActuatedMagnet, Feed, Rig, Slide, Turn

    wire = min(wire, 1.4 * lumen.trunk.narrowest[0])
    area, inertia = np.pi * (wire / 2) ** 2, np.pi * (wire / 2) ** 4 / 4
    length = min(length, 0.9 * max(lumen.length_of(leaf) for leaf in lumen.leaves))
    rod = Guidewire(length, wire / 2, 600.0 / area, 2e-6 / inertia, 1100.0, max(12, round(length / 5e-3)))
    low, high = lumen.bounds
    x, y, _ = lumen.position("inlet").tolist()
    reach = [(round(min(low[i] - at, 0.0), 2), round(max(high[i] - at, 0.0), 2)) for i, at in enumerate((x, y))]
    slides = [Slide(axis, *ends) for axis, ends in zip("xy", reach, strict=True) if ends[0] < ends[1]]
    place = (x, y, float(high[2]) + 0.08)
    magnet = ActuatedMagnet(BlockMagnet((50.8e-3,) * 3, 1.3), place, (Turn("y"), Turn("z"), *slides))
    begin = min(max(min(0.03, lumen.trunk.length / 3, length / 2), 3.5 * length / rod.segments), length)
    rig = Rig((magnet,), feed=Feed(0.03, home=begin))
    tip = CylinderMagnet(0.9 * wire, 8e-3, 1.35)
    return Scenario(name=lumen.name or "anatomy", lumen=lumen, wire=rod, tip=tip, rig=rig, model="free")


def task_of() -> str:
    """The id of the task that the page plays: to the end of the trunk in two minutes; the rig starts at home."""
    from magwire_env import Scenario
    from magwire_env.envs.kinds import Steer
    from magwire_env.envs.task import TASKS, Task, register_task

    class FromHome(Steer):
        name: ClassVar[str] = "steer from home"

        def magnets(self, library: Library, entries: np.ndarray, start: np.ndarray) -> np.ndarray:
            return library.home[entries]

    if _TASK not in TASKS:
        register_task(Task(_TASK, FromHome(), Scenario.paper, time_limit=120.0))
    return _TASK


def _serve(lumen: Lumen, wire: float, port: int) -> None:
    from magwire_env.render.browser import Page

    name = lumen.name or "anatomy"
    print("making the wall that a wire feels, and its kernels the first time …", flush=True)
    page = Page((task_of(),), {name: scene_of(lumen, wire)}, {}, port=port)
    print(f"look at {page.url}; Ctrl-C ends it", flush=True)
    try:
        page.run()
    except KeyboardInterrupt:
        page.server.stop()


RUN: dict[type, Callable[[Any], None]] = {Anatomy: anatomy}
