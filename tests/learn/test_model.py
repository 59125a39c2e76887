import hashlib
import json
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import safetensors.numpy
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import mavhums
from mavhums.core.quantities import WINDOW_KEYS
from mavhums.learn import (
    Calibration,
    Card,
    ModelError,
    Network,
    WindowCard,
    WindowNetwork,
    default_model,
    load_model,
    packaged_models,
    save_model,
)
from mavhums.learn import model as model_module

Tensors = dict[str, NDArray[np.generic]]


@pytest.fixture
def path(tmp_path: Path, network: Network, card: Card) -> Path:
    save_model(tmp_path / "test.safetensors", network, card)
    return tmp_path / "test.safetensors"


def write(path: Path, tensors: Tensors, card: str | None) -> None:
    path.write_bytes(safetensors.numpy.save(tensors, metadata={"mavhums.card": card} if card else None))


def test_what_is_saved_is_loaded(
    path: Path, network: Network, card: Card, values: NDArray[np.float64]
) -> None:
    model = load_model(path)
    assert model.card == card
    assert model.network.keys == network.keys
    np.testing.assert_array_equal(model.network.p_emergency(values), network.p_emergency(values))
    assert model.hash == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_model_answers_by_class_and_says_where_it_may_be_asked(path: Path) -> None:
    model = load_model(path)
    assert model.classes == ("normal", "emergency")
    assert model.emergency == 1
    middle = (model.network.minimum + model.network.maximum) / 2
    values = np.zeros((3, 12))
    values[:, [int(key[1:]) - 1 for key in model.keys]] = np.stack([middle, middle + 1e6, middle * np.nan])
    answers = model.classify(values)
    assert answers.inside.tolist() == [True, False, False]
    np.testing.assert_allclose(answers.probabilities[:2].sum(axis=1), 1)
    np.testing.assert_array_equal(answers.probabilities[:, 1], model.network.p_emergency(values))
    assert np.isnan(answers.probabilities[2]).all()


@pytest.mark.parametrize(
    "classes", [("normal",), ("emergency", "normal"), ("normal", "emergency", "jam"), ("emergency", "jam")]
)
def test_other_classes_than_the_network_has_are_no_card(card: Card, classes: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="classes"):
        Card.model_validate(card.model_dump() | {"classes": classes})


def test_the_same_model_gives_the_same_bytes(
    path: Path, tmp_path: Path, network: Network, card: Card
) -> None:
    again = save_model(str(tmp_path / "again"), network, card)
    assert (tmp_path / "again").read_bytes() == path.read_bytes()
    loaded = load_model(path)
    assert save_model(tmp_path / "third", loaded.network, loaded.card).hash == again.hash
    moved = replace(network, b2=network.b2 + 1e-15)
    assert save_model(tmp_path / "other", moved, card).hash != again.hash


def test_the_file_is_safetensors_with_one_metadata_key(path: Path, card: Card) -> None:
    with safetensors.safe_open(path, "numpy") as file:
        metadata = file.metadata()
        assert set(file.keys()) == {"minimum", "maximum", "w1", "b1", "w2", "b2"}
    assert list(metadata) == ["mavhums.card"]
    assert json.loads(metadata["mavhums.card"]) == card.model_dump(mode="json")


def test_a_save_that_fails_leaves_the_old_file_and_nothing_else(
    path: Path, network: Network, card: Card, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = path.read_bytes()

    def fail(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(ModelError, match=r"cannot write .*test\.safetensors: No space left"):
        save_model(path, replace(network, b2=np.zeros(2)), card)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path, network: Network, card: Card) -> None:
    with pytest.raises(ModelError, match=r"cannot write .*absent/model.*name a folder"):
        save_model(tmp_path / "absent" / "model", network, card)


def test_card_and_network_must_agree(tmp_path: Path, network: Network, card: Card) -> None:
    with pytest.raises(ValueError, match="the card names the features"):
        save_model(tmp_path / "model", network, card.model_copy(update={"features": ("V1", "V2", "V3")}))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["absent", "", "nul\0"])
def test_a_missing_file_is_named_with_the_remedy(tmp_path: Path, name: str) -> None:
    with pytest.raises(ModelError, match=r"no readable model file.*mavhums train") as caught:
        load_model(f"{tmp_path}/{name}")
    assert str(tmp_path) in caught.value.problem


