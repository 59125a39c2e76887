"""The paper's method: models from flights, and studies that repeat published results beside ours.

>>> from mavhums.paper import write_study
>>> write_study("report", quick=True)  # doctest: +SKIP
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.startup import lazy_exports

if TYPE_CHECKING:
    from mavhums.paper.real import write_real_study as write_real_study
    from mavhums.paper.study import write_study as write_study

_OPTIONAL = ("matplotlib", "pygad", "sklearn", "torch")

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {"real": "write_real_study", "study": "write_study"},
    missing=dict.fromkeys(_OPTIONAL, ("the study", "all")),
)
