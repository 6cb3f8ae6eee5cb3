"""`asks`: methods whose queries of inverse kinematics are recorded under what they are for."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def asks(method: Callable[P, T]) -> Callable[P, T]:
    """For methods of what has a `recording`: records the queries made meanwhile under the method's argument `what`."""
    signature = inspect.signature(method)

    @functools.wraps(method)
    def recorded(*args: P.args, **kwargs: P.kwargs) -> T:
        given: dict[str, Any] = signature.bind(*args, **kwargs).arguments
        with given["self"].recording.queries(given["what"]):
            return method(*args, **kwargs)

    return recorded
