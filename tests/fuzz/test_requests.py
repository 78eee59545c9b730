"""Requests with parameters that nobody would give: each is answered, and all live on."""

import logging
import time
from contextlib import ExitStack

import msgpack
import pytest

from schemas.sim import SceneSpec
from services.evaluator.service import EvaluatorService
from services.evaluator.settings import EvaluatorSettings
from services.mapper.service import MapperService
from services.mapper.settings import MapperSettings
from services.planner.service import PlannerService
from services.planner.settings import PlannerSettings
from services.runtime.bus import Bus
from services.runtime.command import unpack_reply
from services.runtime.errors import CommandFailed
from services.runtime.loop import Loop
from services.runtime.router import router
from services.runtime.settings import BusSettings
from services.simulator.service import Simulator
from services.simulator.settings import SimulatorSettings
from services.viewer.service import ViewerService
from services.viewer.settings import ViewerSettings
from tests.fuzz.mutation import Mutator, packed
from tests.integration.conftest import running

pytestmark = pytest.mark.integration

POINTS = [[0.0, 0.0, 0.1], [1.0, 2.0, 3.0]]
BOUNDS = [[-0.1, -0.1, 0.0], [0.1, 0.1, 0.1]]
FLAT = {"dtype": "<f4", "shape": [1, 3], "data": bytes(12)}
SCENE = SceneSpec(object="box", height_m=0.3, subdivide=0, deformations=(), seed=0)
ASKED = {
    "mapper": {
        "get": [{}],
        "set": [{"memory": "decay", "half_life_s": 1.0}, {"memory": "persistent"}],
        "reset": [{}],
        "classify": [{"points_m": POINTS, "frame": "world"}, {"points_m": FLAT}],
        "cast_rays": [
            {"origins_m": POINTS, "directions": POINTS, "max_range_m": 2.0, "unknown_stops": True}
        ],
        "distance": [
            {"points_m": POINTS, "reach_m": 0.2, "unknown_is": "occupied"},
            {"bounds_m": BOUNDS, "reach_m": 0.05},
        ],
        "entropy": [{"bounds_m": BOUNDS}],
        "save": [{"path": "map.npz"}, {"path": "map.bt"}],
        "load": [{"path": "map.npz"}, {"path": "map.bt"}],
    },
    "planner": {
        "get": [{}],
        "set": [
            {"strategy": "rings", "rings": 2, "radius_m": 1.2, "elevation_deg": 30.0},
            {"strategy": "orbit", "orbit_deg_s": 20.0, "cameras": 4, "infeasible": "allow"},
            {"strategy": "static", "view_file": "views.txt", "centre_m": [0.0, 0.0]},
            {"strategy": "circle", "drive": "unicycle", "radius_max_m": 2.0, "horizon_s": 5.0},
        ],
    },
    "evaluator": {"prepare": [{"scene": SCENE.model_dump(mode="json")}]},
    "viewer": {"get": [{}]},
    "simulator": {
        "get": [{}],
        "pause": [{}],
        "resume": [{}],
        "step": [{"ticks": 1}],
        "reset": [{}],
        "set": [{"object": "box", "height_m": 0.3, "deformation": "squash:0.2:0.5"}],
    },
}
LONGEST_S = 20.0


def build(name, bus, loop, folder, port):
    match name:
        case "mapper":
            return MapperService(MapperSettings(memory="persistent", files=folder), bus, loop)
        case "planner":
            return PlannerService(PlannerSettings(), bus, loop)
        case "evaluator":
            return EvaluatorService(EvaluatorSettings(samples=1000), bus, loop)
        case "viewer":
            return ViewerService(ViewerSettings(port=port), bus, loop)
        case _:
            return Simulator(SimulatorSettings(), bus, loop)


