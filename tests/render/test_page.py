"""The page in the browser: its own logic without one, then the whole of it in headless Chromium."""

from __future__ import annotations

import dataclasses
import math
import shutil
import socket
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlparse

import numpy as np
import pytest
import viser

import magwire_env
from agents.catalogue import CONTROLLERS
from magwire_env import Scenario
from magwire_env.physics import BlockMagnet, field
from magwire_env.render import meshes
from magwire_env.render.browser import Page
from magwire_env.render.controls import HAND
from magwire_env.scenario.rig import Coil, Rig, Slide, Turn

CHROMIUM = next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)
WIDTH, HEIGHT = 1100, 700
OWN = "the task's own"


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def make(scenarios=None, tasks=("MagWire/Steer-v0",)) -> Page:
    policies = {name: kind.from_env for name, kind in CONTROLLERS.items()}
    return Page(tasks, scenarios or {OWN: None}, policies, port=free_port())


@pytest.fixture
def page():
    page = make()
    yield page
    page.stop()
    page.server.stop()


# --- without a browser ------------------------------------------------------------------------------------------------


def test_only_this_machine_can_look(page):
    assert page.url.startswith("http://127.0.0.1:")
    port = page.server.get_port()
    with socket.create_connection(("127.0.0.1", port), timeout=5):
        pass
    # Another address of this very machine's loopback net is not served.
    with pytest.raises(ConnectionRefusedError), socket.create_connection(("127.0.0.2", port), timeout=5):
        pass


def test_a_policy_reaches_the_goal(page):
    page.choose_policy("MaxForce")
    assert page.settled(120.0)  # time stands still while kernels are compiled
    page.play(True)
    for _ in range(200):
        page.update(0.1)
    assert page.success
    assert page.summary["time"] == pytest.approx(7.5, abs=0.3)
    assert not page.playing
    page.play(True)  # goes on with a new episode
    assert page.summary is None
    assert page.now.time == 0


def test_the_hand_turns_the_magnet_the_short_way(page):
    start = float(page.now.magnet[0])
    page.hold(0, start + 2 * np.pi + 0.3)
    assert page.command[0] == pytest.approx(start + 0.3)
    page.choose_policy("MaxForce")
    page.hold(0, 2.0)
    assert page.policy_name == HAND
    page.play(True)
    for _ in range(20):
        page.update(0.1)
    assert page.now.magnet[0] == pytest.approx(2.0, abs=1e-6)
    assert page.controls.sliders[0].value == pytest.approx(round(np.degrees(2.0), 2))


def test_time_runs_at_the_chosen_speed(page):
    page.speed = 3.0
    page.play(True)
    for _ in range(30):
        page.update(1 / 30)
    assert page.now.time == pytest.approx(3.0, abs=0.11)
    page.play(False)
    page.update(1.0)
    assert page.now.time == pytest.approx(3.0, abs=0.11)


def test_a_click_on_the_map(page):
    target = page.scene.board.world(0.4, 3.0)
    origin = np.array([0.0, -0.6, 0.3])
    page.click_map(origin, (target - origin) / np.linalg.norm(target - origin))
    assert page.command[0] == pytest.approx(3.0, abs=0.02)
    page.click = "starts"
    page.click_map(origin, target - origin)
    assert page.now.tip_arclength == pytest.approx(0.4, abs=2e-3)
    assert page.now.magnet[0] == pytest.approx(3.0, abs=0.02)
    page.click_map(origin, np.array([0.0, -1.0, 0.0]) + [5.0, 0.0, 0.0])  # past the map
    assert page.now.tip_arclength == pytest.approx(0.4, abs=2e-3)


def test_the_map_shows_the_way_that_was_come(page):
    page.choose_policy("MaxForce")
    page.play(True)
    for _ in range(30):
        page.update(0.1)
    drawn = np.asarray(page.scene.board._path.points)
    assert len(drawn) >= 25
    assert np.allclose(drawn[1:, 0], drawn[:-1, 1])  # each piece begins where the last one ended
    assert drawn[-1, 1, 0] - drawn[0, 0, 0] > 0.05 * page.scene.board.width  # to the right: the tip went on
    page.play(False)
    page.reset()
    page.update(0.0)
    assert len(page.scene.board._path.points) == 1
    assert not np.asarray(page.scene.board._path.points).any()


