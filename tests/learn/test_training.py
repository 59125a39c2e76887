from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, column
from mavhums.learn import (
    Scheme,
    TrainingOptions,
    Vectors,
    load_model,
    save_model,
    select_features,
    train_network,
)
from mavhums.learn.chain import select_columns
from mavhums.learn.trainer import Trained, train_networks

Flights = Callable[..., tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.int64]]]
pytestmark = pytest.mark.usefixtures("small_wrapper")
PAIRS = Scheme(select="pairwise", r2=0.9, vectors=None, networks=2, hidden=(3,))
FEW = TrainingOptions(0, scheme=PAIRS)


@pytest.fixture
def trained_on(monkeypatch: pytest.MonkeyPatch) -> Callable[..., NDArray[np.bool_]]:
    """Which of these samples the networks to choose from were given."""
    calls: list[NDArray[np.float64]] = []

    def spy(hidden: Any, seeds: Any, vectors: Vectors, *more: Any, **options: Any) -> Trained:
        calls.append(vectors.features)
        return train_networks(hidden, seeds, vectors, *more, **options)

    def used(values: NDArray[np.float64]) -> NDArray[np.bool_]:
        seen = {row.tobytes() for row in calls[0]}
        return np.array([row.tobytes() in seen for row in np.ascontiguousarray(values)])

    monkeypatch.setattr("mavhums.learn.training.train_networks", spy)
    return used


def test_selects_one_quantity_of_each_group(flights: Flights) -> None:
    values, emergency, _ = flights(0.2, 1.0)
    selection = select_features(values, emergency, scheme=PAIRS)
    assert ("V1", "V2", "V3") in selection.groups
    for linear in ({"V5", "V8"}, {"V7", "V10"}):
        assert any(linear <= set(group) for group in selection.groups)
    assert sorted(key for group in selection.groups for key in group) == sorted(KEYS)
    assert selection.chi_square["V5"] == pytest.approx(selection.chi_square["V8"])
    assert selection.chi_square["V5"] > selection.chi_square["V1"]
    assert all(0 <= p <= 1 for p in selection.p_values.values())
    for group in selection.groups:
        best = max(group, key=lambda key: selection.chi_square[key])
        assert [key for key in group if key in selection.selected] == [best]


def test_selects_only_among_the_keys_given(flights: Flights) -> None:
    values, emergency, _ = flights(0.2, 1.0)
    values[:, column("V11")] = np.nan
    selection = select_features(values, emergency, keys=("V5", "V8", "V10"), scheme=PAIRS)
    assert selection.groups == (("V5", "V8"), ("V10",))
    assert set(selection.chi_square) == {"V5", "V8", "V10"}


def test_the_network_classifies_flights_it_never_saw(flights: Flights) -> None:
    result = train_network(*flights(0.2, 1.0), FEW)
    values, emergency, _ = flights(0.25, 0.3, 0.9, 0.95)
    assert ((result.network.p_emergency(values) > 0.5) == emergency).mean() > 0.9
    assert result.network.inside(values).mean() > 0.9
    assert set(result.network.keys) <= set(result.selection.selected)
    assert result.training_accuracy > 0.9


@pytest.mark.slow
def test_whole_flights_are_held_out_where_there_are_enough(
    flights: Flights, trained_on: Callable[..., Any]
) -> None:
    values, emergency, numbers = flights(0.2, 0.25, 0.3, 0.9, 1.0, 0.95)
    result = train_network(values, emergency, numbers * 7 + 3, FEW)
    assert result.validation == "flights"
    columns = [column(key) for key in result.network.keys]
    used = trained_on(values[:, columns])
    per_flight = np.array([used[numbers == number].mean() for number in range(6)])
    assert set(per_flight) == {0.0, 1.0}
    assert per_flight[:3].sum() == per_flight[3:].sum() == 2
    right = (result.network.p_emergency(values) > 0.5) == emergency
    assert result.validation_accuracy == pytest.approx(right[~used].mean())
    assert result.training_accuracy == pytest.approx(right[used].mean())
    np.testing.assert_array_equal(result.network.minimum, values[used][:, columns].min(axis=0))


