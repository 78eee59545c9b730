"""The fields of a message as one reads them: names, types, rules, what they mean."""

import ast
import inspect
import textwrap
from collections.abc import Iterator
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from schemas.message import Envelope, Message

_RULES = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}
_LENGTHS = {"min_length": "at least", "max_length": "at most"}
MAX_DEPTH = 4


def schema_lines(message: Any) -> list[str]:
    """Write the fields of a row's message, a line each; those of a model in it indented.

    Args:
        message: `Topic.message`: a message class, or a union of several.
    """
    lines = ["# every message:", *_lines(Envelope, 0)]
    for kind in kinds(message):
        about = (inspect.getdoc(kind) or "").partition("\n")[0]
        lines += [f"# {kind.__name__}: {about}", *_lines(kind, 0)]
    return lines


def kinds(message: Any) -> list[type[Message]]:
    """Return the message classes that a row allows."""
    bare = get_args(message)[0] if get_origin(message) is Annotated else message
    return list(get_args(bare)) if get_origin(bare) in (Union, UnionType) else [bare]


def _lines(model: type[BaseModel], depth: int) -> Iterator[str]:
    meanings = _meanings(model)
    pad = "  " * depth
    for name, field in model.model_fields.items():
        rules = _rules(field.metadata)
        said = f"{pad}{name}: {_type_words(field.annotation)}{f' {rules}' if rules else ''}"
        default = "" if field.is_required() else f" = {field.default!r}"
        meaning = meanings.get(name, "")
        yield f"{said}{default}{f'  # {meaning}' if meaning else ''}"
        for inner in dict.fromkeys(_models(field.annotation)):
            if depth < MAX_DEPTH:
                yield from _lines(inner, depth + 1)


def _type_words(kind: Any) -> str:
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        rules = _rules(inner[1:])
        return _type_words(inner[0]) + (f" {rules}" if rules else "")
    if origin is Literal:
        return " | ".join(repr(choice) for choice in inner)
    if origin in (Union, UnionType):
        parts = [part for part in inner if part not in (memoryview, bytearray)]
        return " | ".join(_type_words(part) for part in parts)
    if origin is tuple:
        if inner[-1] is Ellipsis:
            return f"[{_type_words(inner[0])}, ...]"
        return f"[{', '.join(_type_words(part) for part in inner)}]"
    return "none" if kind is NoneType else getattr(kind, "__name__", str(kind))


def _rules(metadata: Any) -> str:
    words = []
    for each in metadata:
        for part in (each, *getattr(each, "metadata", ())):
            words += [
                f"{sign} {getattr(part, name):g}"
                for name, sign in _RULES.items()
                if getattr(part, name, None) is not None
            ]
            words += [
                f"{most} {getattr(part, name)} long"
                for name, most in _LENGTHS.items()
                if getattr(part, name, None) is not None
            ]
    return ", ".join(dict.fromkeys(words))


def _models(kind: Any) -> Iterator[type[BaseModel]]:
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind
    for part in get_args(kind):
        yield from _models(part)


def _meanings(model: type[BaseModel]) -> dict[str, str]:
    """The texts that stand below the fields in the source, of the model and its bases."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if not issubclass(base, BaseModel) or base is BaseModel:
            continue
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(tree, ast.ClassDef)
        for field, text in zip(tree.body, tree.body[1:], strict=False):
            if (
                isinstance(field, ast.AnnAssign)
                and isinstance(field.target, ast.Name)
                and isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
            ):
                found[field.target.id] = " ".join(str(text.value.value).split())
    return found