def test_a_policy_that_does_not_fit_says_so():
    page = make()
    page.policies["odd"] = lambda env: (_ for _ in ()).throw(ValueError("of another shape"))
    page.choose_policy("odd")
    assert page.policy_name == HAND
    assert page.message == "odd does not fit here: of another shape"
    page.server.stop()


def test_other_rigs_have_their_own_controls():
    paper = Scenario.paper()
    mount = paper.rig.magnets[0]
    x, y, z = mount.position
    chase = dataclasses.replace(mount, dofs=(Slide("x", -0.1, 0.1), Slide("y", -0.1, 0.1), Turn("y")))
    other = dataclasses.replace(mount, position=(x + 0.1, y, z + 0.02))
    rigs = {
        "chase": Rig((chase,)),
        "two": Rig((dataclasses.replace(mount, dofs=(Turn("y"), Turn("z"))), other)),
        "coils": Rig((), (Coil("x", 1e-3, 0.05), Coil("z", 1e-3, 0.05))),
    }
    page = make({name: dataclasses.replace(paper, coupling="wrench", rig=rig) for name, rig in rigs.items()})
    counts = {}
    for name, rig in rigs.items():
        page.open("MagWire/Steer-v0", name)
        assert page.scene.board is None
        assert len(page.controls.sliders) == len(rig.dofs)
        counts[name] = len(page.controls.handles)
        page.hold(0, 0.05)
        page.play(True)
        for _ in range(6):
            page.update(0.1)
        page.scene.update_lines(page.shown)
        assert page.now.time > 0.3
    assert counts == {"chase": 2, "two": 3, "coils": 0}
    page.server.stop()


def test_tasks_that_draw_a_tract_rebuild_the_scene():
    page = make(tasks=("MagWire/Steer-v0", "MagWire/Track-v0"))
    page.open("MagWire/Track-v0", OWN)
    page.play(True)
    goals = set()
    for _ in range(10):
        page.update(0.1)
        goals.add(page.now.goal)
    assert len(goals) > 3
    other = dataclasses.replace(page.now.scenario, name="another")
    page._build(other)
    assert page.scenario is other
    page.server.stop()


def test_field_lines_follow_the_field():
    magnet = BlockMagnet((0.05,) * 3, 1.3)
    cloud = magnet.dipoles("gauss", 4)
    starts = meshes.seeds(magnet)
    corners = np.vstack(meshes.body_halves(magnet))

    def inside(points):
        return meshes.within(corners, np.eye(3), np.zeros(3), points)

    segments, size = meshes.field_lines(lambda p: field(cloud, p), inside, starts, 0.002, 0.1)
    assert not inside(segments[:, 0]).any()
    ways = segments[:, 1] - segments[:, 0]
    flux = field(cloud, segments.mean(axis=1))
    along = (ways * flux).sum(axis=1) / np.linalg.norm(ways, axis=1) / np.linalg.norm(flux, axis=1)
    assert along.min() > 0.9
    assert np.quantile(along, 0.02) > 0.99
    assert np.linalg.norm(ways, axis=1) == pytest.approx(0.002)
    assert size[0] == pytest.approx(np.linalg.norm(field(cloud, starts[:1])))


def test_meshes_are_closed_outwards():
    """The divergence theorem: the faces' signed volume is the body's."""

    def volume(vertices, faces):
        a, b, c = (vertices[faces[:, i].astype(int)] for i in range(3))
        return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6

    for half in meshes.body_halves(BlockMagnet((0.02, 0.04, 0.06), 1.0)):
        assert volume(*meshes.prism(half)) == pytest.approx(0.02 * 0.04 * 0.03)
    vertices, faces = meshes.tube(np.linspace((0, 0, 0), (0.5, 0, 0), 20), 0.01, 64)
    assert np.hypot(vertices[:, 1], vertices[:, 2]) == pytest.approx(0.01)
    centres = vertices[faces.astype(int)].mean(axis=1)
    edges = vertices[faces.astype(int)]
    normals = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    assert (centres[:, 1] * normals[:, 1] + centres[:, 2] * normals[:, 2] > 0).all()


