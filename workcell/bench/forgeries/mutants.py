"""Ways to change a certificate's document, and to make one up: what a forger, or an accident, might do.

Each takes the document, a random generator and other certificates to steal from, and returns a document or its text.
"""

from __future__ import annotations

import contextlib
import copy
import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from workcell.bench.forgeries.honest import sealed

Document = dict[str, Any]
Change = Callable[[Document, np.random.Generator, Sequence[Document]], Document | str]

VALUES: tuple[Any, ...] = (
    0.0, -0.0, 1.0, -1.0, 0.5, 1e-9, -1e-9, -0.99e-9, 1e-300, 5e-324, 1e30, -1e30, 1e49, 1e50, 1.1e50, 1e300, -1e300,
    1.7e308, float("nan"), float("inf"), -float("inf"), 2**31, 2**63, -(2**63), 2**64, 10**400, 1e19, True, False, None,
    "1", "", [], [1.0], {}, -2, -3, -4, 7, 1000000,
)  # fmt: skip
"""What a number may be replaced by."""
SCALES = (0.0, -1.0, 1e-12, 1e12, 1e-150, 1e150, 1e-300, 1e300, 0.5, 2.0, 1.0 + 1e-9)
KINDS = (
    "reach",
    "last_link",
    "branch",
    "farkas/2",
    "cidgik/2",
    "farkas",
    "cidgik",
    "farkas/3",
    "",
    "\ud800",
    "solved",
)


