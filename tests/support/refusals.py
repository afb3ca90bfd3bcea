"""What an action is refused with, so that a test can say that it is not refused."""

from __future__ import annotations

from collections.abc import Callable

from autotune.core.errors import AutotuneError


def refusal(act: Callable[[], object]) -> str:
    """The sentence that an action is refused with; "" where it is done."""
    try:
        act()
    except AutotuneError as error:
        return str(error) or type(error).__name__
    return ""
