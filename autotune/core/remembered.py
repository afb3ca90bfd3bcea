"""Answers to what was asked last, by the content of the question: what is dear to compute and is asked again."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Hashable, Mapping
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Answer = TypeVar("Answer")


class Remembered(Generic[Answer]):
    """The last answers, at most so many; threads may ask beside each other."""

    def __init__(self, most: int = 32) -> None:
        self._most, self._known = most, dict[Hashable, Answer]()
        self._told: Mapping[str, Answer] = {}
        self._lock = threading.Lock()

    def answer(self, question: Hashable, find: Callable[[], Answer]) -> Answer:
        """What is known of a question, or what is found now."""
        with self._lock:
            if question in self._known:
                return self._known[question]
            mark = mark_of(question) if self._told else ""
            told = self._told
        found = told[mark] if mark in told else find()
        with self._lock:
            self._known[question] = found
            while len(self._known) > self._most:
                del self._known[next(iter(self._known))]
        return found

    def answers(self) -> dict[str, Answer]:
        """What is known, by the marks of the questions (`mark_of`): for another process."""
        with self._lock:
            return {mark_of(question): answer for question, answer in self._known.items()}

    def told(self, answers: Mapping[str, Answer]) -> None:
        """Takes `answers` that another process has found, in place of what was taken so before."""
        with self._lock:
            self._told = dict(answers)


class LastOf(Generic[Answer]):
    """The last answers to questions about things themselves, whatever they hold; found by one thread at a time."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._known: list[tuple[tuple[object, ...], Answer]] = []
        self._lock = threading.RLock()

    def answer(self, about: tuple[object, ...], find: Callable[[], Answer]) -> Answer:
        """What is known of these things, or what is found now."""
        with self._lock:
            for things, known in self._known:
                if all(one is other for one, other in zip(things, about, strict=True)):
                    return known
            found = find()
            self._known = [*self._known, (about, found)][-self._most :]
            return found


def mark_of(question: Hashable) -> str:
    """What tells a question apart that consists of texts, numbers and digests, in any process."""
    return hashlib.blake2b(repr(question).encode(), digest_size=16).hexdigest()


def digest_of(*columns: NDArray[Any]) -> bytes:
    """What tells arrays apart by their values and shapes."""
    digest = hashlib.blake2b(digest_size=16)
    for values in columns:
        digest.update(repr((values.shape, values.dtype.str)).encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.digest()
