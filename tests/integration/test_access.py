"""Certificates, roles and passwords between real sessions: who and what is let through."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

pytest.importorskip("cryptography", reason="encircle[security] is not installed")

from schemas.topics import CAMERA_POSE, SIM_STATE, TARGET_POSE
from services.launcher import authority
from services.runtime.bus import Bus
from services.runtime.errors import BusUnavailable, CommandFailed, NoReply
from services.runtime.guard import file_name
from services.runtime.log import start_logging
from services.runtime.loop import Loop
from services.runtime.reader import Reader
from services.runtime.router import router
from services.runtime.settings import BusSettings
from tests.examples import EXAMPLES
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

POSE = EXAMPLES["camera_pose"][1]
ROLES = ("router", "camera/0", "camera/1", "mapper", "planner", "simulator", "viewer", "operator")
Join = Callable[..., Bus]


def certify(folder: Path, *roles: str, days: int = 1) -> Path:
    authority.create(folder, days=2)
    for role in roles:
        authority.issue(folder, role, file_name(role), ["127.0.0.1"], days)
    return folder


@pytest.fixture(scope="module")
def certs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return certify(tmp_path_factory.mktemp("certs"), *ROLES)


@pytest.fixture
def join(certs: Path) -> Iterator[Join]:
    """Join a guarded bus: `join("camera", "0")`, with certificates from elsewhere if told so."""
    with ExitStack() as stack:
        endpoint = stack.enter_context(router(settings=BusSettings(certs=certs)))

        def join_one(
            service: str, instance: str | None = None, folder: Path | None = certs, role: str = ""
        ) -> Bus:
            settings = BusSettings(connect=endpoint, certs=folder, role=role, shm_pool_mib=16)
            bus = stack.enter_context(Bus(settings, service, instance))
            bus.presence.announce()
            return bus

        yield join_one


def tell_until_heard(bus: Bus, camera: int, reader: Reader) -> None:
    """Say where a camera is until the reader has heard of it, for 10 s at most."""
    for _ in range(100):
        bus.publish(CAMERA_POSE, POSE.model_copy(update={"camera": camera}), camera=camera)
        try:
            assert reader.get(0.1).camera == camera
            return
        except TimeoutError:
            continue
    pytest.fail(f"nothing of camera {camera} came through in 10 s")


def test_a_camera_speaks_for_itself_and_cannot_for_another(join: Join) -> None:
    mapper, honest, liar = join("mapper"), join("camera", "0"), join("camera", "1")
    with mapper.every(CAMERA_POSE) as poses:
        tell_until_heard(honest, 0, poses)
        tell_until_heard(liar, 1, poses)  # Its links are good.
        for _ in range(5):
            liar.publish(CAMERA_POSE, POSE.model_copy(update={"camera": 0}), camera=0)
        liar.publish(CAMERA_POSE, POSE.model_copy(update={"camera": 1}), camera=1)
        assert poses.get(5).camera == 1  # In order: the lies before it were not let through.


@pytest.mark.parametrize("service", ["planner", "mapper"])
def test_the_truth_is_kept_from_those_who_must_find_it(join: Join, service: str) -> None:
    simulator, blind, seeing = join("simulator"), join(service), join("camera", "0")
    state, target = EXAMPLES["sim_state"][1], EXAMPLES["target_pose"][1]
    with (
        seeing.every(SIM_STATE) as seen,
        blind.every(SIM_STATE) as hidden,
        blind.every(TARGET_POSE) as told,
    ):
        for reader, topic, message in ((told, TARGET_POSE, target), (seen, SIM_STATE, state)):
            for _ in range(100):
                simulator.publish(topic, message)
                try:
                    reader.get(0.1)
                    break
                except TimeoutError:
                    continue
            else:
                pytest.fail(f"{topic.key} did not come through in 10 s")
        with pytest.raises(TimeoutError):
            hidden.get(0.3)


def test_a_viewer_cannot_command_unless_it_was_granted(join: Join) -> None:
    simulator = join("simulator")
    loop, carried_out = Loop(simulator), []
    loop.serve("pause", lambda params: carried_out.append(params) or {"state": "paused"})
    with running(loop):
        assert join("viewer", role="operator").request("simulator", "pause") == {"state": "paused"}
        assert len(carried_out) == 1
        with pytest.raises((NoReply, CommandFailed)):
            join("viewer").request("simulator", "pause", timeout_s=1.0)
        assert len(carried_out) == 1


def strangers(tmp_path: Path, certs: Path, kind: str) -> Path | None:
    """Return the certificates that a stranger of a kind comes with."""
    if kind == "none":
        return None
    if kind == "foreign":
        return certify(tmp_path / "foreign", "camera/0")
    expired = tmp_path / "expired"
    expired.mkdir()
    for name in ("ca.pem", "ca.key"):
        (expired / name).write_bytes((certs / name).read_bytes())
    authority.issue(expired, "camera/0", "camera-0", ["127.0.0.1"], days=-1)
    return expired


@pytest.mark.parametrize("kind", ["none", "foreign", "expired"])
def test_a_stranger_is_not_let_in_and_that_is_logged(
    join: Join,
    certs: Path,
    tmp_path: Path,
    kind: str,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(logging.root, "handlers", [])  # What is put there is gone with the test.
    start_logging("test", "warning")
    mapper, honest = join("mapper"), join("camera", "1")
    stranger = join("camera", "0", strangers(tmp_path, certs, kind))
    with mapper.every(CAMERA_POSE) as poses:
        tell_until_heard(honest, 1, poses)
        for _ in range(20):
            stranger.publish(CAMERA_POSE, POSE.model_copy(update={"camera": 0}), camera=0)
        assert "camera/0" not in mapper.presence.everybody()
        with pytest.raises(TimeoutError):
            poses.get(0.5)
        tell_until_heard(honest, 1, poses)  # Nobody else has suffered.
    said = "".join(capfd.readouterr())
    assert {"none": "UnknownCA", "foreign": "DecryptError", "expired": "expired"}[kind] in said


def test_a_certificate_that_is_missing_is_named_with_what_makes_it(tmp_path: Path) -> None:
    certify(tmp_path / "certs", "router")
    with pytest.raises(BusUnavailable, match=r"mapper\.pem is not there; encircle certs issue"):
        Bus(BusSettings(certs=tmp_path / "certs"), "mapper")


def test_a_password_opens_the_bus_and_a_wrong_one_does_not(tmp_path: Path) -> None:
    users = tmp_path / "users"
    users.write_text("ring:secret\n")
    known = BusSettings(user="ring", password="secret", users_file=users)
    with router(settings=known) as endpoint:
        settings = known.model_copy(update={"connect": endpoint})
        wrong = settings.model_copy(update={"password": type(known.password)("guess")})
        with (
            Bus(settings, "mapper") as mapper,
            Bus(settings, "camera", "1") as camera,
            Bus(wrong, "camera", "0") as stranger,
            mapper.every(CAMERA_POSE) as poses,
        ):
            tell_until_heard(camera, 1, poses)
            for _ in range(20):
                stranger.publish(CAMERA_POSE, POSE.model_copy(update={"camera": 0}), camera=0)
            with pytest.raises(TimeoutError):
                poses.get(0.5)
