"""What the sections of the configuration have in common."""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationInfo,
    create_model,
    field_validator,
)

from automap.io import limits
from automap.io.toml_file import no_boolean

S = TypeVar("S", bound="Section")


class Section(BaseModel):
    """A frozen group of settings; unknown keys and NaN are refused.

    The text below a field is its comment in ``configs/default.toml``: the unit first.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        validate_default=True,
        use_attribute_docstrings=True,
    )

    @field_validator("*", mode="before")
    @classmethod
    def _number_is_one(cls, value: Any, info: ValidationInfo) -> Any:
        return no_boolean(value, cls.model_fields[str(info.field_name)].annotation)

    @field_validator("*", mode="after")
    @classmethod
    def _size_is_possible(cls, value: Any) -> Any:
        if _largest(value) > limits.MAX_NUMBER:
            raise ValueError(f"no such quantity is larger than {limits.MAX_NUMBER:g}")
        return value


def _largest(value: Any) -> float:
    """The largest size of a decimal in a value, however deep it stands."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return max(map(_largest, value), default=0.0)
    return abs(value) if isinstance(value, float) else 0.0


def of_options(options: type, but: tuple[str, ...] = ()) -> Callable[[type[S]], type[S]]:
    """A decorator that puts the fields of a dataclass of the library before a section's own.

    Types, limits, defaults and comments are the dataclass's, so that each stands once; the
    fields named in ``but`` are no settings.
    """
    hints, notes = get_type_hints(options, include_extras=True), attribute_notes(options)
    taken: dict[str, Any] = {
        item.name: (
            hints[item.name],
            Field(item.default, description=notes[item.name])
            if item.default_factory is MISSING
            else Field(default_factory=item.default_factory, description=notes[item.name]),
        )
        for item in fields(options)
        if item.name not in but
    }

    def extended(own: type[S]) -> type[S]:
        base = create_model(options.__name__, __base__=Section, **taken)
        members = {"__module__": own.__module__, "__doc__": own.__doc__}
        return type(own.__name__, (own, base), members)

    return extended


def attribute_notes(owner: type) -> dict[str, str]:
    """The texts below the fields of a class, by field."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
    assert isinstance(tree, ast.ClassDef)
    return {
        field.target.id: " ".join(str(note.value.value).split())
        for field, note in itertools.pairwise(tree.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(note, ast.Expr)
        and isinstance(note.value, ast.Constant)
    }
