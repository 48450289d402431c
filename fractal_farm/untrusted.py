"""Files that somebody wrote, read with suspicion (DESIGN section 10).

YAML is read with the safe loader, up to a size, without repeated keys and aliases. Whatever is wrong becomes
an `InputError` of one line. `explain` puts pydantic's errors into such lines, with what the model allows.
"""

from __future__ import annotations

import difflib
import functools
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from fractal_farm.errors import InputError

SIZE_LIMIT = 1 << 20


class Section(BaseModel):
    """A section of a file: frozen, no unknown keys, no conversion of types; if empty, all defaults."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _empty_means_defaults(cls, data: Any) -> Any:
        return {} if data is None else data


def read_yaml(path: Path) -> dict[Any, Any]:
    """The mapping in a YAML file.

    Raises:
        InputError: missing, unreadable, above 1 MiB, not UTF-8, not YAML, a repeated key, not a mapping.
    """
    try:
        with path.open("rb") as file:
            content = file.read(SIZE_LIMIT + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the path") from None
    except OSError as error:
        raise InputError(f"{path}: {(error.strerror or 'not readable').lower()}; give a readable file") from None
    if len(content) > SIZE_LIMIT:
        raise InputError(f"{path}: larger than 1 MiB; split the file")
    try:
        text = content.decode()
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8 text; give a YAML file") from None
    value = parse_yaml(text, str(path))
    if not isinstance(value, dict):
        what = "empty" if value is None else f"a {type(value).__name__}"
        raise InputError(f"{path}: {what}; the file must hold a mapping of keys to values")
    return value


def parse_yaml(text: str, source: str) -> Any:
    """A YAML document of plain values.

    Args:
        text: the document.
        source: what messages call it.

    Raises:
        InputError: with the line and column where YAML has them.
    """
    try:
        return yaml.load(text, _PlainLoader)  # noqa: S506 - derived from SafeLoader
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f" line {mark.line + 1}, column {mark.column + 1}:" if mark else ""
        raise InputError(f"{source}:{place} {_one_line(error.problem or error.context)}") from None
    except yaml.YAMLError as error:
        raise InputError(f"{source}: {_one_line(error)}") from None
    except ValueError as error:
        raise InputError(f"{source}: a value is not readable: {_one_line(error)}") from None
    except RecursionError:
        raise InputError(f"{source}: nested too deeply; a few levels are enough") from None


def override_value(tree: dict[Any, Any], override: str) -> str:
    """Put an override `section.field=value` (a YAML value) into a tree of sections.

    Returns:
        The key, `section.field`.

    Raises:
        InputError: not of that form, not YAML, or a section that is a value.
    """
    key, equals, text = override.partition("=")
    parts = key.strip().split(".")
    source = f"--set {_one_line(override)}"
    if not equals or not all(parts):
        raise InputError(f"{source}: not an override; write section.field=value")
    node = tree
    for depth, part in enumerate(parts[:-1], start=1):
        if node.get(part) is None:
            node[part] = {}
        node = node[part]
        if not isinstance(node, dict):
            raise InputError(f"{source}: {'.'.join(parts[:depth])} is {shown(node)}; it has no fields")
    node[parts[-1]] = parse_yaml(text, source)
    return ".".join(parts)


def explain(error: ValidationError, model: type[BaseModel], source_of: Callable[[str], str]) -> str:
    """One line about the first of pydantic's errors: where, which key, which value, what is allowed.

    Args:
        error: from validating `model`.
        model: whose JSON schema knows types and ranges.
        source_of: the file or option that a key (with dots) came from.
    """
    first, *others = error.errors(include_url=False)
    location = list(first["loc"])
    key = ".".join(str(part) for part in location if part != "[key]")
    more = f" (and {len(others)} more)" if others else ""
    return _one_line(f"{source_of(key)}: {_sentence(dict(first), location, key, model)}{more}")


def _sentence(error: dict[str, Any], location: list[Any], key: str, model: type[BaseModel]) -> str:
    schema = _schema(model)
    if error["type"] in ("extra_forbidden", "invalid_key"):
        known = list(_descend(schema, location[:-1]).get("properties", {}))
        close = difflib.get_close_matches(str(location[-1]), known, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"allowed here: {', '.join(known)}"
        return f"unknown key {key}; {hint}"
    if error["type"] == "value_error":
        return f"{key + ': ' if key else ''}{_one_line(error['ctx']['error'])}"
    if location and location[-1] == "[key]":
        above = ".".join(map(str, location[:-2]))
        keys = _descend(schema, location[:-2]).get("keys", "other keys")
        return f"{above} has the key {shown(error['input'])}; allowed: {keys}"
    if error["type"] == "missing" and isinstance(location[-1], str):
        return f"{key} is missing; allowed: {allowed(_descend(schema, location), schema)}"
    if error["type"] == "missing":
        location, key = location[:-1], key.rpartition(".")[0]
    value, field = shown(error["input"]), _descend(schema, location)
    return f"{key} is {value}; allowed: {allowed(field, schema)}"


def shown(value: Any) -> str:
    """A value as a message quotes it: YAML's words, cut to a readable length."""
    words: dict[Any, str] = {None: "null", True: "true", False: "false"}
    if value is None or isinstance(value, bool):
        return words[value]
    if isinstance(value, BaseModel):
        return "a section"
    if isinstance(value, (list, tuple)):
        text = f"[{', '.join(shown(item) for item in value)}]"
    elif isinstance(value, Mapping):
        text = f"{{{', '.join(f'{shown(k)}: {shown(v)}' for k, v in value.items())}}}"
    else:
        text = repr(value)
    text = _one_line(text)
    return text if len(text) <= 60 else f"{text[:57]}..."


