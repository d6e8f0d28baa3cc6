"""Setting the receiver of a recording up, and up again when it was reset."""

from __future__ import annotations

import threading
from pathlib import Path

from automap.io.atomic import write_json
from pipeline.record.clock import HostClock
from pipeline.record.ports import BAUDS
from pipeline.record.reader import Event
from pipeline.record.streams import GnssStream
from pipeline.record.ublox import Outcome, Receiver, RefusedError, Setup, SilentError

BEFORE = "ublox_before.json"
"""What undoes the settings of a recording's receiver."""
_PATIENCE_NS = 15_000_000_000


class ReceiverSetup:
    """Talks with one receiver while it is recorded; ``setup`` None leaves its settings alone.

    ``outcome`` is that of the first settings, which ``restore`` undoes.
    """

    def __init__(
        self,
        folder: Path,
        stream: GnssStream,
        setup: Setup | None,
        clock: HostClock,
        event: Event,
        halt: threading.Event,
    ) -> None:
        self.outcome: Outcome | None = None
        self._folder = folder
        self._stream = stream
        self._setup = setup
        self._clock = clock
        self._event = event
        self._halt = halt
        self._configured_ns = 0
        self._lock = threading.RLock()  # one conversation at a time

    def _receiver(self) -> Receiver:
        return Receiver(self._stream.exchange, self._stream.reader.native_usb)

    def configure(self) -> None:
        """Set what is wished and tell what came of it."""
        if self._setup is None:
            return
        self._configured_ns = self._clock()
        try:
            with self._lock:
                outcome = self._receiver().configure(self._setup, self._stream.reader.set_baud)
        except SilentError:
            if not self._halt.is_set():
                self._event(
                    "warning",
                    "gnss: the receiver does not answer, so it stays as it is; is its line for "
                    "sending connected?",
                )
            return
        except RefusedError as error:
            self._event("warning", f"gnss: {error}; the receiver stays as it is")
            return
        if self.outcome is None:
            self.outcome = outcome
            self._keep_before(outcome)
        self._event("note", f"gnss: {outcome.version}: {', '.join(outcome.done) or 'nothing set'}")
        for text in outcome.refused:
            self._event("warning", f"gnss: {text}")

    def _keep_before(self, outcome: Outcome) -> None:
        """Put what undoes the settings beside the drive: a recorder that is killed cannot."""
        reader = self._stream.reader
        write_json(
            self._folder / BEFORE,
            {
                "port": reader.device,
                "baud": reader.baud,
                "receiver": str(outcome.version),
                "messages": [message.hex() for message in outcome.before],
            },
        )

    def restore(self) -> None:
        """Undo the first settings."""
        if self.outcome is None:
            return
        with self._lock:
            failed = self._receiver().restore(self.outcome.before, self._stream.reader.set_baud)
        for text in failed:
            self._event("warning", f"gnss: {text}")
        if not failed:
            self._event("note", "gnss: the receiver does again what it did before")

    def recover(self) -> None:
        """A receiver that was reset has lost its settings, perhaps its line rate too."""
        stream, now = self._stream, self._clock()
        if not stream.reader.connected or self._halt.is_set():
            return
        if stream.watch.unreadable() and not stream.watch.understood(now):
            self._find_baud()
        elif (
            self.outcome is not None
            and now - self._configured_ns > _PATIENCE_NS
            and stream.forgot(now)
        ):
            self._event("warning", "gnss: the receiver forgot its settings (a reset?); set again")
            self.configure()

    def _find_baud(self) -> None:
        stream, reader = self._stream, self._stream.reader
        before = reader.baud
        for baud in (before, *[b for b in BAUDS if b != before]):
            reader.set_baud(baud)
            heard = stream.messages.messages
            for _ in range(12):
                if self._halt.wait(0.1) or stream.messages.messages > heard:
                    break
            if self._halt.is_set():
                return
            if stream.messages.messages > heard:
                if baud != before:
                    self._event("warning", f"gnss: the receiver speaks at {baud} baud now")
                    self.configure()
                return
        reader.set_baud(before)
