"""How a service lives: published by each at 1 Hz, derived from the topic table."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from schemas.message import Message, Name

Rate = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=0)]


class TopicStatus(BaseModel):
    """One stream as a service sees it."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    key: Annotated[str, Field(max_length=256)]
    sent: bool
    """True: this service publishes it; False: it subscribes."""
    count: Count
    rate_hz: Rate
    declared_hz: Rate
    """0: no rate is promised."""
    alive: bool
    """The last message is younger than 10 periods."""
    rate_ok: bool
    """At least 90 % of the declared rate."""
    lost: Count
    """Gaps in the sender's numbering, messages the receiver let go, and those that a sender held
    back until newer ones took their place."""
    bad: Count
    """Messages refused as invalid."""
    shared_memory: Count
    """Messages that travelled by shared memory."""


class StageStatus(BaseModel):
    """Time spent in one stage of a service's work."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    name: Name
    count: Count
    total_s: Annotated[float, Field(ge=0)]
    p50_ms: Annotated[float, Field(ge=0)]
    p95_ms: Annotated[float, Field(ge=0)]


class ServiceStatus(Message):
    """One service's health."""

    service: Name
    instance: Name
    version: Annotated[str, Field(max_length=64)] = ""
    """Of encircle, as the sender has it installed; empty: it did not say."""
    host: Annotated[str, Field(max_length=255)] = ""
    """Name of the sender's machine, whose clock its stamps are of; empty: it did not say."""
    pid: Count
    uptime_s: Annotated[float, Field(ge=0)]
    cpu_s: Annotated[float, Field(ge=0)]
    """Processor time since start."""
    rss_bytes: Count
    shm_used: bool | None
    """Whether large payloads go by shared memory; None: this service sends none."""
    bad_messages: Count
    bad_reason: Annotated[str, Field(max_length=300)] = ""
    """The last refusal's text."""
    topics: Annotated[tuple[TopicStatus, ...], Field(max_length=512)]
    stages: Annotated[tuple[StageStatus, ...], Field(max_length=64)]
