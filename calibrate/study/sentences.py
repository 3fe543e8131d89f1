"""What is wrong with a study, as one sentence with a remedy."""

import dataclasses
import datetime
import difflib
import re
import typing
from collections.abc import Iterable
from typing import Any

import pydantic

from .base import ParameterValue, Table
from .tables import STUDIES, Spread

ALTERNATIVES = re.compile(r"float|list\[float\]|int|str|bool|literal\[.*\]")
"""Branches of "a number or a list of them" and the like, which are no part of a place."""
NAMED = (ParameterValue, Spread)
"""Tables that stand under a parameter's name."""
MISSPELT = 0.75
"""Likeness from which a key is another one of its table, misspelt."""
DISCRIMINATORS = ("model", "kind")
"""Keys whose value decides which other keys there are."""


def sentence(error: pydantic.ValidationError) -> str:
    """The first problem that pydantic found."""
    problems = error.errors(include_url=False)
    # A misspelt key is also a missing one: the misspelling says more.
    first = next((problem for problem in problems if problem["type"] == "extra_forbidden"), problems[0])
    place, given, context = _find(first["loc"]), first["input"], first.get("ctx", {})
    match first["type"]:
        case "extra_forbidden":
            return _surplus(_find(first["loc"][:-1]), place.name)
        case "missing" if isinstance(first["loc"][-1], int):
            wanted = 1 + max(int(each["loc"][-1]) for each in _beside(first, problems))
            return f"{place.name} must have {wanted} values, but it is {given!r}; add what is missing"
        case "too_long":
            wanted = context["max_length"]
            return f"{place.name} must have {wanted} values at most, but it is {given!r}; leave out the others"
        case "missing":
            return _missing(_find(first["loc"][:-1]), place.name)
        case "union_tag_not_found":
            return f"the key '{place.inner(_quoted(context['discriminator'])[0])}' is missing; add it"
        case "union_tag_invalid":
            known = _quoted(context["expected_tags"])
            return _none_of(place.inner(_quoted(context["discriminator"])[0]), context["tag"], known)
        case "literal_error":
            known = _choices(_beside(first, problems))
            if first["loc"][-1] == "[key]":
                return _none_of(f"a key of {_find(first['loc'][:-2]).name}", given, known)
            if len(known) == 1 and place.tag:
                only = f"{place.name} can only be '{known[0]}'"
                return f"with {place.discriminator} = '{place.tag}', {only}, but it is {given!r}; remove it"
            return _none_of(place.name, given, known)
        case "model_type":
            return f"'{place.name}' must be a table, but it is {given!r}; {_as_table(place.tables[0], given)}"
        case "value_error":
            return first["msg"].removeprefix("Value error, ")
    return f"{place.name}: {first['msg']}, but it is {given!r}; correct it"


@dataclasses.dataclass
class _Place:
    """Where in a study something stands.

    `tables` may stand there. `tag` is what the last discriminator on the way says, and `others` are the tables that
    would stand there if it said something else.
    """

    keys: list[str]
    tables: list[type[Table]]
    tag: str = ""
    others: dict[str, list[type[Table]]] = dataclasses.field(default_factory=dict)
    discriminator: str = ""

    @property
    def name(self) -> str:
        return ".".join(self.keys) or "the study"

    def inner(self, key: str) -> str:
        return ".".join([*self.keys, key])


def _find(location: Iterable[Any]) -> _Place:
    """Walks down the types of a study, past positions in lists and past tags of discriminators."""
    place = _Place([], list(STUDIES))
    for part in location:
        if isinstance(part, int) or ALTERNATIVES.fullmatch(part):
            continue
        tagged = {tag: table for table in place.tables for tag in _tags(table)} if len(place.tables) > 1 else {}
        if part in tagged:
            others = {tag: [table] for tag, table in tagged.items() if table is not tagged[part]}
            place = _Place(place.keys, [tagged[part]], part, others, _tagged_by(tagged[part]))
        else:
            others = {tag: _below(tables, part) for tag, tables in place.others.items()}
            place = _Place([*place.keys, part], _below(place.tables, part), place.tag, others, place.discriminator)
    return place