def wild(mutator, params):
    """Return the bytes of a request gone wrong."""
    request = packed({"params": params})
    match mutator.number(3):
        case 0:
            return mutator.mutant(request).payload
        case 1:
            return packed({"params": {**params, mutator.pick(NAMES): mutator.pick(VALUES)}})
        case _:
            holder = msgpack.unpackb(request)
            if params:
                name = mutator.pick(sorted(holder["params"]))
                holder["params"][name] = mutator.pick(VALUES)
            return packed(holder)


NAMES = ("cameras", "radius_m", "strategy", "path", "points_m", "memory", "height_m", "x" * 60_000)
VALUES = (
    None, True, -1, 0, 64, 2**40, 2**63, -(2**63), 1e300, 5e-324, float("nan"), float("inf"), "",
    "x" * 5000, "../../etc/passwd", "/dev/zero", "/proc/self/mem", "map.ply", "map.glb", ".",
    "a\x00b.npz", [], {}, [[1e300] * 3] * 9, [[float("nan")] * 3], [[0.0] * 3] * 5000, b"\xff" * 90,
    {"dtype": "<f8", "shape": [2**40, 3], "data": b""}, {**FLAT, "y" * 60_000: 1},
    [[-1e9] * 3, [1e9] * 3],
    "static", "dome", "random", "unicycle", "adaptive_scale", "constant_angles",
    0.001, 100.0, "bunny", "torus.stl",
)  # fmt: skip


def storm(tmp_path, num, seed):
    mutator = Mutator(seed)
    refused = dict.fromkeys(ASKED, 0)
    (tmp_path / "views.txt").write_text("rubbish\n")
    with router() as endpoint, ExitStack() as stack:
        settings = BusSettings(connect=endpoint, shm_pool_mib=16)
        buses = {}
        for name in ASKED:
            bus = buses[name] = stack.enter_context(Bus(settings, name))
            loop = Loop(bus)
            build(name, bus, loop, tmp_path, 18180)
            stack.enter_context(running(loop))
        operator = stack.enter_context(Bus(settings, "operator"))
        for name in ASKED:
            if name != "evaluator":
                operator.request(name, "get", timeout_s=LONGEST_S)
        for number in range(num):
            name = mutator.pick(sorted(ASKED))
            verb = mutator.pick(sorted(ASKED[name]))
            payload = wild(mutator, mutator.pick(ASKED[name][verb]))
            key = f"ctl/{name}/{verb}"
            began_s = time.monotonic()
            # Silence is an error, too: NoReply.
            answer = operator._ask(key, LONGEST_S, payload)
            took_s = time.monotonic() - began_s
            assert took_s < LONGEST_S, f"{number}: {key} took {took_s:.1f} s: {payload!r:.300}"
            try:
                unpack_reply(key, answer)
                why = None
            except CommandFailed as error:
                why = str(error)
            if why is not None:
                assert len(why) > len(key) + 2, payload
                assert "malformed reply" not in why, (key, payload, answer[:300])
                refused[name] += 1
        for name in ASKED:
            bad = sum(meter.bad for meter in buses[name].meters if meter.key.startswith("ctl/"))
            assert bad == refused[name]
            if name != "evaluator":
                assert operator.request(name, "get", timeout_s=LONGEST_S)
        operator.request("evaluator", "prepare", {"scene": SCENE.model_dump()}, timeout_s=LONGEST_S)
        operator.request("mapper", "set", {"memory": "persistent"})
        operator.request("mapper", "save", {"path": "after.npz"}, timeout_s=LONGEST_S)
    assert sorted(refused.values())[0] > 0
    outside = {path.name for path in tmp_path.parent.iterdir()}
    assert outside == {tmp_path.name}


@pytest.fixture
def _quiet():
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.usefixtures("_quiet")
def test_every_wild_request_is_answered(tmp_path):
    folder = tmp_path / "inner" / "files"
    folder.mkdir(parents=True)
    storm(folder, 300, 0)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.usefixtures("_quiet")
def test_many_wild_requests_are_answered(tmp_path):
    folder = tmp_path / "inner" / "files"
    folder.mkdir(parents=True)
    storm(folder, 10_000, 1)