def test_quaternions_turn_as_their_matrices_do():
    rng = np.random.default_rng(0)
    for _ in range(50):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        w, *v = meshes.quaternion(turn)
        x = rng.normal(size=3)
        assert x + 2 * np.cross(v, np.cross(v, x) + w * x) == pytest.approx(turn @ x)
    for z in ((0, 0, 1.0), (0, 0, -1.0), (1.0, 0, 0)):
        assert meshes.rotation_to(np.array(z)) @ [0, 0, 1] == pytest.approx(z)


# --- in a browser -----------------------------------------------------------------------------------------------------


@pytest.fixture
def visit(page, tmp_path):
    """The page, a Chromium's tab on it, what the browser's console said and the addresses it asked for."""
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    thread = threading.Thread(target=page.run)
    thread.start()
    said, asked = [], []
    flags = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as run:
        browser = run.chromium.launch_persistent_context(
            tmp_path / "profile",
            executable_path=CHROMIUM,
            headless=True,
            args=flags,
            viewport={"width": WIDTH, "height": HEIGHT},
        )
        tab = browser.pages[0]
        tab.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
        tab.on("pageerror", lambda error: said.append(str(error)))
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(page.url)
        tab.get_by_text("Policy").wait_for()
        until(tab, lambda: page.server.get_clients())
        yield page, tab, said, asked
        browser.close()
    page.stop()
    thread.join(timeout=10)


def until(tab, condition, seconds: float = 30.0) -> None:
    for _ in range(int(seconds * 20)):
        if condition():
            return
        tab.wait_for_timeout(50)
    raise AssertionError(f"not within {seconds} s")


def repeated(tab, action, condition) -> None:
    """Do something with the mouse until it takes: drawn in software, the page sees it a few times a second only."""
    for attempt in range(5):
        action()
        try:
            until(tab, condition, 4.0)
            return
        except AssertionError:
            if attempt == 4:
                raise


def on_screen(page: Page, point: np.ndarray) -> tuple[float, float]:
    """Where the visitor sees a point of the scene, pixels."""
    camera = next(iter(page.server.get_clients().values())).camera
    w, *v = camera.wxyz
    gap = point - camera.position
    x, y, z = gap + 2 * np.cross(np.negative(v), np.cross(np.negative(v), gap) + w * gap)
    focal = HEIGHT / 2 / np.tan(camera.fov / 2)
    return WIDTH / 2 + focal * x / z, HEIGHT / 2 + focal * y / z


