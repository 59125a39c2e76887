"""The cyclic collector rests while objects are made, and does not visit them at once afterwards."""

from __future__ import annotations

import gc
import subprocess
import sys

import pytest

from mavhums.core.startup import no_collection


def is_among(wanted: object, objects: list[object]) -> bool:
    return any(each is wanted for each in objects)


def test_new_objects_are_old_ones_afterwards() -> None:
    with no_collection():
        assert not gc.isenabled()
        made: list[object] = [[]]
    assert gc.isenabled()
    assert is_among(made, gc.get_objects(generation=2))
    assert gc.get_freeze_count() == 0


def test_frozen_objects_stay_frozen() -> None:
    gc.freeze()
    frozen = gc.get_freeze_count()
    try:
        with no_collection():
            made: list[object] = [[]]
        assert gc.get_freeze_count() >= frozen - 100
        assert not is_among(made, gc.get_objects(generation=2))
    finally:
        gc.unfreeze()


def test_a_collector_that_was_off_stays_off() -> None:
    gc.disable()
    try:
        with pytest.raises(ValueError, match="inside"), no_collection():
            raise ValueError("inside")
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_the_command_line_collects_no_lasting_object() -> None:
    code = """
import atexit, contextlib, gc, sys
import mavhums.cli.main as command_line
sys.argv = ["mavhums", "--version"]
with contextlib.suppress(SystemExit):
    command_line.main()
collections = []
gc.callbacks.append(lambda phase, info: collections.append(phase))
lasting = [[] for _ in range(100_000)]
print(len(collections))
ended = [[[]] for _ in range(100_000)]
print(len(collections) > 0)
atexit._run_exitfuncs()
print(gc.get_freeze_count() > len(lasting))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert run.stdout.split()[-3:] == ["0", "True", "True"], run.stdout
