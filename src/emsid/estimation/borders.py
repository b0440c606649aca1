"""The border around a part of a run, such as one model, one check or one figure: its failure costs that part only.

`border` catches every exception but those that end a run on purpose, logs its traceback, and notes a finding with the
name of the part for whoever collects them (`collected`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from logging import getLogger
from typing import TypeVar

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.findings import Finding

T = TypeVar("T")

LOG = getLogger("emsid")
_NOTED: ContextVar[list[Finding] | None] = ContextVar("noted", default=None)


class InternalError(EmsidError):
    """A defect of the program, met in a part of a run.

    Args:
        part: where.
        problem: the exception.
    """

    def __init__(self, part: str, problem: Exception) -> None:
        words = f"{type(problem).__name__}: {problem}".removesuffix(": ")
        super().__init__(f"{part}: an error inside the program ({words})", arguments=("debug",))


@contextmanager
def border(
    part: str,
    model: str = "",
    *,
    report: Callable[[EmsidError], object] | None = None,
    expected: bool = False,
    passing: type[Exception] = Stopped,
) -> Iterator[None]:
    """Let what is raised within cost this part only.

    Args:
        part: its name in the finding.
        model: the model that it is about, if there is one.
        report: called with the problem, in place of a finding.
        expected: whether an `EmsidError` only says that the data do not suit the part, so that there is no finding.
        passing: a further kind of exception that is raised.

    Raises:
        Stopped: as it is raised within.
        MemoryError: likewise.
    """
    try:
        yield
    except (Stopped, MemoryError, passing):
        raise
    except Exception as problem:
        known = problem if isinstance(problem, EmsidError) else InternalError(part, problem)
        LOG.debug("%s", known, exc_info=problem)
        if report is not None:
            report(known)
        elif isinstance(known, InternalError) or not expected:
            note(part, known, model)


def tried(part: str, work: Callable[[], T], otherwise: T, model: str = "") -> T:
    """What a part gives; `otherwise` where it fails, with a finding for whoever collects them.

    Args:
        part: its name in the finding.
        work: the part.
        otherwise: in place of what it gives.
        model: the model that it is about, if there is one.
    """
    with border(part, model):
        return work()
    return otherwise


def joined(parts: Mapping[str, Callable[[], Iterable[T]]]) -> list[T]:
    """What several parts give, one after the other; one that fails is left out, with a finding.

    Args:
        parts: by their names in the finding.
    """
    found: list[T] = []
    for part, work in parts.items():
        with border(part):
            found += list(work())
    return found


def note(part: str, problem: EmsidError, model: str = "") -> None:
    """Add a finding about a part that failed to those that are collected, once.

    Args:
        part: its name.
        problem: why it failed.
        model: the model that it is about, if there is one.
    """
    noted, about = _NOTED.get(), {"model": model} if model else {}
    data = about | {"reason": str(problem).removeprefix(f"{part}: "), "internal": isinstance(problem, InternalError)}
    finding = Finding("part-failed", part, data)
    if noted is not None and finding not in noted:
        noted.append(finding)


@contextmanager
def collected() -> Iterator[list[Finding]]:
    """The findings about parts that fail within."""
    found: list[Finding] = []
    token = _NOTED.set(found)
    try:
        yield found
    finally:
        _NOTED.reset(token)
