"""HTTP connections that are closed where the head of a request does not arrive."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD = 5.0
"""Seconds for the head of a request, which a browser sends at once; the time that an idle connection is kept, too."""


class ImpatientProtocol(H11Protocol):
    """Closes a connection whose request has not named its address, and so the token, after some seconds.

    Without this, anybody on this machine could hold all connections that the server accepts.
    """

    _closing: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait."""
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Wait for the rest of a head, counted from its first byte."""
        super().data_received(data)
        self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        super().connection_lost(exc)
        if self._closing is not None:
            self._closing.cancel()

    def _wait(self) -> None:
        if self.conn.their_state is not h11.IDLE:
            if self._closing is not None:
                self._closing.cancel()
            self._closing = None
        elif self._closing is None:
            self._closing = self.loop.call_later(HEAD, self._close)

    def _close(self) -> None:
        with suppress(RuntimeError):  # the loop has ended
            self.transport.close()
