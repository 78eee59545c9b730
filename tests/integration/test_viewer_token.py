"""The page behind a token, asked by real clients: by HTTP, and by websockets."""

import http.client
import logging
import socket
import time
from pathlib import Path

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from services.runtime.loop import Loop
from services.viewer.admission import AdmissionError
from services.viewer.service import ViewerService
from services.viewer.settings import ViewerSettings
from services.viewer.web_guard import GuardMissing, WebGuard
from tests.integration.conftest import running
from tests.integration.viewer_browser import TIMEOUT_S, Browser

pytestmark = pytest.mark.integration

CHROMIUM = Path("/usr/bin/chromium")
TOKEN = "correct horse/battery+staple"
IN_ADDRESS = "correct%20horse%2Fbattery%2Bstaple"
WRONG = IN_ADDRESS.replace("c", "k", 1)


@pytest.fixture
def start(open_bus):
    """Start a viewer and return its service; stopped when the test ends."""
    ends = []

    def begin(**settings):
        bus = open_bus("viewer")
        loop = Loop(bus)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        service = ViewerService(ViewerSettings(port=port, **settings), bus, loop)
        block = running(loop)
        block.__enter__()
        ends.append(block)
        return service

    yield begin
    for block in ends:
        block.__exit__(None, None, None)


def ask(port, path, **headers):
    """Return status, headers and body of a page."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    told = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return told


def enter(port, path="/", **headers):
    """Open the websocket."""
    return connect(
        f"ws://127.0.0.1:{port}{path}",
        subprotocols=[f"viser-v{viser.__version__}"],
        additional_headers=headers,
        compression=None,
        max_size=None,
    )


def refused(port, path="/", **headers):
    with pytest.raises(InvalidStatus) as told, enter(port, path, **headers):
        pass
    return told.value.response.status_code


def told_anything(connection):
    return Browser(connection).until(lambda message: message.get("type"))


def test_without_the_token_nothing_is_served(start, caplog):
    service = start(token=TOKEN)
    port = service.web.port
    with caplog.at_level(logging.WARNING):
        for path in ("/", "/index.html", "/assets/x", "/?token=", "/?token=%ff", "//?tokens=x",
                     f"/?token={WRONG}", f"/?token={IN_ADDRESS}&token={WRONG}"):  # fmt: skip
            status, headers, body = ask(port, path)
            assert status == 403, path
            assert b"<html" not in body
            assert "Set-Cookie" not in headers
        assert refused(port) == 403
        assert refused(port, f"/?token={WRONG}") == 403
        assert refused(port, Cookie="encircle_00000000=00; ;;=;") == 403
    assert service.web.num_browsers == 0
    assert service._get({})["refused"] == 11
    lines = [text for text in caplog.messages if "refused 127.0.0.1" in text]
    assert len(lines) == 1
    assert TOKEN not in caplog.text


def test_the_right_token_opens_page_and_websocket(start):
    port = start(token=TOKEN).web.port
    status, headers, _ = ask(port, f"/?token={IN_ADDRESS}&x=a%20b")
    assert (status, headers["Location"]) == (303, "/?x=a+b")
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Lax" in cookie
    assert "battery" not in cookie
    shown = cookie.partition(";")[0]
    status, _, body = ask(port, "/", Cookie=f"other=1; {shown}")
    assert status == 200
    assert b"<html" in body
    with enter(port, Cookie=shown) as connection:
        assert told_anything(connection)
    with enter(port, f"/?token={IN_ADDRESS}") as connection:
        assert told_anything(connection)
    assert ask(port, "/", Cookie=shown[:-1] + "x")[0] == 403
    assert ask(port, "/../../etc/passwd", Cookie=shown)[0] == 404


def test_a_page_reconnects_to_a_viewer_that_was_started_anew_but_not_after_a_new_token(start):
    first, again, other = (start(token=each).web.port for each in (TOKEN, TOKEN, "another " * 3))
    shown = ask(first, f"/?token={IN_ADDRESS}")[1]["Set-Cookie"].partition(";")[0]
    assert ask(again, "/", Cookie=shown)[0] == 200
    assert ask(other, "/", Cookie=shown)[0] == 403


def test_the_way_in_never_leads_elsewhere(start):
    port = start(token=TOKEN).web.port
    for path in (f"//evil.example/?token={IN_ADDRESS}", f"/\\evil.example?token={IN_ADDRESS}"):
        assert ask(port, path)[1]["Location"] == "/"
    told = ask(port, f"/?token={IN_ADDRESS}&a=%0d%0aSet-Cookie:%20b=c")[1]
    assert told["Location"] == "/?a=%0D%0ASet-Cookie%3A+b%3Dc"
    assert told["Set-Cookie"].startswith("encircle_")


def test_another_site_that_the_browser_has_open_cannot_steer(start):
    port = start().web.port
    own = f"127.0.0.1:{port}"
    assert refused(port, Origin="https://evil.example") == 403
    assert refused(port, Origin="null") == 403
    assert refused(port, Origin=f"http://127.0.0.1:{port + 1}") == 403
    with enter(port, Origin=f"http://{own}") as connection:
        assert told_anything(connection)
    assert ask(port, "/", Host=f"evil.example:{port}")[0] == 403
    for name in ("localhost", "[::1]", "192.168.1.5", "robot", "robot.local"):
        assert ask(port, "/", Host=f"{name}:{port}")[0] == 200, name


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"host": "0.0.0.0"}, "ENCIRCLE_VIEWER_TOKEN"),
        ({"host": "192.168.1.5"}, "--insecure"),
        ({"host": "::"}, "lets the network steer"),
        ({"token": "short secret"}, "12 characters; it must have 16 or more"),
    ],
)
def test_a_page_for_all_the_network_needs_a_good_token(open_bus, settings, says):
    bus = open_bus("viewer")
    with pytest.raises(AdmissionError, match=says) as told:
        ViewerService(ViewerSettings(**settings), bus, Loop(bus))
    assert "secret" not in str(told.value)


def test_whoever_means_it_serves_all_the_network_without_one(start):
    port = start(host="0.0.0.0", insecure=True).web.port
    assert ask(port, "/")[0] == 200


def test_the_token_is_never_logged(monkeypatch):
    monkeypatch.setenv("ENCIRCLE_VIEWER_TOKEN", TOKEN)
    settings = ViewerSettings()
    assert settings.token.get_secret_value() == TOKEN
    assert TOKEN not in settings.model_dump_json() + repr(settings)


def test_a_server_that_is_begun_in_another_way_is_noticed(start):
    guard = start()._guard
    with pytest.raises(GuardMissing), WebGuard(guard._admission).before_servers():
        pass


@pytest.mark.skipif(not CHROMIUM.exists(), reason=f"{CHROMIUM} is not installed")
@pytest.mark.slow
@pytest.mark.timeout(180)
def test_a_real_browser_comes_in_by_the_address_and_stays_by_the_cookie(start):
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    service = start(token=TOKEN)
    page_at = f"http://127.0.0.1:{service.web.port}/"
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        assert page.goto(page_at).status == 403
        assert service.web.num_browsers == 0
        page.goto(f"{page_at}?token={IN_ADDRESS}")
        assert "token" not in page.url
        eventually(page, lambda: service.web.num_browsers == 1)
        assert page.reload().status == 200
        eventually(page, lambda: service.web.num_browsers == 1)
        assert page.evaluate("document.cookie") == ""
        browser.close()


def eventually(page, happens):
    """Let the browser go on until it is so."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while not happens():
        assert time.monotonic() < deadline_s
        page.wait_for_timeout(50)