@pytest.mark.parametrize("data", [b"", b"not a model", b"\xff" * 64, (2**62).to_bytes(8, "little") + b"{}"])
def test_another_kind_of_file_is_refused(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    with pytest.raises(ModelError, match=r"test\.safetensors: not a whole safetensors file"):
        load_model(path)


def test_a_file_too_large_is_not_taken_into_memory(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate(2**28)
    tracemalloc.start()
    with pytest.raises(ModelError, match="larger than any model"):
        load_model(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**26


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"w3": np.zeros(2)}, "contains other tensors than"),
        ({"w1": np.zeros((3, 4), dtype=np.float32)}, "w1 is not of 64-bit floats"),
        ({"w1": np.zeros((4, 3))}, "w1 has the shape"),
        ({"b2": np.array([0, np.nan])}, "b2 contains a number that is not finite"),
    ],
)
def test_tensors_that_make_no_network_are_refused(
    path: Path, network: Network, card: Card, change: Tensors, message: str
) -> None:
    write(path, {**network.tensors, **change}, card.model_dump_json())
    with pytest.raises(ModelError, match=rf"test\.safetensors: .*{message}"):
        load_model(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "mavhums.model/9"}, "format: .*use the mavhums that wrote it"),
        ({"features": ["V2", "V5", "V99"]}, "'V99' is none of V1"),
        ({"features": []}, "features: "),
        ({"features": ["V2"]}, "1 keys do not name 3 inputs"),
        ({"seed": "three"}, "seed: "),
        ({"pickle": "cos\nsystem"}, "pickle: Extra inputs"),
        ({"metrics": {"accuracy": float("nan")}}, r"metrics\.accuracy: "),
        (None, "has no card"),
        ("{", "card: Invalid JSON"),
        ("[" * 10_000, "card: Invalid JSON"),
        ("[]", "card: "),
    ],
)
def test_cards_that_cannot_be_trusted_are_refused(
    path: Path, network: Network, card: Card, change: dict[str, object] | str | None, message: str
) -> None:
    text = json.dumps(card.model_dump(mode="json") | change) if isinstance(change, dict) else change
    write(path, dict(network.tensors), text)
    with pytest.raises(ModelError, match=rf"test\.safetensors: .*{message}"):
        load_model(path)


@st.composite
def hostile(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """A way to damage a file: some bytes overwritten, the end cut off, something appended."""
    writes = draw(st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 255)), max_size=6))
    cut, tail = draw(st.none() | st.integers(0, 5000)), draw(st.binary(max_size=16))

    def damage(data: bytes) -> bytes:
        damaged = bytearray(data)
        for place, byte in writes:
            damaged[place % len(data)] = byte
        return bytes(damaged[:cut]) + tail

    return damage


