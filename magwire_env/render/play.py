"""Steer by hand in a window: keyboard or mouse, with a score."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from .dofs import dofs_of, number
from .extra import need
from .frames import Frames, Window
from .snapshot import Snapshot, blend, snapshots

__all__ = ["Game", "play"]

SIZE = (960, 720)
FPS = 30

HELP = "drag in a view or on the map, or arrows, A D, W S    R again    Esc leave"

BEGIN = "any key or a click begins"


class Game:
    """One player's episodes: what is held, what happened, what to show between two control steps.

    reference : gives the time (s) another policy needs from the start of an episode seeded so, or None
    name : of that policy
    """

    def __init__(
        self, env: gym.Env, seed: int = 0, reference: Callable[[int], float | None] | None = None, name: str = "par"
    ) -> None:
        self.env, self.core = env, env.unwrapped.core  # type: ignore[attr-defined]
        self.reference, self.name = reference, name
        self.seed = seed - 1
        self.restart()

    def restart(self) -> None:
        """The next episode."""
        self.seed += 1
        self.env.reset(seed=self.seed)
        self.now = self.before = snapshots(self.core)[0]
        self.scenario = self.now.scenario
        self.dofs = dofs_of(self.scenario)
        self.command = self.now.magnet.copy()
        self.score, self.summary, self.success = 0.0, None, False
        self.waiting = True
        self.to_beat = self.reference(self.seed) if self.reference else None

    @property
    def ended(self) -> bool:
        """Whether the episode is over."""
        return self.summary is not None

    def hold(self, dof: int, value: float) -> None:
        """Command one degree of freedom: a turn to an angle (rad), the short way round; others as far as they go."""
        self.command[dof] = self.dofs[dof].towards(self.command[dof], value)

    def nudge(self, dof: int, way: float, seconds: float) -> None:
        """Move one command at the servo's own speed, `way` ±1."""
        if dof < len(self.command):
            self.hold(dof, self.command[dof] + way * self.dofs[dof].speed * seconds)

    def step(self) -> None:
        """One control period; none while the game waits for its player, or after the end."""
        if self.ended or self.waiting:
            return
        action = self.core.actuation.action(self.command[None])[0]
        _, reward, terminated, truncated, info = self.env.step(action)
        self.score += float(reward)
        self.before, self.now = self.now, snapshots(self.core)[0]
        if terminated or truncated:
            self.summary, self.success = info["summary"], bool(info["is_success"])

    def begin(self) -> None:
        """The player is there."""
        self.waiting = False

    def note(self) -> str:
        """The score, with the time to beat where there is one."""
        beat = f"   {self.name} {self.to_beat:.2f} s" if self.to_beat is not None else ""
        return f"score {number(self.score, 1)}{beat}"

    def verdict(self) -> str:
        """One line at the end of an episode."""
        if self.summary is None:
            return ""
        if not self.success:
            return f"not reached, score {number(self.score, 1)}; R: again"
        wall = f"wall force up to {1e3 * self.summary['peak_wall_force']:.0f} mN"
        return f"goal in {self.summary['time']:.2f} s, {wall}; R: again"

    def point_at(self, frames: Frames, at: tuple[float, float]) -> None:
        """The mouse held at a pixel: turns follow its direction from the magnet, slides its place, the map gives θ."""
        picture = frames.picture(self.scenario)
        if picture.map is not None and picture.map.place(at) is not None:
            self.hold(0, picture.map.place(at)[1])  # type: ignore[index]
            return
        for view, rect in zip((picture.views.plan, picture.views.side), picture.views.frames, strict=True):
            if rect.collidepoint(at):
                self._follow(view, np.array(at))

    def _follow(self, view: Any, at: np.ndarray) -> None:
        if not len(self.now.magnet_positions):
            return
        # The magnet nearest to the mouse is meant.
        gaps = at - view.px(self.now.magnet_positions)
        nearest = int(np.hypot(*gaps.T).argmin())
        across, up = gaps[nearest] * (1, -1) / view.scale
        for i, dof in enumerate(self.dofs):
            if dof.magnet != nearest:
                continue
            if dof.turn and dof.axis == view.depth:
                # About y the pole goes to (sin θ, 0, cos θ); about z the plan's angle is counted from x.
                self.hold(i, float(np.arctan2(across, up) if dof.axis == 1 else np.arctan2(up, across)))
            elif not dof.turn and dof.axis in (view.across, view.up):
                self.hold(i, float(self.now.magnet[i] + (across if dof.axis == view.across else up)))


def play(game: Game, frames_limit: int | None = None) -> None:
    """Run the window until it is closed.

    frames_limit : leave after so many frames; for tests
    """
    pygame = need("pygame", "playing")
    frames, window = Frames(game.core, SIZE), Window(SIZE, f"magwire: {game.scenario.name}")
    keys = [
        (pygame.K_LEFT, pygame.K_RIGHT),
        (pygame.K_DOWN, pygame.K_UP),
        (pygame.K_a, pygame.K_d),
        (pygame.K_s, pygame.K_w),
    ]
    per_step = max(1, round(FPS * game.core.sim.control_period))
    count, running = 0, True
    while running and (frames_limit is None or count < frames_limit):
        if count % per_step == 0:
            game.step()
        share = 1.0 if game.ended else (count % per_step + 1) / per_step
        for event in window.show(shown(game, frames, blend(game.before, game.now, share)), FPS):
            if event.type == pygame.QUIT or (event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE):
                running = False
            elif event.type == pygame.KEYDOWN and event.key == pygame.K_r:
                game.restart()
                frames.forget((0,))
            elif event.type in (pygame.KEYDOWN, pygame.MOUSEBUTTONDOWN):
                game.begin()
        pressed = pygame.key.get_pressed()
        for dof, (less, more) in enumerate(keys):
            game.nudge(dof, float(pressed[more]) - float(pressed[less]), 1 / FPS)
        if pygame.mouse.get_pressed()[0]:
            game.point_at(frames, pygame.mouse.get_pos())
        count += 1
    window.close()


def shown(game: Game, frames: Frames, now: Snapshot) -> Any:
    """The frame of a game's moment, with score and help."""
    surface = frames.surface(0, now, game.note())
    frames.picture(game.scenario).caption(game.verdict(), f"{BEGIN}      {HELP}" if game.waiting else "")
    return surface