def test_with_one_flight_of_each_class_whole_blocks_of_time_are_held_out(
    flights: Flights, trained_on: Callable[..., Any]
) -> None:
    values, emergency, numbers = flights(0.2, 1.0)
    result = train_network(values, emergency, numbers, FEW)
    assert result.validation == "blocks"
    used = trained_on(values[:, [column(key) for key in result.network.keys]])
    per_block = used.reshape(2, 12, -1).mean(axis=2)
    assert set(per_block.ravel()) == {0.0, 1.0}
    assert per_block.sum(axis=1).tolist() == [9, 9]


def test_selection_does_not_see_what_is_held_out(flights: Flights, monkeypatch: pytest.MonkeyPatch) -> None:
    rows: list[int] = []

    def spy(table: NDArray[np.float64], *given: Any) -> Any:
        rows.append(len(table))
        return select_columns(table, *given)

    monkeypatch.setattr("mavhums.learn.chain.select_columns", spy)
    train_network(*flights(0.2, 0.25, 0.9, 1.0), FEW)
    assert rows == [480]


@pytest.mark.slow
def test_the_network_of_the_least_loss_held_out_is_chosen(
    flights: Flights, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Trained] = []

    def spy(*data: Any, **options: Any) -> Trained:
        found = train_networks(*data, **options)
        # The more accurate has the larger loss.
        order = found.validation_loss.argsort().argsort() / len(found.networks)
        made.append(replace(found, validation_accuracy=order))
        return made[-1]

    monkeypatch.setattr("mavhums.learn.training.train_networks", spy)
    scheme = replace(PAIRS, networks=5, hidden=(1, 2, 3, 4))
    result = train_network(*flights(0.3, 0.45, 0.55, 0.7), TrainingOptions(1, scheme=scheme))
    [found] = made
    place = int(np.argmin(found.validation_loss))
    assert found.validation_accuracy[place] == 0.0
    np.testing.assert_array_equal(result.network.w1, found.networks[place].w1)
    assert result.chosen == result.candidates[place]
    assert {candidate.hidden for candidate in result.candidates} == {1, 2, 3, 4}


def test_each_stage_is_reported_and_every_report_is_on_the_card(flights: Flights) -> None:
    said: list[str] = []
    scheme = Scheme(vectors=100, networks=3, hidden=(2,))
    options = TrainingOptions(0, scheme=scheme, report=said.append)
    result = train_network(*flights(0.2, 0.25, 0.9, 1.0), options)
    stages = [line.split(":")[0] for line in said if not line.startswith(" ")]
    assert stages == ["chi-square", "filter", "thinning", "wrapper", "networks"]
    found = result.selection
    assert said[:-1] == found.stage_lines(result.network.keys)
    dropped = {each.quantity for each in found.excluded}
    assert {"V8", "V10"} <= dropped  # the same signals as V5 and V7 in other units
    assert dropped.isdisjoint(found.selected)
    assert all(each.r2 >= 0.99 and each.expression.startswith(each.quantity) for each in found.excluded)
    assert found.thinned is not None
    assert (found.thinned.offered, found.thinned.kept) == (480, 100)
    assert found.wrapped is not None
    assert found.wrapped.tried == found.wrapped.possible == 2 ** len(found.selected) - 1


@pytest.mark.slow
def test_the_wrapper_finds_the_one_quantity_that_decides() -> None:
    random, numbers = np.random.default_rng(0), np.repeat(np.arange(8), 60)
    values = random.normal(size=(480, 12))
    emergency = numbers >= 4
    values[:, column("V9")] += 4 * emergency
    for select in ("exhaustive", "genetic", "algorithm-1"):
        scheme = Scheme(select=select, networks=1, hidden=(4,), vectors=None)
        options = TrainingOptions(1, ("V3", "V5", "V9", "V11"), scheme)
        result = train_network(values, emergency, numbers, options)
        assert "V9" in result.network.keys
        assert result.validation_accuracy > 0.9
    options = TrainingOptions(1, scheme=replace(scheme, select="none"))
    whole = train_network(values, emergency, numbers, options)
    assert whole.network.keys == KEYS
    assert whole.selection.wrapped is None


