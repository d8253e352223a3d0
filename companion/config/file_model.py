"""The pydantic model of a configuration file, made from the dataclasses of its sections."""

from __future__ import annotations

import functools
import re
import types
from dataclasses import MISSING
from typing import Any

from pydantic import BaseModel, ConfigDict, create_model
from pydantic import Field as Bounds

from .sections import SECTIONS, fields_of, plain_type

WITHOUT_NUL = r"^[^\x00]*$"
"""A path or a name with a NUL character cannot be given to the operating system."""


def _section_model(section: str) -> type[BaseModel]:
    """A pydantic model with the keys, types and ranges of a section's dataclass."""
    columns: dict[str, Any] = {}
    for f in fields_of(section):
        kind: Any = plain_type(f)
        default = ... if f.default is MISSING else f.default
        limits: dict[str, Any] = {"pattern": WITHOUT_NUL} if kind is str else {}
        if "min" in f.metadata:
            limits = {"ge": f.metadata["min"], "le": f.metadata["max"]}
        if "choices" in f.metadata:
            limits = {"pattern": f"^(?:{'|'.join(map(re.escape, f.metadata['choices']))})$"}
        if "pattern" in f.metadata:
            limits = {"pattern": f.metadata["pattern"]}
        if f.default is None:
            kind = kind | None
        columns[f.name] = (kind, Bounds(default, **limits))
    config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
    model: type[BaseModel] = create_model(section, __config__=config, **columns)
    return model


@functools.cache
def file_model(sections: frozenset[str]) -> type[BaseModel]:
    """A pydantic model of a file with these sections: building those that it lacks would only delay a start."""
    # in the order of SECTIONS: mistakes are listed in the same order on every run
    columns: dict[str, Any] = {name: (_section_model(name), ...) for name in SECTIONS if name in sections}
    if "camera" in sections:
        columns["camera"] = (types.GenericAlias(list, (columns["camera"][0],)), ...)
    model: type[BaseModel] = create_model("file", __config__=ConfigDict(extra="forbid"), **columns)
    return model
