"""The browser page trusts no other page, no message, and no wish."""

from __future__ import annotations

import http.client
import os
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

import msgspec
import numpy as np
import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from agents.catalogue import CONTROLLERS
from agents.cli.main import main as magwire
from agents.cli.view import _policies
from magwire_env.render.controls import HAND
from magwire_env.render.guard import Guard, acceptable
from magwire_env.render.thinking import Thinker

from .test_page import OWN, make

PROTOCOL = f"viser-v{viser.__version__}"
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, 1.0], "fov": 1.0, "near": 0.1,
    "far": 10.0, "image_height": 100, "image_width": 100, "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, 1.0],
}  # fmt: skip


@pytest.fixture
def page():
    page = make(tasks=("MagWire/Steer-v0", "MagWire/Track-v0"))
    yield page
    page.stop()
    page.server.stop()


def status(page, path: str, **headers) -> int:
    """What the page answers to a plain request."""
    connection = http.client.HTTPConnection("127.0.0.1", page.server.get_port(), timeout=10)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    try:
        return connection.getresponse().status
    finally:
        connection.close()


def opened(page, origin: str | None = None, path: str | None = None):
    """A visitor's connection; raises `InvalidStatus` if it is refused."""
    address = f"ws://127.0.0.1:{page.server.get_port()}/{page.guard.token if path is None else path}"
    return connect(address, origin=origin, subprotocols=[PROTOCOL], max_size=None)


# --- who may come in --------------------------------------------------------------------------------------------------


def test_the_address_opens_the_page(page):
    port = page.server.get_port()
    assert page.url == f"http://127.0.0.1:{port}/{page.guard.token}/"
    with urllib.request.urlopen(page.url, timeout=10) as answer:
        assert b"viser" in answer.read()[:5000].lower()
        assert answer.headers["Referrer-Policy"] == "no-referrer"
        assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    with opened(page, origin=f"http://127.0.0.1:{port}") as socket:
        assert len(socket.recv(timeout=10)) > 1000


def test_two_pages_have_two_tokens(page):
    other = make()
    assert len(page.guard.token) > 20
    assert other.guard.token != page.guard.token
    other.server.stop()


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "http://evil.example:PORT", "http://127.0.0.1:9099", "http://localhost:PORT", "null",
     "https://127.0.0.1.evil.example:PORT"],
)  # fmt: skip
def test_another_origin_is_refused(page, origin):
    origin = origin.replace("PORT", str(page.server.get_port()))
    with pytest.raises(InvalidStatus) as refused, opened(page, origin=origin):
        pass
    assert refused.value.response.status_code == 403
    assert b"may not use this one" in refused.value.response.body


@pytest.mark.parametrize("path", ["", "x", "../", "favicon.ico", "TOKEN%20", "token"])
def test_without_the_token_nothing_is_served(page, path):
    path = path.replace("TOKEN", page.guard.token)
    with pytest.raises(InvalidStatus) as refused, opened(page, path=path):
        pass
    assert b"it ends in a token" in refused.value.response.body
    assert status(page, f"/{path}", Host=f"127.0.0.1:{page.server.get_port()}") == 403


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "", "127.0.0.1.evil.example", "10.0.0.1", "[::1"])
def test_another_host_is_refused(page, host):
    """A name that an attacker has resolve to this machine."""
    assert status(page, f"/{page.guard.token}/", Host=host) == 403
    assert status(page, f"/{page.guard.token}/") == 403  # none at all


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST:1", "[::1]:8080"])
def test_this_machines_own_names_are_let_in(page, host):
    assert status(page, f"/{page.guard.token}/", Host=host) == 200


def test_paths_lead_nowhere_else(page):
    host = f"127.0.0.1:{page.server.get_port()}"
    for path in ("../../etc/passwd", "%2e%2e/%2e%2e/etc/passwd", "..\\..\\etc\\passwd", "/etc/passwd", "index.html/x"):
        assert status(page, f"/{page.guard.token}/{path}", Host=host) == 404


