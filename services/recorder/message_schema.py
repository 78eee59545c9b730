"""What a message looks like, as JSON Schema, for whoever opens a recording without us."""

import json
from functools import cache
from typing import Any

from schemas.message import Envelope
from schemas.topics import Topic


@cache
def json_schema(topic: Topic[Any]) -> str:
    """Return the schema of a topic's msgpack maps: the envelope's fields and the message's.

    Byte strings are given as JSON Schema's base64, since JSON has none; msgpack has them raw.
    """
    message = topic.adapter.json_schema(ref_template="#/$defs/{model}")
    definitions = message.pop("$defs", {})
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": schema_name(topic),
        "type": "object",
        "allOf": [Envelope.model_json_schema(), message],
        "$defs": definitions,
    }
    return json.dumps(schema, sort_keys=True)


def schema_name(topic: Topic[Any]) -> str:
    """Return the name of a topic's message, e.g. `encircle.CameraPose`."""
    if isinstance(topic.message, type):
        return f"encircle.{topic.message.__name__}"
    return f"encircle.{topic.key.rsplit('/', 1)[-1].capitalize()}"