def test_the_page_in_a_browser(visit, tmp_path):
    page, tab, said, asked = visit

    # The angle slider turns the magnet, and the tip crawls.
    before = float(page.command[0])

    def slide() -> None:
        box = tab.get_by_role("slider").nth(1).bounding_box()
        knob = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        tab.mouse.move(*knob)
        tab.mouse.down()
        tab.mouse.move(knob[0] + 8, knob[1], steps=4)
        tab.mouse.up()

    repeated(tab, slide, lambda: page.command[0] > before + np.radians(6))
    start = page.now.tip_arclength
    tab.get_by_role("button", name="Play").click()
    until(tab, lambda: page.now.tip_arclength > start + 3e-3)
    assert page.now.magnet[0] == pytest.approx(page.command[0], abs=0.01)
    tab.get_by_role("button", name="Pause").click()
    until(tab, lambda: not page.playing)

    # A click on the force map turns it too.
    place = page.scene.board.world(0.7, np.radians(290))

    def gap() -> float:
        return abs(math.remainder(page.command[0] - np.radians(290), 2 * np.pi))  # it may have gone the other way round

    repeated(tab, lambda: tab.mouse.click(*on_screen(page, place)), lambda: gap() < 0.06)

    # The ring about the magnet can be dragged.
    before = float(page.command[0])
    repeated(tab, lambda: drag_ring(page, tab), lambda: abs(page.command[0] - before) > 0.1)

    # A policy plays to the goal.
    def choose() -> None:
        tab.get_by_role("combobox", name="Policy").or_(tab.get_by_role("textbox", name="Policy")).first.click()
        tab.get_by_role("option", name="MaxForce").click()

    # What is left of the drag, drawn late, may take the magnet back: the hand always may.
    repeated(tab, choose, lambda: page.policy_name == "MaxForce")
    tab.get_by_role("button", name="Reset").click()
    until(tab, lambda: page.now.time == 0)
    page.speed = 4.0
    tab.get_by_role("button", name="Play").click()
    until(tab, lambda: page.summary is not None)
    assert page.success
    tab.get_by_text("goal in").wait_for()

    # Another page of this machine, in the same browser, cannot open it, even with the token.
    assert from_another_page(page, tab) == "refused"

    # What is seen.
    shot = tmp_path / "page.png"
    tab.screenshot(path=shot)
    check_picture(shot)
    assert said == []
    assert {urlparse(url).hostname for url in asked if url.startswith("http")} == {"127.0.0.1"}


def from_another_page(page, tab) -> str:
    """What becomes of a connection that the page of another server asks for."""
    with ThreadingHTTPServer(("127.0.0.1", 0), Blank) as other:
        threading.Thread(target=other.serve_forever, daemon=True).start()
        second = tab.context.new_page()
        second.goto(f"http://127.0.0.1:{other.server_address[1]}/")
        address = page.url.replace("http://", "ws://").rstrip("/")
        result = second.evaluate(
            """([address, protocol]) => new Promise(done => {
                const socket = new WebSocket(address, protocol);
                socket.onopen = () => done("open");
                socket.onerror = () => done("refused");
            })""",
            [address, f"viser-v{viser.__version__}"],
        )
        second.close()
        other.shutdown()
    return result


class Blank(BaseHTTPRequestHandler):
    """A page with nothing on it."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>another</title>")

    def log_message(self, *_) -> None:
        pass


def drag_ring(page, tab) -> None:
    """Pull the ring by its middle: a handle shows a quarter turn of it, of 0.65 times its own size."""
    magnet, reach = page.now.magnet_positions[0], 0.65 * page.controls.handles[0][0].scale
    angle = float(page.command[0]) + np.pi / 4

    def ring(angle: float) -> np.ndarray:
        return magnet + reach * np.array([np.sin(angle), 0.0, np.cos(angle)])

    tab.mouse.move(*on_screen(page, ring(angle)))
    tab.wait_for_timeout(1000)
    tab.mouse.down()
    tab.wait_for_timeout(400)
    tab.mouse.move(*on_screen(page, ring(angle + 0.4)), steps=5)
    tab.wait_for_timeout(1000)
    tab.mouse.up()


def check_picture(path: Path) -> None:
    """Both poles are to be seen, and much else besides white."""
    import imageio.v3 as imageio

    image = imageio.imread(path)[..., :3].astype(int)
    red, blue = image[:, : WIDTH - 400, 0], image[:, : WIDTH - 400, 2]
    assert ((blue - red) > 80).sum() > 2000
    assert ((red - blue) > 80).sum() > 2000
    assert (image[:, : WIDTH - 400].std(axis=2) > 5).mean() > 0.1


def test_the_tasks_are_those_registered():
    assert "MagWire/Steer-v0" in magwire_env.TASK_IDS


def test_a_tube_along_points_that_coincide_is_whole():
    points = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 1], [0, 0, 2], [0, 0, 2]], dtype=float)
    vertices, _ = meshes.tube(points, 0.1, 8)
    assert np.allclose(np.hypot(*vertices[:, :2].T), 0.1)
    assert np.allclose(vertices[:, 2].reshape(6, 8), points[:, 2:])