def test_other_elementary_functions_find_other_dependences(flights: Flights) -> None:
    values, emergency, _ = flights(0.2, 1.0)
    values[:, column("V9")] = np.abs(values[:, column("V5")])
    keys = ("V5", "V9", "V11")
    plain = select_features(values, emergency, keys=keys, scheme=Scheme(order=1))
    bent = select_features(values, emergency, keys=keys, scheme=Scheme(functions=("x", "abs"), order=1))
    assert "V9" in plain.selected
    assert [(each.quantity, each.expression) for each in bent.excluded] == [("V9", "V9 = 1·|V5|")]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"functions": ("x", "log")}, "no elementary function 'log'.*name some of x, abs"),
        ({"functions": ()}, "no elementary function"),
        ({"select": "best"}, "no selection 'best'.*algorithm-1"),
        *(({name: 0}, "out of range") for name in ("order", "vectors", "networks")),
        ({"hidden": ()}, "out of range"),
        ({"r2": 1.5}, "out of range"),
    ],
)
def test_a_scheme_that_is_none_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(MavhumsError, match=message):
        Scheme(**change)


def test_too_large_a_basis_is_refused_with_a_remedy(flights: Flights) -> None:
    values, emergency, _ = flights(0.2, 1.0)
    with pytest.raises(MavhumsError, match="more than 2000: name fewer --functions or a lower --order"):
        select_features(values, emergency, scheme=Scheme(order=6))


def test_the_card_says_how_the_network_came_to_be(flights: Flights, tmp_path: Path) -> None:
    result = train_network(*flights(0.2, 1.0), FEW)
    given = {"name": "x", "airframe": "paper", "tier": "instrumented", "command": "mavhums train"}
    card = result.card(**given, conditions={"flights": 2})
    assert card.model_dump(include=set(given)) == given
    assert card.features == result.network.keys
    assert card.conditions == {"networks": 2, "hidden": 3, "validation": "blocks", "flights": 2}
    accuracies = ("training_accuracy", "validation_accuracy")
    assert card.metrics == {name: getattr(result, name) for name in accuracies}
    assert card.seed == 0
    assert set(card.versions) == {"mavhums", "numpy", "scikit-learn", "scipy", "torch", "instructions"}
    saved = save_model(tmp_path / "model", result.network, card)
    assert load_model(tmp_path / "model").card == saved.card


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": np.zeros((480, 3))}, r"values must have the shape \(n, 12\)"),
        ({"emergency": np.zeros(480)}, "emergency must be one boolean for each sample"),
        ({"emergency": np.zeros(479, dtype=bool)}, "emergency must be one boolean"),
        ({"flights": np.zeros(3)}, "flights must be one number for each sample"),
        ({"emergency": np.zeros(480, dtype=bool)}, "each class needs enough samples"),
        ({"options": replace(FEW, keys=("V5", "V0"))}, "not in tuple"),
    ],
)
def test_refuses_data_that_cannot_be_learned_from(
    flights: Flights, change: dict[str, Any], message: str
) -> None:
    values, emergency, numbers = flights(0.2, 1.0)
    data: dict[str, Any] = {
        "values": values,
        "emergency": emergency,
        "flights": numbers,
        "options": FEW,
    }
    with pytest.raises(ValueError, match=message):
        train_network(**data | change)


def test_a_quantity_with_gaps_is_named(flights: Flights) -> None:
    values, emergency, numbers = flights(0.2, 1.0)
    values[17, column("V9")] = np.nan
    with pytest.raises(ValueError, match="V9 is not finite throughout"):
        train_network(values, emergency, numbers, FEW)
    keys = tuple(key for key in KEYS if key != "V9")
    assert "V9" not in train_network(values, emergency, numbers, replace(FEW, keys=keys)).network.keys


@pytest.mark.slow
def test_weights_move_the_boundary_and_must_be_positive(flights: Callable[..., Any]) -> None:
    values, emergency, numbers = flights(0.2, 0.25, 0.9, 1.0)
    one = TrainingOptions(0, scheme=replace(PAIRS, networks=1))
    plain = train_network(values, emergency, numbers, one)
    alike = train_network(values, emergency, numbers, one, weights=np.full(len(values), 3.0))
    heavy = train_network(values, emergency, numbers, one, weights=np.where(emergency, 50.0, 1.0))
    mean = [result.network.p_emergency(values).mean() for result in (plain, alike, heavy)]
    assert mean[1] == pytest.approx(mean[0], abs=1e-3)
    assert mean[2] > mean[0]
    for weights in (np.zeros(len(values)), np.ones(3)):
        with pytest.raises(ValueError, match="weights must be one positive number"):
            train_network(values, emergency, numbers, one, weights=weights)
