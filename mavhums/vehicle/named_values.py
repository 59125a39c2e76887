"""Counts named values and debug arrays, which scripts and autopilots send under their own names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from mavhums.log import Table
from mavhums.log.base.tables import text_of

__all__ = ["NAMED_MESSAGES", "NamedValues"]

_NAMES = {
    "NAMED_VALUE_FLOAT": "name",
    "NAMED_VALUE_INT": "name",
    "DEBUG_VECT": "name",
    "DEBUG_FLOAT_ARRAY": "name",
    "NVF": "Name",
    "debug_key_value": "key",
    "debug_vect": "name",
    "debug_array": "name",
}
NAMED_MESSAGES = frozenset(_NAMES)
_MOST = 1000


class NamedValues:
    """Counts named values by vehicle, message and name.

    Attributes
    ----------
    counts
        Counts by (system, message, name); only the first thousand names of a log are counted.
    """

    def __init__(self) -> None:
        self.counts: Counter[tuple[int, str, str]] = Counter()

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the named values in these messages."""
        for message, field in _NAMES.items():
            table = tables.get(message)
            if table is None or not table.holds_text(field):
                continue
            for system in np.unique(table.system).tolist():
                names, counts = np.unique(table[field][table.system == system], return_counts=True)
                for name, count in zip(names.tolist(), counts.tolist(), strict=True):
                    key = (int(system), message, text_of(name))
                    if key in self.counts or len(self.counts) < _MOST:
                        self.counts[key] += int(count)
