"""The commands that look at a bus, carried out on a live one."""

import json
import os
import signal
import socket
import subprocess
import threading
import time

import pytest

from schemas.topics import CAMERA_CLOUD, CAMERA_INFO, CAMERA_POSE, FORMATION, MAP_FULL
from services.launcher.cli import dispatch
from services.runtime.loop import Loop
from tests.examples import EXAMPLES
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

PERIOD_S = 0.02
POSE, CLOUD = EXAMPLES["camera_pose"][1], EXAMPLES["depth_cloud"][1]


@pytest.fixture(autouse=True)
def keep_signals():
    """The commands take SIGTERM for Ctrl-C; what the tests had comes back."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def services(open_bus):
    """A planner, a mapper and camera 3, each with its loop; the camera's loop is returned."""
    loops = [Loop(open_bus("planner")), Loop(open_bus("mapper")), Loop(open_bus("camera", "3"))]
    planner, mapper, camera = loops

    def speak():
        camera.bus.publish(CAMERA_POSE, POSE, camera=3)
        camera.bus.publish(CAMERA_CLOUD, CLOUD, camera=3)

    camera.every(PERIOD_S, speak)
    camera.every(0.5, lambda: camera.bus.publish(CAMERA_INFO, EXAMPLES["camera_info"][1], camera=3))
    planner.every(PERIOD_S, lambda: planner.bus.publish(FORMATION, EXAMPLES["formation"][1]))
    mapper.answer(MAP_FULL, lambda: EXAMPLES["map_full"][1])
    mapper.on(CAMERA_CLOUD, lambda _: None)
    with running(planner), running(mapper), running(camera):
        yield camera


@pytest.mark.usefixtures("services")
def test_beside_a_replay_figures_are_said_to_be_the_recordings(open_bus, look):
    _, _, err = look("delay", "cams/3/pose", "--duration", "0.5")
    assert "replay" not in err
    open_bus("replay", announce=True)
    for command in ("hz", "delay"):
        _, _, err = look(command, "cams/3/pose", "--duration", "0.5")
        assert err.count("a replay is alive") == 1


@pytest.fixture
def look(endpoint, capsys):
    """Carry out a command; return its exit code, output lines and complaints."""

    def carry_out(*args):
        code = dispatch([*args, "--bus.connect", endpoint])
        out, err = capsys.readouterr()
        return code, out.splitlines(), err

    return carry_out


@pytest.mark.usefixtures("services")
def test_echo_prints_messages_until_there_are_enough(look):
    code, lines, _ = look("echo", "cams/*/pose", "--once")
    assert code == 0
    assert lines[0] == "--- cams/3/pose"
    assert "  position: [1, -2, 0.5]" in lines
    code, lines, _ = look("echo", "cams/3/pose.pose.position[0]", "-n", "3")
    assert (code, lines) == (0, ["1"] * 3)
    code, lines, _ = look("echo", "cams/*/cloud", "--field", "data", "--json", "--once")
    assert json.loads(lines[0])["key"] == "cams/3/cloud"
    assert json.loads(lines[0])["data"].startswith("depth 4 x 3")
    code, lines, _ = look("echo", "**", "--line", "-n", "5")
    assert len(lines) == 5


@pytest.mark.usefixtures("services")
def test_echo_asks_for_what_is_sent_on_request(look):
    code, lines, _ = look("echo", "map/full", "--once", "--line")
    assert code == 0
    assert "bricks of 8 x 8 x 8 voxels" in lines[0]


@pytest.mark.usefixtures("services")
def test_echo_names_the_fields_there_are(look):
    code, _, complaint = look("echo", "formation.radius", "--once")
    assert code == 2
    assert "no 'radius'; known: v, seq" in complaint


@pytest.mark.usefixtures("services")
def test_echo_at_a_limited_rate_counts_what_it_passes_over(look):
    code, lines, complaint = look("echo", "formation", "--line", "--rate", "4", "--duration", "1.1")
    assert code == 0
    assert 2 <= len(lines) <= 5
    assert "more not printed (--rate 0 prints all)" in complaint


def test_hz_prints_the_rate_that_the_sender_had(services, look):
    begin_s, begin = (
        time.monotonic(),
        services.bus.meters.of(CAMERA_POSE, "cams/3/pose", sent=True).count,
    )
    code, lines, _ = look("hz", "cams/3/pose", "--json", "--duration", "2")
    count = services.bus.meters.of(CAMERA_POSE, "cams/3/pose", sent=True).count - begin
    true_hz = count / (time.monotonic() - begin_s)
    report = json.loads(lines[-1])
    assert code == 0
    assert report["rate_hz"] == pytest.approx(true_hz, rel=0.15)
    assert report["lost"] == report["dropped_here"] == 0
    assert report["received_in_all"] == report["sent_in_all"]


