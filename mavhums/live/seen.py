"""The newest accepted signature of each stream, stored beside the key."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from pathlib import Path

from mavhums.core.errors import MavhumsError
from mavhums.core.files import written_whole

__all__ = ["Seen"]

_LOG = logging.getLogger(__name__)
Stream = tuple[int, int, int]


class Seen:
    """Keeps the accepted time stamps between sessions, so that a replayed recording is never accepted as new.

    Parameters
    ----------
    key
        File of the key; the time stamps are stored beside it, as ``KEY.seen``.
    """

    def __init__(self, key: Path) -> None:
        self._path = key.with_name(f"{key.name}.seen")
        self._saved: dict[Stream, int] = {}
        self._complained = False

    def load(self) -> dict[Stream, int]:
        """Return the newest time stamp by link, system and component; empty if none is stored."""
        try:
            kept = json.loads(self._path.read_text(encoding="ascii"))
            self._saved = {_stream(name): int(ticks) for name, ticks in kept.items()}
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, AttributeError, TypeError) as error:
            _LOG.warning("%s: %s; replays of former sessions cannot be recognised", self._path, error)
            return {}
        return dict(self._saved)

    def save(self, latest: Mapping[Stream, int]) -> None:
        """Store the newest time stamps."""
        if latest == self._saved:
            return
        try:
            with written_whole(self._path) as temporary:
                kept = {"/".join(map(str, stream)): ticks for stream, ticks in latest.items()}
                temporary.write_text(json.dumps(kept), encoding="ascii")
            self._saved = dict(latest)
        except MavhumsError as error:
            if not self._complained:
                _LOG.warning("%s; a replay of this session will not be recognised by the next", error)
            self._complained = True


def _stream(name: str) -> Stream:
    link, system, component = map(int, name.split("/"))
    return link, system, component
