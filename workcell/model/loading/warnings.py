"""What MuJoCo warns of while it reads and compiles models: kept, or an error where it changes the meaning."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

from workcell.errors import ModelError

if TYPE_CHECKING:
    from pathlib import Path

_CHANGES_THE_MEANING = (
    re.compile(r"<mimic> on joint .* ignored"),
    re.compile(r"attribute ignored"),
)
"""Warnings after which the model is another one than the file describes."""
_HONOURED = (re.compile(r"has equal lower and upper limits, limit ignored"),)
"""Warnings of what workcell reads itself: see `workcell.model.loading.limits`."""
_listener: ContextVar[list[str] | None] = ContextVar("listener", default=None)


@contextmanager
def heard_warnings() -> Iterator[list[str]]:
    """A list that fills with what MuJoCo warns of inside, each once: what `Scene.warnings` holds of a scene."""
    heard: list[str] = []
    token = _listener.set(heard)
    try:
        yield heard
    finally:
        _listener.reset(token)


@contextmanager
def quiet_mujoco(where: str | Path | None = None) -> Iterator[None]:
    """Without MuJoCo's warnings on the console and in a log file in the working directory; see `heard_warnings`.

    Raises:
        ModelError: at the end, where a warning says that MuJoCo left out something that the file asks for.
    """
    import mujoco

    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: said.append(" ".join(str(text).split())))
    try:
        with warnings.catch_warnings(record=True) as noted:
            warnings.simplefilter("always")
            yield
    finally:
        mujoco.set_mju_user_warning(before)
    said += [" ".join(str(note.message).split()) for note in noted if issubclass(note.category, UserWarning)]
    said = [text for text in said if not any(rule.search(text) for rule in _HONOURED)]
    for text in said:
        if any(rule.search(text) for rule in _CHANGES_THE_MEANING):
            raise ModelError(f"MuJoCo warns: {text}", where=where, remedy="mend the file")
    heard = _listener.get()
    if heard is not None:
        known = dict.fromkeys([*heard, *said])
        # some come twice, once without their particulars
        heard[:] = [text for text in known if not any(t.startswith(text) for t in known if t != text)]
