"""Requests to a service and its answer: `ctl/<service>[/<i>]/<verb>`."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field


class CommandRequest(BaseModel):
    """What is asked; `params` depend on the verb."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    params: Annotated[dict[str, Any], Field(max_length=64)] = {}


class CommandReply(BaseModel):
    """The answer: a result, or an error that names the value, the rule and the choices."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    ok: bool
    error: Annotated[str, Field(max_length=4096)] = ""
    result: dict[str, Any] = {}
