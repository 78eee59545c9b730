"""`encircle health` beside a live bus: healthy is who is on it, and nobody else."""

import pytest

from services.launcher.cli import dispatch

pytestmark = pytest.mark.integration
ASKED = pytest.mark.usefixtures("asked_at")


@pytest.fixture
def asked_at(endpoint, monkeypatch):
    monkeypatch.setenv("ENCIRCLE_BUS_CONNECT", endpoint)


@ASKED
def test_a_router_that_takes_a_session_is_healthy(capsys):
    assert dispatch(["health", "router"]) == 0
    assert capsys.readouterr().out == "router: healthy\n"


@ASKED
def test_who_is_on_the_bus_is_healthy_and_who_left_is_not(open_bus, capsys):
    with open_bus("camera", "3", announce=True), open_bus("mapper", announce=True):
        assert dispatch(["health", "camera/3"]) == 0
        assert dispatch(["health", "mapper"]) == 0
        assert dispatch(["health", "camera/2"]) == 1
        said = capsys.readouterr().err
        assert "camera/2 is not on the bus; there are: camera/3, mapper/0" in said
    assert dispatch(["health", "camera/3"]) == 1
    assert "there are: none" in capsys.readouterr().err


@ASKED
def test_one_who_does_not_listen_yet_is_not_healthy(open_bus):
    with open_bus("mapper"):
        assert dispatch(["health", "mapper"]) == 1


def test_without_a_router_nobody_is_healthy(monkeypatch, capsys):
    monkeypatch.setenv("ENCIRCLE_BUS_CONNECT", "tcp/127.0.0.1:1")
    assert dispatch(["health", "mapper"]) == 1
    assert "tcp/127.0.0.1:1" in capsys.readouterr().err


@ASKED
def test_a_name_of_no_service_is_answered_with_the_known_ones(capsys):
    assert dispatch(["health", "cameras"]) == 2
    assert "no service 'cameras'; known: router, " in capsys.readouterr().err
