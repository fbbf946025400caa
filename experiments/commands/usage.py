"""What is wrong with an argument, in words of the command line and not of the library that reads it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import typer
import typer.core

#: What a value is not, by the sort of its error.
_IS_NOT = {
    "float_parsing": "a number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number of a size that can be used",
    "int_from_float": "a whole number",
    "int_type": "a whole number",
    "bool_parsing": "true or false",
}
#: What a value is beyond, by the sort of its error, which names the bound alike.
_BEYOND = {
    "greater_than_equal": ("ge", "less than"),
    "less_than_equal": ("le", "more than"),
    "greater_than": ("gt", "not more than"),
    "less_than": ("lt", "not less than"),
}


class Command(typer.core.TyperCommand):
    """A command that says in plain words what it cannot take."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As the library does.

        Raises
        ------
        typer.BadParameter : a value that is none
        """
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            read = getattr(error.__cause__, "errors", None)  # of what checks values for the library
            if read is not None:
                error.message = in_plain_words(read()[0])
            raise


def in_plain_words(wrong: Mapping[str, Any]) -> str:
    """A sentence of one error: its `type`, the value (`input`), the bound (`ctx`), the words of the library (`msg`)."""
    sort, value = wrong["type"], wrong["input"]
    said = repr(value) if isinstance(value, str) else f"{value}"
    if sort in _IS_NOT:
        return f"{said} is not {_IS_NOT[sort]}"
    if str(value).lower() == "nan":
        return f"{value} is not a number"
    if sort in _BEYOND:
        bound, is_so = _BEYOND[sort]
        return f"{value} is {is_so} {wrong['ctx'][bound]:.12g}"
    return str(wrong["msg"]).removeprefix("Value error, ").removesuffix(".")
