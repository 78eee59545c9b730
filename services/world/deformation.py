"""How the target's body moves in itself, as a function of time alone."""

import math
from collections.abc import Sequence
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from schemas.sim import DeformationKind, DeformationSpec
from services.kernels import deform as kernel
from services.world.errors import DeformationError

KINDS: tuple[DeformationKind, ...] = get_args(DeformationKind)

_CODES = {
    "breathing": kernel.BREATHING,
    "squash": kernel.SQUASH,
    "bend": kernel.BEND,
    "twist": kernel.TWIST,
    "wave": kernel.WAVE,
}
# Amplitude and frequency one sees well without the body leaving the map's box.
_DEFAULTS: dict[str, tuple[float, float]] = {
    "breathing": (0.15, 0.4),
    "squash": (0.15, 0.5),
    "bend": (0.5, 0.3),
    "twist": (0.6, 0.3),
    "wave": (0.08, 0.5),
}
# Beyond, the body would turn inside out (relative: at 1) or shear beyond recognition.
_MAX_AMPLITUDE = {"breathing": 0.8, "squash": 0.8, "bend": 2.0, "twist": 2.0, "wave": 0.8}


def parse_deformations(text: str) -> tuple[DeformationSpec, ...]:
    """Read `kind[:amplitude[:hz[:phase]]]`, several joined by `+`; empty or `rigid` is none.

    Raises:
        DeformationError: If a kind is unknown, a number unreadable or out of its limits.
    """
    if text.strip() in ("", "rigid"):
        return ()
    specs = tuple(_parse_one(part.strip()) for part in text.split("+"))
    check(specs)
    return specs


def check(specs: Sequence[DeformationSpec]) -> None:
    """Refuse amplitudes that turn the body inside out.

    Raises:
        DeformationError: If an amplitude is above its kind's limit.
    """
    for spec in specs:
        limit = _MAX_AMPLITUDE[spec.kind]
        if not spec.amplitude <= limit:
            raise DeformationError(
                f"{spec.kind} amplitude must be 0..{limit}, got {spec.amplitude}"
            )


def deformed(
    rest: NDArray[np.float32], height_m: float, specs: Sequence[DeformationSpec], t_s: float
) -> NDArray[np.float32]:
    """Return the (V, 3) vertices at simulated time `t_s`; a rigid body is returned itself."""
    if not specs:
        return rest
    out = np.empty_like(rest)
    angles = [math.tau * spec.hz * t_s + spec.phase_rad for spec in specs]
    kernel.deform(
        out,
        rest,
        height_m,
        np.array([_CODES[spec.kind] for spec in specs], np.int64),
        np.array([spec.amplitude for spec in specs], np.float64),
        np.array(angles, np.float64),
    )
    return out


def _parse_one(text: str) -> DeformationSpec:
    kind, *fields = text.split(":")
    if kind not in _DEFAULTS or len(fields) > 3:
        raise DeformationError(
            f"no deformation {text!r}; known: rigid, {', '.join(KINDS)}, "
            "each kind[:amplitude[:hz[:phase]]], joined by +"
        )
    try:
        numbers = [float(field) for field in fields]
    except ValueError as error:
        raise DeformationError(f"{text!r}: {error}") from error
    amplitude, hz = _DEFAULTS[kind]
    values = dict(zip(("amplitude", "hz", "phase_rad"), numbers, strict=False))
    try:
        return DeformationSpec.model_validate(
            {"kind": kind, "amplitude": amplitude, "hz": hz} | values
        )
    except ValidationError as error:
        fault = error.errors()[0]
        raise DeformationError(f"{text!r}: {fault['loc'][0]}: {fault['msg']}") from error
