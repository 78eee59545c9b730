"""`encircle doctor`: is all well, and if not, what mends it?"""

import time

from schemas.topics import CAMERA_POSE, FORMATION, MAP_SUMMARY, QUALITY, TARGET_POSE
from services.inspector import plain
from services.inspector.checkup import examine
from services.inspector.facts import Facts
from services.inspector.listening_service import Write, open_bus
from services.inspector.settings import DoctorSettings
from services.inspector.verdict import Level
from services.inspector.witness_service import RECENT_S, Witness, ask_for_router
from services.runtime.heartbeat import installed_version

_STAMPED = (TARGET_POSE, CAMERA_POSE, FORMATION, MAP_SUMMARY, QUALITY)
"""Small and frequent: of many the quickest tells how far apart two clocks are."""


def doctor(settings: DoctorSettings, out: Write) -> int:
    """Examine, and print what was found.

    Returns:
        0 when all is well, 1 when anything failed.
    """
    verdicts = examine(_look(settings), installed_version())
    failed = [verdict for verdict in verdicts if verdict.level is Level.FAILED]
    for verdict in verdicts:
        for line in [plain.as_json(verdict.plain())] if settings.json_ else verdict.lines():
            out(line)
    if not settings.json_:
        out(f"{len(failed)} failed" if failed else "all is well")
    return 1 if failed else 0


def _look(settings: DoctorSettings) -> Facts:
    router = ask_for_router(settings.bus)
    if router.fault:
        return Facts(settings.bus.connect, router)
    also = [topic.expression() for topic in _STAMPED]
    recent_s = settings.listen + RECENT_S
    with open_bus(settings.bus) as bus, Witness(bus, settings.bus, also, recent_s) as witness:
        time.sleep(settings.listen)
        return witness.facts(router)