def test_a_page_for_the_network_warns_and_knows_its_names(capsys):
    guard = Guard("0.0.0.0", "t")
    assert "everybody who reaches 0.0.0.0 over the network" in capsys.readouterr().err
    assert guard.why_not("/t/", "192.168.0.7:8080", "http://192.168.0.7:8080") == ""
    assert guard.why_not("/t/", "evil.example:8080", None) == "this page is not at 'evil.example:8080'"
    assert guard.why_not("/t/", "192.168.0.7:8080", "http://192.168.0.7:9099")
    assert guard.address(8080) == "http://0.0.0.0:8080/t/"
    Guard("127.0.0.1"), Guard("localhost"), Guard("::1")
    assert capsys.readouterr().err == ""


def test_a_viser_that_serves_in_another_way_is_not_let_through():
    with pytest.raises(RuntimeError, match="cannot be guarded"), Guard("127.0.0.1").over_servers():
        pass


# --- what may be sent -------------------------------------------------------------------------------------------------


def update(widget, value) -> dict:
    return {"type": "GuiUpdateMessage", "uuid": widget._impl.uuid, "updates": {"value": value}}


def sent(page, *messages) -> None:
    """A visitor comes, sends messages, and is read."""
    with opened(page) as socket:
        for message in (CAMERA, *messages):
            socket.send(message if isinstance(message, (bytes, str)) else msgspec.msgpack.encode(message))
            if message is CAMERA:
                until(lambda: page.server.get_clients())
        socket.ping().wait(10)
        time.sleep(0.2)  # viser hands what it is sent on to a thread