def _below(tables: list[type[Table]], key: str) -> list[type[Table]]:
    """Tables under a key; a key that is no field is one of a dictionary of these very tables."""
    fields = [table.model_fields[key] for table in tables if key in table.model_fields]
    return [inner for field in fields for inner in _tables(field.annotation)] if fields else tables


def _tables(annotation: Any) -> list[type[Table]]:
    """The tables in a type, whatever lists, dictionaries and alternatives are around them."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [table for inner in typing.get_args(annotation) for table in _tables(inner)]


def _tagged_by(table: type[Table]) -> str:
    return next((key for key in DISCRIMINATORS if key in table.model_fields), "")


def _tags(table: type[Table]) -> tuple[str, ...]:
    key = _tagged_by(table)
    return typing.get_args(table.model_fields[key].annotation) if key else ()


def _surplus(place: _Place, name: str) -> str:
    key = name.split(".")[-1]
    part = place.keys[-1] if place.keys else ""
    # TOML takes a name without quotes for tables in tables; a parameter's own always has a dot.
    misspelt = difflib.get_close_matches(key, _keys(place.tables), cutoff=MISSPELT)
    if "." not in part and not misspelt and any(table in NAMED for table in place.tables):
        return f'a parameter\'s name must be in quotes; write "{part}.{key}" = ...'
    owners = [tag for tag, tables in place.others.items() if any(key in table.model_fields for table in tables)]
    if owners:
        right = " or ".join(f"'{owner}'" for owner in owners)
        return f"the key '{name}' belongs to {place.discriminator} = {right}, but it is '{place.tag}'; remove the key"
    return f"unknown key '{name}'; did you mean '{_nearest(key, _keys(place.tables))}'?"


def _as_table(table: type[Table], given: Any) -> str:
    """What to write where a table should stand: with what was given under its first key, where that fits."""
    if table is Spread:
        return "write e.g. {relative = 0.02}"
    key, field = next(iter(table.model_fields.items()))
    kind: Any = field.annotation
    try:
        pydantic.TypeAdapter(kind).validate_python(given, strict=True)
    except pydantic.ValidationError:
        return f"give it keys, e.g. {key}"
    return f"write e.g. {{{key} = {_in_toml(given)}}}"


def _in_toml(given: Any) -> str:
    if isinstance(given, bool):
        return str(given).lower()
    return given.isoformat() if isinstance(given, datetime.date | datetime.time) else repr(given)


def _missing(place: _Place, name: str) -> str:
    key = name.split(".")[-1]
    if all(key in _keys(tables) for tables in place.others.values()):
        return f"the key '{name}' is missing; add it"
    return f"the key '{name}' is missing, which {place.discriminator} = '{place.tag}' needs; add it"


def _beside(first: Any, problems: list[Any]) -> list[Any]:
    """Problems of the same key: with other branches of one value, or other values of one list."""

    def key(problem: Any) -> Any:
        *above, last = problem["loc"]
        return above if isinstance(last, int) or ALTERNATIVES.fullmatch(last) else [*above, last]

    return [each for each in problems if key(each) == key(first)]


def _choices(problems: list[Any]) -> list[str]:
    """What a value could be, as it is written in a study, by all branches that it does not fit."""
    expected = [each["ctx"]["expected"] for each in problems if each["type"] == "literal_error"]
    words = [word.strip("'") for text in expected for word in re.findall(r"'[^']+'|True|False", text)]
    if any(each["type"].startswith("bool_") for each in problems):
        words += ["true", "false"]
    return list(dict.fromkeys(word.lower() if word in ("True", "False") else word for word in words))


def _none_of(where: str, given: Any, known: list[str]) -> str:
    near = _nearest(str(given).lower() if given is not None else "", known)
    unquoted = near in ("true", "false") and isinstance(given, str)
    hint = f"write {near} without quotes" if unquoted else f"did you mean '{near}'?"
    return f"{where} must be one of {', '.join(known)}, but it is '{given}'; {hint}"


def _keys(tables: list[type[Table]]) -> list[str]:
    return [key for table in tables for key in table.model_fields]


def _quoted(text: str) -> list[str]:
    return re.findall(r"'([^']+)'", text)


def _nearest(given: str, known: list[str]) -> str:
    return difflib.get_close_matches(given, known, n=1, cutoff=0.0)[0]
