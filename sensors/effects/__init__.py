"""The catalogue of effects: one file an effect, one line here."""

from __future__ import annotations

from sensors.effects.declaration import Effect, Parameter

__all__ = ["Effect", "Parameter"]