def allowed(field: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    """What a field of a JSON schema accepts, in words."""
    field = {**field, **_resolved(field, schema)}
    if "wording" in field:
        return str(field["wording"])
    if "anyOf" in field:
        return " or ".join(allowed(option, schema) for option in field["anyOf"])
    if "enum" in field:
        return _listed(field["enum"])
    if "const" in field:
        return str(field["const"])
    kind = field.get("type")
    if kind == "null":
        return "null"
    if kind in ("integer", "number"):
        return ("a whole number" if kind == "integer" else "a number") + _range(field)
    if kind == "string":
        return "a text"
    if kind == "array" and "prefixItems" in field:
        return f"[{', '.join(allowed(item, schema) for item in field['prefixItems'])}]"
    if kind == "array":
        least = f"at least {field['minItems']} of " if "minItems" in field else ""
        return f"a list of {least}{allowed(field.get('items', {}), schema)}"
    if "properties" in field:
        return f"a section with {', '.join(field['properties'])}"
    return "a mapping"


def _listed(values: list[Any]) -> str:
    words = [str(value) for value in values]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def _range(field: Mapping[str, Any]) -> str:
    parts = [
        f"{word} {field[name]:g}" if abs(field[name]) < 1e6 else f"{word} {field[name]}"
        for name, word in (
            ("exclusiveMinimum", "above"),
            ("minimum", "from"),
            ("exclusiveMaximum", "below"),
            ("maximum", "to" if "minimum" in field else "up to"),
        )
        if name in field
    ]
    return "".join(f" {part}" for part in parts)


@functools.cache
def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def _resolved(field: Mapping[str, Any], schema: Mapping[str, Any]) -> Mapping[str, Any]:
    while "$ref" in field:
        field = schema["$defs"][field["$ref"].rpartition("/")[2]]
    return field


def _descend(schema: Mapping[str, Any], location: list[Any]) -> Mapping[str, Any]:
    """The schema of the field at a location; of the deepest one known, if the location leads beyond."""
    field = _resolved(schema, schema)
    for part in location:
        options = [_resolved(option, schema) for option in field.get("anyOf", [field])]
        for option in options:
            if part in option.get("properties", {}):
                found = option["properties"][part]
            elif isinstance(part, int) and "prefixItems" in option and part < len(option["prefixItems"]):
                found = option["prefixItems"][part]
            elif isinstance(part, int) and "items" in option:
                found = option["items"]
            elif isinstance(option.get("additionalProperties"), Mapping):
                found = option["additionalProperties"]
            else:
                continue
            field = {**found, **_resolved(found, schema)}
            break
        else:
            return field
    return field


def _one_line(text: object) -> str:
    return " ".join(str(text).split())


class _PlainLoader(yaml.SafeLoader):
    """Safe, without aliases (a few lines of them grow to gigabytes) and without silently repeated keys."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.get_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem="*aliases are not read; repeat the value", problem_mark=mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _value_node in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, (list, dict, set)):
                raise yaml.MarkedYAMLError(problem="a key must be a word", problem_mark=key_node.start_mark)
            if key in seen:
                raise yaml.MarkedYAMLError(problem=f"the key {key!r} appears twice", problem_mark=key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


# YAML 1.2's floats: YAML 1.1, which PyYAML reads, takes 1e-3 for a text.
_PlainLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)
