"""A page of the studio in a real browser, in which no error and no request elsewhere goes unseen."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

_SECONDS = 30.0
_PAUSE = 0.02
SHOWN = "[...document.querySelectorAll('.cell:not([hidden])')]"


@dataclass
class Browsed:
    """A page that is open: playwright's `page`, and what a test asks of it."""

    page: Any

    def read(self, expression: str) -> Any:
        """The value of a JavaScript expression."""
        return self.page.evaluate(f"() => {{ return {expression}; }}")

    def until(self, expression: str, seconds: float = _SECONDS) -> Any:
        """Wait until an expression is true; its value. (Pages forbid what playwright's own waiting evaluates.)"""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if value := self.page.evaluate(f"() => {{ try {{ return {expression}; }} catch {{ return null; }} }}"):
                return value
            time.sleep(_PAUSE)
        raise AssertionError(f"it never became true that {expression}")

    def ready(self) -> None:
        """Wait until the gallery shows finished pictures."""
        self.until(f"{SHOWN}.length > 0 && {SHOWN}.every((cell) => cell.dataset.drawn === 'fine')")

    def count(self) -> int:
        """How many designs the gallery says that it shows."""
        return int(self.read("document.querySelector('.count').dataset.count"))

    def rows(self) -> list[int]:
        """The rows of the designs that are shown, in their order."""
        return self.read(f"{SHOWN}.sort((a, b) => a.ariaPosInSet - b.ariaPosInSet).map((cell) => +cell.dataset.row)")


@contextlib.contextmanager
def browsed(
    chromium: Any, address: str, *, width: int = 1280, height: int = 800, theme: str = "dark", allowed: str = ""
) -> Iterator[Browsed]:
    """A page at an address; at the end, AssertionError if it complained or asked anything of another host.

    Args:
        chromium: playwright's browser.
        address: what to open.
        width: of the window, pixels.
        height: likewise.
        theme: that the system prefers, "dark" or "light".
        allowed: console errors that contain this text are expected.
    """
    context = chromium.new_context(viewport={"width": width, "height": height}, color_scheme=theme)
    page = context.new_page()
    home = urlsplit(address).netloc
    seen: list[str] = []

    def told(message: Any) -> None:
        if message.type in ("error", "warning") and not (allowed and allowed in message.text):
            seen.append(f"{message.type}: {message.text}")

    def asked(request: Any) -> None:
        parts = urlsplit(request.url)
        if parts.scheme not in ("blob", "data") and parts.netloc != home:
            seen.append(f"asked elsewhere: {request.url}")

    page.on("console", told)
    page.on("pageerror", lambda error: seen.append(f"error: {error}"))
    page.on("request", asked)
    try:
        page.goto(address)
        yield Browsed(page)
    finally:
        context.close()
    assert not seen, "\n".join(seen)