@pytest.mark.slow
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damage=hostile())
@example(damage=bytes)
def test_hostile_bytes_give_a_model_or_a_model_error(
    path: Path, network: Network, card: Card, damage: Callable[[bytes], bytes]
) -> None:
    save_model(path, network, card)
    path.write_bytes(damage(path.read_bytes()))
    try:
        model = load_model(path)
    except ModelError as error:
        assert str(path) in error.problem  # noqa: PT017
        assert error.remedy  # noqa: PT017
    else:
        assert all(np.isfinite(tensor).all() for tensor in model.network.tensors.values())
        assert model.hash == hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_packaged_model_is_read_from_the_package(
    path: Path, network: Network, card: Card, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = path.parent / "models"
    monkeypatch.setattr(model_module, "resources", SimpleNamespace(files=lambda name: path.parent))
    with pytest.raises(ModelError, match=r"packaged model .* is missing: reinstall mavhums"):
        default_model()
    folder.mkdir()
    saved = save_model(folder / "paper-instrumented.safetensors", network, card)
    assert default_model().hash == saved.hash


def test_a_calibration_is_kept_and_used(path: Path, network: Network, card: Card) -> None:
    assert load_model(path).probability(0.3) == 0.3
    calibration = Calibration(slope=4.0, intercept=-1.0, event="worn", metrics={"brier_score": 0.1})
    save_model(path, network, card.model_copy(update={"calibration": calibration}))
    model = load_model(path)
    assert model.card.calibration == calibration
    assert model.probability(0.5) == pytest.approx(1 / (1 + np.exp(-1)))
    assert model.keys == network.keys


def test_a_packaged_model_has_a_name_and_a_wrong_name_lists_the_right_ones() -> None:
    assert mavhums.models() == tuple(model.card.name for model in packaged_models())
    for name, model in zip(mavhums.models(), packaged_models(), strict=True):
        assert mavhums.load_model(name).hash == model.hash
    with pytest.raises(ModelError, match=r"paper-ecs: .*no packaged model: name one of") as caught:
        load_model("paper-ecs")
    assert all(name in caught.value.remedy for name in mavhums.models())


def test_the_packaged_models_are_small_and_ask_for_less_and_less() -> None:
    models = packaged_models()
    assert [model.card.name for model in models] == ["paper-instrumented", "paper-without-load", "paper-esc"]
    assert models[0].hash == default_model().hash
    rich, without_load, esc = (set(model.keys) for model in models)
    assert rich & {"V11", "V12"}
    assert not without_load & {"V11", "V12"}
    assert esc <= {"V1", *(f"V{k}" for k in range(4, 11))}
    assert all(model.card.calibration is not None for model in models)
    folder = Path(str(files("mavhums.learn") / "models"))
    assert sum(file.stat().st_size for file in folder.glob("*.safetensors")) < 50_000  # two networks each


@given(slope=st.floats(-1e308, 1e308), intercept=st.floats(-1e308, 1e308), share=st.floats(0, 1))
def test_any_calibration_gives_a_probability(slope: float, intercept: float, share: float) -> None:
    assert 0.0 <= Calibration(slope=slope, intercept=intercept).probability(share) <= 1.0


@pytest.fixture
def window() -> WindowNetwork:
    random = np.random.default_rng(5)
    shapes = {"w1": (2, 3), "b1": (3,), "w2": (3, 3), "b2": (3,)}
    weights = {name: random.normal(size=shape) for name, shape in shapes.items()}
    return WindowNetwork(keys=("V5 way", "V4|V5"), minimum=np.zeros(2), maximum=np.ones(2), **weights)


@pytest.fixture
def with_window(card: Card) -> Card:
    own = WindowCard(
        features=("V5 way", "V4|V5"),
        classes=("normal", "friction_emergency", "winding_resistance"),
        decides_at=0.9,
        confusion={"normal": {"normal": 3, "abstained": 1}},
        selection=card.selection,
    )
    return card.model_copy(update={"window": own})


def test_both_networks_of_a_model_are_loaded(
    tmp_path: Path, network: Network, with_window: Card, window: WindowNetwork
) -> None:
    saved = save_model(tmp_path / "both", network, with_window, window)
    model = load_model(tmp_path / "both")
    assert (model.hash, model.card) == (saved.hash, with_window)
    assert model.window_classes == ("normal", "friction_emergency", "winding_resistance")
    assert with_window.window is not None
    assert model.window_level == with_window.window.decides_at
    assert model.classes == ("normal", "emergency")
    features = np.full((3, len(WINDOW_KEYS)), 0.5)
    features[1, WINDOW_KEYS.index("V5 way")] = 5.0
    features[2, WINDOW_KEYS.index("V4|V5")] = np.nan
    answers = model.classify_windows(features)
    np.testing.assert_array_equal(answers.probabilities, window.probabilities(features))
    np.testing.assert_allclose(answers.probabilities[:2].sum(axis=1), 1.0)
    assert answers.inside.tolist() == [True, False, False]
    assert np.isnan(answers.probabilities[2]).all()


def test_a_model_of_samples_alone_knows_no_windows(path: Path) -> None:
    model = load_model(path)
    assert (model.window, model.window_classes, model.window_level) == (None, (), 1.0)
    with pytest.raises(ValueError, match="no network of windows"):
        model.classify_windows(np.zeros((1, len(WINDOW_KEYS))))


def test_a_card_and_its_network_of_windows_must_agree(
    tmp_path: Path, network: Network, card: Card, with_window: Card, window: WindowNetwork
) -> None:
    others = replace(window, keys=("V5 rms", "V4|V5"))
    for said, other in ((with_window, None), (card, window), (with_window, others)):
        with pytest.raises(ValueError, match="features of windows"):
            save_model(tmp_path / "model", network, said, other)
    assert not list(tmp_path.iterdir())
    tensors: Tensors = {f"window.{name}": tensor for name, tensor in window.tensors.items()}
    write(tmp_path / "half", dict(network.tensors), with_window.model_dump_json())
    with pytest.raises(ModelError, match="contains other tensors"):
        load_model(tmp_path / "half")
    tensors["window.w2"], tensors["window.b2"] = tensors["window.w2"][:, :2], tensors["window.b2"][:2]
    write(tmp_path / "two", tensors | dict(network.tensors), with_window.model_dump_json())
    with pytest.raises(ModelError, match="3 classes do not name 2 outputs"):
        load_model(tmp_path / "two")