@pytest.mark.usefixtures("services")
@pytest.mark.parametrize("command", ["hz", "bw", "delay"])
def test_figures_come_as_a_table(look, command):
    code, lines, _ = look(command, "cams/*/cloud", "formation", "--duration", "1.2")
    assert code == 0
    assert lines[0].startswith("key ")
    assert [line.split()[0] for line in lines[1:3]] == ["cams/3/cloud", "formation"]


def test_list_shows_the_declared_and_the_heard_and_the_strange(services, look):
    stop = threading.Event()

    def strange():
        while not stop.wait(0.05):
            services.bus.republish("other/key", b"hello")

    thread = threading.Thread(target=strange)
    thread.start()
    code, lines, _ = look("list", "--listen", "1.5", "--json")
    stop.set()
    thread.join()
    rows = {row["key"]: row for row in map(json.loads, lines)}
    assert code == 0
    assert rows["cams/3/cloud"]["sender"] == "camera/3"
    assert rows["cams/3/cloud"]["rate_hz"] > 15
    assert rows["sim/state"]["state"] == "no simulator is alive"
    assert rows["map/full"]["state"] == "on request"
    assert rows["other/key"]["message"] == "not in the topic table"
    assert "without envelope" in rows["other/key"]["state"]


@pytest.mark.usefixtures("services")
def test_info_tells_schema_row_sender_reader_and_the_last_message(look):
    code, lines, _ = look("info", "cams/3/cloud")
    text = "\n".join(lines)
    assert code == 0
    assert lines[0].startswith("cams/<i>/cloud  Cloud  15 Hz  latest wins, shared memory  from cam")
    assert "sent by camera/3" in text
    assert "read by mapper/0" in text
    assert "data: depth 4 x 3" in text
    code, lines, _ = look("info", "cams/3/cloud", "--json")
    told = json.loads(lines[0])
    assert "DepthCloud" in told["rows"][0]["schema"]["$defs"]
    assert told["keys"]["cams/3/cloud"]["last"]["camera"] == 3


@pytest.mark.usefixtures("services")
def test_silence_is_explained(look):
    code, lines, complaint = look("echo", "cams/9/pose", "cams/3/poze", "--duration", "2.6")
    assert (code, lines) == (1, [])
    assert "its sender camera/9 is not alive; alive: camera/3, mapper/0, planner/0" in complaint
    assert "perhaps cams/3/pose" in complaint


@pytest.mark.usefixtures("services")
def test_doctor_finds_all_well(look):
    code, lines, _ = look("doctor")
    assert code == 0, lines
    assert lines[-1] == "all is well"
    assert any("3 alive: camera/3, mapper/0, planner/0" in line for line in lines)


def test_doctor_says_when_there_is_no_router(capsys):
    assert dispatch(["doctor", "--bus.connect", "tcp/127.0.0.1:9", "--json"]) == 1
    (verdict,) = map(json.loads, capsys.readouterr().out.splitlines())
    assert verdict["ok"] is False
    assert "nobody listens at tcp/127.0.0.1:9" in verdict["what"]
    assert "encircle run" in verdict["mend"]


def test_doctor_finds_a_router_that_takes_no_more_sessions(capsys):
    with socket.create_server(("127.0.0.1", 0)) as mute:
        where = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        begin_s = time.monotonic()
        assert dispatch(["doctor", "--bus.connect", where]) == 1
        assert time.monotonic() - begin_s < 8
    text = capsys.readouterr().out
    assert "takes connections and no new session" in text
    assert f"encircle router --listen {where}" in text


def test_what_is_no_key_expression_is_named(look):
    code, _, complaint = look("hz", "cams//pose")
    assert code == 2
    assert "key expression 'cams//pose'" in complaint


@pytest.mark.parametrize(
    ("args", "complaint"),
    [
        (["echo", "formation", "-n", "0"], "Input should be greater than 0"),
        (["doctor", "--listen", "1"], "Input should be greater than or equal to 2.5"),
        (["hz"], "at least 1 item"),
    ],
)
def test_wrong_arguments_are_named_with_their_rule(args, complaint, capsys):
    with pytest.raises(SystemExit) as end:
        dispatch(args)
    assert end.value.code == 2
    assert complaint in " ".join(capsys.readouterr().err.split())


@pytest.mark.usefixtures("services")
def test_zenohs_own_command_line_prints_our_messages(endpoint):
    command = ["zenoh", "--connect", endpoint, "--cfg", "scouting/multicast/enabled:false"]
    with subprocess.Popen(
        [*command, "subscribe", "-k", "cams/3/*", "--decoder", "encircle"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as process:
        try:
            lines = [process.stdout.readline() for _ in range(20)]
        finally:
            process.kill()
    poses = [line for line in lines if line.startswith("cams/3/pose")]
    clouds = [line for line in lines if line.startswith("cams/3/cloud")]
    assert poses
    assert clouds
    assert all(line.startswith("cams/3/") for line in lines)
    assert "at 1.000 -2.000 0.500 m" in poses[0]
    assert "depth 4 x 3" in clouds[0]
