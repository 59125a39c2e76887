"""What each stage of the paper's scheme (its figure 1) kept and dropped, and why, as the card tells it."""

from __future__ import annotations

from typing import Literal

from mavhums.core.models import Contract

__all__ = ["Exclusion", "Selection", "Thinned", "Wrapped"]


class Exclusion(Contract):
    """A quantity that Algorithm 1 explains by others.

    Attributes
    ----------
    quantity
        Its key.
    r2
        R² of the regression.
    expression
        The regression as a formula.
    """

    quantity: str
    r2: float
    expression: str


class Thinned(Contract):
    """Vectors before and after those that resemble others were removed."""

    offered: int
    kept: int


class Wrapped(Contract):
    """The search of the subset of quantities whose networks are best.

    Attributes
    ----------
    search
        All subsets, or some of them by a genetic algorithm.
    tried, possible
        Number of subsets scored, and of all.
    accuracy
        Accuracy of the best subset's networks on the samples held out, within [0, 1].
    accuracy_of_all
        The same with all quantities that were searched.
    """

    search: Literal["exhaustive", "genetic"]
    tried: int
    possible: int
    accuracy: float
    accuracy_of_all: float


class Selection(Contract):
    """Result of the stages from the quantities to a network's inputs (paper, sections 2 and 3).

    Attributes
    ----------
    chi_square
        Statistic of each quantity, by key.
    p_values
        Of those statistics, by key.
    groups
        Keys that explain one another; a constant quantity is in none.
    selected
        The quantities that the filter kept, in the order V1…V12. The wrapper chooses the inputs of
        the network among them.
    filter
        Description of the filter that formed the groups.
    excluded
        The quantities that Algorithm 1 excluded, in the order of their exclusion.
    thinned, wrapped
        Results of the later stages; None for a stage that was left out.
    """

    chi_square: dict[str, float]
    p_values: dict[str, float]
    groups: tuple[tuple[str, ...], ...]
    selected: tuple[str, ...]
    filter: str = ""
    excluded: tuple[Exclusion, ...] = ()
    thinned: Thinned | None = None
    wrapped: Wrapped | None = None

    def told(self, inputs: tuple[str, ...] = ()) -> list[str]:
        """Return a line for each stage.

        Parameters
        ----------
        inputs
            The network's inputs, which the wrapper chose; it is told only with them.

        Examples
        --------
        >>> found = Selection(
        ...     chi_square={"V5": 90.0, "V8": 80.0}, p_values={"V5": 0.0, "V8": 1e-9},
        ...     groups=(("V5", "V8"),), selected=("V5",), filter="R² ≥ 0.99",
        ...     excluded=(Exclusion(quantity="V8", r2=0.9999, expression="V8 = 0.02·V5"),),
        ... )
        >>> for line in found.told():
        ...     print(line)
        chi-square: V5 90 (p 0), V8 80 (p 1e-09)
        filter: R² ≥ 0.99; keeps V5
          drops V8 = 0.02·V5 (R² 0.99990)
        """
        ranked = sorted(self.chi_square.items(), key=lambda item: -item[1])
        of = (f"{key} {score:.4g} (p {self.p_values.get(key, 0):.1g})" for key, score in ranked)
        lines = [f"chi-square: {', '.join(of)}"]
        if self.filter:
            lines.append(f"filter: {self.filter}; keeps {' '.join(self.selected)}")
            lines += [f"  drops {each.expression} (R² {each.r2:.5f})" for each in self.excluded]
            silent = {key for key in self.chi_square if not any(key in group for group in self.groups)}
            lines += [f"  drops {key}: constant" for key in sorted(silent)]
            known = silent | {each.quantity for each in self.excluded} | set(self.selected)
            for group in self.groups:
                dropped = [key for key in group if key not in known]
                kept = [key for key in group if key in self.selected]
                lines += [f"  drops {' '.join(dropped)}: explained by {' '.join(kept)}"] if dropped else []
        if self.thinned:
            lines.append(f"thinning: {self.thinned.kept} of {self.thinned.offered} vectors represent all")
        if self.wrapped and inputs:
            lines.append(self._wrapper(self.wrapped, inputs))
        return lines

    def _wrapper(self, wrapped: Wrapped, inputs: tuple[str, ...]) -> str:
        dropped = " ".join(key for key in self.selected if key not in inputs)
        kept = f"keeps {' '.join(inputs)}{f', drops {dropped}' if dropped else ''}"
        return (
            f"wrapper: {wrapped.tried} of {wrapped.possible} subsets tried ({wrapped.search}); {kept}: "
            f"{100 * wrapped.accuracy:.2f} % of the samples held out, with all "
            f"{100 * wrapped.accuracy_of_all:.2f} %"
        )
