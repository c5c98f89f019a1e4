"""The browser page's panel: what to run, the magnet's sliders and handles, numbers and charts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..scenario import Scenario
from . import paint
from .dofs import Dof, number
from .meshes import quaternion
from .panels import drive_name
from .snapshot import Snapshot, axis_rotation

if TYPE_CHECKING:
    from .browser import Page

__all__ = ["CLICKS", "HAND", "Controls"]

HAND = "your hand"

LEGEND = "*Arrows at the tip: dark, the magnetic force; purple, its part along the tract, which drives the tip.*"

STYLE = "<style>.mantine-NumberInput-root { min-width: 3.8rem }</style>"
"""A slider's number has room for six characters, as in 185.73; viser gives it five."""

CLICKS = {"turns the magnet": "turns", "starts there": "starts"}


class Controls:
    """Widgets of one page. A visitor's wish goes through the page's queue; the page's own changes are not wishes."""

    def __init__(self, page: Page) -> None:
        self.page = page
        gui = page.server.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.add_html(STYLE)
        with gui.add_folder("Episode"):
            self._choices(gui)
        self._magnet_folder = gui.add_folder("Magnet")
        with gui.add_folder("Now"):
            self.numbers = gui.add_markdown("")
            gui.add_markdown(LEGEND)
            self._charts(gui)
        self._charted = 0
        self.sliders: list[Any] = []
        self.handles: list[tuple[Any, list[int]]] = []

    def _choices(self, gui: Any) -> None:
        page = self.page
        self.task = gui.add_dropdown("Task", page.tasks)
        self.scenario = gui.add_dropdown("Scenario", tuple(page.scenarios))
        self.policy = gui.add_dropdown("Policy", (HAND, *page.policies))
        self.speed = gui.add_slider("Speed", min=0.1, max=4.0, step=0.1, initial_value=1.0)
        self.go = gui.add_button("Play", color="teal")
        self.again = gui.add_button("Reset", color="gray")
        self.click = gui.add_dropdown("Map click", tuple(CLICKS))
        self.lines = gui.add_checkbox("Field lines", True)
        self._on(self.task, lambda value: page.open(value, self.scenario.value))
        self._on(self.scenario, lambda value: page.open(self.task.value, value))
        self._on(self.policy, page.choose_policy)
        self._on(self.speed, page.set_speed)
        self._on(self.click, page.set_click)
        self._on(self.lines, lambda value: page.scene.show_lines(bool(value)))
        for button, wish in ((self.go, lambda: page.play(not page.playing)), (self.again, page.reset)):
            page.guard.kinds[button._impl.uuid] = bool
            button.on_click(lambda _, wish=wish: page.requests.put(wish))

    def _on(self, widget: Any, wish: Any) -> None:
        """`wish` is done, with the new value, when a visitor and not the page itself changes the widget.

        The value is taken now: before the wish's turn comes, `follow` may have set the widget back.
        """

        def changed(event: Any) -> None:
            if event.client_id is not None:
                value = widget.value
                self.page.requests.put(lambda: wish(value))

        self.page.guard.kinds[widget._impl.uuid] = type(widget.value)
        widget.on_update(changed)

    def _charts(self, gui: Any) -> None:
        start = np.zeros(2)
        axis = {"size": 40, "font": "11px sans-serif", "labelFont": "11px sans-serif", "labelSize": 18}
        time_axis = {**axis, "label": "time [s]", "size": 28}
        self.force_chart, self.way_chart = (
            gui.add_uplot(
                (start, start),
                ({"label": "t [s]"}, {"label": label, "stroke": "rgb({}, {}, {})".format(*colour), "width": 2}),
                scales={"x": {"time": False}},
                axes=(time_axis, {**axis, "label": label, "size": 46}),
                legend={"show": False}, height=115, padding=(12, 10, 0, 0),
            )
            for label, colour in (("force [mN]", paint.DRIVE), ("tip [mm]", paint.INK))
        )  # fmt: skip

    # --- the rig ----------------------------------------------------------------------------------------------------

    def rig(self, scenario: Scenario, magnet: np.ndarray) -> None:
        """Sliders and handles for a scenario's rig, its degrees of freedom at `magnet`."""
        for slider in self.sliders:
            slider.remove()
        self.sliders, self.handles = [], []
        gui, dofs = self.page.server.gui, self.page.dofs
        self.click.visible = len(dofs) == 1  # only then there is a map
        for i, dof in enumerate(dofs):
            low, high = (round(dof.factor * end, 6) for end in (dof.low, dof.high))
            step = 0.01
            with self._magnet_folder:
                value = float(np.clip(self._shown(dof, magnet[i]), low, high))
                slider = gui.add_slider(f"{dof.name} [{dof.unit}]", min=low, max=high, step=step, initial_value=value)
            self._on(slider, lambda value, i=i, dof=dof: self.page.hold(i, value / dof.factor))
            self.sliders.append(slider)
            if dof.turn and dof.magnet is not None:
                self._turn_handle(i, dof, dof.magnet, scenario.rig.magnets[dof.magnet])
        for m, mount in enumerate(scenario.rig.magnets):
            slides = {dof.axis: i for i, dof in enumerate(dofs) if dof.magnet == m and not dof.turn}
            if slides:
                self._slide_handle(m, slides, mount)

    @staticmethod
    def _shown(dof: Dof, value: float) -> float:
        """A command as its slider shows it: in its unit, to two decimals."""
        return round(dof.factor * float(dof.wrapped(value)), 2)

    def _turn_handle(self, i: int, dof: Dof, m: int, mount: Any) -> None:
        """A ring about the magnet to drag round. A handle has a ring only in the plane of two active axes."""
        active = tuple(axis != dof.axis for axis in range(3))
        handle = self.page.server.scene.add_transform_controls(
            f"/turn{i}", scale=2.1 * mount.magnet.reach + 0.01, active_axes=active, disable_axes=True,
            disable_sliders=True, depth_test=False, line_width=4.0,
        )  # fmt: skip

        def dragged(event: Any) -> None:
            if event.client_id is not None and event.phase == "update":
                w, *v = handle.wxyz
                angle = 2 * float(np.arctan2(v[dof.axis], w))
                self.page.requests.put(lambda: self.page.hold(i, angle))

        handle.on_update(dragged)
        self.handles.append((handle, [m, i, dof.axis]))

    def _slide_handle(self, m: int, slides: dict[int, int], mount: Any) -> None:
        """Arrows along the axes a magnet can slide on; slides : axis → number of the degree of freedom."""
        limits = [(-1e3, 1e3)] * 3
        for axis, i in slides.items():
            limits[axis] = mount.position[axis] + self.page.dofs[i].low, mount.position[axis] + self.page.dofs[i].high
        handle = self.page.server.scene.add_transform_controls(
            f"/slide{m}", scale=1.5 * mount.magnet.reach + 0.01, active_axes=tuple(axis in slides for axis in range(3)),
            disable_rotations=True, translation_limits=tuple(limits), depth_test=False, line_width=4.0,
        )  # fmt: skip

        def dragged(event: Any) -> None:
            if event.client_id is not None and event.phase == "update":
                offsets = {i: float(handle.position[axis] - mount.position[axis]) for axis, i in slides.items()}
                self.page.requests.put(lambda: self.page.hold_all(offsets))

        handle.on_update(dragged)
        self.handles.append((handle, [m]))

    # --- following the run ------------------------------------------------------------------------------------------

    def follow(self, now: Snapshot, command: np.ndarray) -> None:
        """Bring sliders and handles to the magnet while a policy moves it; the hand's stay where it put them."""
        held = self.page.policy_name == HAND
        where = command if held else now.magnet
        for dof, slider, value in zip(self.page.dofs, self.sliders, where, strict=True):
            shown = self._shown(dof, value)
            if abs(shown - slider.value) > 1e-6 and not (dof.turn and abs(shown - slider.value) == 360):
                slider.value = float(np.clip(shown, slider.min, slider.max))
        for handle, (m, *turn) in self.handles:
            handle.position = now.magnet_positions[m]
            if turn:
                i, axis = turn
                handle.wxyz = quaternion(axis_rotation("xyz"[axis], float(where[i])))
        label = "Pause" if self.page.playing else "Play"
        if self.go.label != label:
            self.go.label = label
        if self.policy.value != self.page.policy_name:
            self.policy.value = self.page.policy_name

    def restore(self) -> None:
        """Have the choices show what stands, after a wish that was refused."""
        page, click = self.page, next(words for words, kind in CLICKS.items() if kind == self.page.click)
        for widget, value in (
            (self.policy, page.policy_name), (self.task, page.task), (self.scenario, page.scenario_name),
            (self.speed, page.speed), (self.click, click),
        ):  # fmt: skip
            if widget.value != value:
                widget.value = value

    def report(self) -> None:
        """Numbers and charts."""
        page, now = self.page, self.page.shown
        rows = [
            ("tip", f"{number(1e3 * now.tip_arclength)} mm", "goal", f"{1e3 * now.goal:.0f} mm"),
            (
                drive_name(now.scenario),
                f"{number(1e3 * now.drive_force, 1)} mN",
                "lateral",
                f"{1e3 * now.lateral_force:.1f} mN",
            ),
            ("wall", f"{1e3 * now.wall_force:.0f} mN", "score", number(page.score, 1)),
            ("time", f"{now.time:.1f} s", "", ""),
        ]
        words = "| | | | |\n|---|---|---|---|\n" + "\n".join(f"| {' | '.join(row)} |" for row in rows)
        if page.summary is not None:
            words += "\n\n**" + (f"goal in {page.summary['time']:.2f} s" if page.success else "not reached") + "**"
        for line in (page.progress, page.message):
            words += f"\n\n{line}" if line else ""
        if self.numbers.content != words:
            self.numbers.content = words
        past = page.past
        if len(past.time) != self._charted:
            self._charted = len(past.time)
            # A line takes two points: at an episode's start its first stands a control step further, too.
            more = [past.time[0] + 0.1] if len(past.time) == 1 else []
            time = np.array([*past.time, *more])
            for chart, values in ((self.force_chart, past.force), (self.way_chart, past.arclength)):
                chart.data = (time, 1e3 * np.array([*values, *values[: len(more)]]))
