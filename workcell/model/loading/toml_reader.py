"""Files in TOML that people write: read strictly, every complaint names the file and the key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workcell.errors import ModelError, UnknownNameError
from workcell.files import regular_text

LARGEST = 1e6
"""Metres or radians beyond which a number can only be a mistake (and arithmetic loses digits)."""

_NAME = re.compile(r"\w[\w.-]*")


def read_toml(path: Path) -> Mapping[str, Any]:
    """The table that a TOML file is; raises ModelError naming the file."""
    try:
        return tomllib.loads(regular_text(path))
    except OSError as error:
        raise ModelError(f"can't read this file: {error.strerror}", where=path) from None
    except UnicodeDecodeError:
        raise ModelError("this is not a text file", where=path, remedy="a TOML file, in UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise ModelError(f"this is not valid TOML: {error}", where=path) from None
    except ValueError:
        raise ModelError("this holds a number of too many digits", where=path) from None
    except RecursionError:
        raise ModelError("this is nested too deeply", where=path) from None


def is_number(value: object) -> bool:
    """Whether a value is a finite number of sane size, and no truth value."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= LARGEST  # which does not hold of nan


@dataclass(frozen=True, slots=True)
class TomlReader:
    """Takes values out of a file's tables; each method raises ModelError, or UnknownNameError for unknown keys.

    Attributes:
        path: the file, for messages.
    """

    path: Path

    def error(self, key: str, problem: str, valid: str) -> ModelError:
        """What is wrong with a key, and what would be valid."""
        return ModelError(f"{key} {problem}", where=self.path, remedy=f"valid: {valid}")

    def format(self, table: Mapping[str, Any], wanted: str) -> None:
        """The file's format must be the wanted one."""
        if table.get("format") != wanted:
            given = f"is {table['format']!r}" if "format" in table else "is missing"
            raise self.error("format", given, f'format = "{wanted}"')

    def tables(self, table: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
        """A list of tables, empty where the key is missing."""
        entries = table.get(key, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise self.error(key, "must be a list of tables", f"[[{key}]]")
        return entries

    def text(self, table: Mapping[str, Any], key: str, at: str, *, default: str | None = None) -> str:
        """A string."""
        value = table.get(key, default)
        if not isinstance(value, str):
            raise self.error(
                f"{at}.{key}".lstrip("."), "is missing" if value is None else f"is {value!r}", "a string"
            )
        return value

    def name(self, table: Mapping[str, Any], at: str, *, default: str | None = None) -> str:
        """A name of files and of prefixes in the compiled model."""
        name = self.text(table, "name", at, default=default)
        if not _NAME.fullmatch(name):
            raise self.error(f"{at}.name".lstrip("."), f"is {name!r}", "letters, digits, _ - and . inside")
        return name

    def texts(self, table: Mapping[str, Any], key: str, at: str) -> tuple[str, ...]:
        """A list of strings, empty where the key is missing."""
        value = table.get(key, [])
        if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
            raise self.error(f"{at}.{key}", f"is {value!r}", "a list of strings")
        return tuple(value)

    def number(self, table: Mapping[str, Any], key: str, at: str, *, default: float) -> float:
        """A number."""
        value = table.get(key, default)
        if not is_number(value):
            raise self.error(f"{at}.{key}", f"is {value!r}", f"a finite number of at most {LARGEST:g}")
        return float(value)

    def numbers(
        self, table: Mapping[str, Any], key: str, at: str, *, default: tuple[float, ...] | None = None
    ) -> tuple[float, ...]:
        """A list of numbers."""
        value = table.get(key, default)
        if not isinstance(value, list | tuple) or not all(is_number(x) for x in value):
            raise self.error(
                f"{at}.{key}",
                "is missing" if value is None else f"is {value!r}",
                f"a list of finite numbers of at most {LARGEST:g} each",
            )
        return tuple(float(x) for x in value)

    def vector(
        self,
        table: Mapping[str, Any],
        key: str,
        at: str,
        *,
        size: int = 3,
        default: tuple[float, ...] | None = None,
    ) -> tuple[float, ...]:
        """A list of so many numbers."""
        value = self.numbers(table, key, at, default=default)
        if len(value) != size:
            raise self.error(f"{at}.{key}", f"has {len(value)} numbers", f"{size} numbers")
        return value

    def truth(self, table: Mapping[str, Any], key: str, at: str, *, default: bool = False) -> bool:
        """True or false."""
        value = table.get(key, default)
        if not isinstance(value, bool):
            raise self.error(f"{at}.{key}", f"is {value!r}", "true or false")
        return value

    def only_keys(self, table: Mapping[str, Any], known: set[str], at: str) -> None:
        """No other keys than these."""
        for key in table:
            if key not in known:
                raise UnknownNameError("key", key, known, where=f"{self.path}: {at}" if at else self.path)

    def unique(self, names: list[str], at: str) -> None:
        """No name twice."""
        for name in names:
            if names.count(name) > 1:
                raise self.error(at, f"has the name {name!r} twice", "each name once")
