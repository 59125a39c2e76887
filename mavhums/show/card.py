"""The blocks of a model card."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from mavhums.core.models import Contract
from mavhums.core.quantities import QUANTITIES
from mavhums.learn import Card, Model
from mavhums.show.blocks import NOTHING, Block, Cell, Column, Facts, Note, Table

_APART: Final = ("name", "selection", "calibration", "window")


def card_blocks(model: Model) -> Iterator[Block]:
    """Yield a model's purpose, training, metrics, and what each stage of the selection kept and dropped."""
    card = model.card
    hidden = {"hidden neurons": model.network.tensors["w1"].shape[1], "sha256": model.hash}
    yield from _sections(card.name, card, hidden)
    if card.calibration is not None:
        title = "Calibration of a window's votes, on flights of their own"
        formula = f"1 / (1 + exp(−({card.calibration.slope:g}·s {card.calibration.intercept:+g})))"
        yield from _sections(title, card.calibration, {"probability for a share s of votes": formula})
    yield from _selection(card)
    if card.window is not None:
        yield from _sections("Network of windows", card.window, {})
        yield Note(card.window.selection.stage_lines(card.window.features))


def _sections(title: str, part: Contract, more: Mapping[str, object]) -> Iterator[Facts]:
    """Yield the facts of a part of a card, then those of each group of them under its name."""
    fields = {name: getattr(part, name) for name in type(part).model_fields if name not in _APART}
    groups = {name: value for name, value in fields.items() if isinstance(value, Mapping) and value}
    single = {name: value for name, value in fields.items() if name not in groups and value not in (None, {})}
    yield Facts(title, _pairs({**single, **more}))
    for name, group in groups.items():
        yield Facts(f"{title}: {_words(name)}", _pairs(group))


def _pairs(values: Mapping[str, object]) -> list[tuple[str, str]]:
    return [(_words(name), _value(value)) for name, value in values.items()]


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{_words(name)} {_value(part)}" for name, part in value.items())
    if isinstance(value, tuple | list):
        return ", ".join(_words(_value(part)) for part in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _selection(card: Card) -> Iterator[Block]:
    selection = card.selection
    groups = {key: k for k, group in enumerate(selection.groups, 1) for key in group}
    rows: list[list[Cell]] = []
    for key, name, unit in sorted(QUANTITIES, key=lambda each: -selection.chi_square.get(each[0], 0)):
        if key in selection.chi_square:
            p = selection.p_values.get(key)
            chi_square, p_value = f"{selection.chi_square[key]:.4g}", NOTHING if p is None else f"{p:.2g}"
            rows.append(
                [key, name, unit, chi_square, p_value, str(groups.get(key, NOTHING)), _fate(card, key)]
            )
    columns = [
        *map(Column, ("quantity", "name", "unit")),
        *(Column(title, "figure") for title in ("chi-square", "p", "group")),
        Column("use"),
    ]
    yield Table("Stages 1 and 2: chi-square, and groups that explain one another", columns, rows)
    yield Note(selection.stage_lines(card.features)[1:])


def _fate(card: Card, key: str) -> str:
    if key in card.features:
        return "input"
    return "wrapper drops it" if key in card.selection.selected else NOTHING


def _words(name: str) -> str:
    return name.replace("_", " ")