def one_value(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """One number is another, or none at all."""
    values = _some(document, rng)["values"]
    if values:
        values[int(rng.integers(len(values)))] = VALUES[int(rng.integers(len(VALUES)))]
    return document


def a_nudge(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """Some numbers are a little different."""
    values = _some(document, rng)["values"]
    for k in range(len(values)):
        if rng.random() < 0.3:
            values[k] = float(values[k]) * (1.0 + 10.0 ** rng.uniform(-16, 0) * rng.standard_normal())
    return document


def a_scale(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """An array, or all of them, is a multiple of itself."""
    scale, everywhere = SCALES[int(rng.integers(len(SCALES)))], rng.random() < 0.5
    chosen = _some(document, rng)
    for entry in document["data"].values():
        if everywhere or entry is chosen:
            entry["values"] = [scale * float(value) for value in entry["values"]]
    return document


def noise(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """Arrays hold numbers of chance, of any size; a few of them zeros but for a trace."""
    size = 10.0 ** rng.uniform(-15, 15)
    for name, entry in document["data"].items():
        if name not in ("tolerances", "inflation", "clearance") and rng.random() < 0.7:
            count = len(entry["values"])
            drawn = size * rng.standard_normal(count) * (rng.random(count) < rng.uniform())
            entry["values"] = np.abs(drawn).tolist() if rng.random() < 0.3 else drawn.tolist()
    return document


def zeros_but_one(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """All arrays but the tolerances are zero, but for one number below what a careless test would see."""
    trace = float(rng.choice([-0.99e-9, -0.9e-9, 0.9e-9, -1e-12, -1e-300, -5e-324]))
    for name, entry in document["data"].items():
        if name not in ("tolerances", "inflation", "clearance"):
            entry["values"] = [0.0] * len(entry["values"])
    values = _some(document, rng)["values"]
    if values:
        values[int(rng.integers(len(values)))] = trace
    return document


def another_shape(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """An array is cut, grown, turned or said to be of another shape."""
    entry = _some(document, rng)
    choice = int(rng.integers(8))
    if choice == 0:
        entry["values"] = entry["values"][:-1]
    elif choice == 1:
        entry["values"] = [*entry["values"], 0.0]
    elif choice == 2:
        entry["shape"] = entry["shape"][::-1]
    elif choice == 3:
        entry["shape"] = [*entry["shape"], 1]
    elif choice == 4:
        entry["shape"] = [VALUES[int(rng.integers(len(VALUES)))]]
    elif choice == 5:
        entry["values"] = entry["values"][::-1]
    elif choice == 6 and len(entry["shape"]) == 2:
        rows, columns = entry["shape"]
        array = np.array(entry["values"], dtype=float).reshape(rows, columns)
        kept = array[: int(rng.integers(rows + 1)), : int(rng.integers(columns + 1))]
        entry["shape"], entry["values"] = list(kept.shape), kept.ravel().tolist()
    else:
        count = int(rng.integers(0, 50))
        entry["shape"], entry["values"] = [count], [0.0] * count
    return document


def a_swap(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """Two numbers of an array, or two arrays, change places."""
    names = list(document["data"])
    one, two = (names[int(rng.integers(len(names)))] for _ in range(2))
    if rng.random() < 0.5:
        data = document["data"]
        data[one], data[two] = data[two], data[one]
        return document
    values = document["data"][one]["values"]
    if values:
        i, j = rng.integers(len(values), size=2)
        values[i], values[j] = values[j], values[i]
    return document


def a_theft(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """Arrays come from other certificates."""
    other = others[int(rng.integers(len(others)))]
    for name, entry in other["data"].items():
        if rng.random() < 0.7:
            document["data"][name] = copy.deepcopy(entry)
    if rng.random() < 0.3:
        document["kind"], document["scope"] = other["kind"], other["scope"]
    return document


def a_word(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """Something of what the document says of itself is different, or gone."""
    key = ("kind", "scope", "statement", "margin", "problem_hash", "format", "data")[int(rng.integers(7))]
    choice = rng.random()
    if choice < 0.2:
        document.pop(key)
    elif key == "kind":
        document[key] = KINDS[int(rng.integers(len(KINDS)))]
    elif key == "scope":
        document[key] = ("kinematics", "geometry", "model", "everything")[int(rng.integers(4))]
    elif key == "margin" and choice < 0.6:
        document[key] = float(document[key]) * 10.0 ** rng.uniform(-9, 9)
    elif key == "statement" and choice < 0.6:
        document[key] = document[key].replace("1", "2") if rng.random() < 0.5 else "There is none. " * 1000
    else:
        document[key] = VALUES[int(rng.integers(len(VALUES)))]
    return document


def a_name(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """An array is missing, there is one more, or it has another name."""
    names, data = list(document["data"]), document["data"]
    name = names[int(rng.integers(len(names)))]
    entry = data.pop(name) if rng.random() < 0.6 else copy.deepcopy(data[name])
    data[("ray", "places", "pairs", "links", "\udc80", "own", "S")[int(rng.integers(7))]] = entry
    return document


def the_text(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> str:
    """The text is cut, has a key twice, is nested without end, or a letter of it is another."""
    text = json.dumps(document)
    choice, at = int(rng.integers(5)), int(rng.integers(len(text)))
    if choice == 0:
        return text[:at]
    if choice == 1:
        return text[:-1] + ', "margin": 1.0}'
    if choice == 2:
        return text.replace('"values": [', '"values": [' + "[" * int(10 ** rng.uniform(0, 5)), 1)
    if choice == 3:
        return text.replace('"margin": ', '"margin": 1' + "0" * int(10 ** rng.uniform(1, 4)), 1)
    return text[:at] + chr(int(rng.integers(32, 127))) + text[at + 1 :]


def wide_tolerances(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """The tolerances are what no proof may cover, or less than what it must."""
    name = "inflation" if "inflation" in document["data"] else "tolerances"
    if name in document["data"]:
        values = document["data"][name]["values"]
        drawn = (1e-300, -1.0, -1e-3, 0.0, 0.9e-4, 1.5, 1e9, -1e9, -1e49)
        values[int(rng.integers(len(values)))] = drawn[int(rng.integers(len(drawn)))]
    return document


def a_tree(document: Document, rng: np.random.Generator, others: Sequence[Document]) -> Document:
    """A tree of chance, sealed and stated as one who forges would; of other kinds: noise."""
    if document["kind"] != "branch":
        return noise(document, rng, others)
    data = document["data"]
    joints = data["root"]["shape"][1]
    tree: list[float] = []
    splits: list[float] = []
    blocked: list[list[float]] = []
    open_nodes = 1
    odd = rng.random() < 0.3
    while open_nodes and len(tree) < 60:
        inner = rng.random() < 0.45 and len(tree) + open_nodes < 50
        if inner:
            code = (
                int(rng.integers(joints))
                if not odd
                else (-1e300, 1e300, 2**31, 1e19, 0.5)[int(rng.integers(5))]
            )
            tree.append(code)
            splits.append(float(rng.uniform(-2.0, 2.0)))
            open_nodes += 1
            continue
        code = float(rng.choice([-1, -2, -3] if odd else [-1, -2]))
        tree.append(code)
        open_nodes -= 1
        if code < -1:
            far = (2**31, 1e300, -1, 0.5) if odd else (0,)
            blocked.append([float(rng.integers(joints)), float(far[int(rng.integers(len(far)))])])
    pairs = np.array(blocked).reshape(-1, 2).T
    data["tree"] = {"shape": [len(tree)], "values": tree}
    data["splits"] = {"shape": [len(splits)], "values": splits}
    data["blocked"] = {"shape": [2, pairs.shape[1]], "values": pairs.ravel().tolist()}
    document["scope"] = "geometry" if len(blocked) else "kinematics"
    return document


CHANGES: dict[str, Change] = {
    "nothing": lambda document, rng, others: document,
    **{
        change.__name__: change
        for change in (
            one_value,
            a_nudge,
            a_scale,
            noise,
            zeros_but_one,
            another_shape,
            a_swap,
            a_theft,
            a_word,
            a_name,
            the_text,
            wide_tolerances,
            a_tree,
        )
    },
}
"""All of them by name; `nothing` hands in the certificate of another problem."""


_CLUMSY = (KeyError, TypeError, ValueError, OverflowError, IndexError, AttributeError)
"""What a change may stumble over where another change has been before."""


def forged(document: Document, change: str, rng: np.random.Generator, others: Sequence[Document]) -> str:
    """A certificate's text changed once or twice, and, where it is a tree that can be, sealed anew."""
    found = CHANGES[change](copy.deepcopy(document), rng, others)
    if not isinstance(found, str) and rng.random() < 0.2 and _whole(found):
        more = list(CHANGES)
        again = CHANGES[more[int(rng.integers(1, len(more)))]]
        with contextlib.suppress(*_CLUMSY):
            found = again(found, rng, others)
    if not isinstance(found, str) and found.get("kind") == "branch" and rng.random() < 0.9:
        with contextlib.suppress(*_CLUMSY):
            found = sealed(found)
    return found if isinstance(found, str) else json.dumps(found)


def _whole(document: Document) -> bool:
    """Whether a document can be changed once more."""
    data = document.get("data")
    return (
        {"kind", "scope", "statement", "margin", "data"} <= set(document)
        and isinstance(data, dict)
        and isinstance(document["statement"], str)
        and isinstance(document["margin"], float)
        and all(_numbers(entry) for entry in data.values())
    )


def _numbers(entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and all(type(size) is int for size in entry["shape"])
        and all(type(value) in (int, float) and abs(value) < 1e308 for value in entry["values"])
        and int(np.prod(entry["shape"])) == len(entry["values"])
    )


def _some(document: Document, rng: np.random.Generator) -> Document:
    names = list(document["data"])
    return document["data"][names[int(rng.integers(len(names)))]]  # type: ignore[no-any-return]
