"""The base of every settings object: frozen, typed, strict about unknown keys."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """Validated once at the edge; afterwards a value that cannot change."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
