"""Who is told of every answered query: solvers and tasks know nothing of each other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

Observer = Callable[[Any, Any], None]
"""Takes an `IKProblem` and its `IKResult`, or a `MechanismProblem` and its `MechanismResult`."""

_observer: ContextVar[Observer | None] = ContextVar("workcell_ik_observer", default=None)


@contextmanager
def observed(observer: Observer) -> Iterator[None]:
    """Calls `observer(problem, result)` for every query that this thread answers meanwhile; the innermost counts."""
    token = _observer.set(observer)
    try:
        yield
    finally:
        _observer.reset(token)


def report(problem: object, result: object) -> None:
    """Tells the observer, if there is one, of an answered query, of an arm or of a mechanism."""
    observer = _observer.get()
    if observer is not None:
        observer(problem, result)
