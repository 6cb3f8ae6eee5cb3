"""`asks`: methods of a task whose queries of inverse kinematics, and the worlds they plan in, are recorded."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def asks(method: Callable[P, T]) -> Callable[P, T]:
    """For methods of what has a `recording`: records the queries made meanwhile under the method's argument `what`.

    Where the method has an argument `world`, or a `team` of arms with a world each, what the planner sees there is
    recorded as well.
    """
    signature = inspect.signature(method)

    @functools.wraps(method)
    def recorded(*args: P.args, **kwargs: P.kwargs) -> T:
        given: dict[str, Any] = signature.bind(*args, **kwargs).arguments
        recording = given["self"].recording
        worlds = [given["world"]] if "world" in given else []
        for world in worlds or (given["team"].worlds.values() if "team" in given else ()):
            recording.log_world(world)
        with recording.queries(given["what"]):
            return method(*args, **kwargs)

    return recorded