def until(condition, seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_what_the_pages_script_sends_is_acceptable(page):
    assert acceptable(msgspec.msgpack.encode(CAMERA), {})
    kinds = page.guard.kinds
    assert acceptable(msgspec.msgpack.encode(update(page.controls.speed, 2)), kinds)
    for widget, value in ((page.controls.speed, "2"), (page.controls.speed, True), (page.controls.policy, 2)):
        assert not acceptable(msgspec.msgpack.encode(update(widget, value)), kinds)
    sent(page, update(page.controls.speed, 2.5), update(page.controls.policy, "MaxForce"))
    page.update(0.01)
    assert page.settled(60)
    assert (page.speed, page.policy_name) == (2.5, "MaxForce")


def malformed(page, rng, count: int):
    """Messages that no page's script sends: garbage, other types, other fields, other kinds, NaN."""
    widgets = (page.controls.speed, page.controls.policy, page.controls.go, *page.controls.sliders)
    values = [float("nan"), float("inf"), -1e308, None, [], {}, "x" * 10_000, b"\x00", 2**63, [[[]]], "runs/evil"]
    types = ["ShareUrlRequest", "FileTransferStartUpload", "RunJavascriptMessage", "GuiRemoveMessage", "Nothing", "", 5,
             "CommandTriggerMessage", "ViewerCameraMessage", "TransformControlsUpdateMessage", "SceneNodeClickMessage",
             ]  # fmt: skip
    for number in range(count):
        widget, value = widgets[rng.integers(len(widgets))], values[rng.integers(len(values))]
        attribute = ("update_cb", "removed", "value", "is_button", "sync_cb", "label", "min")[rng.integers(7)]
        kind = number % 8
        if kind == 0:
            yield rng.bytes(int(rng.integers(0, 200)))
        elif kind == 1:
            yield "text"
        elif kind == 2:
            yield update(widget, value)
        elif kind == 3:
            yield update(widget, 1.0) | {"updates": {attribute: value, "value": 1.0}}
        elif kind == 4:
            yield {"type": types[rng.integers(len(types))], "uuid": widget._impl.uuid, "name": "/turn0"}
        elif kind == 5:
            yield CAMERA | {list(CAMERA)[1 + rng.integers(len(CAMERA) - 1)]: value}
        elif kind == 6:
            place = {"position": [value] * 3, "wxyz": [float("nan")] * int(rng.integers(5))}
            yield {"type": "TransformControlsUpdateMessage", "name": "/turn0"} | place
        else:
            yield msgspec.msgpack.encode([update(widget, value)] * int(rng.integers(3)))


def test_after_a_thousand_malformed_messages_the_page_works(page, capfd):
    thread = threading.Thread(target=page.run)
    thread.start()
    messages = list(malformed(page, np.random.default_rng(0), 1000))
    sent(page, *messages)
    assert page.guard.refused > 800
    seen = page.updates
    until(lambda: page.updates > seen + 5)
    sent(page, update(page.controls.policy, "MaxForce"))
    until(lambda: page.policy_name == "MaxForce", 60)
    sent(page, update(page.controls.go, True))
    until(lambda: page.now.time > 0.5, 60)
    page.stop()
    thread.join(10)
    assert not thread.is_alive()
    assert "Traceback" not in capfd.readouterr().err


def test_a_message_that_is_too_long_ends_its_own_connection_alone(page):
    with opened(page) as other:
        other.recv(timeout=10)
        with opened(page) as socket:
            socket.send(b"x" * 200_000)
            until(lambda: socket.close_code is not None or _closed(socket))
        other.ping().wait(10)


VISITS = """
import sys
from websockets.sync.client import connect
for number in range(int(sys.argv[3])):
    socket = connect(sys.argv[1], subprotocols=[sys.argv[2]], max_size=None)
    socket.recv(timeout=30)
    socket.socket.shutdown(2) if number % 2 else socket.close()  # every second one is cut off
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_visitors_who_leave_take_all_of_theirs_along(page):
    def visited(times: int) -> tuple[int, int]:
        """Open files, and MB of memory, after so many visits from another process."""
        address = f"ws://127.0.0.1:{page.server.get_port()}/{page.guard.token}"
        visitor = subprocess.Popen([sys.executable, "-c", VISITS, address, PROTOCOL, str(times)])
        while visitor.poll() is None:
            page.update(0.02)
        assert visitor.returncode == 0
        until(lambda: not page.server.get_clients())
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return len(list(Path("/proc/self/fd").iterdir())), pages * os.sysconf("SC_PAGE_SIZE") // 10**6

    files, memory = visited(20)
    more_files, more_memory = visited(60)
    assert more_files <= files + 2
    assert more_memory < memory + 20  # once 0.6 MB a visitor stayed


def _closed(socket) -> bool:
    try:
        socket.recv(timeout=0.1)
    except TimeoutError:
        return False
    except Exception:
        return True
    return False


# --- wishes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        (lambda page: page.choose_policy("runs/evil"), "no such policy"),
        (lambda page: page.open("MagWire/None-v9", OWN), "no such task or scenario"),
        (lambda page: page.open("MagWire/Steer-v0", "/etc/passwd"), "no such task or scenario"),
        (lambda page: page.set_click("burns"), "does no such thing"),
        (lambda page: page.set_speed(float("nan")), "the speed lies between 0.1 and 4"),
        (lambda page: page.set_speed(1e308), "the speed lies between 0.1 and 4"),
        (lambda page: page.hold(0, float("nan")), "cannot go there"),
        (lambda page: page.hold(7, 0.0), "cannot go there"),
        (lambda page: page.hold(0, "x"), "could not be done"),
        (lambda page: page.click_map(np.full(3, np.nan), np.ones(3)), ""),
        (lambda page: 1 / 0, "could not be done: ZeroDivisionError"),
    ],
)  # fmt: skip
def test_a_wish_that_cannot_be_done_ends_nothing(page, wish, words):
    before = page.task, page.scenario_name, page.policy_name, page.speed, page.click, page.command.tolist()
    page.requests.put(lambda: wish(page))
    page.play(True)
    page.update(0.15)
    assert words in page.message
    assert before == (page.task, page.scenario_name, page.policy_name, page.speed, page.click, page.command.tolist())
    assert page.now.time > 0
    page.controls.restore()
    assert page.controls.task.value == page.task
    assert page.controls.speed.value == 1.0


def test_a_policy_that_fails_on_the_way_gives_the_magnet_back(page):
    class Fails:
        calls = 0

        def predict(self, observation, **_):
            self.calls += 1
            if self.calls > 3:
                raise IndexError("out of plans")
            return np.zeros(1, dtype=np.float32), None

    page.policies["fails"] = lambda env: Fails()
    page.choose_policy("fails")
    assert page.settled(10)
    page.play(True)
    for _ in range(6):
        page.update(0.1)
    assert page.message == "fails failed: IndexError: out of plans"
    assert (page.policy_name, page.playing) == (HAND, False)
    page.play(True)
    page.update(0.15)
    assert page.now.time > 0.3


# --- slow policies ----------------------------------------------------------------------------------------------------


class Slow:
    """A policy that plans until it is let go."""

    def __init__(self) -> None:
        self.go, self.planning = threading.Event(), threading.Event()

    def predict(self, observation, episode_start, **_):
        if episode_start[0]:
            self.planning.set()
            self.go.wait(30)
        return np.full(1, 0.3, dtype=np.float32), None


def test_while_a_policy_plans_the_page_goes_on_and_says_so(page):
    slow = Slow()
    page.policies["slow"] = lambda env: slow
    page.play(True)
    page.choose_policy("slow")
    assert slow.planning.wait(10)
    seen = page.updates
    for _ in range(10):
        page.update(0.1)
    assert page.updates == seen + 10
    assert page.now.time == 0
    assert page.progress.startswith("slow is planning, ")
    page.controls.report()
    assert "slow is planning" in page.controls.numbers.content
    slow.go.set()
    assert page.settled(10)
    page.update(0.15)
    assert page.now.time > 0
    assert page.progress == ""


def test_the_hand_takes_over_from_a_policy_that_plans(page):
    slow = Slow()
    page.policies["slow"] = lambda env: slow
    page.choose_policy("slow")
    page.hold(0, 2.0)
    assert page.policy_name == HAND
    page.play(True)
    page.update(0.25)
    assert page.now.time > 0.1
    slow.go.set()
    page.update(0.1)
    assert page.policy_name == HAND


def test_an_episode_that_is_reset_is_planned_anew(page):
    """With a policy of its own: the old one's thread may still be at work."""
    made = []
    page.policies["slow"] = lambda env: made.append(Slow()) or made[-1]
    page.choose_policy("slow")
    assert made[0].planning.wait(10)
    page.reset()
    made[0].go.set()
    until(lambda: len(made) == 2)
    assert page.progress
    made[1].go.set()
    assert page.settled(10)
    page.play(True)
    page.update(0.15)
    assert page.now.time > 0


def test_the_other_task_comes_when_it_is_ready(page, monkeypatch):
    ready = threading.Event()
    real = page._opener.think
    monkeypatch.setattr(page._opener, "think", lambda what, work: real(what, lambda: ready.wait(30) and work()))
    page.open("MagWire/Track-v0", OWN)
    page.play(True)
    page.update(0.15)
    assert page.task == "MagWire/Steer-v0"
    assert "MagWire/Track-v0 is being made ready" in page.progress
    assert page.now.time > 0
    ready.set()
    assert page.settled(30)
    assert page.task == "MagWire/Track-v0"


def test_work_is_done_in_turn_and_given_up():
    thinker, order = Thinker(), []
    first = thinker.think("first", lambda: time.sleep(0.1) or order.append(1))
    second = thinker.think("second", lambda: order.append(2))
    second.give_up()
    third = thinker.think("third", lambda: 1 / 0)
    assert third.wait(10)
    assert order == [1]
    assert first.wait(0)
    with pytest.raises(ZeroDivisionError):
        third.result()


# --- the command ------------------------------------------------------------------------------------------------------


def test_only_policies_named_on_the_command_line_are_listed(tmp_path, monkeypatch):
    (tmp_path / "runs" / "evil" / "best").mkdir(parents=True)
    (tmp_path / "runs" / "evil" / "best" / "model.zip").write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    assert list(_policies((), trust=False)) == list(CONTROLLERS)
    with pytest.raises(SystemExit, match="can carry a program"):
        magwire(["view", "runs/evil"])
