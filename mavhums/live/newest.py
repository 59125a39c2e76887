"""The newest signature that was ever accepted, kept beside the key."""

from __future__ import annotations

import logging
from pathlib import Path

from mavhums.errors import MavhumsError
from mavhums.files import written_whole

__all__ = ["NewestKept"]

_LOG = logging.getLogger(__name__)


class NewestKept:
    """Remembers between sessions how new signatures must be, so that an old session is no new one.

    Parameters
    ----------
    key
        File of the key; what is remembered lies beside it, as ``KEY.newest``.
    """

    def __init__(self, key: Path) -> None:
        self._path = key.with_name(f"{key.name}.newest")
        self._saved = 0
        self._complained = False

    def load(self) -> int:
        """Return the time stamp of the newest frame of former sessions; 0 if that is not known."""
        try:
            self._saved = int(self._path.read_text(encoding="ascii"))
        except FileNotFoundError:
            return 0
        except (OSError, ValueError) as error:
            _LOG.warning("%s: %s; signatures of former sessions cannot be told apart", self._path, error)
            return 0
        return self._saved

    def save(self, newest: int) -> None:
        """Remember a time stamp."""
        if newest <= self._saved:
            return
        try:
            with written_whole(self._path) as temporary:
                temporary.write_text(str(newest), encoding="ascii")
            self._saved = newest
        except MavhumsError as error:
            if not self._complained:
                _LOG.warning("%s; a replay of this session will not be recognised by the next", error)
            self._complained = True
